"""The lines through an aperture.

* lines: pixel to line, the definition of truth (CONVENTIONS.md, "Frames"; paper, sections 3 and 5)
* triangles: planes of triangles, distances from triangles, and facing, computed exactly
"""
