"""Judgment of foreign hogel images; `xfrustum.compare.run` judges images of our own rasterizer.

| module | holds |
| --- | --- |
| `verdict` | the verdict engine: limits, checks, places of wrong pixels, verdicts on images |
| `judged` | comparison of one image with the image expected from a model |
| `outlines` | outlines of pictures in any shading: positions, gaps, displacement |
| `conformance` | judgment of hogels by cases of the conformance suite |
"""
