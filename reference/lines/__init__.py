"""The lines through an aperture.

lines   Pixel to line: the definition of truth (CONVENTIONS.md, "Frames"; paper, sections 3 and 5)
facing  Which side of a triangle the viewer sees, decided exactly: what culling leaves out (paper, section 3)
planes  Planes of triangles and distances from them, in doubles and without bounds of their rounding
"""
