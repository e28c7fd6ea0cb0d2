"""Each error as an image, pixel by pixel (docs/method.md, "What is compared")."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.metrics.displacement import Spread, centers_in_rows, displacement_map, lengths
from xfrustum.compare.metrics.drawn_points import PointsOnFilm
from xfrustum.compare.metrics.pixel_bands import BAND_PIXELS, each_part, in_bands
from xfrustum.compare.metrics.surface import surface_errors
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats, Indices, Mask
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
    truth: HogelImage, raster: HogelImage, reference: Reference | None, *, numbered: bool
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
    """

    def judge(true: HogelImage, shown: HogelImage, rows: slice) -> tuple[ErrorMaps, Floats]:
        points = PointsOnFilm.of(shown, truth.camera)
        shift = points.displacement(centers_in_rows(points, rows))
        return _judge(true, shown, reference, numbered, points, shift), lengths(shift)

    bands = in_bands(truth, raster, judge)
    maps = _assembled(np.concatenate, [found for found, _ in bands])
    return maps, np.concatenate([some for _, some in bands])


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedImage:
    """An image that was compared with the truth, beside which images with other depth buffers are judged.

    Most of their pixels show the same point of the same triangle. What is found for a pixel depends on no
    other pixel, so that such pixels need not be judged again.

    Attributes
    ----------
    image
        The image, which names triangles.
    maps
        Its error maps, without that of radiance.
    spread
        Spread of its displacement; None where it shows no surface off the plate.
    """

    image: HogelImage
    maps: ErrorMaps
    spread: Spread | None

    @classmethod
    def of(cls, truth: HogelImage, image: HogelImage, reference: Reference | None) -> JudgedImage:
        """Compare an image that names triangles with the truth."""
        maps, moved = error_maps(truth, image, reference, numbered=True)
        return cls(image=image, maps=maps, spread=Spread.of(moved))

    def differing(self, other: HogelImage) -> Indices:
        """Return the flat numbers of the pixels at which another image shows anything else."""
        differs = (self.image.triangle != other.triangle) | (self.image.object != other.object)
        # Bits are compared, because a position that is not a number equals no other.
        positions = self.image.position, other.position
        exactly = np.result_type(*positions)
        bits = np.dtype(f"u{exactly.itemsize}")
        mine, its = (np.ascontiguousarray(one, dtype=exactly).view(bits).ravel() for one in positions)
        moved = np.flatnonzero(mine != its)
        differs.reshape(-1)[moved // 3] = True
        return np.flatnonzero(differs)


def error_maps_beside(
    truth: HogelImage, raster: HogelImage, reference: Reference | None, judged: JudgedImage
) -> tuple[ErrorMaps, Spread | None]:
    """Return the error maps of an image without that of radiance, and the spread of its displacement.

    Parameters
    ----------
    truth, raster, reference
        Images and tracer as for `error_maps`; the raster names triangles.
    judged
        Image of the same cameras that was compared with this truth, and may show the same at most pixels.
    """
    pixels = judged.differing(raster)
    if not pixels.size:
        return judged.maps, judged.spread

    def judge(some: Indices) -> ErrorMaps:
        shown = raster.at(some)
        points = PointsOnFilm.of(shown, truth.camera)
        row, column = np.divmod(some[points.points.pixels], truth.camera.resolution[0])
        shift = points.displacement((column.astype(np.float64), row.astype(np.float64)))
        return _judge(truth.at(some), shown, reference, True, points, shift)

    parts = np.array_split(pixels, math.ceil(pixels.size / BAND_PIXELS))
    found = each_part(judge, parts, pixels.size)

    def patched(arrays: Sequence[NDArray[Any]]) -> NDArray[Any]:
        whole, *rows = arrays
        changed = whole.copy()
        changed.reshape(-1, *whole.shape[2:])[pixels] = np.concatenate([row[0] for row in rows])
        return changed

    maps = _assembled(patched, [judged.maps, *found])
    return maps, Spread.of(lengths(maps.displacement)[raster.off_plate])


def _assembled(
    join: Callable[[Sequence[NDArray[Any]]], NDArray[Any]], parts: Sequence[ErrorMaps]
) -> ErrorMaps:
    """Return error maps whose arrays are joined from those of several; what any part lacks is None."""

    def joined(name: str) -> Any:
        arrays = [getattr(part, name) for part in parts]
        return None if any(array is None for array in arrays) else join(arrays)

    return ErrorMaps(**{item.name: joined(item.name) for item in fields(ErrorMaps)})


def judged_pixels(truth: HogelImage) -> Mask:
    """Return the pixels whose truth is no tie, (H, W)."""
    if truth.certainty is None:
        return np.ones(truth.triangle.shape, dtype=np.bool_)
    return np.not_equal(truth.certainty, Certainty.TIE)


def _judge(
    truth: HogelImage,
    raster: HogelImage,
    reference: Reference | None,
    numbered: bool,
    shown: PointsOnFilm,
    shift: Floats,
) -> ErrorMaps:
    """Judge some pixels (H, W), given the points that they show and the displacement (N, 2) of these."""
    judged = judged_pixels(truth)
    errors = surface_errors(truth, raster, reference, shown) if reference else None
    same = (truth.triangle == raster.triangle) & judged
    return ErrorMaps(
        judged=judged,
        surface=errors.wrong & judged if errors else None,
        outside=errors.outside & judged if errors else None,
        triangle=judged & ~same if numbered else np.zeros_like(judged),
        displacement=displacement_map(judged.shape, shown, shift),
        height=_height_map(truth, raster, same),
        radiance=None,
    )


def _height_map(truth: HogelImage, raster: HogelImage, same: Mask) -> Floats:
    """Return raster minus truth, (H, W), at the judged pixels with the same triangle number."""
    pixels = np.flatnonzero(same & truth.covered)
    height = raster.height.reshape(-1).take(pixels)
    known = np.isfinite(height)
    error = np.full(same.shape, np.nan)
    error.reshape(-1)[pixels[known]] = height[known] - truth.height.reshape(-1).take(pixels[known])
    return error
