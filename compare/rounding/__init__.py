"""Bounds of a rasterizer's rounding, and the classifier of causes (edge, order, lost).

causes     Classification of wrong pixels: edge, order, lost, or unexplained
depth      Error bounds of the depth that a buffer stores for a triangle at a pixel
directions Causes of wrong pixels in images by direction
edges      Edges that rounding may move across a pixel's center: mesh edges, cuts, clipping seams
planes     Error bounds of quantities interpolated over a triangle: depth, or 1 / w
positions  Error bounds of drawn surface points in float32
triangles  Cameras of a rasterizer, triangles on their films, and the pixels that show them
"""
