"""Triangles sorted into those behind the height of a pencil's center and those before it.

All apertures of a plate share z = 0 and the reach, so that this is done once for a plate.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from xfrustum.reference.lines.cone import s_bounds
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats, Indices, Mask

TRIANGLES_PER_CHUNK = 1 << 14
"""Triangles that are sorted at once, few enough for intermediate results, about 1 kB per triangle, to stay in
the processor's caches."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Side:
    """Triangles that reach into one side of the center's height, and into the pencil's range on that side.

    Attributes
    ----------
    sign
        +1 behind the center (s > 0), -1 before it.
    number
        (N,) triangle numbers, ascending.
    x, y
        (3, N) scene coordinates of the corners.
    s
        (3, N) places of the corners along the lines, their depth below the center's height.
    """

    sign: int
    number: Indices
    x: Floats
    y: Floats
    s: Floats

    def without(self, numbers: Indices) -> Side:
        """Return the triangles without those of some numbers."""
        if not len(numbers):
            return self
        kept = np.flatnonzero(~np.isin(self.number, numbers))
        x, y, s = (some(values, kept) for values in (self.x, self.y, self.s))
        return Side(sign=self.sign, number=self.number[kept], x=x, y=y, s=s)


@dataclass(frozen=True, kw_only=True, eq=False)
class Sides:
    """Some triangles, sorted by side.

    Attributes
    ----------
    sides
        Triangles on either side; a triangle that reaches into both sides is in both.
    across
        (N,) numbers of the triangles that reach the center's height itself.
    x, y
        (3, N) scene coordinates of the corners of these.
    """

    sides: tuple[Side, ...]
    across: Indices
    x: Floats
    y: Floats

    def touching(self, x: float, y: float) -> Indices:
        """Return the numbers of the triangles whose boxes in space contain a point of that height."""
        if not len(self.across):
            return self.across
        return self.across[_spans_zero(self.x - x) & _spans_zero(self.y - y)]


def sorted_by_side(triangles: Floats, pencil: Pencil) -> Iterator[Sides]:
    """Sort triangles (F, 3, 3) by the height of a pencil's center and by its range, chunk by chunk."""
    for start in range(0, len(triangles), TRIANGLES_PER_CHUNK):
        # Coordinate first, corner second: minima over corners are then minima of whole arrays.
        x, y, z = np.ascontiguousarray(triangles[start : start + TRIANGLES_PER_CHUNK].transpose(2, 1, 0))
        z = z - pencil.center[2]
        low, high = s_bounds(z, pencil)
        imaged = (low <= pencil.s_range[1]) & (high >= pencil.s_range[0])
        sides = []
        for sign in (1, -1):
            if sign * pencil.s_range[sign > 0] > 0:
                here = np.flatnonzero(imaged & ((z.min(axis=0) < 0) if sign > 0 else (z.max(axis=0) > 0)))
                corners = (some(x, here), some(y, here), -some(z, here))
                sides.append(Side(sign=sign, number=start + here, x=corners[0], y=corners[1], s=corners[2]))
        across = np.flatnonzero(imaged & _spans_zero(z))
        yield Sides(sides=tuple(sides), across=start + across, x=some(x, across), y=some(y, across))


def some(x: Floats, chosen: Indices) -> Floats:
    """Return some columns of an array (3, T)."""
    # Not x[:, chosen], which would put the corners next to each other in memory.
    return np.take(x, chosen, axis=1)


def _spans_zero(x: Floats) -> Mask:
    return np.asarray((x.min(axis=0) <= 0) & (x.max(axis=0) >= 0))
