"""What the tracer alone would have shown: the second opinion on every pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.certify import FirstSurfaces
from xfrustum.reference.entry import ray_origins
from xfrustum.reference.lines import Pencil
from xfrustum.reference.tracer import Tracer
from xfrustum.scenes.hogel_image import NOTHING, Certainty
from xfrustum.scenes.scene import Scene


def proposed(tracer: Tracer, scene: Scene, pencil: Pencil, rows: range) -> NDArray[np.int32]:
    """Trace each pixel's line once, from the viewer's end through the aperture to the back.

    Parameters
    ----------
    tracer
        In float32.
    scene
        What may be met.
    pencil
        A crossed frustum.
    rows
        Rows of the image.

    Returns
    -------
    (rows, W) triangle numbers, `NOTHING` where the first hit lies beyond the reach or there is none.
    """
    center = np.asarray(pencil.center)
    directions = pencil.directions(slice(rows.start, rows.stop)).reshape(-1, 3)
    hits = tracer.first_hits(ray_origins(scene, center, directions, pencil.s_range[0]), directions)
    # Tracers know no far end here; whether a first hit lies beyond it is plain geometry.
    met = hits != NOTHING
    corners = scene.triangles[hits[met]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    slope = np.einsum("ij,ij->i", normals, directions[met])
    offset = np.einsum("ij,ij->i", normals, corners[:, 0] - center)
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = offset / slope > pencil.s_range[1]
    hits[met] = np.where(beyond, NOTHING, hits[met])
    return hits.reshape(len(rows), -1)


def uncertified(tracer: Tracer, scene: Scene, pencil: Pencil, rows: range) -> FirstSurfaces:
    """Return what a tracer proposes as if it were decided: the places are those of the triangles' planes."""
    triangle = proposed(tracer, scene, pencil, rows)
    directions = pencil.directions(slice(rows.start, rows.stop))
    s = np.full(triangle.shape, np.nan)
    met = triangle != NOTHING
    corners = scene.triangles[triangle[met]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    offset = np.einsum("ij,ij->i", normals, corners[:, 0] - np.asarray(pencil.center))
    with np.errstate(divide="ignore", invalid="ignore"):
        s[met] = offset / np.einsum("ij,ij->i", normals, directions[met])
    return FirstSurfaces(
        triangle=triangle,
        s=s,
        certainty=np.full(triangle.shape, Certainty.UNEXAMINED, dtype=np.uint8),
        companions=np.zeros((0, 3), dtype=np.int64),
    )
