"""Does the true frustum see a given surface point, or is something else in front of it?"""

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
    """Points that an image claims to show.

    Attributes
    ----------
    position
        (N, 3) scene units, z not 0.
    triangle
        (N,) the number of the triangle that each is on, `NOTHING` where that is not known.
    tolerance
        (N,) how exactly the points are known, scene units: a surface that passes within this
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
        Finds the first surface.
    scene
        Its triangles.
    pencil
        A crossed frustum; each point's line passes through its center.
    points
        Where to look.
    """
    s_point = pencil.center[2] - points.position[:, 2]
    directions = np.empty_like(points.position)
    # Axis by axis: numpy is several times slower along rows of three.
    for axis in range(2):
        directions[:, axis] = (points.position[:, axis] - pencil.center[axis]) / s_point
    directions[:, 2] = -1.0
    origins = ray_origins(scene, np.asarray(pencil.center), directions, pencil.s_range[0])
    # What is met nearer to the point than half its tolerance is the point's own, and need not be met.
    length = np.sqrt(np.einsum("ij,ij->i", directions, directions))
    until = s_point + (origins[:, 2] - pencil.center[2]) - points.tolerance / (2 * length)
    hits = tracer.first_hits(origins, directions, np.maximum(until, 0.0))
    met = np.flatnonzero((hits != NOTHING) & (hits != points.triangle))
    corners = scene.triangles[hits[met]]
    normals = triangle_normals(corners)
    s_hit = plane_places(corners, normals, np.asarray(pencil.center), directions[met])
    before = s_hit < s_point[met]
    met, corners = met[before], corners[before]
    behind = np.zeros(len(hits), dtype=np.bool_)
    behind[met[_apart(points.position[met], corners, normals[before], points.tolerance[met])]] = True
    return behind


FAR_FROM_PLANE = 2.0
"""Times the tolerance. A triangle is no nearer than its plane, and tolerances are some 16 roundings of
float32: what both distances are rounded by in double precision cannot make up for a factor of two."""


def _apart(points: Floats, corners: Floats, normals: Floats, tolerance: Floats) -> Mask:
    """Return which points are farther than their tolerance from their own triangle."""
    length = np.linalg.norm(normals, axis=1)
    along = np.abs(np.einsum("ij,ij->i", points - corners[:, 0], normals))
    apart: Mask = along > FAR_FROM_PLANE * tolerance * length
    # Triangles without area have no plane.
    apart &= length > 0
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
        start, edge = corners[:, k], corners[:, (k + 1) % 3] - corners[:, k]
        along = points - start
        inside &= np.einsum("ij,ij->i", cross_products(edge, along), normals) >= 0
        squared = np.einsum("ij,ij->i", edge, edge)
        share = np.einsum("ij,ij->i", along, edge) / np.where(squared > 0, squared, 1.0)
        foot = along - np.clip(share, 0.0, 1.0)[:, None] * edge
        nearest_edge = np.minimum(nearest_edge, np.linalg.norm(foot, axis=1))
    from_plane = np.abs(np.einsum("ij,ij->i", points - corners[:, 0], unit))
    return np.where(inside, from_plane, nearest_edge)
