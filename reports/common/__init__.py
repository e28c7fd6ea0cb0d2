"""What all reports share: outputs, progress, times, pages, numbers in words.

figure_style           How every figure looks: colors that are told apart, axes that can be read, timings
                       of repetitions
formatting             Numbers as people read them, and words that pages share
geometry               Camera geometries: pivot, fit, offset and cuts of a setting, without its near and its
                       depth buffer
json_ready             Values as JSON takes them: one conversion for everything that is written or embedded
outputs                Outputs that are whole or absent: probed before the work, written aside, renamed
                       at the end
progress               One look for every progress bar
provenance             Versions, machine and scene: what a measurement must carry to be repeated
raster_command         The commands that draw an aperture or the plate with some settings, to be copied
records                Records as tables: columns and their types follow from the fields of a dataclass,
                       not from the data
summaries              What results print with `--json`: each result has a record, and its summary is the
                       record as JSON
templates_environment  The one place where templates are filled in: HTML pages, SVG and Markdown
timing                 Wall seconds per named stage, which `compare` takes, and what repetitions come to
turns                  Pictures that are made in turns until their times are told apart, within a bounded
                       time
"""
