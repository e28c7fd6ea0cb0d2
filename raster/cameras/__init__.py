"""The two cameras as matrices, their passes, and their depth formats.

cameras        Clip coordinates from scene coordinates, for C and for C* (paper, sections 4 and 5,
               figures 4 to 6)
depth_formats  What a depth format and a mapping mean for the two cameras (docs/method.md, "The two
               cameras")
passes         Which cameras draw, in which order, and how OpenGL is set for each
"""
