"""Bounds of a rasterizer's rounding, and the classifier of causes (edge, order, lost).

causes     Classification of wrong pixels: edge, order, lost, or unexplained; also by direction
depth      Error bounds of depth: interpolated over a triangle, and stored in a buffer
edges      Edges that rounding may move across a pixel's center: mesh edges, cuts, clipping seams
triangles  Cameras of a rasterizer, drawn points in float32, and the pixels of triangles
"""
