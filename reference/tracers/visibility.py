"""Surface points that the true frustum does not see, because another surface hides them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.lines.planes import cross_products, plane_places, triangle_normals
from xfrustum.reference.tracers.entry import ray_origins
from xfrustum.reference.tracers.tracer import Tracer
from xfrustum.scenes.arrays import Floats, Mask, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.scenes.model.scene import Scene


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfacePoints:
    """Surface points that an image shows.

    Attributes
    ----------
    position
        (N, 3) scene units, z not 0.
    triangle
        (N,) number of the triangle that each point lies on, `NOTHING` where that is not known.
    tolerance
        (N,) distance within which each point is known, scene units: a surface that passes within this
        distance of a point is the point's own. Thus a mesh's tessellation makes no difference.
    """

    position: Floats
    triangle: Numbers
    tolerance: Floats


def hidden(tracer: Tracer, scene: Scene, pencil: Pencil, points: SurfacePoints) -> Mask:
    """Return which points lie behind another surface on their own true line.

    Parameters
    ----------
    tracer
        Tracer of the scene.
    scene
        Scene with the triangles.
    pencil
        Crossed frustum; each point's line passes through its center.
    points
        Points that are asked about.
    """
    s_point = pencil.center[2] - points.position[:, 2]
    directions = np.empty_like(points.position)
    # Axis by axis: numpy is several times slower along rows of three.
    for axis in range(2):
        directions[:, axis] = (points.position[:, axis] - pencil.center[axis]) / s_point
    directions[:, 2] = -1.0
    origins = ray_origins(scene, np.asarray(pencil.center), directions, pencil.s_range[0])
    # Rays end before the point by half its tolerance: a surface met beyond that is the point's own.
    length = np.sqrt(np.einsum("ij,ij->i", directions, directions))
    until = s_point + (origins[:, 2] - pencil.center[2]) - points.tolerance / (2 * length)
    hits = tracer.first_hits(origins, directions, np.maximum(until, 0.0))
    # Another surface that is met before the point hides it, unless it passes through it.
    met = np.flatnonzero((hits != NOTHING) & (hits != points.triangle))
    corners = scene.triangles[hits[met]]
    normals = triangle_normals(corners)
    s_hit = plane_places(corners, normals, np.asarray(pencil.center), directions[met])
    before = s_hit < s_point[met]
    met, corners = met[before], corners[before]
    behind = np.zeros(len(hits), dtype=np.bool_)
    behind[met[_apart(points.position[met], corners, points.tolerance[met])]] = True
    return behind


FAR_TOLERANCES = 2.0
"""Tolerances of distance from a triangle's plane beyond which a point surely is apart from the triangle. A
triangle is no nearer than its plane, and a tolerance is some 16 roundings of float32: the roundings of both
distances in double precision cannot make up for a factor of two."""


def _apart(points: Floats, corners: Floats, tolerance: Floats) -> Mask:
    """Return which points are farther than their tolerance from their own triangle."""
    normals = triangle_normals(corners)
    length = np.linalg.norm(normals, axis=1)
    along = np.abs(np.einsum("ij,ij->i", points - corners[:, 0], normals))
    apart: Mask = along > FAR_TOLERANCES * tolerance * length
    # Triangles without area have no plane.
    apart &= length > 0
    # Near the plane, the distance from the triangle itself decides.
    near = np.flatnonzero(~apart)
    apart[near] = distance_to_triangles(points[near], corners[near]) > tolerance[near]
    return apart


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
