"""Rays of pixels made by a Dr.Jit kernel, and traced in it where Mitsuba traces on the processors."""

from __future__ import annotations

from typing import Any

import drjit as dr

from xfrustum.reference.devices.arithmetic import cross, difference, dot
from xfrustum.reference.devices.arithmetic_jit import JIT, Float32, Int32, on_device
from xfrustum.reference.devices.strict_jit import strict_arithmetic
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.lines.lines_jit import interleaved, pixel_directions, read_interleaved
from xfrustum.reference.tracers.embree import EmbreeTracer
from xfrustum.reference.tracers.entry import entries
from xfrustum.reference.tracers.mitsuba_tracer import MitsubaTracer
from xfrustum.scenes.arrays import Numbers
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.scenes.model.scene import Scene


def traced_in_kernel(tracer: MitsubaTracer, scene: Scene, pencil: Pencil, rows: range) -> Numbers:
    """Return what `proposals.proposed` returns of one pencil, all in one kernel."""
    with strict_arithmetic():
        direction = pixel_directions(pencil, rows)
        origin, along = _rays(tracer.scale, scene, pencil, direction)
        hits = Int32(tracer.first_along(origin, along))
        return _within_reach(scene, pencil, hits, direction).reshape(len(rows), -1)


def traced_by_embree(tracer: EmbreeTracer, scene: Scene, pencil: Pencil, rows: range) -> Numbers:
    """Return what `proposals.proposed` returns of one pencil, with rays that a kernel has made."""
    size = len(rows) * pencil.resolution[0]
    with strict_arithmetic():
        rays = _rays(tracer.scale, scene, pencil, pixel_directions(pencil, rows))
        origins, directions = (interleaved(vectors, size) for vectors in rays)
        dr.eval(origins, directions)
    # Embree traces outside of the lock that other kernels wait for.
    hits = tracer.first_along(*(read_interleaved(vectors, (size, 3)) for vectors in (origins, directions)))
    with strict_arithmetic():
        direction = pixel_directions(pencil, rows)
        return _within_reach(scene, pencil, on_device(hits), direction).reshape(len(rows), -1)


def _rays(scale: float, scene: Scene, pencil: Pencil, direction: list[Any]) -> tuple[list[Any], list[Any]]:
    """Return origins and directions of rays in single precision: the very ones that NumPy makes."""
    (first, by) = JIT.constants((pencil.s_range[0], scale))
    origin = entries(JIT, scene, JIT.constants(pencil.center), direction, first)
    return [Float32(part * by) for part in origin], [Float32(part) for part in direction]


def _within_reach(scene: Scene, pencil: Pencil, hits: Any, direction: list[Any]) -> Numbers:
    """Return hits, `NOTHING` in place of those beyond the reach; the tracer was given no far end."""
    met = hits != NOTHING
    corners = JIT.table(scene.faces)(dr.maximum(hits, 0))
    vertices = JIT.table(scene.vertices)
    origin, *others = (vertices(corner) for corner in corners)
    normal = cross(*(difference(other, origin) for other in others))
    offset = dot(normal, difference(origin, JIT.constants(pencil.center)))
    (reach,) = JIT.constants(pencil.s_range[1:])
    beyond = offset / dot(normal, direction) > reach
    numbers: Numbers = dr.select(met & ~beyond, hits, Int32(NOTHING)).numpy()
    return numbers
