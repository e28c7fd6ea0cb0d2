"""The boxes of pixels in which triangles may show, compiled by Dr.Jit: one lane for each triangle.

The formulas are those of `certify.sides` and `certify.footprints`, operation by operation, so that the boxes
are the same to the last pixel. Which way a triangle is turned is found beside them, where its corners are at
hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from xfrustum.reference.devices.arithmetic import difference
from xfrustum.reference.devices.arithmetic_jit import JIT, Int32
from xfrustum.reference.devices.strict_jit import strict_arithmetic
from xfrustum.reference.lines.cone import EDGES, ROUNDING, Planes, Viewpoint
from xfrustum.reference.lines.corners_jit import CornerTable
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Indices, Numbers

TOUCHING = 3
"""Value in place of a turn for triangles whose boxes in space contain the center."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _FilmAxis:
    """The map from slopes to columns, or to rows from the top, in arrays of one element.

    Attributes
    ----------
    shear, scale, middle
        Parts of column = (slope - shear) scale + middle.
    slack
        Bound on the rounding of this formula.
    count, last
        Number of columns, and the number of the last one.
    """

    shear: Any
    scale: Any
    middle: Any
    slack: Any
    count: Any
    last: Any

    @classmethod
    def of(cls, pencil: Pencil, axis: int, slack: float) -> _FilmAxis:
        count = pencil.resolution[axis]
        scale = count / (2 * pencil.half_extent[axis])
        numbers = (pencil.shear[axis], scale, (count - 1) / 2, slack, count, count - 1)
        shear, scale_, middle, slack_, count_, last = JIT.constants([float(one) for one in numbers])
        return cls(shear=shear, scale=scale_, middle=middle, slack=slack_, count=count_, last=last)


@dataclass(frozen=True, kw_only=True, eq=False)
class Boxes:
    """The boxes of the triangles on one side of a pencil's center.

    Attributes
    ----------
    number
        (N,) triangle numbers, ascending.
    box
        (4, N) first and last column, first and last row, inclusive.
    turned
        (N,) the sign of the edge functions inside each triangle, twice that where the sign is in doubt.
    touching
        (M,) numbers of the triangles whose boxes in space contain the center, and which have no box here.
    """

    number: Indices
    box: Numbers
    turned: Numbers
    touching: Indices


def boxes_on(
    table: CornerTable, pencil: Pencil, slack: tuple[float, float], sides: Sequence[int]
) -> list[Boxes]:
    """Return the boxes of all triangles of a table that may show on some sides of a pencil's center.

    Parameters
    ----------
    table
        Corners of the triangles.
    pencil
        Lines of the image.
    slack
        Bounds in columns and in rows on the rounding of places on the film.
    sides
        +1 behind the center (s > 0), -1 before it.

    Returns
    -------
    Boxes on each of the sides; on all of them the same triangles touch the center.
    """
    with strict_arithmetic():
        listed = table.listed(pencil)
        if listed is None:
            return []
        seen_from = Viewpoint.of(pencil, JIT)
        film = tuple(_FilmAxis.of(pencil, axis, slack[axis]) for axis in range(2))
        found = [_on_side(listed.points, seen_from, film, side) for side in sides]
        dr.eval(*(array for arrays in found for array in arrays))
        return [_read(arrays, listed.number) for arrays in found]


def _read(arrays: Sequence[Any], number: Indices) -> Boxes:
    *box, turned = (array.numpy() for array in arrays)
    hit = np.flatnonzero((turned != 0) & (turned != TOUCHING))
    return Boxes(
        number=number[hit],
        box=np.stack([bound[hit] for bound in box]),
        turned=turned[hit],
        touching=number[np.flatnonzero(turned == TOUCHING)],
    )


def _on_side(
    points: list[list[Any]], seen_from: Viewpoint, film: tuple[_FilmAxis, ...], side: int
) -> list[Any]:
    """Return first and last column, first and last row, and the turn of each triangle.

    The turn is the sign of the edge functions inside it, twice that where the sign is in doubt, zero where
    no line can meet the triangle on this side, and `TOUCHING` where its box in space contains the center.
    """
    corners = [difference(point, seen_from.center) for point in points]
    x, y, z = ([corner[axis] for corner in corners] for axis in range(3))
    low, high = (-_most(z), -_least(z))
    low, high = low - seen_from.slack * abs(low), high + seen_from.slack * abs(high)
    imaged = (low <= seen_from.ends[1]) & (high >= seen_from.ends[0])
    here = imaged & ((_least(z) < 0) if side > 0 else (_most(z) > 0))
    touching = imaged & _spans_zero(x) & _spans_zero(y) & _spans_zero(z)
    s = [-height for height in z]
    across, down = film
    low, high = _slope_range(x, s, side)
    first = _clipped((low - across.shear) * across.scale + across.middle - across.slack, 0.0, across.count)
    last = _clipped((high - across.shear) * across.scale + across.middle + across.slack, -1.0, across.last)
    low, high = _slope_range(y, s, side)
    top = _clipped(down.middle - (high - down.shear) * down.scale - down.slack, 0.0, down.count)
    bottom = _clipped(down.middle - (low - down.shear) * down.scale + down.slack, -1.0, down.last)
    box = [Int32(dr.ceil(first)), Int32(dr.floor(last)), Int32(dr.ceil(top)), Int32(dr.floor(bottom))]
    hit = here & (box[0] <= box[1]) & (box[2] <= box[3])

    of = Planes.of(JIT, points, seen_from.center, False)
    turned = dr.select(of.plane < 0, Int32(-side), Int32(side))
    turned = dr.select(abs(of.plane) <= of.plane_bound, 2 * turned, turned)
    return [*box, dr.select(touching, TOUCHING, dr.select(hit, turned, 0))]


def _slope_range(x: list[Any], s: list[Any], side: int) -> tuple[Any, Any]:
    """Return the range of x / s over the part of each triangle on one side; see `certify.footprints`."""
    ahead = [side * one > 0 for one in s]
    slopes = [one / depth for one, depth in zip(x, s, strict=True)]
    low = _least([dr.select(mine, slope, np.inf) for mine, slope in zip(ahead, slopes, strict=True)])
    high = _most([dr.select(mine, slope, -np.inf) for mine, slope in zip(ahead, slopes, strict=True)])
    for i, j in EDGES:
        crosses = ahead[i] ^ ahead[j]
        here, there = x[j] * s[i], x[i] * s[j]
        toward = dr.select(s[i] - s[j] > 0, float(side), -float(side)) * (here - there)
        doubt = ROUNDING * (abs(here) + abs(there))
        high = dr.select(crosses & (toward >= -doubt), np.inf, high)
        low = dr.select(crosses & (toward <= doubt), -np.inf, low)
    return low, high


def _least(values: list[Any]) -> Any:
    return dr.minimum(dr.minimum(values[0], values[1]), values[2])


def _most(values: list[Any]) -> Any:
    return dr.maximum(dr.maximum(values[0], values[1]), values[2])


def _spans_zero(values: list[Any]) -> Any:
    return (_least(values) <= 0) & (_most(values) >= 0)


def _clipped(values: Any, low: Any, high: Any) -> Any:
    return dr.minimum(dr.maximum(values, low), high)
