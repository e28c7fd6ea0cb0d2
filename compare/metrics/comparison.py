"""Comparison of a raster image with the truth, in pixels and numbers (docs/method.md)."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from xfrustum.compare.metrics import error_maps
from xfrustum.compare.metrics.radiance import RadianceError, RadianceNumbers, compare_radiance
from xfrustum.reference import Reference
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.images import NOTHING, Certainty, HogelImage
from xfrustum.scenes.representation import NO_UNIT, SCENE_UNITS, Labelled, ShortRepr, dataset

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, kw_only=True)
class Share:
    """Number of pixels that are wrong in one respect; the fraction is 0 without judged pixels."""

    wrong: int
    fraction: float


@dataclass(frozen=True, kw_only=True)
class SurfaceShare(Share):
    """Number of judged pixels that show the wrong surface."""

    #: number of wrong pixels whose point belongs outside the true film
    outside: int
    #: number of wrong pixels whose true surface was culled; None without culling
    culled: int | None = None


@dataclass(frozen=True, kw_only=True)
class ComparisonNumbers:
    """Errors of a raster image in numbers: the record that `compare --json` prints."""

    pixels: int
    #: pixels whose truth is not a tie
    judged: int
    #: pixels where the truth shows a surface
    covered: int
    #: raster pixels that show a surface in the plate, where displacement is undefined
    at_plate: int
    #: None if the scene was not available
    surface: SurfaceShare | None
    #: None if the raster image names no triangles
    triangle: Share | None
    displacement_px: error_maps.Spread | None  #: None if the raster shows no surface off the plate
    height: (
        error_maps.HeightError | None
    )  #: None if no pixel shows the same triangle in both images
    #: None if colors were not compared, or an image has none
    radiance: RadianceNumbers | None
    #: number of the truth's pixels by class of certainty
    certainty: dict[str, int]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Comparison(ShortRepr, ComparisonNumbers):
    """Errors of a raster image, in numbers and pixel by pixel."""

    errors: error_maps.PixelErrors
    #: None if colors were not compared
    colors: RadianceError | None

    @property
    def maps(self) -> error_maps.ErrorMaps:
        """Each error as an image."""
        return replace(self.errors.maps, radiance=self.colors.error if self.colors else None)

    @property
    def surface_wrong(self) -> int | None:
        """Number of judged pixels with the wrong surface; None without the scene."""
        return self.surface.wrong if self.surface else None

    @property
    def numbers(self) -> ComparisonNumbers:
        """The numbers without the images."""
        return ComparisonNumbers(
            **{part.name: getattr(self, part.name) for part in fields(ComparisonNumbers)}
        )

    def summary(self) -> dict[str, Any]:
        """Return the numbers as `compare --json` prints them."""
        return asdict(self.numbers)

    def to_xarray(self, units: str = SCENE_UNITS) -> xarray.Dataset:
        """Return the errors as `xarray.Dataset`, lengths in `units`; InputError without xarray."""
        maps, camera = self.maps, self.errors.truth.camera
        moved, surface, radiance = maps.displacement, maps.surface, maps.radiance
        labels: tuple[tuple[str, Any, str, str | None], ...] = (
            ("judged", maps.judged, "judged: no tie", None),
            ("surface", surface, "wrong surface", None),
            ("triangle", maps.triangle, "another triangle", None),
            ("displacement_columns", moved[..., 0], "true minus drawn place, to the right", "px"),
            ("displacement_rows", moved[..., 1], "true minus drawn place, down", "px"),
            ("height_error", maps.height, "height, image minus truth", units),
            ("radiance_error", radiance, "linear radiance, image minus truth", NO_UNIT),
        )
        images = {
            name: None if values is None else Labelled(values=values, meaning=meaning, units=unit)
            for name, values, meaning, unit in labels
        }
        renderers = {"truth": camera.renderer, "image": self.errors.raster.camera.renderer}
        scene = {"scene": camera.scene, "scene_hash": camera.scene_hash}
        return dataset(images, {}, {"aperture": list(camera.aperture.index), **scene, **renderers})


def compare_images(
    truth: HogelImage,
    raster: HogelImage,
    reference: Reference | None,
    *,
    radiance: bool = True,
    perceptual: bool = False,
    cached_errors: error_maps.PixelErrors | None = None,
) -> Comparison:
    """Judge a raster image of an aperture by the truth.

    Parameters
    ----------
    truth
        True image, whose camera is the true frustum; pixels that are ties are not judged.
    raster
        Image of any renderer.
    reference
        Tracer of the same scene; without it `surface` is None.
    radiance, perceptual
        Whether to compare colors, and whether to compare how different the pictures look.
    cached_errors
        Errors of another image by the same truth: pixels that are equal in both images are not
        judged again.

    Raises
    ------
    InputError
        The images differ in size, aperture or scene.
    """
    _check(truth, raster, reference)
    colors = compare_radiance(truth, raster, perceptual=perceptual) if radiance else None
    errors = error_maps.pixel_errors(truth, raster, reference, cached_errors)
    judged = int(np.count_nonzero(errors.judged))

    def share(wrong: Mask) -> dict[str, Any]:
        count = int(np.count_nonzero(wrong))
        return {"wrong": count, "fraction": count / judged if judged else 0.0}

    surface = None
    if errors.surface is not None and errors.outside is not None:
        culled = error_maps.culled_pixels(truth, raster)
        surface = SurfaceShare(
            **share(errors.surface),
            outside=int(np.count_nonzero(errors.outside)),
            culled=None if culled is None else int(np.count_nonzero(culled & errors.surface)),
        )
    classes = {Certainty.UNEXAMINED.name.lower(): truth.triangle.size}
    if truth.certainty is not None:
        counts = np.bincount(truth.certainty.reshape(-1), minlength=len(Certainty))
        classes = {kind.name.lower(): int(counts[kind]) for kind in Certainty}
    return Comparison(
        pixels=errors.judged.size,
        judged=judged,
        covered=int(np.count_nonzero(truth.covered)),
        at_plate=errors.at_plate,
        surface=surface,
        triangle=Share(**share(errors.triangle)) if error_maps.names_triangles(raster) else None,
        displacement_px=errors.spread,
        height=errors.height_error,
        radiance=colors.numbers if colors else None,
        certainty=classes,
        errors=errors,
        colors=colors,
    )


def _check(truth: HogelImage, raster: HogelImage, reference: Reference | None) -> None:
    if truth.camera.settings is not None:
        raise InputError(
            f"the truth was made by a double frustum ({truth.camera.renderer}): "
            "give the traced image first"
        )
    if truth.triangle.shape != raster.triangle.shape:
        (h, w), (rh, rw) = truth.triangle.shape, raster.triangle.shape
        raise InputError(
            f"the truth has {w} x {h} pixels and the raster {rw} x {rh}: "
            "trace and draw the same scene"
        )
    if truth.camera.scene_hash != raster.camera.scene_hash:
        raise InputError(
            "truth and raster show different scenes (content hashes differ): "
            "make both from one file"
        )
    mine, other = truth.camera.aperture, raster.camera.aperture
    if (mine.x, mine.y) != (other.x, other.y):
        raise InputError(
            f"truth and raster show different apertures, {mine.column},{mine.row} and "
            f"{other.column},{other.row}: give both the same --aperture"
        )
    if reference is not None and raster.triangle.max(initial=NOTHING) >= len(reference.scene.faces):
        raise InputError(
            f"the raster names triangle {raster.triangle.max()}, "
            f"the scene has {len(reference.scene.faces)}: "
            "number them from 0 (id.triangle is that number + 1)"
        )
