"""Displacement: how far the picture moved, pixel by pixel (docs/method.md, "What is compared")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.compare.metrics.film import DrawnPoints, true_lines
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.model.hogel_image import HogelCamera, HogelImage


@dataclass(frozen=True, kw_only=True)
class Spread:
    """How a quantity in pixels is distributed over an image."""

    rms: float
    p50: float
    p95: float
    p99: float
    max: float

    @classmethod
    def of(cls, values: Floats) -> Spread | None:
        """Return the spread of values of any shape, None where there are no values."""
        if values.size == 0:
            return None
        with np.errstate(invalid="ignore"):
            p50, p95, p99 = np.percentile(values, (50, 95, 99)).tolist()
        return cls(rms=root_mean_square(values), p50=p50, p95=p95, p99=p99, max=float(values.max()))


def root_mean_square(values: Floats) -> float:
    """Return the root mean square of values of any shape, of which there is at least one."""
    largest = float(np.abs(values).max())
    if not 0 < largest < np.inf:
        return largest
    # Values are scaled first: near the plate the squares of displacements may overflow.
    return largest * float(np.sqrt(np.mean(np.square(values / largest))))


def shifts_at(raster: HogelImage, camera: HogelCamera, pixels: Indices) -> Floats:
    """Return the displacement at some pixels.

    Parameters
    ----------
    raster
        Image that is judged.
    camera
        Camera of the true frustum.
    pixels
        (N,) flat numbers of pixels that show a surface off the plate.

    Returns
    -------
    (2, N) columns and rows by which the true place of each pixel's surface point lies off the pixel's center.
    """
    columns, rows = DrawnPoints.of(raster, pixels).places(true_lines(camera))
    row = pixels // camera.resolution[0]
    return np.stack((columns - (pixels - row * camera.resolution[0]), rows - row))


def film_shifts(raster: HogelImage, camera: HogelCamera) -> Floats:
    """Return the displacement of all pixels, (2, H W): `displacement`, coordinate by coordinate."""
    found = np.full((2, raster.triangle.size), np.nan)
    pixels = np.flatnonzero(raster.off_plate)
    found[:, pixels] = shifts_at(raster, camera, pixels)
    return found


def displacement(raster: HogelImage, camera: HogelCamera) -> Floats:
    """Return the place where each pixel's surface point belongs, minus the place where it was drawn.

    No optical flow is needed: the image says which surface point it shows, and the true frustum
    says where that point belongs.

    Parameters
    ----------
    raster
        Image that is judged.
    camera
        Camera of the true frustum.

    Returns
    -------
    (H, W, 2) columns and rows in pixels, rows counting down; NaN where no surface is shown and
    where it lies in the plate.
    """
    return np.moveaxis(film_shifts(raster, camera).reshape(2, *raster.triangle.shape), 0, -1)


def lengths(shift: Floats) -> Floats:
    """Return the lengths (...) of vectors (..., 2)."""
    return np.hypot(shift[..., 0], shift[..., 1])
