"""Distances of points from triangles and from their planes."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from xfrustum.reference.certify.narrow import UNDERFLOW
from xfrustum.reference.devices.arithmetic import NUMPY, cross, difference, dot
from xfrustum.reference.lines.cone import ROUNDING, Planes
from xfrustum.reference.lines.planes import cross_products, triangle_normals
from xfrustum.scenes.arrays import Floats, Mask


def off_planes(points: Floats, corners: Floats, tolerance: Floats) -> Mask:
    """Return which points are farther than a tolerance from the plane of a triangle.

    Doubles decide it within the bounds of their rounding (`cone`), and rational numbers what these leave
    open.

    Parameters
    ----------
    points
        (N, 3) points.
    corners
        (N, 3, 3) one triangle for each point. One without area has no plane, and no point is off it.
    tolerance
        (N,) distances.
    """
    planes = Planes.of(NUMPY, list(corners.transpose(1, 2, 0)), points.T, False)
    normal, magnitude = (
        np.linalg.norm(np.array(vector), axis=0) for vector in (planes.normal, planes.normal_magnitude)
    )
    # |(p_0 - P) . n| > t |n|: the length of n has the bounds of its coordinates.
    beyond = np.abs(planes.plane) - tolerance * normal
    bound = planes.plane_bound + ROUNDING * tolerance * magnitude + UNDERFLOW
    off = np.asarray(beyond > bound)
    for n in np.flatnonzero(np.abs(beyond) <= bound).tolist():
        off[n] = _surely_off_plane(points[n], corners[n], float(tolerance[n]))
    return off


def _surely_off_plane(point: Floats, corners: Floats, tolerance: float) -> bool:
    """Return, in rational numbers, whether a point is farther than a tolerance from a triangle's plane."""
    p, *triangle = ([Fraction(value) for value in row] for row in (point.tolist(), *corners.tolist()))
    first, second = difference(triangle[1], triangle[0]), difference(triangle[2], triangle[0])
    normal = cross(first, second)
    along = dot(difference(triangle[0], p), normal)
    return bool(along * along > Fraction(tolerance) ** 2 * dot(normal, normal))


def distance_to_triangles(points: Floats, corners: Floats) -> Floats:
    """Return the distance of each point (N, 3) from one triangle for each, (N, 3, 3)."""
    normals = triangle_normals(corners)
    length = np.linalg.norm(normals, axis=1)
    unit = normals / np.where(length > 0, length, 1.0)[:, None]
    inside = length > 0
    nearest_edge = np.full(len(points), np.inf)
    for k in range(3):
        # Over the triangle, along its normal: on the inner side of all three edges.
        start, edge = corners[:, k], corners[:, (k + 1) % 3] - corners[:, k]
        along = points - start
        inside &= np.einsum("ij,ij->i", cross_products(edge, along), normals) >= 0
        squared = np.einsum("ij,ij->i", edge, edge)
        share = np.einsum("ij,ij->i", along, edge) / np.where(squared > 0, squared, 1.0)
        foot = along - np.clip(share, 0.0, 1.0)[:, None] * edge
        nearest_edge = np.minimum(nearest_edge, np.linalg.norm(foot, axis=1))
    from_plane = np.abs(np.einsum("ij,ij->i", points - corners[:, 0], unit))
    return np.where(inside, from_plane, nearest_edge)
