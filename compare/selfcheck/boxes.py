"""Boxes that rule out triangles: a line that misses a triangle's box misses the triangle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats, Indices, Mask

BOX_MARGIN = 2.0**-40
"""Width added around every box, relative to the largest coordinate times 1 + the steepest slope. The bounds
of a box are a difference of two coordinates and its product with a slope: at most 3 roundings of 2^-53, each
of a number no larger than twice that product. The margin is over a thousand times as wide."""

CHUNK_TRIANGLES = 1 << 13
"""Triangles whose boxes are compared with all rows at once; each needs a byte for every row and column."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxesMet:
    """Pairs of a pixel and a triangle whose box the pixel's line may meet, by pixel, then by `nearest`.

    Attributes
    ----------
    pixel
        (N,) pixel numbers: W times the row within the given rows, plus the column.
    triangle
        (N,) triangle numbers.
    nearest
        (N,) lower bounds of s: no point of the triangle's box has a smaller one.
    """

    pixel: Indices
    triangle: Indices
    nearest: Floats


def boxes_met(triangles: Floats, pencil: Pencil, rows: range) -> BoxesMet:
    """Return all pairs of pixel and triangle in some rows except those that surely do not meet.

    A point of the line has x - cx = s dx and s = cz - z. If the point lies in a triangle, s lies between the
    least and the largest s of the corners. Therefore s dx lies in the interval between these two times dx,
    and x - cx in the interval of the corners. The two intervals must overlap, for x and for y alike. Boxes
    are widened by `BOX_MARGIN`, so that rounding loses no pair.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners in scene units.
    pencil
        Lines of all pixels of the image.
    rows
        Rows of the image whose lines are compared.
    """
    width = pencil.resolution[0]
    dx, dy = pencil.dx, pencil.dy[rows.start : rows.stop]
    steepest = max(np.abs(dx).max(), np.abs(dy).max())
    pixels: list[Indices] = []
    numbers: list[Indices] = []
    bounds: list[Floats] = []
    for start in range(0, len(triangles), CHUNK_TRIANGLES):
        low, high = _boxes(triangles[start : start + CHUNK_TRIANGLES], pencil, steepest)
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
    """Return the least and the largest x, y and s of the widened boxes, from the center, (T, 3) each."""
    center = np.asarray(pencil.center)
    size = np.maximum(np.abs(triangles).max(axis=(1, 2), initial=0.0), np.abs(center).max())
    margin = (BOX_MARGIN * (1 + steepest) * size)[:, None]
    relative = (triangles - center) * [1.0, 1.0, -1.0]
    return relative.min(axis=1) - margin, relative.max(axis=1) + margin


def _reached(near: Floats, far: Floats, low: Floats, high: Floats, slopes: Floats) -> Mask:
    """Return whether lines pass through boxes' intervals along one axis, (T, N).

    A line of slope a passes through the places s a, for s from near to far of a box.

    Parameters
    ----------
    near, far
        (T,) least and largest s of each box.
    low, high
        (T,) ends of each box's interval.
    slopes
        (N,) slope of each line.
    """
    one, other = near[:, None] * slopes, far[:, None] * slopes
    return np.asarray((np.minimum(one, other) <= high[:, None]) & (np.maximum(one, other) >= low[:, None]))
