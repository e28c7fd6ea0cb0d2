"""Means over the pixel's box and over the aperture, drawn in tiles (paper, section 6: band limiting)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from OpenGL import GL

from xfrustum.raster.cameras.passes import Pass
from xfrustum.raster.device.targets import most_samples
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.arrays import Singles
from xfrustum.scenes.errors import InputError

POINTS_AT_ONCE = 1 << 21
"""Points that are drawn at once. This bounds a target's memory, 28 bytes for each coverage sample of a
point."""


@dataclass(frozen=True, kw_only=True)
class Tile:
    """A part of the film that is drawn at once, several points a pixel."""

    film: tuple[int, int]  #: W, H of the whole film in pixels
    corner: tuple[int, int]  #: Column and row of the tile's first pixel, from the top left of the film
    extent: tuple[int, int]  #: Columns and rows of pixels; they may run past the film's end
    supersample: int  #: Points along each side of a pixel

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows of points."""
        return self.extent[0] * self.supersample, self.extent[1] * self.supersample

    def seen_by(self, camera: Pass) -> Pass:
        """Return the camera whose whole image is this part of its film."""
        (width, height), (column, row), (columns, rows) = self.film, self.corner, self.extent
        center = ((2 * column + columns) / width - 1, 1 - (2 * row + rows) / height)
        matrix = np.eye(4)
        for axis, part in enumerate((columns / width, rows / height)):
            matrix[axis, axis] = 1 / part
            matrix[axis, 3] = -center[axis] / part
        return replace(camera, clip_from_scene=matrix @ camera.clip_from_scene)


def tiles(film: tuple[int, int], supersample: int, largest: int) -> Iterator[Tile]:
    """Return tiles of one size that cover a film, row by row.

    Parameters
    ----------
    film
        W, H in pixels.
    supersample
        Points along each side of a pixel.
    largest
        Largest width or height, in points, that the device draws.
    """
    width, height = film
    columns = min(width, max(1, min(largest, POINTS_AT_ONCE // supersample) // supersample))
    at_once = max(1, POINTS_AT_ONCE // (columns * supersample**2))
    rows = min(height, at_once, largest // supersample)
    for row in range(0, height, rows):
        for column in range(0, width, columns):
            yield Tile(film=film, corner=(column, row), extent=(columns, rows), supersample=supersample)


class Mean:
    """The mean color of images that are drawn in tiles, summed in double precision.

    Parameters
    ----------
    film
        W, H in pixels.
    """

    def __init__(self, film: tuple[int, int]) -> None:
        self._sum = np.zeros((film[1], film[0], 3))

    def add(self, tile: Tile, color: Singles) -> None:
        """Add the points of one tile, (rows, columns, 3), row 0 at the top."""
        (columns, rows), (column, row), n = tile.extent, tile.corner, tile.supersample
        boxes = color.reshape(rows, n, columns, n, 3)
        mean = boxes.mean(axis=(1, 3), dtype=np.float64)
        there = self._sum[row : row + rows, column : column + columns]
        there += mean[: there.shape[0], : there.shape[1]]

    def over(self, count: int) -> Singles:
        """Return the mean of a number of whole images, (H, W, 3)."""
        return (self._sum / count).astype(np.float32)


def check_sampling(sampling: Sampling, device: str) -> None:
    """Raise InputError where the current context's device cannot sample so finely."""
    coverage = most_samples()
    if sampling.multisample > coverage:
        raise InputError(
            f"multisample {sampling.multisample} is too fine for {device}, which has at most {coverage} "
            "coverage samples; choose fewer, or supersample"
        )
    largest = largest_image()
    if sampling.supersample > largest:
        raise InputError(
            f"supersample {sampling.supersample} is too fine for {device}, which draws at most {largest} "
            "points in a row; choose fewer"
        )


def largest_image() -> int:
    """Return the largest width and height of an image on the current context's device."""
    return int(GL.glGetIntegerv(GL.GL_MAX_TEXTURE_SIZE))
