"""The judge: truth against raster, pixel by pixel and in numbers (docs/method.md, "What is compared")."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from xfrustum.compare.metrics.displacement import Spread
from xfrustum.compare.metrics.error_maps import ErrorMaps, error_maps
from xfrustum.compare.metrics.radiance import RadianceError, compare_radiance
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty, HogelImage


@dataclass(frozen=True, kw_only=True)
class HeightError:
    """Raster minus truth in scene units, where both show the same triangle."""

    rms: float
    max: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """How a raster image differs from the truth.

    Attributes
    ----------
    pixels, judged, covered, at_plate
        Number of pixels; of those whose truth is no tie; of those where the truth shows a
        surface; of raster pixels that show a surface in the plate, where displacement is undefined.
    surface_wrong, triangle_wrong
        Judged pixels that show another surface, or another triangle number; None where the scene
        was not at hand, or where the raster image names no triangles.
    displacement_px
        None where the raster shows no surface off the plate.
    height
        None where no pixel shows the same triangle in both.
    radiance
        None where an image has no color.
    certainty
        Pixels of the truth by class, in words.
    maps
        The same, pixel by pixel.
    """

    pixels: int
    judged: int
    covered: int
    at_plate: int
    surface_wrong: int | None
    triangle_wrong: int | None
    displacement_px: Spread | None
    height: HeightError | None
    radiance: RadianceError | None
    certainty: dict[str, int]
    maps: ErrorMaps

    def summary(self) -> dict[str, Any]:
        """Return the numbers as `compare --json` prints them."""
        return {
            "pixels": self.pixels,
            "judged": self.judged,
            "covered": self.covered,
            "at_plate": self.at_plate,
            "surface": self._share(self.surface_wrong),
            "triangle": self._share(self.triangle_wrong),
            "displacement_px": asdict(self.displacement_px) if self.displacement_px else None,
            "height": asdict(self.height) if self.height else None,
            "radiance": self.radiance.summary() if self.radiance else None,
            "certainty": self.certainty,
        }

    def _share(self, wrong: int | None) -> dict[str, float] | None:
        if wrong is None:
            return None
        return {"wrong": wrong, "fraction": wrong / self.judged if self.judged else 0.0}


def compare_images(
    truth: HogelImage,
    raster: HogelImage,
    reference: Reference | None,
    *,
    radiance: bool = True,
    perceptual: bool = False,
) -> Comparison:
    """Judge a raster image of an aperture by the truth.

    Parameters
    ----------
    truth
        Its camera is the true frustum; pixels that are ties are not judged.
    raster
        From any renderer.
    reference
        Of the same scene, to trace the true lines through the points that the raster shows;
        without it `surface` is unknown.
    radiance, perceptual
        Whether to compare colors, and how different the pictures look.

    Raises
    ------
    InputError
        The images differ in size, aperture or scene.
    """
    if truth.camera.settings is not None:
        raise InputError(
            f"the truth was made by a double frustum ({truth.camera.renderer}): give the traced image first"
        )
    _check_same_question(truth, raster)
    _check_numbers(raster, reference)
    numbered = bool((raster.triangle != NOTHING).any()) or not raster.covered.any()
    colors = compare_radiance(truth, raster, perceptual=perceptual) if radiance else None
    maps, lengths = error_maps(truth, raster, reference, numbered=numbered)
    if colors:
        maps = replace(maps, radiance=colors.error)
    return Comparison(
        pixels=maps.judged.size,
        judged=int(maps.judged.sum()),
        covered=int(truth.covered.sum()),
        at_plate=int((raster.covered & (raster.height == 0)).sum()),
        surface_wrong=None if maps.surface is None else int(maps.surface.sum()),
        triangle_wrong=int(maps.triangle.sum()) if numbered else None,
        displacement_px=Spread.of(lengths),
        height=_height_error(maps.height[np.isfinite(maps.height)]),
        radiance=colors,
        certainty=_certainty_counts(truth),
        maps=maps,
    )


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


def _height_error(error: Floats) -> HeightError | None:
    if error.size == 0:
        return None
    return HeightError(rms=float(np.sqrt(np.mean(error**2))), max=float(np.abs(error).max()))


def _certainty_counts(truth: HogelImage) -> dict[str, int]:
    if truth.certainty is None:
        return {Certainty.UNEXAMINED.name.lower(): truth.triangle.size}
    counts = np.bincount(truth.certainty.ravel(), minlength=len(Certainty))
    return {kind.name.lower(): int(counts[kind]) for kind in Certainty}
