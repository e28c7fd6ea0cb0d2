"""Surfaces as triangles: shapes, patches, placement, refinement, normals.

operations    Meshes made from meshes: placed, refined, and smoothed, in double precision
shapes        Built-in shapes of size one about the origin, which `shape = "..."` in a scene file names
tessellation  Bezier patches, and sets of them as triangles: within a chord tolerance, and without cracks
"""

#: Names in the order in which messages list them; scene files are checked by them before NumPy is loaded.
SHAPE_NAMES = ("box", "square", "sphere", "cylinder", "cone", "torus")
