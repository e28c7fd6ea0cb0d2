"""The lines through an aperture.

lines      Pixel to line: the definition of truth (CONVENTIONS.md, "Frames"; paper, sections 3 and
5) triangles  Triangles' planes, distances from them, and which side the viewer sees, decided
exactly
"""
