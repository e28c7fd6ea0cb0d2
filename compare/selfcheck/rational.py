"""The truth once more, by brute force in integers, to check the reference with.

This module is independent of the reference on purpose. The two share only the definition of the line of a
pixel (`Pencil`). Here a line is intersected with a triangle's plane first; then the point is compared with
the three edges in two dimensions, seen along the axis that the plane faces most. All doubles are integers
over a common power of two, so that nothing is ever rounded.

Conventions (CONVENTIONS.md): triangles are closed, a line that lies in a triangle's plane does not
meet the triangle, the first s within the reach wins, and equal s is a tie.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.compare.selfcheck.boxes import boxes_met
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats, Indices, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING

Integers = tuple[int, int, int]
"""Three coordinates of a point or vector as integers."""

Ratio = tuple[int, int]
"""Numerator and positive denominator."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ExactRows:
    """The first triangle on each line of some rows, decided without any rounding.

    Attributes
    ----------
    triangle
        (rows, W) int32 number of the triangle met first, the smallest one in a tie; `NOTHING` where a line
        meets none.
    s
        (rows, W) the double nearest to the exact s of the meeting point; NaN where a line meets none.
    ties
        (N, 3) row of the image, column and triangle number of all triangles that are first together,
        sorted.
    """

    triangle: Numbers
    s: Floats
    ties: Indices


@dataclass(frozen=True, kw_only=True)
class IntegerPlane:
    """A triangle relative to the center, in integers.

    Attributes
    ----------
    normal, offset
        Coefficients of the plane: its points q have normal . q = offset.
    axes
        The two axes x and y that remain when the plane is seen along the third one, which it does not
        contain.
    edges
        Coefficients (u, v, w) of each edge in these axes: u y - v x - w is at least zero on the triangle's
        side of the edge.
    """

    normal: Integers
    offset: int
    axes: tuple[int, int]
    edges: tuple[Integers, ...]

    def met_by(self, d: Integers) -> Ratio | None:
        """Return the ratio s at which the line s d meets the triangle; None where it does not."""
        # Step 1: the plane is met at s = offset / slope; slope zero is a line parallel to the plane.
        slope = self.normal[0] * d[0] + self.normal[1] * d[1] + self.normal[2] * d[2]
        if slope == 0:
            return None
        # Step 2: make the denominator positive, so that multiplying an inequality by it keeps its sense.
        offset, slope = (self.offset, slope) if slope > 0 else (-self.offset, -slope)
        # Step 3: slope times the meeting point, compared with slope times each edge's equation.
        x, y = offset * d[self.axes[0]], offset * d[self.axes[1]]
        for u, v, w in self.edges:
            if u * y - v * x < w * slope:
                return None
        return offset, slope


class Integral:
    """A scale that turns doubles into integers: value * 2**bits.

    Parameters
    ----------
    values
        All doubles that will be converted; finite.
    """

    def __init__(self, values: Floats) -> None:
        denominators = {value.as_integer_ratio()[1] for value in np.unique(values).tolist()}
        self.bits = max(denominators, default=1).bit_length() - 1

    def __call__(self, value: float) -> int:
        """Return one of the values as integer."""
        numerator, denominator = value.as_integer_ratio()
        return numerator << (self.bits - denominator.bit_length() + 1)


def integer_plane(corners: tuple[Integers, Integers, Integers]) -> IntegerPlane | None:
    """Return a triangle's plane and edges; None for a triangle without area, which no line meets."""
    # Step 1: the normal, by the cross product of two edges.
    p0, p1, p2 = corners
    a, b = [(q[0] - p0[0], q[1] - p0[1], q[2] - p0[2]) for q in (p1, p2)]
    normal = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    if not any(normal):
        return None
    # Step 2: see the plane along the axis of the normal's largest component, which cannot be zero.
    facing = max(range(3), key=lambda axis: abs(normal[axis]))
    x, y = (facing + 1) % 3, (facing + 2) % 3
    # Step 3: go around the triangle counterclockwise as x and y see it. The corners' own order is
    # counterclockwise where that component of the normal is positive.
    turns = ((p0, p1), (p1, p2), (p2, p0)) if normal[facing] > 0 else ((p1, p0), (p2, p1), (p0, p2))
    edges = []
    for start, end in turns:
        u, v = end[x] - start[x], end[y] - start[y]
        edges.append((u, v, u * start[y] - v * start[x]))
    # Step 4: the plane goes through the first corner.
    offset = normal[0] * p0[0] + normal[1] * p0[1] + normal[2] * p0[2]
    return IntegerPlane(normal=normal, offset=offset, axes=(x, y), edges=tuple(edges))


