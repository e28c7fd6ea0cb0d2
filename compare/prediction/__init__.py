"""Closed forms of every error, from the truth's geometry alone.

chain         The chain from the truth to the raster, one thing changed per link (docs/method.md, "The
              error budget")
contours      Where in a true image does one surface end before another? Contours, with normals and lengths
depth         Closed form of the smallest separation of two surfaces that a depth buffer still orders
displacement  Closed form of displacement: where each point is drawn, from the truth alone
eye_error     What the bent eye vector costs at an image's surface points: predicted and measured
eye_vector    Which way a surface point is looked at: truly, and by the camera that draws it
              (docs/method.md, "Light")
predict       Closed forms of every error, from the scene's geometry alone (docs/method.md)
shading       What a bent eye vector does to highlights and reflections, to first order (docs/method.md,
              "Light")
share         Closed form of the share of pixels that a depth buffer shows wrongly, from the truth's
              geometry alone
silhouettes   Closed form of the surface error that displacement causes along silhouettes
stacks        Surfaces one behind the other, as far as depth buffers have to tell them apart
"""
