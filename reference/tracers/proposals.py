"""The image that the tracer alone would have shown: the second opinion on every pixel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from xfrustum.reference.certify.certify import FirstSurfaces
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.tracers.entry import ray_origins
from xfrustum.reference.tracers.planes import plane_places
from xfrustum.reference.tracers.tracer import Tracer
from xfrustum.scenes.arrays import Numbers
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty
from xfrustum.scenes.model.scene import Scene


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
        s = plane_places(scene.triangles[own[met]], np.asarray(pencil.center), directions[met])
        own[met] = np.where(s > pencil.s_range[1], NOTHING, own[met])
    return hits.reshape(len(pencils), len(rows), -1)


def uncertified(tracer: Tracer, scene: Scene, pencil: Pencil, rows: range) -> FirstSurfaces:
    """Return a tracer's proposal in the form of a decision; places are those of the triangles' planes."""
    (triangle,) = proposed(tracer, scene, [pencil], rows)
    directions = pencil.directions(slice(rows.start, rows.stop))
    s = np.full(triangle.shape, np.nan)
    met = triangle != NOTHING
    s[met] = plane_places(scene.triangles[triangle[met]], np.asarray(pencil.center), directions[met])
    return FirstSurfaces(
        triangle=triangle,
        s=s,
        certainty=np.full(triangle.shape, Certainty.UNEXAMINED, dtype=np.uint8),
        companions=np.zeros((0, 3), dtype=np.int64),
    )
