"""The boxes of pixels in which triangles may show, compiled by Dr.Jit: one lane for each triangle.

The formulas are those of `sides` and `footprints`, operation by operation, so that the boxes are the same to
the last pixel. Which way a triangle is turned is found beside them, where its corners are at hand already.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.certify.footprints import (
    Footprints,
    footprints_around_center,
    joined_footprints,
    pixel_slack,
    sides_of,
)
from xfrustum.reference.certify.table_jit import CornerTable
from xfrustum.reference.devices.arithmetic import difference
from xfrustum.reference.devices.arithmetic_jit import JIT, Int32
from xfrustum.reference.devices.strict_jit import strict_arithmetic
from xfrustum.reference.lines.cone import EDGES, ROUNDING, Planes, Viewpoint
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Numbers

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
        Bound on the rounding of this formula, see `pixel_slack`.
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
    def of(cls, pencil: Pencil, axis: int) -> _FilmAxis:
        count = pencil.resolution[axis]
        scale = count / (2 * pencil.half_extent[axis])
        numbers = (pencil.shear[axis], scale, (count - 1) / 2, pixel_slack(pencil, axis), count, count - 1)
        shear, scale_, middle, slack, count_, last = JIT.constants([float(one) for one in numbers])
        return cls(shear=shear, scale=scale_, middle=middle, slack=slack, count=count_, last=last)


def footprints_on_device(table: CornerTable, pencil: Pencil, exact: ExactPencil) -> Footprints:
    """Return what `footprints` returns of all triangles of a table, with the way that they are turned.

    Parameters
    ----------
    table
        Corners of the triangles.
    pencil
        Lines of the image.
    exact
        The same lines in integers.
    """
    parts: list[Footprints] = []
    turned: Numbers = np.zeros(0, dtype=np.int32)
    with strict_arithmetic():
        listed = table.listed(pencil)
        if listed is None:
            return joined_footprints([])
        seen_from = Viewpoint.of(pencil, JIT)
        film = tuple(_FilmAxis.of(pencil, axis) for axis in range(2))
        found = {side: _on_side(listed.points, seen_from, film, side) for side in sides_of(pencil)}
        dr.eval(*(array for arrays in found.values() for array in arrays))
        for side, arrays in found.items():
            *box, turned = (array.numpy() for array in arrays)
            hit = np.flatnonzero((turned != 0) & (turned != TOUCHING))
            parts.append(
                Footprints(
                    number=listed.number[hit],
                    side=np.full(len(hit), side, dtype=np.int8),
                    holds_center=np.zeros(len(hit), dtype=np.bool_),
                    box=np.stack([bound[hit] for bound in box]),
                    turned=turned[hit].astype(np.int8),
                )
            )
    # Triangles about the center are found on either side alike.
    touching = listed.number[np.flatnonzero(turned == TOUCHING)]
    if len(touching):
        parts.append(footprints_around_center(touching, pencil, exact))
    return joined_footprints(parts)


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
    """Return the range of x / s over the part of each triangle on one side; see `footprints.slope_range`."""
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
