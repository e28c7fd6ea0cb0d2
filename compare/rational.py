"""Independent truth by brute force in integers, to check the reference.

This module is independent of the reference on purpose. The two share only the definition of the
line of a pixel (`RayBundle`, `LineGrid`). Here a line is first intersected with a triangle's plane.
The point is then projected along the axis of the normal's largest component, and tested against the
three edges in two dimensions. All doubles are integers over a common power of two, so that no
operation rounds. Conventions (CONVENTIONS.md): triangles are closed, a line in a triangle's plane
does not meet the triangle, the smallest s within the reach is the hit, and equal s is a tie.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.reference.lines import LineGrid, RayBundle
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.images import NOTHING

Integers = tuple[int, int, int]  #: three coordinates of a point or vector as integers
Ratio = tuple[int, int]  #: numerator and positive denominator

BOX_MARGIN = 2.0**-40
"""Width added around every box, relative to the largest coordinate times 1 + the steepest slope.

The bounds of a box are a difference of two coordinates and the product of this difference with a
slope. They have at most 3 roundings of 2^-53, each of a number no larger than twice the largest
coordinate times 1 + the steepest slope. The margin is over a thousand times wider."""

CHUNK_TRIANGLES = 1 << 13
"""Number of triangles tested at once, with a byte of memory for each triangle, row and column."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ExactRows:
    """The first triangle on each line of some rows, decided without any rounding."""

    #: (rows, W) int32, in a tie the smallest number; `NOTHING` where a line meets no triangle
    triangle: Numbers
    #: (rows, W) the double nearest to the exact s of the hit; NaN without a hit
    s: Floats
    #: (N, 3) image row, column and number of each triangle in a tie for the first hit, sorted
    ties: Indices


def first_by_brute_force(triangles: Floats, bundle: RayBundle, rows: range) -> ExactRows:
    """Compute in integers the first of the triangles (F, 3, 3) on every line of these rows."""
    width = bundle.resolution[0]
    pixel, candidates, nearest = _boxes_met(triangles, bundle, rows)
    lines = _ExactLines(triangles, np.unique(candidates), bundle)
    triangle = np.full((len(rows), width), NOTHING, dtype=np.int32)
    s = np.full((len(rows), width), np.nan)
    ties: list[tuple[int, int, int]] = []
    # Pairs are sorted by pixel, and the pixels are computed in turn.
    pixels, starts = np.unique(pixel, return_index=True)
    ends = np.append(starts, len(pixel))[1:]
    for number, start, end in zip(pixels.tolist(), starts.tolist(), ends.tolist(), strict=True):
        row, column = divmod(number, width)
        pairs = zip(candidates[start:end].tolist(), nearest[start:end].tolist(), strict=True)
        winners, where = lines.first(rows.start + row, column, list(pairs))
        if winners:
            triangle[row, column], s[row, column] = winners[0], where
        if len(winners) > 1:
            ties.extend((rows.start + row, column, winner) for winner in winners)
    return ExactRows(triangle=triangle, s=s, ties=np.array(ties, dtype=np.int64).reshape(-1, 3))


def first_on_lines(triangles: Floats, lines: LineGrid) -> ExactRows:
    """Compute in integers the first of the triangles (F, 3, 3) on every line of a grid.

    Each line passes through its own point, and is computed by itself.
    """
    width, height = lines.resolution
    triangle = np.full((height, width), NOTHING, dtype=np.int32)
    s = np.full((height, width), np.nan)
    ties = [np.zeros((0, 3), dtype=np.int64)]
    for row in range(height):
        for column in range(width):
            line = first_by_brute_force(triangles, lines.line(column, row), range(1))
            triangle[row, column], s[row, column] = line.triangle[0, 0], line.s[0, 0]
            ties.append(line.ties + np.array([row, column, 0]))
    return ExactRows(triangle=triangle, s=s, ties=np.concatenate(ties))


