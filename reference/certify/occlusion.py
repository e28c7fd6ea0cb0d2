"""Occlusion query: points of an image hidden by other surfaces on their own lines (docs/truth.md).

A point's own line has the slopes (x - a_x)/s and (y - a_y)/s, as doubles. Each point has a
tolerance, the bound of its position error. A triangle hides the point under two conditions: the
line meets it in front of the point by more than half the tolerance, and the point is farther from
the triangle's plane than the tolerance. A point closer to the plane may really lie on its other
side, where the triangle does not hide it.

The lines are traced as rays: the walk and the filter of `reference.rays` return the triangles that
a line may meet in front of its point. Pairs that doubles leave open are decided in rational
arithmetic.
"""

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

from xfrustum.reference.backend import (
    Float64,
    UInt32,
    constants,
    cross,
    difference,
    dot,
    dr,
    on_device,
    product,
    recording,
    vectors_on_device,
)
from xfrustum.reference.certify.cone import ROUNDING, UNDERFLOW, Planes, Triangles
from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.lines import RayBundle
from xfrustum.reference.rays.filter import meet
from xfrustum.reference.rays.rays import RAYS_AT_ONCE, Candidates, ExactMesh
from xfrustum.reference.rays.walk import Rays
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfacePoints:
    """Surface points of an image."""

    position: Floats  #: (N, 3) scene units, not at the height of the center of projection
    #: (N,) number of the triangle that contains the point, `NOTHING` if unknown
    triangle: Numbers
    #: (N,) uncertainty of each point, scene units: a triangle with its plane within this distance
    #: does not hide the point. Tessellation of a surface therefore has no effect.
    tolerance: Floats

    def __getitem__(self, some: slice) -> "SurfacePoints":
        """Return a slice of the points."""
        return SurfacePoints(**{name: values[some] for name, values in vars(self).items()})


