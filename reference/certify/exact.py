"""Intersection in integer arithmetic: whether and where a line meets a triangle.

All coordinates and slopes are doubles, hence integers over a common power of two. Every quantity in
this module is a Python integer or a ratio of two integers. Triangles are closed, and a line in a
triangle's plane does not meet the triangle: a surface seen exactly edge-on covers nothing
(docs/truth.md).
"""

import math
from collections import deque
from fractions import Fraction
from functools import cached_property, lru_cache
from weakref import ref

import numpy as np

from xfrustum.reference.lines import RayBundle
from xfrustum.scenes.arrays import Floats

Integers = tuple[int, int, int]


def _fraction_bits(values: Floats) -> int:
    """Return the smallest b >= 0 with values * 2**b all integers."""
    values = values[values != 0]
    if not len(values):
        return 0
    mantissa, exponent = np.frexp(values)
    digits = np.rint(np.abs(mantissa) * 2.0**53).astype(np.int64)
    trailing = np.log2((digits & -digits).astype(np.float64)).astype(np.int64)
    return int(max(0, (53 - trailing - exponent).max()))


#: Number of scenes in the cache of bit counts; all apertures of a plate share one entry
REMEMBERED_SCENES = 8

_REMEMBERED: deque[tuple[ref[Floats], int]] = deque(maxlen=REMEMBERED_SCENES)


def _bits_of_scene(triangles: Floats) -> int:
    """Return the smallest b >= 0 with triangles * 2**b all integers; cache it if read-only."""
    for known, bits in tuple(_REMEMBERED):
        if known() is triangles:
            return bits
    bits = _fraction_bits(triangles.ravel())
    if not triangles.flags.writeable:
        _REMEMBERED.append((ref(triangles), bits))
    return bits


def _scaled(value: float, bits: int) -> int:
    """Return value * 2**bits, which must be an integer."""
    numerator, denominator = float(value).as_integer_ratio()
    return (numerator << bits) // denominator


def _cross(a: Integers, b: Integers) -> Integers:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _dot(a: Integers, b: Integers) -> int:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


