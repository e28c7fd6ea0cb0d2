"""Verification of foreign renderers: sources, verdict, sentences, baselines.

| module | holds |
| --- | --- |
| `request` | options of the user, and the validated request |
| `verification` | the procedure from images to the verification |
| `sources` | images: files, a layout, a program, or a function |
| `verdict` | the record, its pictures, JSON object, page and JUnit file |
| `words` | sentences about defects, measures and verdicts |
| `jobs` | verification by several processes |
| `baseline` | comparison with accepted measures |
"""
