"""Where on the true film does a surface point belong? (CONVENTIONS.md, film coordinates)"""

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
        Only its aperture, shear, half-extent and resolution matter, not who drew the image.

    Returns
    -------
    (..., 2) column and row, where a pixel's center has whole numbers and rows count down; NaN for
    points in the plane of the plate, which the film does not show anywhere in particular.
    """
    film = film_coordinates(points, camera)
    width, height = camera.resolution
    place = np.empty(film.shape)
    place[..., 0], place[..., 1] = (film[..., 0] + 1) * width / 2 - 0.5, (1 - film[..., 1]) * height / 2 - 0.5
    return place


def film_coordinates(points: NDArray[np.floating], camera: HogelCamera) -> Floats:
    """Return film coordinates u and v, (..., 2), of surface points (..., 3); see `true_pixel`."""
    points = np.asarray(points, dtype=np.float64)
    z = points[..., 2]
    depth = np.where(z == 0, np.nan, -z)
    film = np.empty((*z.shape, 2))
    film[..., 0] = ((points[..., 0] - camera.aperture.x) / depth - camera.shear[0]) / camera.half_extent[0]
    film[..., 1] = ((points[..., 1] - camera.aperture.y) / depth - camera.shear[1]) / camera.half_extent[1]
    return film


def pixel_centers(camera: HogelCamera, rows: slice = slice(None)) -> Floats:
    """Return column and row of every pixel, (H, W, 2), or of some rows."""
    width, height = camera.resolution
    down = np.arange(height, dtype=np.float64)[rows]
    centers = np.empty((len(down), width, 2))
    centers[..., 0], centers[..., 1] = np.arange(width), down[:, None]
    return centers
