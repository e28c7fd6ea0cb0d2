"""Location of points inside, on or outside a surface, exactly, by parity of crossings along +z.

A point is moved by an infinitesimal amount, (h, h^2, 0) with h > 0 as small as needed (simulation
of simplicity, Edelsbrunner and Muecke, 1990). The ray of the moved point passes through no vertex,
no edge and no triangle parallel to +z; it crosses any other triangle in its interior or not at all.
Points on the surface are recognized before they are moved.
"""

from collections.abc import Sequence
from enum import IntEnum
from typing import Any

import numpy as np

from xfrustum.reference.backend import cross, difference, dot
from xfrustum.reference.rays.integers import Integers, coordinates, integers
from xfrustum.reference.rays.rays import ExactMesh, RayBatch
from xfrustum.scenes.arrays import Floats, Indices, Mask


class Location(IntEnum):
    """Location of a point relative to a surface."""

    OUTSIDE = -1
    ON = 0
    INSIDE = 1


def locate(mesh: ExactMesh, points: Floats) -> Indices:
    """Return the `Location` (N,) of points (N, 3) by the parity of surfaces above them."""
    location = np.full(len(points), Location.OUTSIDE, dtype=np.int64)
    low, high = mesh.triangles.min(axis=(0, 1)), mesh.triangles.max(axis=(0, 1))
    within = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
    inside = points[within]
    up = np.zeros_like(inside)
    up[:, 2] = 1.0
    ends = np.tile([0.0, np.inf], (len(inside), 1))
    pairs = mesh.candidates(RayBatch(origins=inside, directions=up, ends=ends))
    # The ray crosses a certain hit in its interior, above the point, before and after the move.
    crossings = np.bincount(pairs.ray[pairs.sure], minlength=len(inside))
    doubtful = pairs[~pairs.sure]
    on, crossed = crossings_above(mesh.triangles[doubtful.triangle], inside[doubtful.ray])
    crossings += np.bincount(doubtful.ray[crossed], minlength=len(inside))
    location[within[crossings % 2 == 1]] = Location.INSIDE
    location[within[doubtful.ray[on]]] = Location.ON
    return location


def crossings_above(triangles: Floats, points: Floats) -> tuple[Mask, Mask]:
    """Return masks of points on triangles (K, 3, 3), and of triangles above moved points.

    Points (K, 3) and triangles are paired; the decisions are made in integers.
    """
    (corners, start), _ = integers(triangles, points)
    p, origin = coordinates(corners), coordinates(start)
    q = [difference([axis[:, k] for axis in p], origin) for k in range(3)]
    sides = [cross(q[i], q[j]) for i, j in ((0, 1), (1, 2), (2, 0))]
    normal = [sum(side[axis] for side in sides) for axis in range(3)]
    offset = dot(q[0], normal)
    # A point is on a triangle with area if it is in the plane, on the inner side of all edges. It
    # is on a triangle without area if it is on the line of its corners, within their box.
    in_plane = (offset == 0) & _all([dot(side, normal) >= 0 for side in sides])
    flat = _all([part == 0 for part in normal])
    on_line = _all([part == 0 for side in sides for part in side])
    in_box = _all(
        [np.minimum.reduce([corner[axis] for corner in q]) <= 0 for axis in range(3)]
        + [np.maximum.reduce([corner[axis] for corner in q]) >= 0 for axis in range(3)]
    )
    on = np.where(flat, on_line & in_box, in_plane)
    # Sides of the moved point, projected along z: the sign of E - h (y_j - y_i) + h^2 (x_j - x_i)
    # is the sign of the first term that is not zero.
    signs = []
    for (i, j), side in zip(((0, 1), (1, 2), (2, 0)), sides, strict=True):
        x, y, _ = difference(q[j], q[i])
        signs.append(_first_sign([side[2], -y, x]))
    inside = (signs[0] == signs[1]) & (signs[1] == signs[2]) & (signs[0] != 0)
    above = (offset != 0) & ((offset > 0) == (normal[2] > 0))
    return on.astype(np.bool_), (inside & above).astype(np.bool_)


def open_edges(triangles: Floats) -> int:
    """Return the number of edges that belong to an odd number of triangles (F, 3, 3).

    Corners at the same position are one vertex. Zero means that the surface is closed.
    """
    # Adding 0.0 turns -0.0 into 0.0.
    _, vertex = np.unique(triangles.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
    faces = vertex.reshape(-1, 3)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges = edges[edges[:, 0] != edges[:, 1]]
    _, counts = np.unique(edges[:, 0] * len(triangles) * 3 + edges[:, 1], return_counts=True)
    return int((counts % 2).sum())


def _all(conditions: Sequence[Any]) -> Any:
    return np.logical_and.reduce(
        [np.asarray(condition, dtype=np.bool_) for condition in conditions]
    )


def _first_sign(terms: Sequence[Integers]) -> Integers:
    """Return the sign of the first term that is not zero."""
    sign: Any = 0
    for term in reversed(terms):
        own = (term > 0).astype(np.int64) - (term < 0).astype(np.int64)
        sign = np.where(own != 0, own, sign)
    return np.asarray(sign)
