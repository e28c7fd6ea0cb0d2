"""What the tracer alone would have shown: the second opinion on every pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.cone import Floats
from xfrustum.reference.lines import Pencil
from xfrustum.reference.tracer import Tracer
from xfrustum.scenes.hogel_image import NOTHING


def proposed(tracer: Tracer, triangles: Floats, pencil: Pencil, rows: range) -> NDArray[np.int32]:
    """Trace each pixel's line once, from the viewer's end through the aperture to the back.

    Parameters
    ----------
    tracer
        In float32.
    triangles
        (F, 3, 3) corners in scene units.
    pencil
        A crossed frustum.
    rows
        Rows of the image.

    Returns
    -------
    (rows, W) triangle numbers, `NOTHING` where the first hit lies beyond the reach or there is none.
    """
    directions = pencil.directions(slice(rows.start, rows.stop))
    origins = np.asarray(pencil.center) + pencil.s_range[0] * directions
    hits = tracer.first_hits(origins.reshape(-1, 3), directions.reshape(-1, 3)).reshape(directions.shape[:2])
    # Tracers know no far end here; whether a first hit lies beyond it is plain geometry.
    met = hits != NOTHING
    corners = triangles[hits[met]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    slope = np.einsum("ij,ij->i", normals, directions[met])
    offset = np.einsum("ij,ij->i", normals, corners[:, 0] - np.asarray(pencil.center))
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = offset / slope > pencil.s_range[1]
    hits[met] = np.where(beyond, NOTHING, hits[met])
    return hits
