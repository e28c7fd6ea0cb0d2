"""The place of a surface point on the true film (CONVENTIONS.md, film coordinates)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.hogel_image import HogelCamera


def true_pixel(points: NDArray[np.floating], camera: HogelCamera) -> Floats:
    """Project surface points through the true frustum of an aperture.

    Parameters
    ----------
    points
        (..., 3) scene units.
    camera
        Camera of an image; only its aperture, shear, half-extent and resolution matter.

    Returns
    -------
    (..., 2) column and row, where a pixel's center has whole numbers and rows count down; NaN for
    points in the plane of the plate, which have no place on the film.
    """
    points = np.asarray(points, dtype=np.float64)
    z = points[..., 2]
    depth = np.where(z == 0, np.nan, -z)
    u = ((points[..., 0] - camera.aperture.x) / depth - camera.shear[0]) / camera.half_extent[0]
    v = ((points[..., 1] - camera.aperture.y) / depth - camera.shear[1]) / camera.half_extent[1]
    width, height = camera.resolution
    place = np.empty((*z.shape, 2))
    place[..., 0], place[..., 1] = (u + 1) * width / 2 - 0.5, (1 - v) * height / 2 - 0.5
    return place


def pixel_centers(camera: HogelCamera, rows: slice = slice(None)) -> Floats:
    """Return column and row of every pixel, (H, W, 2), or of some rows."""
    width, height = camera.resolution
    down = np.arange(height, dtype=np.float64)[rows]
    centers = np.empty((len(down), width, 2))
    centers[..., 0], centers[..., 1] = np.arange(width), down[:, None]
    return centers
