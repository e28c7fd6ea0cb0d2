"""Lines along which clipping may split a triangle: edges that no mesh has.

A renderer that cuts triangles at its film and at its near and far planes draws what is left as several
triangles. Which ones it does not say, but their common sides are diagonals of the polygon that is left.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats


def seams(corners: Floats, pencil: Pencil, shift: tuple[float, float]) -> Floats:
    """Return the diagonals of what clipping leaves of a triangle.

    Parameters
    ----------
    corners
        (3, 3) corners of the triangle, scene units.
    pencil
        The camera's lines, through the sampling points.
    shift
        Distance of sampling points from their pixels' centers, columns and rows; the film's borders are not
        shifted with them.

    Returns
    -------
    (K, 2, 2) both ends of each, in pixels from the film's left and upper border; K is 0 where the triangle
    is not cut, or where no more than three corners are left of it.
    """
    width, height = pencil.resolution
    q = corners - np.asarray(pencil.center)
    # s is positive in front of a C and negative in front of a C*; the distance along the axis, w, never.
    side = 1.0 if sum(pencil.s_range) > 0 else -1.0
    w = -side * q[:, 2]
    u, v = ((side * q[:, :2] - np.outer(w, pencil.shear)) / pencil.half_extent).T
    left = (u + w) * width / 2 + shift[0] * w
    top = (w - v) * height / 2 + shift[1] * w
    begin, end = sorted(abs(s) for s in pencil.s_range)
    # What is left is where these are not negative: near and far plane, then the film's borders.
    bounds = np.array(
        [
            (0, 0, 1, -begin),
            (0, 0, -1, end),
            (1, 0, 0, 0),
            (-1, 0, width, 0),
            (0, 1, 0, 0),
            (0, -1, height, 0),
        ],
        dtype=np.float64,
    )
    polygon = np.stack((left, top, w, np.ones(3)), axis=1)
    for bound in bounds:
        polygon = _cut(polygon, polygon @ bound)
    count = len(polygon)
    diagonals = [(i, j) for i, j in combinations(range(count), 2) if j - i not in (1, count - 1)]
    places: Floats = polygon[:, :2] / polygon[:, 2:3]
    return places[np.array(diagonals, dtype=np.int64).reshape(-1, 2)]


def distance_to_segments(points: Floats, segments: Floats) -> Floats:
    """Return how far points (N, 2) lie from the nearest of some segments (K, 2, 2); infinite without any."""
    nearest = np.full(len(points), np.inf)
    for start, end in segments:
        along = end - start
        squared = float(along @ along)
        share = (
            np.clip((points - start) @ along / squared, 0.0, 1.0) if squared > 0 else np.zeros(len(points))
        )
        nearest = np.minimum(nearest, np.linalg.norm(points - start - share[:, None] * along, axis=1))
    return nearest


def distance_to_border(points: Floats, resolution: tuple[int, int]) -> Floats:
    """Return how far points (N, 2) lie from the nearest border of a film, in pixels, borders prolonged."""
    off = np.full(len(points), np.inf)
    for place, extent in zip(points.T, resolution, strict=True):
        off = np.minimum(off, np.minimum(np.abs(place), np.abs(place - extent)))
    return off


def _cut(polygon: Floats, bound: Floats) -> Floats:
    """Return what is left of a convex polygon (N, 4) where a linear function of it is not negative."""
    kept = []
    for i, here in enumerate(polygon):
        following, next_bound = polygon[i - len(polygon) + 1], bound[i - len(polygon) + 1]
        if bound[i] >= 0:
            kept.append(here)
        if (bound[i] >= 0) != (next_bound >= 0):
            kept.append(here + (following - here) * (bound[i] / (bound[i] - next_bound)))
    return np.array(kept).reshape(-1, 4)
