"""Each error as an image, pixel by pixel (docs/method.md, "What is compared")."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np

from xfrustum.compare.metrics.displacement import Spread, displacement
from xfrustum.compare.metrics.pixel_findings import PixelFindings, pixel_findings
from xfrustum.compare.metrics.surface import SurfaceErrors, Undecided, decided, surface_errors
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.hogel_image import Certainty, HogelImage
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
    def of(cls, error: Floats, count: int) -> HeightError | None:
        """Return the size of so many errors, None where there are none; other zeros stand for nothing."""
        if count == 0:
            return None
        largest = max(float(error.max()), -float(error.min()))
        return cls(rms=math.sqrt(float(np.sum(np.square(error))) / count), max=largest)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PixelErrors(Brief):
    """The errors of an image: numbers of displacement and height, and which pixels are wrong.

    A survey reads numbers alone: the maps of displacement and height are made when they are first asked for.

    Attributes
    ----------
    truth, raster
        The true image, and the image that is judged by it.
    judged, surface, outside, triangle
        As in `ErrorMaps`.
    spread
        Spread of the displacement; None where the image shows no surface off the plate.
    height
        Error of the height; None where no pixel shows the same triangle in both images.
    at_plate
        Number of the image's pixels that show a surface in the plate.
    """

    truth: HogelImage
    raster: HogelImage
    judged: Mask
    surface: Mask | None
    outside: Mask | None
    triangle: Mask
    spread: Spread | None
    height: HeightError | None
    at_plate: int

    @cached_property
    def maps(self) -> ErrorMaps:
        """Each error as an image, without that of radiance."""
        return ErrorMaps(
            judged=self.judged,
            surface=self.surface,
            outside=self.outside,
            triangle=self.triangle,
            displacement=displacement(self.raster, self.truth.camera),
            height=_height_map(self.truth, self.raster, self.judged),
            radiance=None,
        )


def pixel_errors(
    truth: HogelImage, raster: HogelImage, reference: Reference | None, *, numbered: bool
) -> PixelErrors:
    """Return the errors of an image.

    Parameters
    ----------
    truth, raster
        Images of one size, aperture and scene.
    reference
        Reference of this scene; without it there is no `surface`.
    numbered
        Whether the raster image names triangles.
    """
    return pixel_errors_of_each(truth, [raster], reference, [numbered])[0]


def pixel_errors_of_each(
    truth: HogelImage, images: Sequence[HogelImage], reference: Reference | None, numbered: Sequence[bool]
) -> list[PixelErrors]:
    """Return the errors of several images, as `pixel_errors` does, in less time.

    Parameters
    ----------
    truth, images
        The true image, and images of the same size, aperture and scene.
    reference
        Reference of the scene; without it there are no surfaces.
    numbered
        Whether each image names triangles.
    """
    if not images:
        return []
    scene, clear = (reference.scene, reference.clear(truth, len(images))) if reference else (None, None)
    measured, undecided = [], []
    surfaces: Sequence[SurfaceErrors | None]
    for image in images:
        found = pixel_findings(truth, image, scene, clear)
        # What is found is large: it is reduced before the next image is looked at.
        measured.append(_Measured.of(found))
        if found.surface is not None and scene is not None:
            undecided.append(Undecided.of(found.surface, image, scene))
    surfaces = decided(undecided, truth, reference) if reference else [None] * len(images)
    judged = judged_pixels(truth)
    return [
        PixelErrors(
            truth=truth,
            raster=image,
            judged=judged,
            surface=surface.wrong & judged if surface else None,
            outside=surface.outside & judged if surface else None,
            triangle=(truth.triangle != image.triangle) & judged & named,
            spread=numbers.spread,
            height=numbers.height,
            at_plate=numbers.at_plate,
        )
        for image, numbers, surface, named in zip(images, measured, surfaces, numbered, strict=True)
    ]


@dataclass(frozen=True, kw_only=True)
class _Measured:
    """Numbers of an image's displacement and height; see `PixelErrors`."""

    spread: Spread | None
    height: HeightError | None
    at_plate: int

    @classmethod
    def of(cls, found: PixelFindings) -> _Measured:
        """Return the numbers of what is found of each pixel."""
        return cls(
            spread=Spread.of(found.moved, int(np.count_nonzero(found.off_plate))),
            height=HeightError.of(found.rise, int(np.count_nonzero(found.same))),
            at_plate=int(np.count_nonzero(found.in_plate)),
        )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class JudgedImage(Brief):
    """An image that was compared with the truth, beside which images with other depth buffers are judged.

    Most of their pixels show the same point of the same triangle. Whether a pixel shows the wrong surface
    depends on no other pixel, so that such pixels need not be judged again.

    Attributes
    ----------
    image
        The image, which names triangles.
    errors
        Its errors.
    """

    image: HogelImage
    errors: PixelErrors

    @classmethod
    def of(cls, truth: HogelImage, image: HogelImage, reference: Reference | None) -> JudgedImage:
        """Compare an image that names triangles with the truth."""
        return cls(image=image, errors=pixel_errors(truth, image, reference, numbered=True))

    @property
    def maps(self) -> ErrorMaps:
        """Error maps of the image, without that of radiance."""
        return self.errors.maps

    def differing(self, other: HogelImage) -> Indices:
        """Return the flat numbers of the pixels at which another image shows anything else."""
        known = self._known.get(other)
        if known is None:
            known = self._known[other] = differing_pixels(self.image, other)
        return known

    @cached_property
    def _known(self) -> WeakKeyDictionary[HogelImage, Indices]:
        """What `differing` has found of images that are still there."""
        return WeakKeyDictionary()

    def surfaces_beside(
        self, truth: HogelImage, other: HogelImage, reference: Reference
    ) -> tuple[Mask, Mask] | None:
        """Return the `surface` and `outside` (H, W) of an image that shows the same at most pixels.

        None where this image has none. Parameters are those of `pixel_errors_beside`.
        """
        if self.errors.surface is None or self.errors.outside is None:
            return None
        pixels = self.differing(other)
        if not pixels.size:
            return self.errors.surface, self.errors.outside
        errors = surface_errors(truth.at(pixels), other.at(pixels), reference)
        surface, outside = self.errors.surface.copy(), self.errors.outside.copy()
        surface.reshape(-1)[pixels], outside.reshape(-1)[pixels] = errors.wrong[0], errors.outside[0]
        return surface & self.errors.judged, outside & self.errors.judged


