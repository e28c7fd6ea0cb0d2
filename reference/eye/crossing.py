"""Lines without a common point: which triangles they may cross, found from where the eye sees these.

The line that a hogel replays to an eye's pixel runs beside the ray of that pixel: at the depth s below the
plate they are at most D0 + |s| D1 apart, with D0 half a hogel and D1 half a pixel of its film. A triangle is
therefore made wider by this much; wherever a line crosses the triangle, the pixel's ray meets the wider one.
D0 + |s| D1 is convex over s, so that the wider triangle lies within the hull of its wider corners, and what
an eye sees of that hull lies between what it sees of these.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from xfrustum.reference.lines.grid import LineGrid
from xfrustum.scenes.arrays import Floats, Indices

PAIRS_AT_ONCE = 1 << 19
"""Pairs of a line and a triangle that are found at once; each takes about 1 kB where it is decided."""

TRIANGLES_AT_ONCE = 1 << 13
"""Triangles whose columns and rows are found at once."""

MARGIN = 1e-11
"""Margin of every comparison, relative to the sum of absolute values in it: more than ten thousand roundings
of 1e-16, for a few dozen operations."""

BESIDE_THE_EYE = 1e-6
"""Smallest distance of a triangle's corner below the eye at which the triangle is projected, as a part of the
eye's height. Others, which reach beside the eye or behind it, may cross any line."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Axis:
    """The lines of a grid along one axis, beside the rays of the eye.

    Attributes
    ----------
    place, slope
        (N,) where the lines meet the plate, and their slopes.
    seen
        (N,) slopes of the eye's rays, ascending or descending.
    eye, height
        The eye's coordinate on this axis, and its height before the plate.
    """

    place: Floats
    slope: Floats
    seen: Floats
    eye: float
    height: float

    def candidates(self, x: Floats, s: Floats) -> tuple[Indices, Indices]:
        """Return first and end of the lines that may cross triangles, (T,) each.

        Parameters
        ----------
        x, s
            (3, T) coordinate and depth below the plate of the corners.
        """
        if not len(self.seen):
            none = np.zeros(x.shape[1], dtype=np.int64)
            return none, none
        apart = np.abs(self.place - self.eye - self.height * self.seen).max()
        spread = np.abs(self.slope - self.seen).max()
        size = np.abs(x) + abs(self.eye) + (self.height + np.abs(s)) * (1 + np.abs(self.seen).max())
        wider = apart + np.abs(s) * spread + MARGIN * size
        below = self.height + s
        beside = (below <= BESIDE_THE_EYE * self.height).any(axis=0)
        below = np.where(below > 0, below, 1.0)
        low = np.where(beside, -np.inf, ((x - wider - self.eye) / below).min(axis=0))
        high = np.where(beside, np.inf, ((x + wider - self.eye) / below).max(axis=0))
        if self.seen[0] <= self.seen[-1]:
            return np.searchsorted(self.seen, low, "left"), np.searchsorted(self.seen, high, "right")
        down = -self.seen
        return np.searchsorted(down, -high, "left"), np.searchsorted(down, -low, "right")

    def crossed(self, x: Floats, s: Floats) -> tuple[Indices, Indices]:
        """Return triangle and line of all that may cross, seen along the other axis: sorted by triangle."""
        first, end = self.candidates(x, s)
        counts = np.maximum(end - first, 0)
        triangle = np.repeat(np.arange(len(counts)), counts)
        line = np.arange(len(triangle)) - np.repeat(np.cumsum(counts) - counts - first, counts)
        aside = [x[k, triangle] - self.place[line] - s[k, triangle] * self.slope[line] for k in range(3)]
        size = np.abs(self.place[line]) + sum(
            np.abs(x[k, triangle]) + np.abs(s[k, triangle] * self.slope[line]) for k in range(3)
        )
        doubt = MARGIN * size
        misses = np.logical_and.reduce([a > doubt for a in aside])
        misses |= np.logical_and.reduce([a < -doubt for a in aside])
        return triangle[~misses], line[~misses]


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossings:
    """Pairs of a line and a triangle that it may cross: (N,) column, row and number of the triangle."""

    column: Indices
    row: Indices
    triangle: Indices


def crossings(triangles: Floats, grid: LineGrid, columns: Axis, rows: Axis) -> Iterator[Crossings]:
    """Yield all pairs of a line and a triangle that may cross within the range, in bounded parts.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners, scene units.
    grid
        The lines.
    columns, rows
        The same lines beside the rays of the eye.
    """
    z = triangles[..., 2]
    reached = (-z.min(axis=1) >= grid.s_range[0]) & (-z.max(axis=1) <= grid.s_range[1])
    numbers = np.flatnonzero(reached)
    for start in range(0, len(numbers), TRIANGLES_AT_ONCE):
        some = numbers[start : start + TRIANGLES_AT_ONCE]
        x, y, heights = np.ascontiguousarray(triangles[some].transpose(2, 1, 0))
        on_column, column = columns.crossed(x, -heights)
        on_row, row = rows.crossed(y, -heights)
        down = np.bincount(on_row, minlength=len(some))
        # Every column of a triangle with every row of it.
        repeats = down[on_column]
        first_row = np.cumsum(down) - down
        ends = np.cumsum(repeats)
        begin = 0
        while begin < len(on_column):
            before = ends[begin - 1] if begin else 0
            stop = max(begin + 1, int(np.searchsorted(ends, before + PAIRS_AT_ONCE)))
            part = np.repeat(np.arange(begin, stop), repeats[begin:stop])
            step = np.arange(len(part)) - np.repeat(
                ends[begin:stop] - repeats[begin:stop] - before, repeats[begin:stop]
            )
            own = on_column[part]
            yield Crossings(column=column[part], row=row[first_row[own] + step], triangle=some[own])
            begin = stop