def _boxes_met(
    triangles: Floats, bundle: RayBundle, rows: range
) -> tuple[Indices, Indices, Floats]:
    """Return pairs (N,) of a pixel and a triangle that it may hit, with a lower bound of s.

    Pixels are numbered within these rows; pairs are sorted by pixel, then by this bound. A point of
    the line has x - cx = s dx and s = cz - z. If the point lies in a triangle, s lies between the
    smallest and the largest s of the corners, and s dx between the products of these two with dx.
    In addition, x - cx lies between its smallest and largest value at the corners. The two
    intervals must overlap, in x and in y. Boxes are widened by `BOX_MARGIN`, so that rounding loses
    no pair.
    """
    center, slopes = np.asarray(bundle.center), (bundle.dx, bundle.dy[rows.start : rows.stop])
    steepest = max(np.abs(slope).max() for slope in slopes)
    pairs = [(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))]
    for start in range(0, len(triangles), CHUNK_TRIANGLES):
        chunk = triangles[start : start + CHUNK_TRIANGLES]
        size = np.maximum(np.abs(chunk).max(axis=(1, 2), initial=0.0), np.abs(center).max())
        margin = (BOX_MARGIN * (1 + steepest) * size)[:, None]
        relative = (chunk - center) * [1.0, 1.0, -1.0]
        low, high = relative.min(axis=1) - margin, relative.max(axis=1) + margin
        near, far = (
            np.maximum(low[:, 2], bundle.s_range[0]),
            np.minimum(high[:, 2], bundle.s_range[1]),
        )
        in_row = _reached((near, far), (low[:, 1], high[:, 1]), slopes[1])
        some = np.flatnonzero((near <= far) & in_row.any(axis=1))
        in_column = _reached((near[some], far[some]), (low[some, 0], high[some, 0]), slopes[0])
        for box, columns in zip(some.tolist(), in_column, strict=True):
            rows_of_box = np.flatnonzero(in_row[box])[:, None] * bundle.resolution[0]
            pixel = (rows_of_box + np.flatnonzero(columns)).ravel()
            pairs.append(
                (pixel, np.full(len(pixel), start + box), np.full(len(pixel), low[box, 2]))
            )
    pixels, numbers, nearest = (np.concatenate(part) for part in zip(*pairs, strict=True))
    order = np.lexsort((nearest, pixels))
    return pixels[order], numbers[order], nearest[order]


def _reached(s: tuple[Floats, Floats], ends: tuple[Floats, Floats], slopes: Floats) -> Mask:
    """Return (T, N) whether lines of slopes (N,) cross intervals (T,) within ranges of s (T,)."""
    low_s, high_s = (bound[:, None] * slopes for bound in s)
    low, high = (end[:, None] for end in ends)
    return np.asarray((np.minimum(low_s, high_s) <= high) & (np.maximum(low_s, high_s) >= low))


