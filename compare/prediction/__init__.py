"""Closed forms of every error, from the truth's geometry alone.

band_limiting  How far a hogel's area blurs, and how many points stand for the area chain
The chain from the truth to the raster, one thing changed per link (docs/method.md) depth
Depth buffers: the smallest separation that they order, and the share that they show wrongly
displacement   Where each point is drawn eye_vector     The line on which a surface point is seen,
and what its bend does to highlights predict        All errors of some settings together, and what
shows what belongs outside the film silhouettes    The surface error that displacement causes along
silhouettes, and the contours of an image
"""
