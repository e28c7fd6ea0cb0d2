"""Closed forms of every error, from the truth's geometry alone.

band_limiting  How far a hogel's area blurs, and how many points stand for the area
chain          The chain from the truth to the raster, one thing changed per link (docs/method.md)
contours       The contours of a true image, where one surface ends before another, with normals and lengths
depth          The smallest separation of two surfaces that a depth buffer still orders
displacement   Where each point is drawn
eye_vector     The line on which a surface point is seen, and what its bend does to highlights
predict        All errors of some settings together, and what shows what belongs outside the film
share          The share of pixels that a depth buffer shows wrongly
silhouettes    The surface error that displacement causes along silhouettes
"""
