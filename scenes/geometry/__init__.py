"""Surfaces as triangles: shapes, patches, placement, refinement, normals.

bezier        Bezier patches: points, normals and second derivatives of tensor-product surfaces of any
              degrees
placement     Placing a mesh in the scene, in double precision
refine        The same surfaces in more triangles: for results that must not depend on the tessellation
shape_names   The names of the built-in shapes, for the checks of a scene file, which need no arrays
shapes        Built-in shapes of size one about the origin, which `shape = "..."` in a scene file names
smoothing     Vertex normals for meshes that have none: the mean of the faces around each point
tessellation  Sets of Bezier patches as triangles: within a chord tolerance of the surface, and without
              cracks
"""
