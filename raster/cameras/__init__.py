"""The two cameras as matrices, their passes, and their depth formats.

cameras        Clip coordinates from scene coordinates, for C and for C* (paper, sections 4 and 5,
               figures 4 to 6)
depth_formats  Depth formats and mappings as the two cameras use them (docs/method.md, "The two cameras")
passes         The passes of an image: its cameras in drawing order, and how OpenGL is set for each
"""
