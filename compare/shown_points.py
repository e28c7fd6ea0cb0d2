"""Which surface point does a pixel show, when an image says only which triangle?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.drawn_model import DrawnModel
from xfrustum.reference.visibility import distance_to_triangles
from xfrustum.scenes.hogel_image import HogelImage
from xfrustum.scenes.scene import Scene

Floats = NDArray[np.float64]


def shown_points(scene: Scene, model: DrawnModel, image: HogelImage) -> Floats:
    """Return the surface points (H, W, 3) that an image as found shows, NaN where it says nothing.

    Its own where it has them; else where the line that a pixel has by a guess meets the triangle
    that it names.
    """
    if np.isfinite(image.position[..., :2]).any():
        return np.asarray(image.position, dtype=np.float64)
    upright = model.orientation.upright(image.triangle)
    aperture = model.answers(scene, image.camera.aperture)
    points = np.full((*upright.shape, 3), np.nan)
    rows, columns = np.nonzero((upright >= 0) & (upright < len(scene.faces)))
    corners = scene.triangles[upright[rows, columns]]
    best, off = np.full((len(rows), 3), np.nan), np.full(len(rows), np.inf)
    for side in (1, -1):
        pencil = model.pencil(scene, aperture, side)
        met = _met(corners, np.asarray(pencil.center), pencil.directions()[rows, columns])
        ahead = np.isfinite(met).all(axis=1) & (side * (met[:, 2] - model.plate_height) <= 0)
        distance = np.full(len(rows), np.inf)
        distance[ahead] = distance_to_triangles(met[ahead], corners[ahead])
        nearer = distance < off
        best[nearer], off[nearer] = met[nearer], distance[nearer]
    points[rows, columns] = best
    return np.asarray(model.orientation.applied(points))


def _met(corners: Floats, center: Floats, directions: Floats) -> Floats:
    """Return where lines through a center meet the planes of triangles, one each, (N, 3)."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.einsum("ij,ij->i", normals, corners[:, 0] - center)
        s /= np.einsum("ij,ij->i", normals, directions)
        met: Floats = center + s[:, None] * directions
    return met
