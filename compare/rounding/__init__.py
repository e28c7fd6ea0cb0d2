"""How exactly a rasterizer can know edges, depths and positions.

clip_seams  Lines along which clipping may split a triangle: edges that no mesh has
depth       How exactly does a depth buffer know the depth of a triangle at a pixel?
edges       How near is a pixel's center to an edge that rounding may move across it?
positions   How exactly a rasterizer in float32 can know the surface point that it draws
"""
