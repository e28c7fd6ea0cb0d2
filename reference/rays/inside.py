"""Points inside of, on, and outside of a surface: parity of crossings along +z, exactly.

A point moves by an infinitesimal amount, (h, h^2, 0) with h > 0 as small as needed (simulation of
simplicity, Edelsbrunner and Muecke, 1990). Its ray then passes no vertex, no edge and no triangle
parallel to +z, and crosses each other triangle inside or not at all. Points on the surface are
recognized before they move.
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
    # A surely met triangle is crossed inside, above the point, before and after the point moves.
    crossings = np.bincount(pairs.ray[pairs.sure], minlength=len(inside))
    doubtful = pairs[~pairs.sure]
    on, crossed = crossings_above(mesh.triangles[doubtful.triangle], inside[doubtful.ray])
    crossings += np.bincount(doubtful.ray[crossed], minlength=len(inside))
    location[within[crossings % 2 == 1]] = Location.INSIDE
    location[within[doubtful.ray[on]]] = Location.ON
    return location


def crossings_above(triangles: Floats, points: Floats) -> tuple[Mask, Mask]:
    """Return which points lie on triangles (K, 3, 3), and which triangles lie above moved points.

    Points (K, 3) and triangles are paired; integers decide.
    """
    (corners, start), _ = integers(triangles, points)
    p, origin = coordinates(corners), coordinates(start)
    q = [difference([axis[:, k] for axis in p], origin) for k in range(3)]
    sides = [cross(q[i], q[j]) for i, j in ((0, 1), (1, 2), (2, 0))]
    normal = [sum(side[axis] for side in sides) for axis in range(3)]
    offset = dot(q[0], normal)
    # On a triangle with area: in its plane, on the inner side of all edges. Without area: on its
    # line, and within its box.
    in_plane = (offset == 0) & _all([dot(side, normal) >= 0 for side in sides])
    flat = _all([part == 0 for part in normal])
    on_line = _all([part == 0 for side in sides for part in side])
    in_box = _all(
        [np.minimum.reduce([corner[axis] for corner in q]) <= 0 for axis in range(3)]
        + [np.maximum.reduce([corner[axis] for corner in q]) >= 0 for axis in range(3)]
    )
    on = np.where(flat, on_line & in_box, in_plane)
    # The sides of the moved point, seen along z: of E - h (y_j - y_i) + h^2 (x_j - x_i) the first
    # term that is not zero.
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
    # 0.0 makes one number of the two zeros.
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
