"""One hogel of a foreign renderer judged; `xfrustum.compare.run` judges our own rasterizer's.

conformance  By a case of the conformance suite: which wrong pixels are accepted, and why judged
By what was asked for: wrong pixels, displacement, colors and causes outlines     Outlines of
pictures in any shading: where they run, which are missing, how far they moved
"""
