"""Planes of triangles and distances from them, in NumPy, in doubles and without bounds of their rounding."""

from __future__ import annotations

import numpy as np

from xfrustum.scenes.arrays import Floats


def cross_products(a: Floats, b: Floats) -> Floats:
    """Return the cross products of vectors (N, 3): the same numbers as `np.cross`, in a third of the time."""
    (ax, ay, az), (bx, by, bz) = np.ascontiguousarray(a.T), np.ascontiguousarray(b.T)
    return np.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx), axis=1)


def triangle_normals(corners: Floats) -> Floats:
    """Return the cross products of the first two edges of triangles (N, 3, 3)."""
    return cross_products(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def plane_places(corners: Floats, normals: Floats, center: Floats, directions: Floats) -> Floats:
    """Return s at which lines center + s d meet the planes of triangles, one triangle for each line, (N,).

    Parameters
    ----------
    corners, normals
        (N, 3, 3) triangles and (N, 3) their `triangle_normals`.
    center
        (3,) point that all lines pass through.
    directions
        (N, 3) d of each line.

    Returns
    -------
    s is not finite where a line is parallel to the plane, or where the triangle has no area.
    """
    offset = np.einsum("ij,ij->i", normals, corners[:, 0] - center)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(offset / np.einsum("ij,ij->i", normals, directions))


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
