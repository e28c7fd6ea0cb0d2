"""Conformance run of ray casters, one function each; run from this folder.

    xfrustum conformance run --python casting:embree
    xfrustum conformance run --python casting:by_trimesh     # pip install rtree
    xfrustum conformance run --python casting:by_mitsuba
    xfrustum conformance run --python casting:mitsuba_sensor

Embree and Mitsuba round to float32; trimesh's own search uses NumPy in double precision.
`mitsuba_sensor` uses Mitsuba's sensors: the two offset cameras of a case, as `camera --for mitsuba`
writes them.
"""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import trimesh
from lines import asked_for, check_float32, check_numbers, check_two_cameras, film, lines, numbers


def _mesh(folder: Path) -> trimesh.Trimesh:
    scene = np.load(folder / "scene.npz")
    if not len(scene["faces"]):
        raise NotImplementedError("a scene without triangles")
    return trimesh.Trimesh(scene["vertices"], scene["faces"], process=False)


def embree(folder: Path, asked: dict[str, Any], hogel: tuple[int, int]) -> Any:
    """Return the numbers of a hogel by Embree, through trimesh and embreex."""
    from trimesh.ray.ray_pyembree import RayMeshIntersector  # noqa: PLC0415

    origins, directions = lines(asked, hogel)
    check_float32(np.load(folder / "scene.npz"), origins)
    first = RayMeshIntersector(_mesh(folder), scale_to_box=False).intersects_first(
        origins, directions
    )
    return numbers(folder, asked, hogel, first)


def by_trimesh(folder: Path, asked: dict[str, Any], hogel: tuple[int, int]) -> Any:
    """Return the numbers of a hogel by trimesh's own search in NumPy."""
    from trimesh.ray.ray_triangle import RayMeshIntersector  # noqa: PLC0415

    origins, directions = lines(asked, hogel)
    first = RayMeshIntersector(_mesh(folder)).intersects_first(origins, directions)
    return numbers(folder, asked, hogel, first)


def by_mitsuba(folder: Path, asked: dict[str, Any], hogel: tuple[int, int]) -> Any:
    """Return the numbers of a hogel by Mitsuba 3."""
    import mitsuba as mi  # noqa: PLC0415

    mi.set_variant("llvm_ad_rgb")
    origins, directions = lines(asked, hogel)
    check_float32(np.load(folder / "scene.npz"), origins)
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    ray = mi.Ray3f(
        mi.Point3f(origins.T.astype(np.float32)),
        mi.Vector3f((directions / length).T.astype(np.float32)),
    )
    return numbers(folder, asked, hogel, _first(folder, ray))


def mitsuba_sensor(folder: Path, asked: dict[str, Any], hogel: tuple[int, int]) -> Any:
    """Return the numbers of a hogel by Mitsuba's sensors; lines of C* begin at their far ends."""
    import mitsuba as mi  # noqa: PLC0415

    from xfrustum.raster.description import mitsuba  # noqa: PLC0415
    from xfrustum.scenes import InputError  # noqa: PLC0415

    mi.set_variant("llvm_ad_rgb")
    scene = np.load(folder / "scene.npz")
    cameras = json.loads((folder / "cameras.json").read_text())
    check_numbers(asked)
    check_two_cameras(scene, asked, cameras)
    cameras["frustum"] = SimpleNamespace(**cameras["frustum"])
    try:
        sensors = mitsuba(cameras)["sensors"]
    except InputError as told:
        raise NotImplementedError(str(told)) from told
    u, v = film(asked)
    shown = np.zeros(u.size, np.int64)
    for one in sensors:
        if tuple(one["aperture"]) != tuple(hogel):
            continue
        sensor = mi.load_dict(
            one["sensor"] | {"to_world": mi.ScalarTransform4f(one["sensor"]["to_world"])}
        )
        down = v if one["rows_reversed"] else -v
        place = mi.Point2f(((u + 1) / 2).ravel(), ((down + 1) / 2).ravel())
        ray, _ = sensor.sample_ray(0.0, 0.5, place, mi.Point2f(0.5))
        if one["wins"] == "farthest":
            ray = mi.Ray3f(ray.o + ray.maxt * ray.d, -ray.d, ray.maxt, 0.0, ray.wavelengths)
        first = _first(folder, ray)
        shown = np.where(first >= 0, first + 1, shown)
    return asked_for(scene, asked, shown.reshape(u.shape))


def _first(folder: Path, ray: Any) -> Any:
    """Return the number (N,) of the first triangle that Mitsuba meets along rays, -1 for none."""
    import mitsuba as mi  # noqa: PLC0415

    part = _mesh(folder)
    mesh = mi.Mesh("all", len(part.vertices), len(part.faces))
    params = mi.traverse(mesh)
    params["vertex_positions"] = mi.Float(part.vertices.ravel().astype(np.float32))
    params["faces"] = mi.UInt32(part.faces.ravel().astype(np.uint32))
    params.update()
    found = mi.load_dict({"type": "scene", "mesh": mesh}).ray_intersect_preliminary(ray)
    return np.where(np.array(found.is_valid()), np.array(found.prim_index).astype(np.int64), -1)
