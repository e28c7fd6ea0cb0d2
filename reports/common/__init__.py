"""What all reports share: outputs, progress, times, pages, numbers in words.

figure_style           How every figure looks: colors that are told apart, axes that can be read
junit                  Test cases as JUnit XML outputs                Outputs that are whole or
absent: probed before the work, written aside, renamed provenance             What repeats a result:
versions and machine, commands, and what nobody examined records                Records as tables:
columns and their types follow from the fields of a dataclass templates_environment  The one place
where templates are filled in: HTML pages, SVG and Markdown timing                 What repetitions
come to, and races in which all contestants take turns
"""
