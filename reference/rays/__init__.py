"""First surfaces along any rays, exactly; a class with trimesh's interface.

* tree: tree of bounding boxes about the triangles, built without recursion
* walk: broad phase, the triangles whose boxes a ray may pass before a limit
* filter: narrow phase in doubles, with bounds of rounding
* integers: decisions of pairs of a ray and a triangle
* rays: first surfaces and all surfaces along rays
* inside: points inside of, on, and outside of a surface
* intersector: trimesh's interface
"""
