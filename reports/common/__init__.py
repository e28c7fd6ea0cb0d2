"""Parts of all reports: outputs, records, templates, times and provenance.

outputs                Whole files or none, JSON and its schemas, progress, provenance
pictures               Encoded pictures of images and of their errors
records                Records as JSON and as tables, by the fields of dataclasses
templates_environment  The only place that fills in templates: pages, SVG, JUnit, Markdown
timing                 Medians of repetitions with intervals, and races in turns
"""
