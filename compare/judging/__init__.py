"""Judgment of foreign hogel images; `xfrustum.compare.run` judges our own rasterizer's.

| module | holds |
| --- | --- |
| `verdict` | the verdict engine: limits, checks, places of wrong pixels, verdicts on images |
| `judged` | figures of one image beside the answer of a model |
| `outlines` | outlines of pictures in any shading: course, gaps, displacement |
| `conformance` | cases of the conformance suite |
"""
