"""The bounds of a rasterizer's rounding, and the classifier of causes (edge, order, lost).

cameras     A camera as a rasterizer draws with it: exact lines, and how exactly the device follows them
causes      The one classifier of causes: edge, order, lost, or unexplained
clip_seams  Lines along which clipping may split a triangle: edges that no mesh has
depth       How exactly a depth buffer knows the depth of a triangle at a pixel
edges       Edges that rounding may move across a pixel's center, with the far cut, which depends on the
            mapping
positions   How exactly a rasterizer in float32 can know the surface point that it draws
triangles   Triangles on the films of the cameras that may have drawn them, and the pixels that show them
"""
