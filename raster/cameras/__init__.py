"""The two cameras as matrices, their passes, and their depth formats.

cameras        The matrices of C and C*, with the step back by near (paper, figures 4 to 6)
depth_formats  Depth formats and mappings as the two cameras use them (docs/method.md, "The two cameras")
description    The cameras for renderers that somebody else writes: as JSON, for glTF and for Mitsuba
passes         The passes of an image: its cameras in drawing order, and how OpenGL is set for each
"""
