"""Closed forms of every error, from the truth's geometry alone.

band_limiting  Closed form of band limiting: how far a hogel's area blurs, and how many points stand for the
              area
chain         The chain from the truth to the raster, one thing changed per link (docs/method.md, "The
              error budget")
contours      The contours of a true image, where one surface ends before another, with normals and lengths
depth         Closed form of the smallest separation of two surfaces that a depth buffer still orders
displacement  Closed form of displacement: where each point is drawn, from the truth alone
eye_vector    The line on which a surface point is seen, and what its bend does to highlights
outside       Closed form of the pixels that show what belongs outside the film, from what the truth shows at
              its border
predict       Closed forms of every error, from the scene's geometry alone (docs/method.md)
share         Closed form of the share of pixels that a depth buffer shows wrongly, from the truth's
              geometry alone
silhouettes   Closed form of the surface error that displacement causes along silhouettes
"""
