"""Errors of each pixel: displacement, surface, triangle and height (docs/method.md, "What is compared")."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

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
from xfrustum.scenes.notebook.shown import Brief


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
    """The errors of an image.

    Attributes
    ----------
    moved
        (H, W) lengths of the displacement in pixels, NaN where undefined.
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
    moved: Floats
    height: Floats
    changed: Indices | None = None

    @property
    def spread(self) -> Spread | None:
        """Spread of the displacement; None where the image shows no surface off the plate."""
        return Spread.of(self.moved[self.raster.off_plate])

    @property
    def height_error(self) -> HeightError | None:
        """Error of the height; None where no pixel shows the same triangle in both images."""
        return HeightError.of(self.height[~np.isnan(self.height)])

    @property
    def at_plate(self) -> int:
        """Number of the image's pixels that show a surface in the plate, where displacement is undefined."""
        return int(np.count_nonzero(in_plate(self.raster)))

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
    beside
        Errors of an image of the same cameras, by the same truth. What is found of a pixel depends on no
        other, so that pixels that show the same are not judged again.
    """
    if beside is not None:
        return _errors_beside(truth, raster, reference, beside)
    judged = judged_pixels(truth)
    return PixelErrors(
        truth=truth,
        raster=raster,
        judged=judged,
        triangle=(truth.triangle != raster.triangle) & judged & names_triangles(raster),
        height=_height(truth, raster, judged),
        **_located(truth, raster, reference, judged, np.arange(judged.size)),
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
    some: dict[str, Any] = {
        "triangle": (before.triangle != after.triangle) & judged,
        "height": _height(before, after, judged),
        **_located(before, after, reference, judged, pixels),
    }
    for name, values in some.items():
        whole = getattr(beside, name)
        if values is not None and whole is not None:
            some[name] = whole.copy()
            some[name].reshape(-1)[pixels] = values[0]
    return replace(beside, raster=raster, changed=pixels, **some)


def _located(
    truth: HogelImage, raster: HogelImage, reference: Reference | None, judged: Mask, pixels: Indices
) -> dict[str, Any]:
    """Return `moved`, `surface` and `outside` of images of the same pixels (N,) of the film."""
    points = DrawnPoints.of(raster, np.flatnonzero(raster.off_plate))
    places = points.places(true_lines(truth.camera))
    width, here = truth.camera.resolution[0], pixels[points.pixels]
    row = here // width
    moved = np.full(raster.triangle.shape, np.nan)
    moved.reshape(-1)[points.pixels] = np.hypot(places[0] - (here - row * width), places[1] - row)
    if reference is None:
        return {"moved": moved, "surface": None, "outside": None}
    errors = surface_errors(truth, raster, reference, (points, places))
    return {"moved": moved, "surface": errors.wrong & judged, "outside": errors.outside & judged}


def _height(truth: HogelImage, raster: HogelImage, judged: Mask) -> Floats:
    """Return raster minus truth, NaN where judged pixels do not show the same triangle."""
    same = (truth.triangle == raster.triangle) & judged & truth.covered & np.isfinite(raster.height)
    found = np.full(judged.shape, np.nan)
    found[same] = raster.height[same].astype(np.float64) - truth.height[same]
    return found


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
