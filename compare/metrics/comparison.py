"""Truth against raster, pixel by pixel and in numbers (docs/method.md, "What is compared")."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from xfrustum.compare.metrics.displacement import Spread, lengths
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
from xfrustum.scenes.arrays import Bytes, Mask
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty, HogelImage
from xfrustum.scenes.notebook import (
    NO_UNIT,
    SCENE_UNITS,
    Figure,
    Labelled,
    Shown,
    Table,
    as_shown,
    dataset,
    digits,
    marked,
    percent,
    png,
)

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
        return labelled(self, units)

    def _said(self) -> str:
        camera, renderer = self.errors.truth.camera, self.errors.raster.camera.renderer
        column, row = camera.aperture.index
        return (
            f"{renderer} against the truth, aperture {column},{row} of {camera.scene or 'a scene'!r}; "
            f"{said_of_numbers(self)}"
        )

    def _tables(self) -> Sequence[Table]:
        return (table_of_numbers(self),)

    def _figures(self) -> Sequence[Figure]:
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


if TYPE_CHECKING:
    import xarray

MOVED_PX = 1.0
"""Displacement from which on a map is in full color: a neighboring pixel shows what this one should."""


def said_of_numbers(found: ComparisonNumbers) -> str:
    """Return the errors of an image in a line."""
    return f"of {found.judged:,} judged pixels {', '.join(_errors(found))}"


def _errors(found: ComparisonNumbers) -> Iterator[str]:
    yield (
        "unknown show the wrong surface"
        if found.surface is None
        else (f"{_share(found.surface)} show the wrong surface")
    )
    if found.triangle is not None:
        yield f"{_share(found.triangle)} another triangle"
    if found.displacement_px is not None:
        spread = found.displacement_px
        yield f"99 of 100 surface points within {digits(spread.p99)} px, all within {digits(spread.max)} px"


def _share(share: Share) -> str:
    return f"{share.wrong:,} ({percent(share.fraction)})"


def table_of_numbers(found: ComparisonNumbers) -> Table:
    """Return the numbers of a comparison."""
    rows = [
        ("pixels", f"{found.pixels:,}; {found.judged:,} are judged, {found.covered:,} show a surface"),
        ("certainty of the truth", ", ".join(f"{n:,} {name}" for name, n in found.certainty.items() if n)),
    ]
    if found.surface is not None:
        rows.append(("wrong surface", f"{_share(found.surface)}, {found.surface.outside:,} outside the film"))
    if found.triangle is not None:
        rows.append(("another triangle", _share(found.triangle)))
    if found.displacement_px is not None:
        spread = found.displacement_px
        numbers = f"rms {digits(spread.rms)}, 50 % {digits(spread.p50)}, 95 % {digits(spread.p95)}"
        rows.append(("displacement, px", f"{numbers}, 99 % {digits(spread.p99)}, max {digits(spread.max)}"))
    if found.height is not None:
        rows.append(
            ("height, scene units", f"rms {digits(found.height.rms)}, max {digits(found.height.max)}")
        )
    if found.radiance is not None:
        rows.append(("radiance", f"rms {digits(found.radiance.rms)}, max {digits(found.radiance.max)}"))
    return Table(rows=rows)


def figures(found: Comparison) -> Iterator[Figure]:
    """Yield the errors on the dimmed image, the truth, and the image."""
    truth, drawn = found.errors.truth, found.errors.raster
    picture = as_shown(drawn.color, drawn.covered, drawn.height)
    moved = lengths(found.maps.displacement) / MOVED_PX
    yield Figure(
        caption=f"wrong surfaces red, displacement blue (full at {digits(MOVED_PX)} px)",
        content=png(marked(picture, found.maps.surface, moved)),
    )
    yield Figure(caption="truth", content=png(_picture(truth)))
    yield Figure(caption="image", content=png(picture))


def _picture(image: HogelImage) -> Bytes:
    return as_shown(image.color, image.covered, image.height)


def labelled(found: Comparison, units: str) -> xarray.Dataset:
    """Return the errors as labelled arrays; see `Comparison.to_xarray`."""
    maps, camera = found.maps, found.errors.truth.camera
    columns, rows = maps.displacement[..., 0], maps.displacement[..., 1]
    images = {
        "judged": Labelled(values=maps.judged, meaning="whether the truth is no tie"),
        "surface": None if maps.surface is None else Labelled(
            values=maps.surface, meaning="whether the wrong surface is shown"
        ),
        "triangle": Labelled(values=maps.triangle, meaning="whether another triangle is shown"),
        "displacement_columns": Labelled(
            values=columns, meaning="true minus drawn place, to the right", units="px"
        ),
        "displacement_rows": Labelled(values=rows, meaning="true minus drawn place, down", units="px"),
        "height_error": Labelled(values=maps.height, meaning="height, image minus truth", units=units),
        "radiance_error": None if maps.radiance is None else Labelled(
            values=maps.radiance, meaning="linear radiance, image minus truth", units=NO_UNIT
        ),
    }  # fmt: skip
    attributes = {
        "aperture": list(camera.aperture.index),
        "scene": camera.scene,
        "scene_hash": camera.scene_hash,
        "truth": camera.renderer,
        "image": found.errors.raster.camera.renderer,
    }
    return dataset(images, {}, attributes)
