"""Ray casters through the suite, one function for each; run in this folder.

    xfrustum conformance run --python casting:embree
    xfrustum conformance run --python casting:by_trimesh
    xfrustum conformance run --python casting:by_mitsuba

Embree and Mitsuba round to float32; trimesh's own search is in NumPy, in doubles.
"""

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from lines import lines, numbers


def _mesh(folder: Path) -> trimesh.Trimesh:
    scene = np.load(folder / "scene.npz")
    if not len(scene["faces"]):
        raise NotImplementedError("a scene without triangles")
    return trimesh.Trimesh(scene["vertices"], scene["faces"], process=False)


def embree(folder: Path, asked: dict[str, Any], hogel: tuple[int, int]) -> Any:
    """Ask Embree, by trimesh and embreex, for the first triangle along each line."""
    from trimesh.ray.ray_pyembree import RayMeshIntersector  # noqa: PLC0415

    origins, directions = lines(asked, hogel)
    first = RayMeshIntersector(_mesh(folder), scale_to_box=False).intersects_first(origins, directions)
    return numbers(folder, asked, hogel, first)


def by_trimesh(folder: Path, asked: dict[str, Any], hogel: tuple[int, int]) -> Any:
    """Ask trimesh's own search, in NumPy."""
    from trimesh.ray.ray_triangle import RayMeshIntersector  # noqa: PLC0415

    origins, directions = lines(asked, hogel)
    first = RayMeshIntersector(_mesh(folder)).intersects_first(origins, directions)
    return numbers(folder, asked, hogel, first)


def by_mitsuba(folder: Path, asked: dict[str, Any], hogel: tuple[int, int]) -> Any:
    """Ask Mitsuba 3 for the first triangle along each line."""
    import mitsuba as mi  # noqa: PLC0415

    mi.set_variant("llvm_ad_rgb")
    origins, directions = lines(asked, hogel)
    part = _mesh(folder)
    mesh = mi.Mesh("all", len(part.vertices), len(part.faces))
    params = mi.traverse(mesh)
    params["vertex_positions"] = mi.Float(part.vertices.ravel().astype(np.float32))
    params["faces"] = mi.UInt32(part.faces.ravel().astype(np.uint32))
    params.update()
    scene = mi.load_dict({"type": "scene", "mesh": mesh})
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    ray = mi.Ray3f(
        mi.Point3f(origins.T.astype(np.float32)), mi.Vector3f((directions / length).T.astype(np.float32))
    )
    found = scene.ray_intersect_preliminary(ray)
    hit = np.array(found.is_valid()).astype(bool)
    first = np.where(hit, np.array(found.prim_index).astype(np.int64), -1)
    return numbers(folder, asked, hogel, first)
