"""Closed forms of every error, from the truth's geometry alone.

band_limiting  Closed form of band limiting: how far a hogel's area blurs, and how many points stand for the
              area
chain         The chain from the truth to the raster, one thing changed per link (docs/method.md, "The
              error budget")
contours      The contours of a true image, where one surface ends before another, with normals and lengths
depth         Closed form of the smallest separation of two surfaces that a depth buffer still orders
displacement  Closed form of displacement: where each point is drawn, from the truth alone
eye_error     The error of the bent eye vector at an image's surface points, predicted and measured
eye_vector    The line on which a surface point is seen, truly and by its camera (docs/method.md, "Light")
outside       Closed form of the pixels that show what belongs outside the film, from what the truth shows at
              its border
predict       Closed forms of every error, from the scene's geometry alone (docs/method.md)
shading       The effect of a bent eye vector on highlights and reflections, to first order (docs/method.md,
              "Light")
share         Closed form of the share of pixels that a depth buffer shows wrongly, from the truth's
              geometry alone
silhouettes   Closed form of the surface error that displacement causes along silhouettes
stacks        Surfaces one behind the other that a depth buffer has to tell apart
"""
