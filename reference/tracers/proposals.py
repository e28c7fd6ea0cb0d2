"""The image that the tracer alone would have shown: the second opinion on every pixel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module

import numpy as np

from xfrustum.reference.certify.certify import FirstSurfaces
from xfrustum.reference.certify.processors import compiled
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.lines.planes import plane_places, triangle_normals
from xfrustum.reference.tracers.embree import EmbreeTracer
from xfrustum.reference.tracers.entry import ray_origins
from xfrustum.reference.tracers.mitsuba_tracer import MitsubaTracer
from xfrustum.reference.tracers.tracer import Tracer
from xfrustum.scenes.arrays import Bytes, Floats, Mask, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook.shown import Brief

OPINION_PIXELS = 1 << 18
"""Pixels that a second opinion asks for at once. This bounds the memory, some 200 bytes each."""


def proposed(tracer: Tracer, scene: Scene, pencils: Sequence[Pencil], rows: range) -> Numbers:
    """Trace each pixel's line once, from the viewer's end through the aperture to the back, in one call.

    Parameters
    ----------
    tracer
        Tracer of the scene, in float32.
    scene
        Scene with the triangles.
    pencils
        Crossed frusta, at least one, all of the same resolution.
    rows
        Rows of each image.

    Returns
    -------
    numbers
        (P, rows, W) triangle numbers, `NOTHING` where there is no hit or the first lies beyond the reach.
    """
    if compiled() and len(scene.faces) and (isinstance(tracer, EmbreeTracer) or _on_llvm(tracer)):
        return np.stack([_compiled(tracer, scene, pencil, rows) for pencil in pencils])
    some = slice(rows.start, rows.stop)
    lines = [pencil.directions(some).reshape(-1, 3) for pencil in pencils]
    origins = [
        ray_origins(scene, np.asarray(pencil.center), directions, pencil.s_range[0])
        for pencil, directions in zip(pencils, lines, strict=True)
    ]
    hits = tracer.first_hits(np.concatenate(origins), np.concatenate(lines)).reshape(len(pencils), -1)
    for pencil, directions, own in zip(pencils, lines, hits, strict=True):
        # The tracer was given no far end: the planes of the triangles tell which hits lie beyond the reach.
        met = own != NOTHING
        beyond = _first_places(scene, pencil, own[met], directions[met]) > pencil.s_range[1]
        own[met] = np.where(beyond, NOTHING, own[met])
    return hits.reshape(len(pencils), len(rows), -1)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SecondOpinion(Brief):
    """The pixels at which a tracer contradicts decisions; calling it asks the tracer.

    Attributes
    ----------
    tracer
        Function that returns the tracer of the scene.
    scene
        Scene with the triangles.
    pencil, rows
        Lines of the image, and those of its rows that were decided.
    triangle, certainty
        (rows, W) triangle numbers that were decided, and their `Certainty`.
    """

    tracer: Callable[[], Tracer]
    scene: Scene
    pencil: Pencil
    rows: range
    triangle: Numbers
    certainty: Bytes

    def __call__(self) -> Mask:
        """Return the pixels (rows, W) that are no tie and at which the tracer shows another triangle."""
        overruled = np.empty(self.triangle.shape, dtype=np.bool_)
        size = max(1, OPINION_PIXELS // self.pencil.resolution[0])
        for start in range(0, len(self.rows), size):
            part = slice(start, start + size)
            (number,) = proposed(self.tracer(), self.scene, [self.pencil], self.rows[part])
            overruled[part] = (number != self.triangle[part]) & (self.certainty[part] != Certainty.TIE)
        return overruled


def _on_llvm(tracer: Tracer) -> bool:
    return isinstance(tracer, MitsubaTracer) and tracer.on_llvm


def _compiled(tracer: Tracer, scene: Scene, pencil: Pencil, rows: range) -> Numbers:
    # Imported only here, because Dr.Jit's arrays need the LLVM that `compiled` has chosen.
    module = import_module("xfrustum.reference.tracers.proposals_jit")
    trace = module.traced_by_embree if isinstance(tracer, EmbreeTracer) else module.traced_in_kernel
    numbers: Numbers = trace(tracer, scene, pencil, rows)
    return numbers


def uncertified(tracer: Tracer, scene: Scene, pencil: Pencil, rows: range) -> FirstSurfaces:
    """Return a tracer's proposal in the form of a decision; places are those of the triangles' planes."""
    (triangle,) = proposed(tracer, scene, [pencil], rows)
    directions = pencil.directions(slice(rows.start, rows.stop))
    s = np.full(triangle.shape, np.nan)
    met = triangle != NOTHING
    s[met] = _first_places(scene, pencil, triangle[met], directions[met])
    return FirstSurfaces(
        triangle=triangle,
        s=s,
        certainty=np.full(triangle.shape, Certainty.UNEXAMINED, dtype=np.uint8),
        companions=np.zeros((0, 3), dtype=np.int64),
    )


def _first_places(scene: Scene, pencil: Pencil, triangle: Numbers, directions: Floats) -> Floats:
    """Return s at which lines (N, 3) of a pencil meet the planes of the triangles with numbers (N,)."""
    corners = scene.triangles[triangle]
    return plane_places(corners, triangle_normals(corners), np.asarray(pencil.center), directions)