class Occlusion:
    """Query of the points that the triangles of a scene hide."""

    def __init__(self, triangles: Triangles) -> None:
        self._triangles = triangles

    @cached_property
    def _mesh(self) -> ExactMesh:
        return ExactMesh.from_triangles(self._triangles.corners)

    def hidden(self, bundle: RayBundle, points: SurfacePoints) -> Mask:
        """Return a mask (N,) of points behind another surface on their own line from the center."""
        behind = np.zeros(len(points.position), dtype=np.bool_)
        if not len(self._triangles):
            return behind
        # Process the points in parts, to bound the memory of rays and pairs.
        for start in range(0, len(behind), RAYS_AT_ONCE):
            part = slice(start, start + RAYS_AT_ONCE)
            behind[part] = self._hidden(bundle, points[part])
        return behind

    def _hidden(self, bundle: RayBundle, points: SurfacePoints) -> Mask:
        pairs = self._pairs(bundle, points)
        behind = np.zeros(len(points.position), dtype=np.bool_)
        if not len(pairs.ray):
            return behind
        beyond, within = self._off_planes(points, pairs)
        behind[pairs.ray[pairs.sure & beyond]] = True
        # Only points that no triangle certainly hides need rational arithmetic.
        left = pairs[~within & ~behind[pairs.ray]]
        met = self._hides(bundle, points, left.ray, left.triangle)
        behind[left.ray[met]] = True
        return behind

    def _pairs(self, bundle: RayBundle, points: SurfacePoints) -> Candidates:
        """Return the pairs of points and other triangles that may be in front of them."""
        with recording():
            # Error bounds exceed the errors, so that a hit certainly within the closed range is
            # before its end.
            pairs = self._mesh.candidates_of(_lines_to(self._mesh, bundle, points))
        pairs = pairs[points.triangle[pairs.ray] != pairs.triangle]
        # Doubles leave open all lines that meet a triangle in the center itself, at s = 0. A line
        # in the triangle's plane has an infinite error, and does not meet the triangle.
        exact = ExactPencil(self._triangles.corners, bundle)
        depth = bundle.center[2] - points.position[pairs.ray, 2]
        through = (depth > points.tolerance[pairs.ray]) & (bundle.s_range[0] <= 0)
        through &= np.isfinite(pairs.error)
        for number in np.unique(pairs.triangle[through & ~pairs.sure]).tolist():
            corners = self._triangles.corners[number] - bundle.center
            touches = (corners.min(axis=0) <= 0).all() and (corners.max(axis=0) >= 0).all()
            if touches and exact.contains_center(number):
                pairs.sure[through & (pairs.triangle == number)] = True
        return pairs

    def _off_planes(self, points: SurfacePoints, pairs: Candidates) -> tuple[Mask, Mask]:
        """Return masks of points certainly off the triangles' planes, and certainly not off them.

        A point P is off a plane if it is farther away than its tolerance t:
        |(p_0 - P) . n| > t |n|.
        """
        with recording():
            position = vectors_on_device(points.position[pairs.ray])
            tolerance = on_device(points.tolerance[pairs.ray])
            corners = self._triangles.points(UInt32(on_device(pairs.triangle)))
            planes = Planes.from_points(corners, position, False)
            # The rounding bounds of n's coordinates bound the error of |n|.
            length, magnitude = (
                dr.sqrt(dot(values, values)) for values in (planes.normal, planes.magnitude)
            )
            beyond = abs(planes.offset) - product(tolerance, length)
            bound = planes.bound + product(product(ROUNDING, tolerance), magnitude) + UNDERFLOW
            surely, not_at_all = beyond > bound, beyond < -bound
            dr.eval(surely, not_at_all)
            return surely.numpy(), not_at_all.numpy()

    def _hides(
        self, bundle: RayBundle, points: SurfacePoints, point: Indices, triangle: Indices
    ) -> Mask:
        """Return a mask of the pairs whose triangle hides the point, in rational arithmetic."""
        if not len(point):
            return np.zeros(0, dtype=np.bool_)
        position, tolerance = points.position[point], points.tolerance[point]
        # The same doubles as in `_lines_to`.
        offset = position - bundle.center
        dx, dy = offset[:, 0] / -offset[:, 2], offset[:, 1] / -offset[:, 2]
        ends = -offset[:, 2] - tolerance / (2 * np.sqrt(dx * dx + dy * dy + 1.0))
        directions = np.stack((dx, dy, np.full(len(point), -1.0)), axis=1)
        corners = self._triangles.corners[triangle]
        centers = np.tile(bundle.center, (len(point), 1))
        # A line that ends before the range begins meets no triangle.
        ranges = np.stack((np.full(len(point), bundle.s_range[0]), ends), axis=1)
        decided = meet(corners, centers, directions, ranges)
        hides = decided.met
        for pair in np.flatnonzero(hides).tolist():
            hides[pair] = decided.place(pair) < Fraction(ends[pair]) and _off_plane(
                position[pair], corners[pair], float(tolerance[pair])
            )
        return hides


def _lines_to(mesh: ExactMesh, bundle: RayBundle, points: SurfacePoints) -> Rays:
    """Return the lines to points as rays, each ending half a tolerance before its point."""
    *center, first = constants([*bundle.center, bundle.s_range[0]])
    x, y, z = vectors_on_device(points.position)
    s = center[2] - z
    dx, dy = (x - center[0]) / s, (y - center[1]) / s
    steepness = dr.sqrt(product(dx, dx) + product(dy, dy) + 1.0)
    end = s - on_device(points.tolerance) / product(2.0, steepness)
    lanes = dr.zeros(Float64, dr.width(end))
    return mesh.rays_from(bundle.center, [dx, dy, lanes - 1.0], (lanes + first, end))


def _off_plane(point: Floats, corners: Floats, tolerance: float) -> bool:
    """Return whether a point is farther than a tolerance from a plane, in rational arithmetic.

    False for a triangle without area.
    """
    p, *triangle = (
        [Fraction(value) for value in row] for row in (point.tolist(), *corners.tolist())
    )
    first, second = difference(triangle[1], triangle[0]), difference(triangle[2], triangle[0])
    normal = cross(first, second)
    along = dot(difference(triangle[0], p), normal)
    return bool(along * along > Fraction(tolerance) ** 2 * dot(normal, normal))