@dataclass(frozen=True, kw_only=True)
class _Plane:
    """A triangle relative to the center, in integers: the plane is normal . q = offset.

    The triangle is projected along an axis that the plane does not contain. In the other two
    coordinates, x and y, each edge has coefficients (u, v, w): u y - v x - w is at least zero on
    the triangle's side of the edge.
    """

    normal: Integers
    offset: int
    axes: tuple[int, int]
    edges: tuple[Integers, ...]

    @classmethod
    def through(cls, corners: list[Integers]) -> _Plane | None:
        """Return plane and edges of a triangle; None without an area, because no line meets it."""
        # Step 1: the normal, by the cross product of two edges.
        p0, p1, p2 = corners
        a, b = [(q[0] - p0[0], q[1] - p0[1], q[2] - p0[2]) for q in (p1, p2)]
        normal = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
        if not any(normal):
            return None
        # Step 2: project along the axis of the normal's largest component, which is not zero.
        facing = max(range(3), key=lambda axis: abs(normal[axis]))
        x, y = (facing + 1) % 3, (facing + 2) % 3
        # Step 3: order the edges counterclockwise in x and y. The order of the corners is
        # counterclockwise if this component of the normal is positive.
        turns = (
            ((p0, p1), (p1, p2), (p2, p0)) if normal[facing] > 0 else ((p1, p0), (p2, p1), (p0, p2))
        )
        edges = []
        for start, end in turns:
            u, v = end[x] - start[x], end[y] - start[y]
            edges.append((u, v, u * start[y] - v * start[x]))
        # Step 4: compute the offset of the plane from the first corner.
        offset = normal[0] * p0[0] + normal[1] * p0[1] + normal[2] * p0[2]
        return cls(normal=normal, offset=offset, axes=(x, y), edges=tuple(edges))

    def met_by(self, d: Integers) -> Ratio | None:
        """Return the ratio s at which the line s d meets the triangle; None if it does not."""
        # Step 1: the line meets the plane at s = offset / slope; it is parallel if slope is zero.
        slope = self.normal[0] * d[0] + self.normal[1] * d[1] + self.normal[2] * d[2]
        if slope == 0:
            return None
        # Step 2: make the denominator positive, so that multiplying by it keeps inequalities.
        offset, slope = (self.offset, slope) if slope > 0 else (-self.offset, -slope)
        # Step 3: test slope times the point against slope times the equation of each edge.
        x, y = offset * d[self.axes[0]], offset * d[self.axes[1]]
        if any(u * y - v * x < w * slope for u, v, w in self.edges):
            return None
        return offset, slope


class _Integral:
    """Scale 2**bits that converts a set of finite doubles to integers."""

    def __init__(self, values: Floats) -> None:
        denominators = {value.as_integer_ratio()[1] for value in np.unique(values).tolist()}
        self.bits = max(denominators, default=1).bit_length() - 1

    def __call__(self, value: float) -> int:
        numerator, denominator = value.as_integer_ratio()
        return numerator << (self.bits - denominator.bit_length() + 1)


class _ExactLines:
    """Lines of a ray bundle, and the triangles (F, 3, 3) that they may meet, in integers."""

    def __init__(self, triangles: Floats, numbers: Indices, bundle: RayBundle) -> None:
        # Lengths have one scale and slopes another, each a power of two.
        corners = triangles[numbers]
        length = _Integral(np.concatenate((corners.ravel(), bundle.center, bundle.s_range)))
        slope = _Integral(np.concatenate((bundle.dx, bundle.dy)))
        self._bits = length.bits, slope.bits
        self._dx, self._dy = (
            [slope(value) for value in axis.tolist()] for axis in (bundle.dx, bundle.dy)
        )
        self._begin, self._end = (length(float(end)) for end in bundle.s_range)
        cx, cy, cz = (length(float(value)) for value in bundle.center)
        self._planes = {
            number: _Plane.through(
                [(length(x) - cx, length(y) - cy, length(z) - cz) for x, y, z in points]
            )
            for number, points in zip(numbers.tolist(), corners.tolist(), strict=True)
        }

    def first(
        self, row: int, column: int, pairs: list[tuple[int, float]]
    ) -> tuple[list[int], float]:
        """Return the triangles of the first hit and the double nearest to s; pairs ascend by s."""
        length_bits, slope_bits = self._bits
        d = (self._dx[column], self._dy[row], -(1 << slope_bits))
        winners, first, where = list[int](), (0, 1), float("nan")
        for number, bound in pairs:
            # All further candidates lie behind the hit.
            if winners and bound > where:
                break
            plane = self._planes[number]
            met = plane.met_by(d) if plane else None
            if (
                met is None
                or not self._begin * met[1] <= met[0] << slope_bits <= self._end * met[1]
            ):
                continue
            # Compare two ratios: multiplying by both positive denominators keeps the sign.
            ahead = met[0] * first[1] - first[0] * met[1]
            if not winners or ahead < 0:
                # Python rounds a quotient of integers once, to the nearest double.
                winners, first = [number], met
                where = (met[0] << slope_bits) / (met[1] << length_bits)
            elif ahead == 0:
                winners.append(number)
        return sorted(winners), where
