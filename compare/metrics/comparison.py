"""Truth against raster, pixel by pixel and in numbers (docs/method.md, "What is compared")."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from xfrustum.compare.metrics.displacement import Spread
from xfrustum.compare.metrics.error_maps import (
    ErrorMaps,
    HeightError,
    PixelErrors,
    names_triangles,
    pixel_errors,
)
from xfrustum.compare.metrics.radiance import RadianceError, RadianceNumbers, compare_radiance
from xfrustum.compare.metrics.surface import culled_pixels
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty, HogelImage
from xfrustum.scenes.notebook.labels import SCENE_UNITS
from xfrustum.scenes.notebook.shown import Figure, Shown, Table

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, kw_only=True)
class Share:
    """How many of the judged pixels are wrong in one sense.

    Attributes
    ----------
    wrong
        Number of these pixels.
    fraction
        Their share of the judged pixels; 0 where no pixel is judged.
    """

    wrong: int
    fraction: float

    @classmethod
    def of(cls, wrong: Mask, judged: Mask) -> Share:
        """Return the share of some of the judged pixels, both given as masks (H, W)."""
        count, all_judged = int(np.count_nonzero(wrong)), int(np.count_nonzero(judged))
        return cls(wrong=count, fraction=count / all_judged if all_judged else 0.0)


@dataclass(frozen=True, kw_only=True)
class SurfaceShare(Share):
    """How many of the judged pixels show the wrong surface.

    Attributes
    ----------
    outside
        Number of these pixels whose point belongs outside the true film, where no pixel shows it.
    culled
        Number of these pixels whose true surface is turned away from the viewer, so that culling left it
        out; None where nothing was culled.
    """

    outside: int
    culled: int | None = None

    @classmethod
    def of_errors(cls, errors: PixelErrors, culled: Mask | None) -> SurfaceShare | None:
        """Return the share of wrong surfaces; None where the scene was not at hand.

        `culled` are the pixels (H, W) whose true surface was left out; None where nothing was culled.
        """
        if errors.surface is None or errors.outside is None:
            return None
        share = Share.of(errors.surface, errors.judged)
        return cls(
            wrong=share.wrong,
            fraction=share.fraction,
            outside=int(np.count_nonzero(errors.outside)),
            culled=None if culled is None else int(np.count_nonzero(culled & errors.surface)),
        )


@dataclass(frozen=True, kw_only=True)
class ComparisonNumbers:
    """How a raster image differs from the truth, in numbers: the object that `compare --json` prints.

    Attributes
    ----------
    pixels, judged, covered, at_plate
        Number of all pixels; of pixels whose truth is no tie; of pixels where the truth shows a
        surface; of raster pixels that show a surface in the plate, where displacement is undefined.
    surface
        Judged pixels that show the wrong surface; None where the scene was not at hand.
    triangle
        Judged pixels that show another triangle number; None where the raster image names no triangles.
    displacement_px
        Lengths of the displacements; None where the raster shows no surface off the plate.
    height
        Error of the height; None where no pixel shows the same triangle in both images.
    radiance
        Error of the colors; None where they were not compared, or an image has none.
    certainty
        Number of the truth's pixels by class of certainty, named in words.
    """

    pixels: int
    judged: int
    covered: int
    at_plate: int
    surface: SurfaceShare | None
    triangle: Share | None
    displacement_px: Spread | None
    height: HeightError | None
    radiance: RadianceNumbers | None
    certainty: dict[str, int]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Comparison(Shown, ComparisonNumbers):
    """How a raster image differs from the truth: in numbers, and pixel by pixel.

    Attributes
    ----------
    errors, colors
        Errors of the pixels, and of their colors; None where these were not compared.
    """

    errors: PixelErrors
    colors: RadianceError | None

    @cached_property
    def maps(self) -> ErrorMaps:
        """Each error as an image, made when it is first asked for."""
        return replace(self.errors.maps, radiance=self.colors.error if self.colors else None)

    @property
    def surface_wrong(self) -> int | None:
        """Number of judged pixels that show the wrong surface; None where the scene was not at hand."""
        return self.surface.wrong if self.surface else None

    @property
    def triangle_wrong(self) -> int | None:
        """Number of judged pixels that show another triangle; None where the raster names no triangles."""
        return self.triangle.wrong if self.triangle else None

    @property
    def numbers(self) -> ComparisonNumbers:
        """The numbers alone, without the images."""
        return ComparisonNumbers(**{one.name: getattr(self, one.name) for one in fields(ComparisonNumbers)})

    def summary(self) -> dict[str, Any]:
        """Return the numbers as `compare --json` prints them."""
        return asdict(self.numbers)

    def to_xarray(self, units: str = SCENE_UNITS) -> xarray.Dataset:
        """Return the errors with labels, as an `xarray.Dataset` over v and u; see `HogelImage.to_xarray`.

        Parameters
        ----------
        units
            Name of the scene's unit of length (`scene.units`), which images do not know.

        Raises
        ------
        InputError
            xarray is not installed.
        """
        from xfrustum.compare.metrics.comparison_facts import labelled  # noqa: PLC0415 - it knows this module

        return labelled(self, units)

    def _said(self) -> str:
        from xfrustum.compare.metrics.comparison_facts import said_of_comparison  # noqa: PLC0415 - likewise

        return said_of_comparison(self)

    def _tables(self) -> Sequence[Table]:
        from xfrustum.compare.metrics.comparison_facts import table_of_numbers  # noqa: PLC0415 - likewise

        return (table_of_numbers(self),)

    def _figures(self) -> Sequence[Figure]:
        from xfrustum.compare.metrics.comparison_facts import figures  # noqa: PLC0415 - likewise

        return tuple(figures(self))


def compare_images(
    truth: HogelImage,
    raster: HogelImage,
    reference: Reference | None,
    *,
    radiance: bool = True,
    perceptual: bool = False,
    beside: PixelErrors | None = None,
) -> Comparison:
    """Judge a raster image of an aperture by the truth.

    Parameters
    ----------
    truth
        True image, whose camera is the true frustum; pixels that are ties are not judged.
    raster
        Image of any renderer.
    reference
        Tracer of the same scene, which follows the true lines through the points that the raster shows;
        without it `surface` is None.
    radiance, perceptual
        Whether to compare colors, and how different the pictures look.
    beside
        Errors by the same truth of an image of the same cameras, which saves time where both show the same.

    Raises
    ------
    InputError
        The images differ in size, aperture or scene.
    """
    _check(truth, raster, reference)
    colors = compare_radiance(truth, raster, perceptual=perceptual) if radiance else None
    errors = pixel_errors(truth, raster, reference, beside)
    return Comparison(
        pixels=errors.judged.size,
        judged=int(np.count_nonzero(errors.judged)),
        covered=int(np.count_nonzero(truth.covered)),
        at_plate=errors.at_plate,
        surface=SurfaceShare.of_errors(errors, culled_pixels(truth, raster)),
        triangle=Share.of(errors.triangle, errors.judged) if names_triangles(raster) else None,
        displacement_px=errors.spread,
        height=errors.height_error,
        radiance=colors.numbers if colors else None,
        certainty=_certainty_counts(truth),
        errors=errors,
        colors=colors,
    )


def _check(truth: HogelImage, raster: HogelImage, reference: Reference | None) -> None:
    if truth.camera.settings is not None:
        raise InputError(
            f"the truth was made by a double frustum ({truth.camera.renderer}): give the traced image first"
        )
    _check_same_question(truth, raster)
    _check_numbers(raster, reference)


def _check_same_question(truth: HogelImage, raster: HogelImage) -> None:
    if truth.triangle.shape != raster.triangle.shape:
        (h, w), (rh, rw) = truth.triangle.shape, raster.triangle.shape
        raise InputError(
            f"the truth has {w} x {h} pixels and the raster {rw} x {rh}: trace and draw the same scene"
        )
    if truth.camera.scene_hash != raster.camera.scene_hash:
        raise InputError(
            "truth and raster show different scenes (content hashes differ): make both from one file"
        )
    mine, other = truth.camera.aperture, raster.camera.aperture
    if (mine.x, mine.y) != (other.x, other.y):
        raise InputError(
            f"truth and raster show different apertures, {mine.column},{mine.row} and "
            f"{other.column},{other.row}: give both the same --aperture"
        )


def _check_numbers(raster: HogelImage, reference: Reference | None) -> None:
    if reference is not None and raster.triangle.max(initial=NOTHING) >= len(reference.scene.faces):
        raise InputError(
            f"the raster names triangle {raster.triangle.max()}, the scene has {len(reference.scene.faces)}: "
            "number them from 0 (id.triangle is that number + 1)"
        )


def _certainty_counts(truth: HogelImage) -> dict[str, int]:
    if truth.certainty is None:
        return {Certainty.UNEXAMINED.name.lower(): truth.triangle.size}
    counts = np.bincount(truth.certainty.reshape(-1), minlength=len(Certainty))
    return {kind.name.lower(): int(counts[kind]) for kind in Certainty}
