"""Exact first surfaces along rays, and a class with trimesh's interface.

* tree: tree of bounding boxes about the triangles, built without recursion
* walk: broad phase, triangles whose boxes a ray may pass before a limit
* filter: narrow phase in doubles, with rounding bounds
* integers: decision of ray-triangle pairs in integers
* rays: first surfaces and all surfaces along rays
* inside: location of points inside, on or outside a surface
* intersector: trimesh's interface
"""
