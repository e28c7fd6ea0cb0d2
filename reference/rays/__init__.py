"""Exact first surfaces along rays, and a class with trimesh's interface.

* walk: broad phase, a tree of bounding boxes and the boxes that a ray may pass before a limit
* filter: narrow phase, in doubles with rounding bounds and in integers
* rays: first surfaces and all surfaces along rays
* intersector: trimesh's interface, and location of points inside, on or outside a surface
"""
