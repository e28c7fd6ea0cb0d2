"""Triangles as the cones that they span about the point all lines pass through.

For q_i = p_i - center, a line center + s d meets the triangle's edge (i, j) where

    E_ij(d) = d . (q_i x q_j)

is zero, and the triangle itself where E_01, E_12 and E_20 have one common sign, on either side
of the center. It meets the triangle's plane at s = (q_0 . n) / (d . n), n = (p_1 - p_0) x (p_2 - p_0).
All three edge functions are linear in d: a crossed frustum needs no clipping and no second case.

Rounding (docs/truth.md derives the constants): with u = 2^-53, every edge function and both dot
products are computed within `ROUNDING` times their own sum of absolute products. Valid while no
product under- or overflows; coordinates between 1e-75 and 1e75, and zero, are safe.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from xfrustum.reference.devices.arithmetic import Arithmetic, Coordinates, cross, difference
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats

UNIT_ROUNDOFF = 2.0**-53
"""Largest relative error of one rounded operation in double precision, u."""

ROUNDING = 12 * UNIT_ROUNDOFF
"""Bound on rounding errors, relative to the sum of absolute products: 8 u by the derivation, and 4 u for the
rounding of the bound itself."""

EDGES = ((0, 1), (1, 2), (2, 0))
"""First and second corner of each edge of a triangle."""


def cross_magnitude(a: Coordinates, b: Coordinates) -> list[Any]:
    """Return the sums of absolute products in a x b, to which its rounding errors are relative."""
    (ax, ay, az), (bx, by, bz) = ([abs(part) for part in vector] for vector in (a, b))
    return [ay * bz + az * by, az * bx + ax * bz, ax * by + ay * bx]


def _dot(a: Coordinates, b: Coordinates) -> Any:
    # The sums have another order than in `arithmetic.dot`, which would change the last bits of places.
    return a[0] * b[0] + a[2] * b[2] + a[1] * b[1]


def s_bounds(z: Floats, pencil: Pencil) -> tuple[Floats, Floats]:
    """Return a lower and an upper bound of s over each triangle, given q_z of its corners (3, T).

    A corner has s = -q_z; q_z is exact where the center lies in the plate.
    """
    low, high = -z.max(axis=0), -z.min(axis=0)
    slack = 0.0 if pencil.center[2] == 0 else 2 * UNIT_ROUNDOFF
    return low - slack * np.abs(low), high + slack * np.abs(high)


@dataclass(frozen=True, kw_only=True, eq=False)
class Viewpoint:
    """The center of a pencil and the ends of its range, as numbers of NumPy or Dr.Jit.

    Attributes
    ----------
    center
        The three coordinates of the common point.
    ends
        First and last s.
    slack
        Relative error of s of a corner, see `s_bounds`.
    """

    center: Coordinates
    ends: Sequence[Any]
    slack: Any

    @classmethod
    def of(cls, pencil: Pencil, by: Arithmetic) -> Viewpoint:
        """Return the viewpoint of a pencil."""
        (slack,) = by.constants([0.0 if pencil.center[2] == 0 else 2 * UNIT_ROUNDOFF])
        return cls(center=by.constants(pencil.center), ends=by.constants(pencil.s_range), slack=slack)


@dataclass(frozen=True, kw_only=True, eq=False)
class Planes:
    """The planes of some triangles, one lane each; vectors are lists of coordinates.

    Attributes
    ----------
    normal, normal_magnitude
        n, not normalized, and the sums of absolute products in it.
    plane, plane_bound
        q_0 . n, and the bound of its rounding error.
    """

    normal: Coordinates
    normal_magnitude: Coordinates
    plane: Any
    plane_bound: Any

    @classmethod
    def of(cls, by: Arithmetic, points: Sequence[Coordinates], center: Coordinates, holds: Any) -> Planes:
        """Return the planes of triangles.

        Parameters
        ----------
        by
            Arithmetic of the corners.
        points
            Corners, each with three coordinates.
        center
            Point that all lines pass through.
        holds
            Whether the triangles are known to contain the center.
        """
        # The normal, from edge vectors p_j - p_0: q_j - q_0 would be rounded twice.
        first, second = difference(points[1], points[0]), difference(points[2], points[0])
        normal, magnitude = cross(first, second), cross_magnitude(first, second)
        # The plane's distance, and its bound from the sum of all absolute products in q_0 . n. Where the
        # center lies in the triangle both are exactly zero.
        corner = difference(points[0], center)
        plane, plane_bound = _dot(corner, normal), ROUNDING * _dot([abs(part) for part in corner], magnitude)
        return cls(
            normal=normal,
            normal_magnitude=magnitude,
            plane=by.select(holds, 0.0, plane),
            plane_bound=by.select(holds, 0.0, plane_bound),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Cones:
    """Some triangles as seen from a pencil's center, with the magnitudes that bound their rounding errors.

    There is one lane for each triangle, in the arrays of NumPy or Dr.Jit.

    Attributes
    ----------
    edge, edge_magnitude
        q_i x q_j of the edges 01, 12, 20, each with three coordinates, and the sums of absolute products in
        it.
    planes
        Planes of the triangles.
    within
        Whether all corners, and hence all of the triangle, surely lie in the pencil's range.
    """

    edge: Sequence[Coordinates]
    edge_magnitude: Sequence[Coordinates]
    planes: Planes
    within: Any

    @classmethod
    def of(cls, by: Arithmetic, points: Sequence[Coordinates], seen_from: Viewpoint, holds: Any) -> Cones:
        """Return triangles as cones; parameters are those of `Planes.of`."""
        # The corners q_i relative to the center. One rounding each.
        corners = [difference(point, seen_from.center) for point in points]
        heights = [corner[2] for corner in corners]
        low = -by.maximum(by.maximum(heights[0], heights[1]), heights[2])
        high = -by.minimum(by.minimum(heights[0], heights[1]), heights[2])
        low, high = low - seen_from.slack * abs(low), high + seen_from.slack * abs(high)
        return cls(
            edge=[cross(corners[i], corners[j]) for i, j in EDGES],
            edge_magnitude=[cross_magnitude(corners[i], corners[j]) for i, j in EDGES],
            planes=Planes.of(by, points, seen_from.center, holds),
            within=(low >= seen_from.ends[0]) & (high <= seen_from.ends[1]),
        )
