"""Displacement: how far the picture moved, pixel by pixel (docs/method.md, "What is compared")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.compare.metrics.film import pixel_centers, true_pixel
from xfrustum.scenes.arrays import Floats
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
        """Return the spread of some values of any shape, None where there are no values."""
        if values.size == 0:
            return None
        largest = float(values.max())
        if largest == 0 and float(values.min()) == 0:
            return cls(rms=0.0, p50=0.0, p95=0.0, p99=0.0, max=0.0)
        p50, p95, p99 = np.percentile(values, [50, 95, 99])
        return cls(rms=root_mean_square(values), p50=float(p50), p95=float(p95), p99=float(p99), max=largest)


def root_mean_square(values: Floats) -> float:
    """Return the root mean square of values of any shape, of which there is one and none is negative."""
    # Values are scaled first: near the plate the squares of displacements may overflow.
    largest = float(values.max())
    return largest * float(np.sqrt(np.mean((values / largest) ** 2))) if largest > 0 else 0.0


def displacement(raster: HogelImage, camera: HogelCamera, rows: slice = slice(None)) -> Floats:
    """Return the place where each pixel's surface point belongs, minus the place where it was drawn.

    No optical flow is needed: the image says which surface point it shows, and the true frustum
    says where that point belongs.

    Parameters
    ----------
    raster
        Image that is judged.
    camera
        Camera of the true frustum.
    rows
        Rows of the true frustum that the image has.

    Returns
    -------
    (H, W, 2) columns and rows in pixels, rows counting down; NaN where no surface is shown and
    where it lies in the plate.
    """
    return displacement_from(raster, camera, pixel_centers(camera, rows))


def displacement_from(raster: HogelImage, camera: HogelCamera, drawn_at: Floats) -> Floats:
    """Return the displacement, as `displacement` does, of pixels whose places (H, W, 2) are given."""
    shift = true_pixel(raster.position, camera)
    shift -= drawn_at
    # Each vector is one complex number: numpy is several times slower along rows of two numbers.
    shift.view(np.complex128)[..., 0][~raster.off_plate] = complex(np.nan, np.nan)
    return shift


def lengths(shift: Floats) -> Floats:
    """Return the lengths (...) of vectors (..., 2), without over- or underflow."""
    return np.abs(np.ascontiguousarray(shift).view(np.complex128)[..., 0])
