"""Errors of each pixel: displacement, surface, triangle and height (docs/method.md, "What is compared")."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.metrics.displacement import (
    DrawnPoints,
    Spread,
    displacement,
    root_mean_square,
    true_lines,
)
from xfrustum.compare.metrics.surface import in_plate, surface_errors
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty, HogelImage
from xfrustum.scenes.notebook import Brief


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ErrorMaps(Brief):
    """Each error as an image.

    Attributes
    ----------
    judged
        (H, W) pixels whose truth is no tie.
    surface
        (H, W) pixels that show the wrong surface; None where the scene was not at hand.
    outside
        (H, W) of these, the ones whose point belongs outside the true film; None likewise.
    triangle
        (H, W) pixels that show another triangle number.
    displacement
        (H, W, 2) columns and rows in pixels, NaN where undefined.
    height
        (H, W) raster minus truth, NaN where they do not show the same triangle.
    radiance
        (H, W, 3) raster minus truth, NaN where it is not judged; None where it was not compared.
    """

    judged: Mask
    surface: Mask | None
    outside: Mask | None
    triangle: Mask
    displacement: Floats
    height: Floats
    radiance: Floats | None


@dataclass(frozen=True, kw_only=True)
class HeightError:
    """Raster minus truth in scene units, where both show the same triangle."""

    rms: float
    max: float

    @classmethod
    def of(cls, error: Floats) -> HeightError | None:
        """Return the size of errors (N,), None where there are none."""
        return cls(rms=root_mean_square(error), max=float(np.abs(error).max())) if error.size else None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PixelErrors(Brief):
    """The errors of an image: numbers of displacement and height, and which pixels are wrong.

    A survey reads numbers alone: maps of displacement and height are made when they are first asked for.

    Attributes
    ----------
    judged, surface, outside, triangle
        As in `ErrorMaps`.
    spread, height_error
        Spread of the displacement, and error of the height; None where there is no pixel to measure them at.
    changed
        Flat numbers of the pixels that show anything else than the image beside which this one was judged;
        None where there was none.
    """

    truth: HogelImage
    raster: HogelImage
    judged: Mask
    surface: Mask | None
    outside: Mask | None
    triangle: Mask
    spread: Spread | None
    height_error: HeightError | None
    changed: Indices | None = None

    @property
    def at_plate(self) -> int:
        """Number of the image's pixels that show a surface in the plate, where displacement is undefined."""
        return int(np.count_nonzero(in_plate(self.raster)))

    @cached_property
    def moved(self) -> Floats:
        """Lengths (H, W) of the displacement in pixels, NaN where it is undefined."""
        points = DrawnPoints.of(self.raster, np.flatnonzero(self.raster.off_plate))
        found = np.full(self.judged.shape, np.nan)
        found.reshape(-1)[points.pixels] = _lengths(points, self.truth, points.pixels)[0]
        return found

    @cached_property
    def height(self) -> Floats:
        """Raster minus truth (H, W), NaN where judged pixels do not show the same triangle."""
        found = np.full(self.judged.shape, np.nan)
        pixels, rise = _rise(self.truth, self.raster, self.judged)
        found.reshape(-1)[pixels] = rise
        return found

    def find_maps(self) -> None:
        """Find the maps beside which other images are judged, in the thread of the caller."""
        _ = self.moved, self.height

    @cached_property
    def maps(self) -> ErrorMaps:
        """Each error as an image, without that of radiance."""
        return ErrorMaps(
            judged=self.judged,
            surface=self.surface,
            outside=self.outside,
            triangle=self.triangle,
            displacement=displacement(self.raster, self.truth.camera),
            height=self.height,
            radiance=None,
        )


def pixel_errors(
    truth: HogelImage, raster: HogelImage, reference: Reference | None, beside: PixelErrors | None = None
) -> PixelErrors:
    """Return the errors of an image.

    Parameters
    ----------
    truth, raster
        Images of one size, aperture and scene.
    reference
        Reference of this scene; without it there is no `surface`.
    beside
        Errors of an image of the same cameras, by the same truth. What is found of a pixel depends on no
        other, so that pixels that show the same are not judged again.
    """
    if beside is not None:
        return _errors_beside(truth, raster, reference, beside)
    judged = judged_pixels(truth)
    points = DrawnPoints.of(raster, np.flatnonzero(raster.off_plate))
    moved, places = _lengths(points, truth, points.pixels)
    errors = surface_errors(truth, raster, reference, (points, places)) if reference else None
    return PixelErrors(
        truth=truth,
        raster=raster,
        judged=judged,
        surface=errors.wrong & judged if errors else None,
        outside=errors.outside & judged if errors else None,
        triangle=(truth.triangle != raster.triangle) & judged & names_triangles(raster),
        spread=Spread.of(moved),
        height_error=HeightError.of(_rise(truth, raster, judged)[1]),
    )


