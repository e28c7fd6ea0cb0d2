"""pytest plugin that replaces both ray classes of trimesh by `ExactIntersector`."""

from trimesh.ray import ray_pyembree, ray_triangle

from xfrustum.rays import ExactIntersector

ray_pyembree.RayMeshIntersector = ExactIntersector
ray_triangle.RayMeshIntersector = ExactIntersector
