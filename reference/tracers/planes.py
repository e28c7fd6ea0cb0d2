"""Meetings of lines with the planes of triangles, in double precision without bounds.

They serve the proposals of tracers, not the certificate: `certify.narrow` bounds the same quotient.
"""

from __future__ import annotations

import numpy as np

from xfrustum.scenes.arrays import Floats


def plane_normals(corners: Floats) -> Floats:
    """Return the cross product (N, 3) of the first two edges of triangles (N, 3, 3)."""
    return cross_of_pairs(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def plane_places(corners: Floats, center: Floats, directions: Floats) -> Floats:
    """Return s where each line center + s d meets its own triangle's plane, (N,).

    Infinite or NaN where the line is parallel to the plane.

    Parameters
    ----------
    corners
        (N, 3, 3) corners of the triangles, scene units.
    center
        (3,) the lines' common point.
    directions
        (N, 3) direction d of each line, of any length.
    """
    normals = plane_normals(corners)
    offset = np.einsum("ij,ij->i", normals, corners[:, 0] - center)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(offset / np.einsum("ij,ij->i", normals, directions))


def cross_of_pairs(a: Floats, b: Floats) -> Floats:
    """Return a x b of vectors (N, 3): the numbers of `numpy.cross`, in a third of the time."""
    (ax, ay, az), (bx, by, bz) = np.ascontiguousarray(a.T), np.ascontiguousarray(b.T)
    return np.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx), axis=1)
