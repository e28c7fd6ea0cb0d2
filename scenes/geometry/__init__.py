"""Surfaces as triangles: shapes, patches, placement, refinement, normals.

shapes        Built-in shapes of size one about the origin; meshes placed, refined, and smoothed
tessellation  Triangles of Bezier patches (`.bpt`), within a chord tolerance, without cracks
"""

#: Names in the order in which messages list them; scene files are checked by them before NumPy is
#: loaded.
SHAPE_NAMES = ("box", "square", "sphere", "cylinder", "cone", "torus")
