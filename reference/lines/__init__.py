"""The lines through an aperture, and triangles as these lines see them.

boxes_jit  The boxes of pixels in which triangles may show, compiled by Dr.Jit: one lane for each triangle
cone       Triangles as the cones that they span about the point all lines pass through
corners_jit
           The corners of a scene's triangles on Dr.Jit's device, put there once for all pencils
facing     Which side of a triangle the viewer sees, decided exactly: what culling leaves out (paper,
           section 3)
grid       Lines that have no common point: those of pixels that are taken from many hogels, by columns and
           rows
lines      Pixel to line: the definition of truth (CONVENTIONS.md, "Frames"; paper, sections 3 and 5)
lines_jit  Lines of pixels and vectors of pixels on Dr.Jit, one lane for each pixel
pairs      Pixels and the triangles that their lines meet, or may meet
planes     Where lines meet the planes of triangles, in double precision and without bounds of its rounding
"""
