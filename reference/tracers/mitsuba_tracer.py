"""Mitsuba as tracer: a second, independent proposal, on all processors or a GPU.

The scalar variant, which is the fallback without LLVM, makes a call from Python for every ray: its
answers are the same, but it is some twenty times slower.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from xfrustum.reference.devices.arithmetic import Coordinates
from xfrustum.reference.devices.dr_jit import backend
from xfrustum.reference.devices.packets import in_packets
from xfrustum.reference.tracers.tracer import unit_scale
from xfrustum.scenes.arrays import Floats, Indices, Numbers, Singles
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.scenes.model.scene import Scene

RAYS_PER_CALL = 1 << 20
"""Rays of one call. This bounds the memory, some 100 bytes per ray."""


def mitsuba_versions() -> dict[str, str]:
    """Return name and version of the tracer, its variant and its LLVM, for reports."""
    return backend().versions


class MitsubaTracer:
    """A scene's acceleration structure in Mitsuba, built once; robust where Embree builds it.

    Parameters
    ----------
    scene
        Scene whose triangle numbers are returned.

    Attributes
    ----------
    scale
        Factor by which lengths are multiplied before they are rounded to float32.
    """

    name = "mitsuba"

    def __init__(self, scene: Scene) -> None:
        self._backend = backend()
        mi = self._backend.mitsuba
        # The classes are kept, so that this tracer outlives a change of Mitsuba's variant.
        self._ray, self._point, self._vector = mi.Ray3f, mi.Point3f, mi.Vector3f
        self._int, self._float = mi.Int, mi.Float
        self.scale = unit_scale(scene.vertices)
        self._scene = None
        if len(scene.faces):
            self._scene = robust_scene(scene, self.scale)

    @property
    def versions(self) -> dict[str, str]:
        """Name and version of the tracer, its variant and its LLVM, for reports."""
        return self._backend.versions

    def first_hits(self, origins: Floats, directions: Floats) -> Numbers:
        """Return the first triangle of each ray, (N,); see `Tracer.first_hits`."""
        hits = np.full(len(origins), NOTHING, dtype=np.int32)
        if self._scene is None:
            return hits
        trace = self._one_by_one if self._backend.scalar else self._together
        for start in range(0, len(origins), RAYS_PER_CALL):
            part = slice(start, start + RAYS_PER_CALL)
            hits[part] = trace(
                (origins[part] * self.scale).astype(np.float32), directions[part].astype(np.float32)
            )
        return hits

    @property
    def on_llvm(self) -> bool:
        """Whether rays are traced in kernels on the processors, as Dr.Jit's arrays of the reference are."""
        return self._scene is not None and self._backend.variant.startswith("llvm")

    def first_along(self, origin: Coordinates, direction: Coordinates) -> Any:
        """Return the first triangle of each ray on Dr.Jit, of which nothing is traced yet.

        Parameters
        ----------
        origin, direction
            Coordinates in single precision; the origins are scaled by `scale`.
        """
        assert self._scene is not None
        ray = self._ray(self._point(*map(self._float, origin)), self._vector(*map(self._float, direction)))
        met = self._scene.ray_intersect_preliminary(ray, coherent=True)
        return self._backend.drjit.select(met.is_valid(), self._int(met.prim_index), NOTHING)

    def _together(self, origins: Singles, directions: Singles) -> Numbers:
        dr = self._backend.drjit
        assert self._scene is not None
        # Dr.Jit's arrays of vectors hold each coordinate in one piece.
        ray = self._ray(self._point(_coordinates(origins)), self._vector(_coordinates(directions)))
        met = self._scene.ray_intersect_preliminary(ray, coherent=True)
        hits: Numbers = dr.select(met.is_valid(), self._int(met.prim_index), NOTHING).numpy()
        return hits

    def _one_by_one(self, origins: Singles, directions: Singles) -> Numbers:
        assert self._scene is not None
        trace = self._scene.ray_intersect_preliminary
        hits = np.full(len(origins), NOTHING, dtype=np.int32)
        # One ray at a time: as Python objects, all rays together would take a hundred times the memory.
        for i in range(len(origins)):
            ray = self._ray(origins[i].tolist(), directions[i].tolist())
            met = trace(ray)
            if met.is_valid():
                hits[i] = met.prim_index
        return hits


def robust_scene(scene: Scene, scale: float) -> Any:
    """Return a `mi.Scene` of all triangles, scaled, in Embree's robust mode where Embree traces."""
    mesh = triangle_mesh("scene", scene.vertices * scale, scene.faces)
    return backend().mitsuba.load_dict(
        {"type": "scene", "embree_use_robust_intersections": True, "mesh": mesh}, optimize=False
    )


def triangle_mesh(name: str, vertices: Floats, faces: Indices, bsdf: Any | None = None) -> Any:
    """Return a `mi.Mesh` whose primitive numbers are the rows of `faces`.

    Parameters
    ----------
    name
        Name of the mesh in Mitsuba.
    vertices, faces
        (V, 3) and (F, 3), F at least 1; Mitsuba keeps the vertices in float32.
    bsdf
        A Mitsuba BSDF; None for Mitsuba's default.
    """
    mi = backend().mitsuba
    properties = mi.Properties()
    if bsdf is not None:
        properties["bsdf"] = bsdf
    mesh = mi.Mesh(name, len(vertices), len(faces), properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = in_packets(vertices, np.float32)
    parameters["faces"] = in_packets(faces, np.uint32)
    parameters.update()
    return mesh


def _coordinates(vectors: Singles) -> Singles:
    return in_packets(vectors.T).reshape(3, -1)
