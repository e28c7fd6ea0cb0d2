"""Each error as an image, pixel by pixel (docs/method.md, "What is compared")."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from xfrustum.compare.metrics.displacement import displacement, displacement_beside, lengths
from xfrustum.compare.metrics.pixel_bands import in_bands
from xfrustum.compare.metrics.surface import JudgedImage, SurfaceErrors, surface_errors
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.hogel_image import Certainty, HogelImage


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorMaps:
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


def error_maps(
    truth: HogelImage,
    raster: HogelImage,
    reference: Reference | None,
    *,
    numbered: bool,
    judged: JudgedImage | None = None,
) -> tuple[ErrorMaps, Floats]:
    """Return the error maps without that of radiance, and the lengths of all displacements, (N,) px.

    Parameters
    ----------
    truth, raster
        Images of one size, aperture and scene.
    reference
        Tracer of this scene; without it there is no `surface`.
    numbered
        Whether the raster image names triangles.
    judged
        Image judged before that may show the same at most pixels; see `surface_errors`.
    """

    def errors_of(true: HogelImage, shown: HogelImage, rows: slice) -> SurfaceErrors:
        assert reference is not None
        return surface_errors(true, shown, reference, judged.rows(rows) if judged else None)

    def moved_of(shown: HogelImage, rows: slice) -> Floats:
        if judged is None:
            return displacement(shown, truth.camera, rows)
        before = judged.rows(rows)
        return displacement_beside(shown, truth.camera, rows, before.moved, before.shows_the_same(shown))

    surfaces = errors_of if reference else None
    bands = in_bands(truth, raster, partial(_judge, moved_of, surfaces, numbered))
    maps = [band.maps for band in bands]
    surface = [part.surface for part in maps if part.surface is not None]
    outside = [part.outside for part in maps if part.outside is not None]
    joined = ErrorMaps(
        judged=np.concatenate([part.judged for part in maps]),
        surface=np.concatenate(surface) if surface else None,
        outside=np.concatenate(outside) if outside else None,
        triangle=np.concatenate([part.triangle for part in maps]),
        displacement=np.concatenate([part.displacement for part in maps]),
        height=np.concatenate([part.height for part in maps]),
        radiance=None,
    )
    return joined, np.concatenate([band.lengths for band in bands])


def judged_pixels(truth: HogelImage) -> Mask:
    """Return the pixels whose truth is no tie, (H, W)."""
    if truth.certainty is None:
        return np.ones(truth.triangle.shape, dtype=np.bool_)
    return np.not_equal(truth.certainty, Certainty.TIE)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Band:
    """Some rows of the error maps, and the lengths of their displacements."""

    maps: ErrorMaps
    lengths: Floats


def _judge(
    moved_of: Callable[[HogelImage, slice], Floats],
    surfaces: Callable[[HogelImage, HogelImage, slice], SurfaceErrors] | None,
    numbered: bool,
    truth: HogelImage,
    raster: HogelImage,
    rows: slice,
) -> _Band:
    judged = judged_pixels(truth)
    shift = moved_of(raster, rows)
    errors = surfaces(truth, raster, rows) if surfaces else None
    maps = ErrorMaps(
        judged=judged,
        surface=errors.wrong & judged if errors else None,
        outside=errors.outside & judged if errors else None,
        triangle=(truth.triangle != raster.triangle) & judged & numbered,
        displacement=shift,
        height=_height_map(truth, raster, judged),
        radiance=None,
    )
    return _Band(maps=maps, lengths=lengths(shift)[raster.off_plate])


def _height_map(truth: HogelImage, raster: HogelImage, judged: Mask) -> Floats:
    same = truth.covered & (truth.triangle == raster.triangle) & judged
    same &= np.isfinite(raster.height)
    # Heights of pixels that are not the same may be any number.
    with np.errstate(invalid="ignore", over="ignore"):
        return np.where(same, raster.height - truth.height.astype(np.float64), np.nan)
