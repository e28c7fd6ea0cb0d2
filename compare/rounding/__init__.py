"""The bounds of a rasterizer's rounding, and the classifier of causes (edge, order, lost).

causes      The one classifier of causes: edge, order, lost, or unexplained depth       How exactly
a depth buffer knows the depth of a triangle at a pixel edges       Edges that rounding may move
across a pixel's center: of the mesh, of cuts, seams of clipping fingerprints  What a fingerprint
says of its device, and whether a model holds for what it drew planes      How exactly a device
knows what it interpolates over a triangle: depth, or 1 / w positions   How exactly a rasterizer in
float32 can know the surface point that it draws triangles   Cameras as a rasterizer draws with
them, triangles on their films, and the pixels that show them
"""
