"""Places on the film: of surface points, and of the centers of pixels (CONVENTIONS.md, "Film")."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.lines.lines import Pencil, pixel_places
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
    return pixel_places(points, true_lines(camera))


def true_lines(camera: HogelCamera) -> Pencil:
    """Return the lines of the true frustum of the aperture that an image's camera names."""
    return Pencil(
        center=(camera.aperture.x, camera.aperture.y, 0.0),
        shear=camera.shear,
        half_extent=camera.half_extent,
        resolution=camera.resolution,
        s_range=(-camera.reach[0], camera.reach[1]),
    )


def pixel_centers(camera: HogelCamera, rows: slice = slice(None)) -> Floats:
    """Return column and row of every pixel, (H, W, 2), or of some rows."""
    width, height = camera.resolution
    down = np.arange(height, dtype=np.float64)[rows]
    centers = np.empty((len(down), width, 2))
    centers[..., 0], centers[..., 1] = np.arange(width), down[:, None]
    return centers
