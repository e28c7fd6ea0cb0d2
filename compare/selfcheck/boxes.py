"""Which triangles cannot matter to a line: it misses the box about them, by a wide margin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats, Indices, Mask

MARGIN = 2.0**-40
"""Relative to the largest coordinate, times 1 + the steepest slope. What is computed here of a box is
a difference of two coordinates and its product with a slope: 3 roundings of 2^-53 at most, each of a
number no larger than twice that. The margin is over a thousand times as wide."""

TRIANGLES_AT_ONCE = 1 << 13


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxesMet:
    """Pixels and triangles whose boxes their lines may meet, ordered by pixel, then by `nearest`.

    Attributes
    ----------
    pixel
        (N,) row within the rows asked for * W + column.
    triangle
        (N,) triangle numbers.
    nearest
        (N,) no point of the triangle's box has a smaller s.
    """

    pixel: Indices
    triangle: Indices
    nearest: Floats


def boxes_met(triangles: Floats, pencil: Pencil, rows: range) -> BoxesMet:
    """Return all pairs of pixel and triangle in some rows except those that surely do not meet.

    A point of the line has x - cx = s dx and s = cz - z. If it lies in a triangle, s lies between the
    least and the largest s of the corners, hence s dx between these two times dx, and x - cx between
    those of the corners: two intervals of which one has to reach the other, for x and for y alike. Boxes
    are widened by `MARGIN`, so that rounding takes away no pair.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners in scene units.
    pencil
        The lines.
    rows
        Rows of the image.
    """
    width = pencil.resolution[0]
    dx, dy = pencil.dx, pencil.dy[rows.start : rows.stop]
    steepest = max(np.abs(dx).max(), np.abs(dy).max())
    pixels: list[Indices] = []
    numbers: list[Indices] = []
    bounds: list[Floats] = []
    for start in range(0, len(triangles), TRIANGLES_AT_ONCE):
        low, high = _boxes(triangles[start : start + TRIANGLES_AT_ONCE], pencil, steepest)
        near, far = np.maximum(low[:, 2], pencil.s_range[0]), np.minimum(high[:, 2], pencil.s_range[1])
        in_row = _reached(near, far, low[:, 1], high[:, 1], dy)
        some = np.flatnonzero((near <= far) & in_row.any(axis=1))
        in_column = _reached(near[some], far[some], low[some, 0], high[some, 0], dx)
        for box, columns in zip(some.tolist(), in_column, strict=True):
            pixel = (np.flatnonzero(in_row[box])[:, None] * width + np.flatnonzero(columns)).ravel()
            pixels.append(pixel)
            numbers.append(np.full(len(pixel), start + box))
            bounds.append(np.full(len(pixel), low[box, 2]))
    if not pixels:
        none = np.zeros(0, dtype=np.int64)
        return BoxesMet(pixel=none, triangle=none, nearest=np.zeros(0))
    pixel, nearest = np.concatenate(pixels), np.concatenate(bounds)
    order = np.lexsort((nearest, pixel))
    return BoxesMet(pixel=pixel[order], triangle=np.concatenate(numbers)[order], nearest=nearest[order])


def _boxes(triangles: Floats, pencil: Pencil, steepest: float) -> tuple[Floats, Floats]:
    """Return the widened boxes about the center, least and largest x, y and s, (T, 3) each."""
    center = np.asarray(pencil.center)
    size = np.maximum(np.abs(triangles).max(axis=(1, 2), initial=0.0), np.abs(center).max())
    margin = (MARGIN * (1 + steepest) * size)[:, None]
    relative = (triangles - center) * [1.0, 1.0, -1.0]
    return relative.min(axis=1) - margin, relative.max(axis=1) + margin


def _reached(near: Floats, far: Floats, low: Floats, high: Floats, slopes: Floats) -> Mask:
    """Return for which slopes (T, N) s times the slope, near <= s <= far, reaches into low to high."""
    one, other = near[:, None] * slopes, far[:, None] * slopes
    return np.asarray((np.minimum(one, other) <= high[:, None]) & (np.maximum(one, other) >= low[:, None]))
