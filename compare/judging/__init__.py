"""Hogels judged: many of the project's own rasterizer, and one of a foreign renderer.

foreign_cameras  The cameras of a foreign renderer, with bounds of rounding for a precision that nobody has
                 stated
judge            Many hogels drawn with several settings each, and judged by their certified truth
judged           One hogel of a foreign renderer, judged by a question: the truth, or what its author declares
outline_shift    Displacement of a picture's outlines by registration, where no pixel names a triangle
"""
