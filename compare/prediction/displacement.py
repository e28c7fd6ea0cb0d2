"""Closed form of displacement: where each point is drawn, from the truth alone (docs/method.md)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.metrics.error_maps import lengths, pixel_centers
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.hogel_image import HogelCamera, HogelImage
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum, Offset, Pivot
from xfrustum.scenes.plate.plate import Frustum


@dataclass(frozen=True, kw_only=True, eq=False)
class TruePoints:
    """Surface points at the places on the film where the truth shows them."""

    height: Floats  #: (...) signed z, scene units; NaN where there is no surface off the plate
    from_middle: Floats  #: (..., 2) columns and rows from the middle of the film: W/2 u and -H/2 v
    camera: HogelCamera

    @classmethod
    def from_image(cls, truth: HogelImage) -> TruePoints:
        """Return the points of all pixels, (H, W)."""
        height = np.full(truth.triangle.shape, np.nan)
        np.copyto(height, truth.height, where=truth.off_plate)
        from_middle = pixel_centers(truth.camera) - (np.asarray(truth.camera.resolution) - 1) / 2
        return cls(height=height, from_middle=from_middle, camera=truth.camera)

    @cached_property
    def depth(self) -> Floats:
        """Distances (...) from the plate, scene units; NaN as in `height`."""
        return np.abs(self.height)

    @cached_property
    def radius(self) -> Floats:
        """Distances (...) from the middle of the film, pixels."""
        return lengths(self.from_middle)

    def at(self, pixels: Indices) -> TruePoints:
        """Return the points at some pixels, given as indices of the flattened image."""
        height, from_middle = (
            self.height.reshape(-1)[pixels],
            self.from_middle.reshape(-1, 2)[pixels],
        )
        return TruePoints(height=height, from_middle=from_middle, camera=self.camera)

    def shown(self) -> TruePoints:
        """Return the points that are on a surface and off the plate."""
        return self.at(np.flatnonzero(np.isfinite(self.height)))


def displacements(points: TruePoints, frustum: Frustum, settings: DoubleFrustum) -> Floats:
    """Return the true minus the drawn position of some points, (..., 2) columns and rows in pixels.

    NaN where there is no surface off the plate, and where no camera draws it: on the other side of
    the plate when only one camera draws, and closer than n without an offset. From the places at
    which both cameras draw a point (docs/method.md, "Shear") follows, without a difference of
    nearly equal numbers, with u where it belongs, w = |z| + n, the shear k (0 for pivot
    `aperture`), and 1 / zf = 0 for fit `angle`,

        u n / w (1 - |z| / zf)  +  n k / (t w) (1 + n / zf).

    This holds in the first slab. The cameras of the other slabs stand in the aperture, and displace
    nothing.
    """
    bent = _bent(points, frustum, settings)
    fitted = settings.fitted_height(frustum)
    per_fit = 0.0 if fitted is None else 1 / fitted
    field = points.from_middle * (bent * (1 - points.depth * per_fit))[..., None]
    if settings.pivot is Pivot.CAMERA:
        camera = points.camera
        sides = [camera.resolution[0] / 2, -camera.resolution[1] / 2]
        film_units = np.asarray(camera.shear) / camera.half_extent * sides
        field += (bent * (1 + settings.near * per_fit))[..., None] * film_units
    return field


def displacement_lengths(points: TruePoints, frustum: Frustum, settings: DoubleFrustum) -> Floats:
    """Return the lengths of displacements of points, (...) in pixels; see `displacements`."""
    if settings.pivot is Pivot.CAMERA:
        return lengths(displacements(points, frustum, settings))
    # Every point moves along its radius, away from the middle of the film or toward it.
    moved = points.radius * _bent(points, frustum, settings)
    fitted = settings.fitted_height(frustum)
    return moved if fitted is None else moved * np.abs(1 - points.depth / fitted)


def _bent(points: TruePoints, frustum: Frustum, settings: DoubleFrustum) -> Floats:
    """Return n / w of some points, (...): 0 outside the first slab, NaN where no camera draws."""
    near = settings.near if settings.offset is Offset.PLATE else 0.0
    bent: Floats = points.depth + near
    np.divide(near, bent, out=bent)
    if settings.slabs:
        bent[np.isfinite(points.height) & ~in_first_slab(points.height, frustum, settings)] = 0.0
    if settings.camera is not Camera.BOTH or settings.offset is Offset.NONE:
        bent[~is_drawn(points.height, settings)] = np.nan
    return bent


def in_first_slab(height: NDArray[np.floating], frustum: Frustum, settings: DoubleFrustum) -> Mask:
    """Return for each height whether the slab that touches the plate draws a surface there."""
    toward, behind = (settings.sections(reach)[0][1] for reach in frustum.reach)
    return np.asarray((height <= toward) & (height >= -behind))


def is_drawn(height: NDArray[np.floating], settings: DoubleFrustum) -> Mask:
    """Return for each height off the plate whether any camera draws a surface there."""
    drawn: Mask = np.isfinite(height)
    if settings.camera is not Camera.BOTH:
        drawn &= (height < 0) == (settings.camera is Camera.C)
    if settings.offset is Offset.NONE:
        drawn &= np.abs(height) >= settings.near
    return drawn
