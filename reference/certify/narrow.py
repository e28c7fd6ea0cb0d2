"""Pixel against triangle in double precision, with a bound on every rounding error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from xfrustum.reference.certify.rows import Rows
from xfrustum.reference.lines.cone import ROUNDING, Cones
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.lines.pairs import Pairs
from xfrustum.scenes.arrays import Floats, Indices, Numbers

UNDERFLOW = 2.0**-1022
"""Smallest double that is held to full precision. Three quotients and products below it, of s and of its
bound, are off by at most half a step each, 2^-1075, whatever their size."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sifted:
    """Who may be first in some rows of an image.

    Attributes
    ----------
    triangle, s
        (pixels,) the only triangle that can be first, surely met, and where; `NOTHING` and NaN
        where no line meets any, and where `contested` has pairs.
    contested
        All pairs of the pixels for which several triangles may be first, or one in doubt.
    """

    triangle: Numbers
    s: Floats
    contested: Pairs


class NarrowPhase(Protocol):
    """Cuts rows by their triangles' edges and evaluates the pixels that are left, on whatever computes."""

    def __init__(self, pencil: Pencil, rows: range) -> None: ...

    def add(self, rows: Rows) -> None:
        """Take more triangles into account."""
        ...

    def finish(self) -> Sifted:
        """Return who may be first among all that was added."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class RowPlanes:
    """What the evaluation of a row's pixels needs of its triangle, in NumPy's or Dr.Jit's arrays.

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


def level_of(normal: Any, magnitude: Any, dy: Any) -> tuple[Any, Any]:
    """Return what of d . n depends on the row alone, and its magnitude; see `RowPlanes`."""
    return normal[1] * dy - normal[2], abs(dy) * magnitude[1] + magnitude[2]


def counted_range(
    within: Any, ends: Sequence[Any], select: Callable[[Any, Any, Any], Any]
) -> tuple[Any, Any]:
    """Return from which s to which hits count: the range's ends; everything for triangles within."""
    everything, (first, last) = np.finfo(np.float64), ends
    return select(within, float(everything.min), first), select(within, float(everything.max), last)


def plane_meeting(dx: Any, row: RowPlanes, select: Callable[[Any, Any, Any], Any]) -> tuple[Any, Any]:
    """Return s where lines meet triangles' planes, and the bound of its error.

    Written once for NumPy and for Dr.Jit, which differ in what `select` is.

        |s - s_true| <= (plane_bound + |s| slope_bound) / (|slope| - slope_bound),

    and the division itself and this expression round: `ROUNDING` times |s| pays for both, and
    `UNDERFLOW` where a quotient is smaller than what doubles hold to full precision. The error is
    infinite where the slope may be zero, and zero where the plane runs through the center exactly.

    Parameters
    ----------
    dx
        Slopes of the lines.
    row
        For each line.
    select
        `numpy.where` or `drjit.select`.
    """
    slope = row.normal_x * dx + row.level
    slope_bound = ROUNDING * (row.magnitude_x * abs(dx) + row.level_magnitude)
    margin = abs(slope) - slope_bound
    certain = margin > slope_bound
    s = select(certain, row.plane / select(certain, slope, 1.0), 0.0)
    error = (row.plane_bound + abs(s) * slope_bound) / select(certain, margin, 1.0)
    error = error * (1 + ROUNDING) + ROUNDING * abs(s) + select(row.plane_bound > 0, UNDERFLOW, 0.0)
    error = select(certain, error, np.inf)
    return s, error


def surely_counts(s: Any, error: Any, first: Any, last: Any) -> Any:
    """Return whether s surely lies in a range, and on a side of the center that is known.

    An s of which not even the sign is known may well be first, but says nothing about where: such a
    pixel is left to the integers. An infinite error never counts. Written once for NumPy and Dr.Jit.
    """
    return (s - error >= first) & (s + error <= last) & (error <= abs(s))


def settled(cones: Cones, cone: Indices, found: Pairs, pencil: Pencil) -> Pairs:
    """Decide coverage of the pairs that are not sure yet by their edge functions, with bounds.

    Parameters
    ----------
    cones, cone
        Where the triangles come from, and (N,) which of them is each pair's.
    found
        Pairs whose s is possible; `sure` where coverage already is.
    """
    doubtful = np.flatnonzero(~found.sure)
    if not len(doubtful):
        return found
    c, cone = cones, cone[doubtful]
    row, column = np.divmod(found.pixel[doubtful], pencil.resolution[0])
    dx, dy = pencil.dx[column], pencil.dy[row]
    low, high = np.full(len(cone), np.inf), np.full(len(cone), -np.inf)
    surely_low, surely_high = low.copy(), high.copy()
    for k in range(3):
        edge, magnitude = c.edge[k][:, cone], c.edge_magnitude[k][:, cone]
        value = edge[0] * dx + edge[1] * dy - edge[2]
        bound = ROUNDING * (np.abs(dx) * magnitude[0] + np.abs(dy) * magnitude[1] + magnitude[2])
        low, high = np.minimum(low, value - bound), np.maximum(high, value + bound)
        surely_low, surely_high = (
            np.minimum(surely_low, value + bound),
            np.maximum(surely_high, value - bound),
        )
    inside = np.ones(len(found.pixel), dtype=np.bool_)
    # Outside: some edge function is surely positive and another surely negative.
    inside[doubtful] = ~((surely_high > 0) & (surely_low < 0))
    sure = found.sure.copy()
    first, last = counted_range(c.within[cone], pencil.s_range, np.where)
    counts = surely_counts(found.s[doubtful], found.error[doubtful], first, last)
    sure[doubtful] = ((low > 0) | (high < 0)) & counts
    return Pairs(pixel=found.pixel, triangle=found.triangle, s=found.s, error=found.error, sure=sure)[inside]
