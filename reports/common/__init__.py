"""Parts of all reports: outputs, records, templates, times and provenance.

figure_style           Style of every figure: distinct colors, readable axes
junit                  Test cases as JUnit XML
outputs                Whole files or none: probed before the work, written aside, renamed
pictures               Encoded pictures of images and of their errors
provenance             Versions, machine, and commands that repeat a result
records                Records as JSON and as tables, by the fields of dataclasses
templates_environment  The only place that fills in templates: HTML pages, SVG, XML, Markdown
timing                 Medians of repetitions with intervals, and races in turns
"""
