"""Mitsuba's bare intersection of rays that lie on the device: what a certified truth is raced against."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from xfrustum.reference.devices.dr_jit import backend
from xfrustum.reference.devices.packets import in_packets
from xfrustum.reference.tracers.mitsuba_tracer import robust_scene
from xfrustum.reference.tracers.tracer import unit_scale
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene


def bare_intersection(scene: Scene, origins: Floats, directions: Floats) -> Callable[[], object]:
    """Return what intersects some rays with a scene each time it is called, and waits until that is done.

    Parameters
    ----------
    scene
        At least one triangle.
    origins, directions
        (N, 3) each, scene units.
    """
    mi, dr = backend().mitsuba, backend().drjit
    scale = unit_scale(scene.vertices)
    loaded = robust_scene(scene, scale)
    o, d = (in_packets(v.T, np.float32).reshape(3, -1) for v in (origins * scale, directions))
    ray = mi.Ray3f(mi.Point3f(o), mi.Vector3f(d))
    # Rays in NumPy's own memory would be traced from there; the bare rate begins on the device.
    dr.make_opaque(ray)
    dr.sync_thread()

    def trace() -> object:
        met = loaded.ray_intersect_preliminary(ray, coherent=True)
        dr.eval(met)
        dr.sync_thread()
        return met

    return trace
