"""The narrow phase: each pixel against each triangle whose box holds it, in doubles, roundings bounded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from xfrustum.reference.certify.rows import Rows
from xfrustum.reference.lines.cone import ROUNDING, Cones, Planes
from xfrustum.reference.lines.grid import LineGrid
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.lines.pairs import Pairs
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers

UNDERFLOW = 2.0**-1022
"""Smallest double of full precision. Below it, the three quotients and products that make s and its bound are
off by at most half a step each, 2^-1075, whatever their size; this number covers them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sifted:
    """The triangles that may be first in some rows of an image.

    Attributes
    ----------
    triangle, s
        (pixels,) number and place of the triangle that surely is first; `NOTHING` and NaN where the line
        meets none, and where `contested` has pairs.
    contested
        All pairs of the pixels for which several triangles may be first, or one that is not surely met.
    device
        `triangle` and `s` as arrays of Dr.Jit, where they lie on its device; else None.
    """

    triangle: Numbers
    s: Floats
    contested: Pairs
    device: tuple[Any, Any] | None = None


class NarrowPhase(Protocol):
    """An engine that cuts rows by their triangles' edges and evaluates the pixels that are left.

    Parameters
    ----------
    pencil
        Lines of the image.
    rows
        Rows of the image in which everything that is added lies.
    """

    def __init__(self, pencil: Pencil, rows: range) -> None: ...

    def add(self, rows: Rows) -> None:
        """Take more triangles into account."""
        ...

    def finish(self) -> Sifted:
        """Return the triangles that may be first among all that were added."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class RowPlanes:
    """The planes of triangles along single rows of pixels, in NumPy's or Dr.Jit's arrays.

    Along a row d . n = normal_x dx + level; its rounding error is at most
    `ROUNDING` (magnitude_x |dx| + level_magnitude). Hits count from s = first to s = last.
    """

    plane: Any
    plane_bound: Any
    normal_x: Any
    magnitude_x: Any
    level: Any
    level_magnitude: Any
    first: Any
    last: Any


def row_planes(
    planes: Planes, within: Any, dy: Any, ends: Sequence[Any], select: Callable[[Any, Any, Any], Any]
) -> RowPlanes:
    """Return the planes of triangles along rows.

    Parameters
    ----------
    planes, within
        Planes of each row's triangle, and whether the triangle surely lies within the pencil's range.
    dy
        Slopes of the rows.
    ends
        First and last s of the pencil's range.
    select
        `numpy.where` or `drjit.select`.
    """
    normal, magnitude = planes.normal, planes.normal_magnitude
    first, last = counted_range(within, ends, select)
    return RowPlanes(
        plane=planes.plane,
        plane_bound=planes.plane_bound,
        normal_x=normal[0],
        magnitude_x=magnitude[0],
        level=normal[1] * dy - normal[2],
        level_magnitude=abs(dy) * magnitude[1] + magnitude[2],
        first=first,
        last=last,
    )


def counted_range(
    within: Any, ends: Sequence[Any], select: Callable[[Any, Any, Any], Any]
) -> tuple[Any, Any]:
    """Return the first and last s at which hits count: the ends of the range, or any s for triangles within.

    A triangle that surely lies within the range needs no test against its ends, which would leave a hit
    close to them in doubt.
    """
    everything, (first, last) = np.finfo(np.float64), ends
    return select(within, float(everything.min), first), select(within, float(everything.max), last)


def plane_meeting(dx: Any, row: RowPlanes, select: Callable[[Any, Any, Any], Any]) -> tuple[Any, Any]:
    """Return s where lines meet triangles' planes, and a bound on its error.

    Written once for NumPy and for Dr.Jit. With p = plane, d . n = slope and their bounds,

        |s - s_true| <= (plane_bound + |s| slope_bound) / (|slope| - slope_bound).

    The error is infinite where the slope may be zero, and zero where the plane runs through the center
    exactly.

    Parameters
    ----------
    dx
        Slopes of the lines.
    row
        Planes, one for each line.
    select
        `numpy.where` or `drjit.select`.
    """
    # The denominator d . n and its bound. It is certain to have its sign, with a margin to spare, where
    # it is more than twice its bound.
    slope = row.normal_x * dx + row.level
    slope_bound = ROUNDING * (row.magnitude_x * abs(dx) + row.level_magnitude)
    margin = abs(slope) - slope_bound
    certain = margin > slope_bound
    # The quotient; 1 in place of a slope that is not certain keeps it finite.
    s = select(certain, row.plane / select(certain, slope, 1.0), 0.0)
    # The bound above, from the errors of both dot products.
    error = (row.plane_bound + abs(s) * slope_bound) / select(certain, margin, 1.0)
    # The roundings of that expression (1 + ROUNDING), of the quotient s (ROUNDING |s|), and of quotients
    # below full precision.
    error = error * (1 + ROUNDING) + ROUNDING * abs(s) + select(row.plane_bound > 0, UNDERFLOW, 0.0)
    error = select(certain, error, np.inf)
    return s, error


def surely_counts(s: Any, error: Any, first: Any, last: Any) -> Any:
    """Return whether s surely lies in a range, and surely on one side of the center.

    Where not even the sign of s is certain, the triangle may well be first, but its place is unknown: the
    pixel is left to the integers. An infinite error never counts. Written once for NumPy and Dr.Jit.
    """
    return (s - error >= first) & (s + error <= last) & (error <= abs(s))


def settled(rows: Rows, cone: Indices, found: Pairs, pencil: Pencil) -> Pairs:
    """Return pairs with doubtful coverage decided by edge functions, without those that surely do not meet.

    Parameters
    ----------
    rows, cone
        Rows of the triangles, and (N,) the triangle of each pair as an index into their arrays.
    found
        Pairs whose s is possible, `sure` where they are known to meet.
    pencil
        Lines of the pixels.
    """
    doubtful = np.flatnonzero(~found.sure)
    if not len(doubtful):
        return found
    different, lane = np.unique(cone[doubtful], return_inverse=True)
    possible, sure = met(rows.cones(pencil, different), lane, found[doubtful], pencil)
    inside, surely = np.ones(len(found.pixel), dtype=np.bool_), found.sure.copy()
    inside[doubtful], surely[doubtful] = possible, sure
    return replace(found, sure=surely)[inside]


def met(c: Cones, lane: Indices, found: Pairs, lines: Pencil | LineGrid) -> tuple[Mask, Mask]:
    """Return which pairs may meet by their edge functions (N,), and which surely do.

    Parameters
    ----------
    c, lane
        Triangles as cones, in NumPy, and (N,) the triangle of each pair among them.
    found
        Pairs whose s is possible.
    lines
        Lines of the pixels.
    """
    # Bounds on the smallest and the largest of the three edge functions: [low, surely_low] holds the
    # smallest value, [surely_high, high] the largest.
    row, column = np.divmod(found.pixel, lines.resolution[0])
    dx, dy = lines.dx[column], lines.dy[row]
    low, high = np.full(len(lane), np.inf), np.full(len(lane), -np.inf)
    surely_low, surely_high = low.copy(), high.copy()
    for k in range(3):
        edge, magnitude = ([part[lane] for part in parts[k]] for parts in (c.edge, c.edge_magnitude))
        value = edge[0] * dx + edge[1] * dy - edge[2]
        bound = ROUNDING * (np.abs(dx) * magnitude[0] + np.abs(dy) * magnitude[1] + magnitude[2])
        low, high = np.minimum(low, value - bound), np.maximum(high, value + bound)
        surely_low, surely_high = (
            np.minimum(surely_low, value + bound),
            np.maximum(surely_high, value - bound),
        )
    # Surely outside: one edge function is surely positive and another surely negative.
    possible = ~((surely_high > 0) & (surely_low < 0))
    # Surely inside: all are surely positive, or all surely negative, and s counts.
    first, last = counted_range(c.within[lane], lines.s_range, np.where)
    sure = ((low > 0) | (high < 0)) & surely_counts(found.s, found.error, first, last)
    return possible, sure
