"""Triangles as cones about the common point of all lines, with rounding bounds.

For q_i = p_i - center, a line center + s d meets the triangle's edge (i, j) where

    E_ij(d) = d . (q_i x q_j)

is zero, and the triangle itself if E_01, E_12 and E_20 have the same sign, on either side of the
center. It meets the triangle's plane at s = (q_0 . n) / (d . n), n = (p_1 - p_0) x (p_2 - p_0). All
three edge functions are linear in d: a crossed frustum needs no clipping and no second case.

Rounding (docs/truth.md derives the constants): with u = 2^-53, the error of every edge function and
of both dot products is at most `ROUNDING` times the sum of absolute products. This is valid as long
as no product underflows or overflows: coordinates between 1e-75 and 1e75, and zero, are safe.

All arrays are Dr.Jit arrays, with one lane for each pair of a line and a triangle, or for each row
of a triangle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from xfrustum.reference.backend import (
    Array4f64,
    Float64,
    constants,
    cross,
    difference,
    dr,
    on_device,
    product,
    recording,
)
from xfrustum.reference.lines import RayBundle
from xfrustum.scenes.arrays import Floats, Indices

#: largest relative error of one rounded operation in double precision, u
UNIT_ROUNDOFF = 2.0**-53

#: Bound on rounding errors, relative to the sum of absolute products: 8 u by the derivation, plus 4
#: u for the rounding of the bound itself
ROUNDING = 12 * UNIT_ROUNDOFF

#: Smallest double of full precision. Below it, each of the three quotients and products in s and
#: its bound has an error of at most half a step, 2^-1075, whatever its size; this number covers all
#: three.
UNDERFLOW = 2.0**-1022

#: Number of consecutive triangles (a run) in a common box. Meshes list neighbors together: for the
#: car's hogels, shares of 0.30 (C) and 0.05 (C*) of all triangles are kept on average; a box for
#: each triangle would keep 0.22 and 0.02.
RUN = 32

#: Widening of a film, relative to its steepest slope, in the test of boxes of runs: 2^32 times the
#: rounding of the test
RUN_MARGIN = 2.0**-20

#: first and second corner of each edge of a triangle
EDGES = ((0, 1), (1, 2), (2, 0))


class Triangles:
    """Corners (F, 3, 3) of triangles on the device, shared by all ray bundles, 96 bytes each."""

    def __init__(self, corners: Floats) -> None:
        self.corners = corners
        # Corners are padded to four numbers, because a gather reads four adjacent numbers at once.
        padded = np.zeros((len(corners), 3, 4))
        padded[..., :3] = corners
        with recording():
            self._rows = on_device(padded)

    @cached_property
    def extent(self) -> Floats:
        """Largest absolute x, y and z of all corners, (3,)."""
        return np.asarray(np.abs(self.corners).max(axis=(0, 1), initial=0.0))

    @cached_property
    def _boxes_of_runs(self) -> tuple[Floats, Floats]:
        """Smallest and largest coordinates of each run of triangles, (R, 3)."""
        begins = np.arange(0, len(self.corners), RUN)
        return (
            np.minimum.reduceat(self.corners.min(axis=1), begins),
            np.maximum.reduceat(self.corners.max(axis=1), begins),
        )

    def __len__(self) -> int:
        """Return the number of triangles."""
        return len(self.corners)

    def before(self, bundle: RayBundle) -> Indices:
        """Return the numbers of triangles, ascending, without runs that a bundle surely misses."""
        if not len(self):
            return np.zeros(0, dtype=np.int64)
        low, high = (ends - bundle.center for ends in self._boxes_of_runs)
        lowest, highest = low[:, 2], high[:, 2]
        first, last = (RUN_MARGIN * abs(end) for end in bundle.s_range)
        ranged = (highest >= -bundle.s_range[1] - last) & (lowest <= first - bundle.s_range[0])
        met = np.zeros(len(low), dtype=np.bool_)
        for side in (1, -1):
            if side * bundle.s_range[side > 0] <= 0:
                continue
            # On this side of the center, at s = -z, lines keep x between (k - t) s and (k + t) s.
            between = ranged.copy()
            for axis, (k, t) in enumerate(zip(bundle.shear, bundle.half_extent, strict=True)):
                wide = side * (t + RUN_MARGIN * (abs(k) + t))
                for least, slope in ((low[:, axis], wide + k), (-high[:, axis], wide - k)):
                    between &= least + np.minimum(slope * lowest, slope * highest) <= 0
            met |= between
        runs = np.flatnonzero(met)
        numbers = (runs[:, None] * RUN + np.arange(RUN)).ravel()
        return numbers[numbers < len(self)]

    def points(self, number: Any) -> list[list[Any]]:
        """Return the three corners of triangles by their numbers, each with three coordinates."""
        corners = [dr.gather(Array4f64, self._rows, number * 3 + k) for k in range(3)]
        return [[Float64(corner[axis]) for axis in range(3)] for corner in corners]


@dataclass(frozen=True, kw_only=True, eq=False)
class Viewpoint:
    """Center of a ray bundle, and first and last s of its range.

    `slack` is the relative error of s of a corner, -q_z; zero if the center lies in the plate.
    """

    center: list[Any]
    ends: list[Any]
    slack: Any

    @classmethod
    def from_bundle(cls, bundle: RayBundle) -> Viewpoint:
        """Return the viewpoint of a ray bundle."""
        (slack,) = constants([0.0 if bundle.center[2] == 0 else 2 * UNIT_ROUNDOFF])
        return cls(center=constants(bundle.center), ends=constants(bundle.s_range), slack=slack)

    def depths(self, heights: Sequence[Any]) -> tuple[Any, Any]:
        """Return a lower and an upper bound of s over triangles, given q_z of their corners."""
        low = -dr.maximum(dr.maximum(*heights[:2]), heights[2])
        high = -dr.minimum(dr.minimum(*heights[:2]), heights[2])
        return low - product(self.slack, abs(low)), high + product(self.slack, abs(high))


@dataclass(frozen=True, kw_only=True, eq=False)
class Planes:
    """Planes of triangles: n, not normalized, and q_0 . n, with rounding bounds.

    `magnitude` are the sums of absolute products in n. `offset` is q_0 . n, and `bound` bounds its
    rounding error.
    """

    normal: list[Any]
    magnitude: list[Any]
    offset: Any
    bound: Any

    @classmethod
    def from_points(
        cls, points: Sequence[Sequence[Any]], center: Sequence[Any], holds: Any
    ) -> Planes:
        """Return the planes of triangles; `holds` marks triangles that contain the center."""
        # The normal is computed from edge vectors p_j - p_0, because q_j - q_0 would be rounded
        # twice.
        first, second = difference(points[1], points[0]), difference(points[2], points[0])
        normal, magnitude = cross(first, second), cross_magnitude(first, second)
        # The bound is relative to the sum of absolute products in q_0 . n. If the center lies in
        # the triangle, offset and bound are exactly zero.
        corner = difference(points[0], center)
        offset = _dot(corner, normal)
        bound = product(ROUNDING, _dot([abs(part) for part in corner], magnitude))
        return cls(
            normal=normal,
            magnitude=magnitude,
            offset=dr.select(holds, 0.0, offset),
            bound=dr.select(holds, 0.0, bound),
        )

    def along_rows(self, dy: Any) -> RowPlanes:
        """Return the planes along rows of lines with slopes dy, for any dx."""
        normal, magnitude = self.normal, self.magnitude
        return RowPlanes(
            offset=self.offset,
            bound=self.bound,
            normal_x=normal[0],
            magnitude_x=magnitude[0],
            level=product(normal[1], dy) - normal[2],
            level_magnitude=product(abs(dy), magnitude[1]) + magnitude[2],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Cones:
    """Triangles seen from the center of a ray bundle.

    `edges` are q_i x q_j of the edges 01, 12 and 20, and `magnitudes` are the sums of absolute
    products in them. `within` is true if the whole triangle certainly lies in the range of the
    lines, and `holds` is true if the center lies in the closed triangle.
    """

    edges: list[list[Any]]
    magnitudes: list[list[Any]]
    planes: Any  #: `Planes`, or the planes of `directions`
    within: Any
    holds: Any

    @classmethod
    def from_points(
        cls, points: Sequence[Sequence[Any]], seen_from: Viewpoint, holds: Any
    ) -> Cones:
        """Return triangles, given by their corners, as cones."""
        # The corners q_i relative to the center, with one rounding each.
        corners = [difference(point, seen_from.center) for point in points]
        low, high = seen_from.depths([corner[2] for corner in corners])
        return cls(
            edges=[cross(corners[i], corners[j]) for i, j in EDGES],
            magnitudes=[cross_magnitude(corners[i], corners[j]) for i, j in EDGES],
            planes=Planes.from_points(points, seen_from.center, holds),
            within=(low >= seen_from.ends[0]) & (high <= seen_from.ends[1]),
            holds=holds,
        )

    def covering(self, dx: Any, dy: Any) -> tuple[Any, Any]:
        """Return whether lines may pass through the triangles, and whether they certainly do."""
        positive, negative = [], []
        for edge, magnitude in zip(self.edges, self.magnitudes, strict=True):
            value = product(edge[0], dx) + product(edge[1], dy) - edge[2]
            size = product(abs(dx), magnitude[0]) + product(abs(dy), magnitude[1]) + magnitude[2]
            bound = product(ROUNDING, size)
            positive.append(value > bound)
            negative.append(value < -bound)
        inside = (positive[0] & positive[1] & positive[2]) | (
            negative[0] & negative[1] & negative[2]
        )
        outside = (positive[0] | positive[1] | positive[2]) & (
            negative[0] | negative[1] | negative[2]
        )
        # Every line meets a triangle that contains the center, whatever its edge functions.
        return self.holds | ~outside, self.holds | inside


@dataclass(frozen=True, kw_only=True, eq=False)
class RowPlanes:
    """Planes of triangles along single rows of lines.

    Along a row d . n = normal_x dx + level; its rounding error is at most
    `ROUNDING` (magnitude_x |dx| + level_magnitude).
    """

    offset: Any
    bound: Any
    normal_x: Any
    magnitude_x: Any
    level: Any
    level_magnitude: Any

    def met(self, dx: Any) -> tuple[Any, Any]:
        """Return s where lines of slopes dx meet the planes, and a bound on its error.

        With p = offset, d . n = slope and their bounds,

            |s - s_true| <= (bound + |s| slope_bound) / (|slope| - slope_bound).

        The error is infinite where the slope may be zero, and zero where the plane passes exactly
        through the center.
        """
        # The denominator d . n and its bound. Its sign is certain, with a margin, if it exceeds
        # twice its bound.
        slope = product(self.normal_x, dx) + self.level
        slope_bound = product(ROUNDING, product(self.magnitude_x, abs(dx)) + self.level_magnitude)
        return places(self.offset, self.bound, slope, slope_bound)


def places(offset: Any, bound: Any, slope: Any, slope_bound: Any) -> tuple[Any, Any]:
    """Return s = q_0 . n / d . n of two dot products with rounding bounds, and its error bound.

    The error is infinite where the slope may be zero; see `RowPlanes.met`.
    """
    # The sign of the denominator is certain, with a margin, if it exceeds twice its bound.
    margin = abs(slope) - slope_bound
    certain = margin > slope_bound
    # The quotient; 1 in place of an uncertain slope keeps it finite.
    s = dr.select(certain, offset / dr.select(certain, slope, 1.0), 0.0)
    # The error bound due to both dot products.
    error = (bound + product(abs(s), slope_bound)) / dr.select(certain, margin, 1.0)
    # Add the roundings of this expression (1 + ROUNDING), of the quotient s (ROUNDING |s|), and of
    # quotients below full precision.
    error = product(error, 1 + ROUNDING) + product(ROUNDING, abs(s))
    error = error + dr.select(bound > 0, UNDERFLOW, 0.0)
    return s, dr.select(certain, error, np.inf)


def in_range(s: Any, error: Any, within: Any, ends: Sequence[Any]) -> tuple[Any, Any]:
    """Return whether s +- error may lie in a range, and whether the hit certainly counts.

    A triangle that certainly lies within the range is not tested against the ends of the range,
    because the test would leave hits close to the ends uncertain. If even the sign of s is
    uncertain, the triangle may be first, but its position is unknown, and the pixel is decided in
    integers. A hit with an infinite error is never certain.
    """
    largest = float(np.finfo(np.float64).max)
    first, last = dr.select(within, -largest, ends[0]), dr.select(within, largest, ends[1])
    nearest, farthest = s - error, s + error
    sure = (nearest >= first) & (farthest <= last) & (error <= abs(s))
    return (farthest >= first) & (nearest <= last), sure


def cross_magnitude(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    """Return the sums of absolute products in a x b, the scale of its rounding errors."""
    (ax, ay, az), (bx, by, bz) = ([abs(part) for part in vector] for vector in (a, b))
    sums = (ay, bz, az, by), (az, bx, ax, bz), (ax, by, ay, bx)
    return [product(a, b) + product(c, d) for a, b, c, d in sums]


def _dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    # Do not use `backend.dot`: its sums have another order, which would change the last bits of s.
    return product(a[0], b[0]) + product(a[2], b[2]) + product(a[1], b[1])