class ExactLines:
    """The lines of a pencil and some triangles, all in integers.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners in scene units.
    numbers
        Numbers of the triangles that the lines may meet.
    pencil
        Lines of all pixels of the image.
    """

    def __init__(self, triangles: Floats, numbers: Indices, pencil: Pencil) -> None:
        # Lengths and slopes have scales of their own: each is a common power of two.
        corners = triangles[numbers]
        self._length = Integral(np.concatenate((corners.ravel(), pencil.center, pencil.s_range)))
        slope = Integral(np.concatenate((pencil.dx, pencil.dy)))
        self._slope_bits = slope.bits
        self._dx = [slope(value) for value in pencil.dx.tolist()]
        self._dy = [slope(value) for value in pencil.dy.tolist()]
        self._range = (self._length(float(pencil.s_range[0])), self._length(float(pencil.s_range[1])))
        cx, cy, cz = (self._length(float(value)) for value in pencil.center)

        def relative(point: list[float]) -> Integers:
            x, y, z = point
            return (self._length(x) - cx, self._length(y) - cy, self._length(z) - cz)

        self._planes = {
            number: integer_plane((relative(p0), relative(p1), relative(p2)))
            for number, (p0, p1, p2) in zip(numbers.tolist(), corners.tolist(), strict=True)
        }

    def first(
        self, row: int, column: int, numbers: list[int], nearest: list[float]
    ) -> tuple[list[int], float]:
        """Return the triangles met first, in ascending order, and the double nearest to their s.

        Parameters
        ----------
        row, column
            Pixel whose line is followed.
        numbers, nearest
            Numbers of the candidates, and a lower bound of s for each, in ascending order of the bounds.
        """
        d = (self._dx[column], self._dy[row], -(1 << self._slope_bits))
        winners: list[int] = []
        first: Ratio = (0, 1)
        where = float("nan")
        for number, bound in zip(numbers, nearest, strict=True):
            # All further candidates lie behind the first one found.
            if winners and bound > where:
                break
            plane = self._planes[number]
            met = plane.met_by(d) if plane else None
            if met is None or not self._in_range(met):
                continue
            # The sign of the difference of two ratios, multiplied by both positive denominators.
            ahead = met[0] * first[1] - first[0] * met[1]
            if not winners or ahead < 0:
                winners, first, where = [number], met, self._double(met)
            elif ahead == 0:
                winners.append(number)
        return sorted(winners), where

    def _in_range(self, met: Ratio) -> bool:
        offset, slope = met
        return self._range[0] * slope <= offset << self._slope_bits <= self._range[1] * slope

    def _double(self, met: Ratio) -> float:
        """Return the nearest double: Python rounds a quotient of integers once."""
        return (met[0] << self._slope_bits) / (met[1] << self._length.bits)


def first_by_brute_force(triangles: Floats, pencil: Pencil, rows: range) -> ExactRows:
    """Decide the first surface of every pixel in some rows, all in integers.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners in scene units.
    pencil
        Lines of all pixels of the image.
    rows
        Rows of the image, in order.
    """
    # Step 1: for every pixel, the triangles whose boxes its line may meet.
    width = pencil.resolution[0]
    met = boxes_met(triangles, pencil, rows)
    # Step 2: only these triangles become integers.
    lines = ExactLines(triangles, np.unique(met.triangle), pencil)
    triangle = np.full((len(rows), width), NOTHING, dtype=np.int32)
    s = np.full((len(rows), width), np.nan)
    ties: list[tuple[int, int, int]] = []
    # Step 3: pairs are sorted by pixel; decide one pixel after the other.
    pixels, starts = np.unique(met.pixel, return_index=True)
    ends = np.append(starts, len(met.pixel))[1:]
    for pixel, start, end in zip(pixels.tolist(), starts.tolist(), ends.tolist(), strict=True):
        row, column = divmod(pixel, width)
        candidates, nearest = met.triangle[start:end].tolist(), met.nearest[start:end].tolist()
        winners, where = lines.first(rows.start + row, column, candidates, nearest)
        if winners:
            triangle[row, column], s[row, column] = winners[0], where
        if len(winners) > 1:
            ties.extend((rows.start + row, column, winner) for winner in winners)
    return ExactRows(triangle=triangle, s=s, ties=np.array(ties, dtype=np.int64).reshape(-1, 3))