class ExactPencil:
    """Intersections of a ray bundle's lines with the triangles of a scene, in integers.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners of the scene's triangles, in scene units.
    bundle
        Lines through one point.
    """

    def __init__(self, triangles: Floats, bundle: RayBundle) -> None:
        self._triangles = triangles
        self._bundle = bundle
        self._range = (Fraction(bundle.s_range[0]), Fraction(bundle.s_range[1]))
        self.cone = lru_cache(maxsize=1 << 16)(self._cone)

    @cached_property
    def _bits(self) -> int:
        """Number of binary digits after the point with which every coordinate is exact."""
        return max(_bits_of_scene(self._triangles), _fraction_bits(np.asarray(self._bundle.center)))

    @cached_property
    def _slope_bits(self) -> int:
        """Number of binary digits after the point with which every slope is exact."""
        return max(_fraction_bits(self._bundle.dx), _fraction_bits(self._bundle.dy))

    @cached_property
    def _center(self) -> Integers:
        """The center times 2**bits."""
        x, y, z = (_scaled(coordinate, self._bits) for coordinate in self._bundle.center)
        return x, y, z

    def _corners(self, triangle: int) -> list[Integers]:
        """Return a triangle's corners relative to the center, times 2**bits."""
        return [
            (
                _scaled(p[0], self._bits) - self._center[0],
                _scaled(p[1], self._bits) - self._center[1],
                _scaled(p[2], self._bits) - self._center[2],
            )
            for p in self._triangles[triangle].tolist()
        ]

    def _cone(self, triangle: int) -> tuple[tuple[Integers, Integers, Integers], Integers, int]:
        """Return normals of the edge planes, normal and offset of the plane of a triangle."""
        q0, q1, q2 = self._corners(triangle)
        e01, e12, e20 = _cross(q0, q1), _cross(q1, q2), _cross(q2, q0)
        # (p1 - p0) x (p2 - p0), expanded, is the sum of the three edge normals.
        normal = (e01[0] + e12[0] + e20[0], e01[1] + e12[1] + e20[1], e01[2] + e12[2] + e20[2])
        return (e01, e12, e20), normal, _dot(q0, normal)

    def direction(self, pixel: int) -> Integers:
        """Return d of a pixel (row * W + column) times 2**slope_bits."""
        row, column = divmod(pixel, self._bundle.resolution[0])
        return (
            _scaled(self._bundle.dx[column], self._slope_bits),
            _scaled(self._bundle.dy[row], self._slope_bits),
            -(1 << self._slope_bits),
        )

    def meets(self, pixel: int, triangle: int) -> Fraction | None:
        """Return s at which a pixel's line meets a triangle; None for a miss or out of range."""
        d = self.direction(pixel)
        edges, normal, offset = self.cone(triangle)
        # A line in the triangle's plane, or parallel to it, does not meet it.
        slope = _dot(d, normal)
        if slope == 0:
            return None
        # Edge functions of both signs mean a miss. Zero belongs to the closed triangle.
        signs = [_dot(d, edge) for edge in edges]
        if min(signs) < 0 < max(signs):
            return None
        # The offset has three factors of 2**bits; the slope has two, and one factor of
        # 2**slope_bits.
        s = Fraction(offset << self._slope_bits, slope << self._bits)
        return s if self._range[0] <= s <= self._range[1] else None

    def meets_beside_center(self, triangle: int) -> bool:
        """Return whether the triangle's plane does not contain the center."""
        return self.cone(triangle)[2] != 0

    def aims_past(self, triangle: int) -> bool:
        """Return whether a triangle is a needle toward the center, but not on pixel 0's line."""
        edges, _, _ = self.cone(triangle)
        if edges != ((0, 0, 0),) * 3:
            return False
        d = self.direction(0)
        return any(_cross(d, q) != (0, 0, 0) for q in self._corners(triangle))

    def box_holds(self, triangle: int) -> bool:
        """Return whether pixel 0 lies in one of the two boxes of a triangle; see `boxes`.

        A box, on one side of the center, bounds slopes x / s. It contains dx if x - s dx has both
        signs, or a zero, over the corners on this side and the points where edges cross s = 0.
        """
        q, d, unit = self._corners(triangle), self.direction(0), 1 << self._slope_bits
        s = [-corner[2] for corner in q]

        def between(axis: int, side: int) -> bool:
            ahead = [side * depth > 0 for depth in s]
            signs = [q[i][axis] * unit - s[i] * d[axis] for i in range(3) if ahead[i]]
            crossing = [(i, j) for i in range(3) for j in range(3) if ahead[i] and not ahead[j]]
            signs += [side * (q[j][axis] * s[i] - q[i][axis] * s[j]) for i, j in crossing]
            return bool(signs) and min(signs) <= 0 <= max(signs)

        return any(between(0, side) and between(1, side) for side in (1, -1))

    def contains_center(self, triangle: int) -> bool:
        """Return whether the center lies in a closed triangle: every line meets it at s = 0."""
        edges, normal, offset = self.cone(triangle)
        return (
            offset == 0 and normal != (0, 0, 0) and all(_dot(edge, normal) >= 0 for edge in edges)
        )

    def zero(self, triangle: int) -> float:
        """Return the signed zero 0 / (d . n) of the first pixel."""
        return math.copysign(0.0, _dot(self.direction(0), self.cone(triangle)[1]))

    def coplanar(self, first: int, second: int) -> bool:
        """Return whether every line meets two triangles' planes at the same s."""
        _, a, a_offset = self.cone(first)
        _, b, b_offset = self.cone(second)
        return _cross(a, b) == (0, 0, 0) and all(
            a[i] * b_offset == b[i] * a_offset for i in range(3)
        )