def names_triangles(image: HogelImage) -> bool:
    """Return whether an image names triangles, or shows nothing."""
    return bool((image.triangle != NOTHING).any()) or not image.covered.any()


def _errors_beside(
    truth: HogelImage, raster: HogelImage, reference: Reference | None, beside: PixelErrors
) -> PixelErrors:
    """Return the errors of an image, judged again only where it differs from one that was judged."""
    pixels = differing_pixels(beside.raster, raster)
    if not pixels.size:
        return replace(beside, raster=raster, changed=pixels)
    before, after, judged = truth.at(pixels), raster.at(pixels), beside.judged.reshape(-1)[pixels][None]
    points = DrawnPoints.of(after, np.flatnonzero(after.off_plate))
    lengths, places = _lengths(points, truth, pixels[points.pixels])
    errors = surface_errors(before, after, reference, (points, places)) if reference else None
    moved = _with(beside.moved, pixels, np.nan)
    moved.reshape(-1)[pixels[points.pixels]] = lengths
    height = _with(beside.height, pixels, np.nan)
    same, rise = _rise(before, after, judged)
    height.reshape(-1)[pixels[same]] = rise
    found = replace(
        beside,
        raster=raster,
        surface=_with(beside.surface, pixels, errors.wrong & judged) if errors else None,
        outside=_with(beside.outside, pixels, errors.outside & judged) if errors else None,
        triangle=_with(beside.triangle, pixels, (before.triangle != after.triangle) & judged),
        spread=Spread.of(moved[raster.off_plate]),
        height_error=HeightError.of(height[~np.isnan(height)]),
        changed=pixels,
    )
    # The maps are there already.
    vars(found).update(moved=moved, height=height)
    return found


def _with(whole: NDArray[Any] | None, pixels: Indices, values: Any) -> Any:
    """Return a map (H, W) with other values at some pixels, given by their flat numbers."""
    assert whole is not None, "both images were judged with the scene at hand"
    found = whole.copy()
    found.reshape(-1)[pixels] = values
    return found


def _lengths(points: DrawnPoints, truth: HogelImage, pixels: Indices) -> tuple[Floats, tuple[Floats, Floats]]:
    """Return how far points (N,) are from where pixels of the film show them, and their places on it."""
    width, places = truth.camera.resolution[0], points.places(true_lines(truth.camera))
    row = pixels // width
    return np.hypot(places[0] - (pixels - row * width), places[1] - row), places


def _rise(truth: HogelImage, raster: HogelImage, judged: Mask) -> tuple[Indices, Floats]:
    """Return the judged pixels (N,) that show the same triangle, and raster minus truth of their heights."""
    same = (truth.triangle == raster.triangle) & judged & truth.covered & np.isfinite(raster.height)
    pixels = np.flatnonzero(same)
    drawn, true = (image.height.reshape(-1)[pixels] for image in (raster, truth))
    return pixels, drawn.astype(np.float64) - true


def differing_pixels(one: HogelImage, other: HogelImage) -> Indices:
    """Return the flat numbers of the pixels at which two images show different things."""
    differs = (one.triangle != other.triangle) | (one.object != other.object)
    for axis in range(3):
        mine, its = one.position[..., axis], other.position[..., axis]
        # A position that is not a number equals no other.
        differs |= (mine != its) & ~(np.isnan(mine) & np.isnan(its))
    return np.flatnonzero(differs)


def judged_pixels(truth: HogelImage) -> Mask:
    """Return the pixels whose truth is no tie, (H, W)."""
    if truth.certainty is None:
        return np.ones(truth.triangle.shape, dtype=np.bool_)
    return np.not_equal(truth.certainty, Certainty.TIE)
