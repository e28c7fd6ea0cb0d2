"""Distances of points from triangles."""

from __future__ import annotations

import numpy as np

from xfrustum.reference.lines.planes import cross_products, triangle_normals
from xfrustum.scenes.arrays import Floats, Mask

FAR_TOLERANCES = 2.0
"""Tolerances of distance from a triangle's plane beyond which a point surely is apart from the triangle. A
triangle is no nearer than its plane, and a tolerance is some 16 roundings of float32: the roundings of both
distances in double precision cannot make up for a factor of two."""


def apart(points: Floats, corners: Floats, tolerance: Floats) -> Mask:
    """Return which points are farther than their tolerance from their own triangle."""
    normals = triangle_normals(corners)
    length = np.linalg.norm(normals, axis=1)
    along = np.abs(np.einsum("ij,ij->i", points - corners[:, 0], normals))
    far: Mask = along > FAR_TOLERANCES * tolerance * length
    # Triangles without area have no plane.
    far &= length > 0
    # Near the plane, the distance from the triangle itself decides.
    near = np.flatnonzero(~far)
    far[near] = distance_to_triangles(points[near], corners[near]) > tolerance[near]
    return far


def distance_to_triangles(points: Floats, corners: Floats) -> Floats:
    """Return the distance of each point (N, 3) from its own triangle (N, 3, 3)."""
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
