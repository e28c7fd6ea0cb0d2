"""Diagnosis of a foreign renderer: reading of its pixels, candidate models, and their test.

`diagnosis.diagnose(test_set)` returns the findings. Discrete defects are entries of
`defects.HYPOTHESES`; defects with numbers are groups of
`compare.renderer_model.drawn_model.GROUPS`.

| module | holds |
| --- | --- |
| `diagnosis` | the procedure from images to findings, and the test on all judged hogels |
| `testset` | claims of pixels, and the images by which candidate models are tested |
| `encodings` | readings of stored pixels: encoding, channels, offset, transfer, damage |
| `geometry_fit` | the joint fit of conventions and numbers to the claims |
| `registration` | the fit to pictures without triangle numbers |
| `enumeration` | composition of the halves, films, axes, equivalent models |
| `defects` | records of named defects, in codes and numbers |
"""
