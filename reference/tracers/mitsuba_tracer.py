"""Mitsuba as tracer: a second, independent proposal, on all processors or a GPU."""

from collections.abc import Callable
from typing import Any

import numpy as np

from xfrustum.reference.llvm import mitsuba_backend, vector_backend
from xfrustum.reference.memory import padded
from xfrustum.reference.tracers.tracer import unit_scale
from xfrustum.scenes.arrays import Floats, Indices, Numbers, Singles
from xfrustum.scenes.model.images import NOTHING
from xfrustum.scenes.model.scene import Scene

#: rays of one call. This bounds the memory, some 100 bytes per ray.
RAYS_PER_CALL = 1 << 20


def mitsuba_versions() -> dict[str, str]:
    """Return name and version of the tracer, its variant and its LLVM, for reports."""
    return mitsuba_backend().versions


class MitsubaTracer:
    """Acceleration structure of a scene in Mitsuba, robust on Embree; `scale` as in Embree's."""

    name = "mitsuba"

    def __init__(self, scene: Scene) -> None:
        self._backend = vector_backend()
        mi = self._backend.mitsuba
        # The classes are kept, so that this tracer outlives a change of Mitsuba's variant.
        self._ray, self._point, self._vector = mi.Ray3f, mi.Point3f, mi.Vector3f
        self._int = mi.Int
        self.scale = unit_scale(scene.vertices)
        self._scene = robust_scene(scene, self.scale) if len(scene.faces) else None

    def first_hits(self, origins: Floats, directions: Floats) -> Numbers:
        """Return the first triangle of each ray, (N,); see `Tracer.first_hits`."""
        hits = np.full(len(origins), NOTHING, dtype=np.int32)
        if self._scene is None:
            return hits
        dr = self._backend.drjit
        for start in range(0, len(origins), RAYS_PER_CALL):
            part = slice(start, start + RAYS_PER_CALL)
            point = self._point(_coordinates((origins[part] * self.scale).astype(np.float32)))
            ray = self._ray(point, self._vector(_coordinates(directions[part].astype(np.float32))))
            met = self._scene.ray_intersect_preliminary(ray, coherent=True)
            hits[part] = dr.select(met.is_valid(), self._int(met.prim_index), NOTHING).numpy()
        return hits


def robust_scene(scene: Scene, scale: float) -> Any:
    """Return a `mi.Scene` of all triangles, scaled; in robust mode if Mitsuba uses Embree."""
    mesh = triangle_mesh("scene", scene.vertices * scale, scene.faces)
    return mitsuba_backend().mitsuba.load_dict(
        {"type": "scene", "embree_use_robust_intersections": True, "mesh": mesh}, optimize=False
    )


def triangle_mesh(name: str, vertices: Floats, faces: Indices, bsdf: Any | None = None) -> Any:
    """Return a `mi.Mesh` in float32 with primitives in the order of `faces`, at least one."""
    mi = mitsuba_backend().mitsuba
    properties = mi.Properties()
    if bsdf is not None:
        properties["bsdf"] = bsdf
    mesh = mi.Mesh(name, len(vertices), len(faces), properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = padded(vertices, np.float32)
    parameters["faces"] = padded(faces, np.uint32)
    parameters.update()
    return mesh


def bare_intersection(scene: Scene, origins: Floats, directions: Floats) -> Callable[[], object]:
    """Return a function that intersects rays (N, 3) with a scene on the device, synchronously."""
    mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
    scale = unit_scale(scene.vertices)
    loaded = robust_scene(scene, scale)
    ray = mi.Ray3f(mi.Point3f(_coordinates(origins * scale)), mi.Vector3f(_coordinates(directions)))
    # Copy the rays to the device: the measured rate must not include reading NumPy's memory.
    dr.make_opaque(ray)
    dr.sync_thread()

    def trace() -> object:
        met = loaded.ray_intersect_preliminary(ray, coherent=True)
        dr.eval(met)
        dr.sync_thread()
        return met

    return trace


def _coordinates(vectors: Floats | Singles) -> Singles:
    # Dr.Jit's arrays of vectors store each coordinate contiguously.
    rows: Singles = padded(vectors.T, np.float32).reshape(3, -1)
    return rows
