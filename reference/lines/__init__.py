"""The lines through an aperture, and triangles as these lines see them.

cone       Triangles as the cones that they span about the point all lines pass through
facing     Which side of a triangle the viewer sees, decided exactly: what culling leaves out (paper,
           section 3)
grid       Lines that have no common point: those of pixels that are taken from many hogels, by columns and
           rows
lines      Pixel to line: the definition of truth (CONVENTIONS.md, "Frames"; paper, sections 3 and 5)
lines_jit  Lines of pixels and vectors of pixels on Dr.Jit, one lane for each pixel
pairs      Pixels and the triangles that their lines meet, or may meet
planes     Where lines meet the planes of triangles, in double precision and without bounds of its rounding
"""