def differing_pixels(one: HogelImage, other: HogelImage) -> Indices:
    """Return the flat numbers of the pixels at which two images show different things."""
    if all(getattr(one, name) is getattr(other, name) for name in ("triangle", "object", "position")):
        return np.zeros(0, dtype=np.int64)
    differs = (one.triangle != other.triangle) | (one.object != other.object)
    # Bits are compared, because a position that is not a number equals no other.
    positions = one.position, other.position
    exactly = np.result_type(*positions)
    bits = np.dtype(f"u{exactly.itemsize}")
    mine, its = (values.astype(exactly, copy=False).view(bits) for values in positions)
    for axis in range(3):
        differs |= mine[..., axis] != its[..., axis]
    return np.flatnonzero(differs)


def pixel_errors_beside(
    truth: HogelImage, raster: HogelImage, reference: Reference | None, judged: JudgedImage
) -> PixelErrors:
    """Return the errors of an image, as `pixel_errors` does.

    Parameters
    ----------
    truth, raster, reference
        Images and reference as for `pixel_errors`; the raster names triangles.
    judged
        Image of the same cameras that was compared with this truth, and may show the same at most pixels.
    """
    pixels = judged.differing(raster)
    if not pixels.size:
        return judged.errors
    found = pixel_errors(truth, raster, None, numbered=True)
    surfaces = judged.surfaces_beside(truth, raster, reference) if reference else None
    return found if surfaces is None else replace(found, surface=surfaces[0], outside=surfaces[1])


def judged_pixels(truth: HogelImage) -> Mask:
    """Return the pixels whose truth is no tie, (H, W)."""
    if truth.certainty is None:
        return np.ones(truth.triangle.shape, dtype=np.bool_)
    return np.not_equal(truth.certainty, Certainty.TIE)


def _height_map(truth: HogelImage, raster: HogelImage, judged: Mask) -> Floats:
    """Return raster minus truth (H, W), NaN where judged pixels do not show the same triangle."""
    same = (truth.triangle == raster.triangle) & judged & truth.covered & np.isfinite(raster.height)
    found = np.full(judged.shape, np.nan)
    np.subtract(raster.height, truth.height, out=found, where=same, dtype=np.float64)
    return found
