"""Verification of foreign renderers: sources, verdict, sentences, baselines.

| module | holds |
| --- | --- |
| `verification` | the way from images to the verification |
| `sources` | images: files, a layout, a program, or a function |
| `other_layouts` | layouts in which files may be meant |
| `verdict` | the record, its JSON object, page and JUnit file |
| `words` | sentences about defects, figures and verdicts |
| `worst` | pictures of the worst hogels |
| `jobs` | verification by several processes |
| `baseline` | comparison with accepted measures |
"""
