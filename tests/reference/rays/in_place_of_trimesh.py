"""Plugin of pytest: `ExactIntersector` in place of both of trimesh's classes for rays."""

from trimesh.ray import ray_pyembree, ray_triangle

from xfrustum.rays import ExactIntersector

ray_pyembree.RayMeshIntersector = ExactIntersector
ray_triangle.RayMeshIntersector = ExactIntersector
