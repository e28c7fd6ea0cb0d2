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

from dataclasses import dataclass

import numpy as np

from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats, Indices, Mask

UNIT_ROUNDOFF = 2.0**-53
"""Largest relative error of one rounded operation in double precision, u."""

ROUNDING = 12 * UNIT_ROUNDOFF
"""Bound on rounding errors, relative to the sum of absolute products: 8 u by the derivation, and 4 u for the
rounding of the bound itself."""

EDGES = ((0, 1), (1, 2), (2, 0))
"""First and second corner of each edge of a triangle."""


def cross(a: Floats, b: Floats) -> Floats:
    """Return a x b of vectors (3, T)."""
    return np.stack((a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]))


def cross_magnitude(a: Floats, b: Floats) -> Floats:
    """Return the sums of absolute products in a x b (3, T), to which its rounding errors are relative."""
    a, b = np.abs(a), np.abs(b)
    return np.stack((a[1] * b[2] + a[2] * b[1], a[2] * b[0] + a[0] * b[2], a[0] * b[1] + a[1] * b[0]))


def _dot(a: Floats, b: Floats) -> Floats:
    product = a * b
    return np.asarray(product[0] + product[2] + product[1])


def s_bounds(z: Floats, pencil: Pencil) -> tuple[Floats, Floats]:
    """Return a lower and an upper bound of s over each triangle, given q_z of its corners (3, T).

    A corner has s = -q_z; q_z is exact where the center lies in the plate.
    """
    low, high = -z.max(axis=0), -z.min(axis=0)
    slack = 0.0 if pencil.center[2] == 0 else 2 * UNIT_ROUNDOFF
    return low - slack * np.abs(low), high + slack * np.abs(high)


@dataclass(frozen=True, kw_only=True, eq=False)
class Cones:
    """Some triangles as seen from a pencil's center, with the magnitudes that bound their rounding errors.

    Attributes
    ----------
    number
        (T,) triangle numbers.
    edge, edge_magnitude
        (3, 3, T) q_i x q_j of the edges 01, 12, 20, by edge and coordinate, and the sums of
        absolute products in it.
    normal, normal_magnitude
        (3, T) n, not normalized, and the sums of absolute products in it.
    plane, plane_bound
        (T,) q_0 . n, and the bound of its rounding error.
    holds_center
        (T,) whether the center lies exactly in the closed triangle: then every line meets it at s = 0.
    within
        (T,) whether all corners, and hence all of the triangle, surely lie in the pencil's range.
    """

    number: Indices
    edge: Floats
    edge_magnitude: Floats
    normal: Floats
    normal_magnitude: Floats
    plane: Floats
    plane_bound: Floats
    holds_center: Mask
    within: Mask


def cones(
    triangles: Floats,
    number: Indices,
    pencil: Pencil,
    holds_center: Mask | None = None,
) -> Cones:
    """Return the triangles with the given numbers as cones.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners of all triangles of a scene.
    number
        (T,) numbers of the triangles that are wanted.
    pencil
        Lines through the center.
    holds_center
        (T,) whether each is known to contain the center; None where none does.
    """
    if holds_center is None:
        holds_center = np.zeros(len(number), dtype=np.bool_)
    # Corner, coordinate, triangle: the corners p_i.
    points = np.ascontiguousarray(triangles[number].transpose(1, 2, 0))
    center = np.asarray(pencil.center)[:, None]
    low, high = s_bounds(points[:, 2] - center[2], pencil)
    within = (low >= pencil.s_range[0]) & (high <= pencil.s_range[1])
    return cones_about(center, points, number, within, holds_center)


def cones_about(center: Floats, points: Floats, number: Indices, within: Mask, holds_center: Mask) -> Cones:
    """Return triangles as cones about a center, or each about a center of its own.

    Parameters
    ----------
    center
        (3, 1) the common center, or (3, T) centers.
    points
        (3, 3, T) corners p_i by corner and coordinate, scene units.
    number, within, holds_center
        (T,) as in `Cones`.
    """
    # The corners q_i relative to the center. One rounding each.
    corners = points - center
    # The normal, from edge vectors p_j - p_0: q_j - q_0 would be rounded twice.
    first, second = points[1] - points[0], points[2] - points[0]
    normal, normal_magnitude = cross(first, second), cross_magnitude(first, second)
    # The plane's distance, and its bound from the sum of all absolute products in q_0 . n. Where the center
    # lies in the triangle both are exactly zero.
    plane = _dot(corners[0], normal)
    plane_bound = ROUNDING * _dot(np.abs(corners[0]), normal_magnitude)
    return Cones(
        number=number,
        edge=np.stack([cross(corners[i], corners[j]) for i, j in EDGES]),
        edge_magnitude=np.stack([cross_magnitude(corners[i], corners[j]) for i, j in EDGES]),
        normal=normal,
        normal_magnitude=normal_magnitude,
        plane=np.where(holds_center, 0.0, plane),
        plane_bound=np.where(holds_center, 0.0, plane_bound),
        holds_center=holds_center,
        within=within,
    )
