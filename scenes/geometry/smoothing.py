"""Vertex normals for meshes that have none: the mean of the faces around each point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.model.scene import NormalsMade, SceneObject


def smoothed(part: SceneObject) -> SceneObject:
    """Return the object with normals at the vertices that have none of their own.

    Faces that meet in a point count by their angles there, so that how a flat surface is cut into
    triangles does not matter (Thürmer and Wüthrich, "Computing vertex normals from polygonal facets",
    1998). Vertices in the same place count as one point: a seam of the texture is not an edge. Where
    the mean is zero, and at vertices without faces, there still is none.
    """
    mean = _mean_normals(part.vertices, part.faces)
    own = part.vertex_normals
    if own is None or not np.isfinite(own).any():
        return replace(part, vertex_normals=mean, normals_made=NormalsMade.ALL)
    normals = np.where(np.isfinite(own), own, mean)
    added = bool((np.isfinite(normals) & ~np.isfinite(own)).any())
    return replace(
        part, vertex_normals=normals, normals_made=NormalsMade.SOME if added else part.normals_made
    )


def _mean_normals(vertices: Floats, faces: Indices) -> Floats:
    """Return (V, 3) unit normals, NaN where there are none."""
    points, point_of_vertex = np.unique(vertices, axis=0, return_inverse=True)
    point_of_vertex = point_of_vertex.reshape(-1)
    weighted = _angle_weighted(vertices[faces]).reshape(-1, 3)
    corners = point_of_vertex[faces].reshape(-1)
    total = np.stack([np.bincount(corners, axis, len(points)) for axis in weighted.T], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    unit = np.divide(total, length, out=np.full(total.shape, np.nan), where=length > 0)
    return np.asarray(unit[point_of_vertex])


def _angle_weighted(triangles: Floats) -> Floats:
    """Return (F, 3, 3) normals of triangles, once for each corner, as long as the angle there."""
    # Scale sides to size one: products of the sides of tiny or huge triangles would under- or overflow.
    sides = np.roll(triangles, -1, axis=1) - triangles
    scale = np.abs(sides).max(axis=(1, 2), keepdims=True)
    sides = sides / np.where(scale > 0, scale, 1.0)
    after, before = sides, -np.roll(sides, 1, axis=1)
    cross = np.cross(after, before)
    twice_area = np.linalg.norm(cross, axis=2, keepdims=True)
    angle = np.arctan2(twice_area, (after * before).sum(axis=2, keepdims=True))
    return np.asarray(np.divide(cross, twice_area, out=np.zeros(cross.shape), where=twice_area > 0) * angle)
