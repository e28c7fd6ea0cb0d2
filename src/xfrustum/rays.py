"""Exact rays for any mesh: `mesh.ray = ExactIntersector(mesh)` makes trimesh's ray queries exact.

`ExactIntersector` has the interface of trimesh's own two classes. `first` also returns how certain
each hit is, as an `xfrustum.scenes.Certainty`, and the triangles of ties; `locate_points`
returns a `Location`.
"""

from xfrustum.reference.rays.intersector import ExactIntersector, Location
from xfrustum.reference.rays.rays import FirstHits

__all__ = ["ExactIntersector", "FirstHits", "Location"]
