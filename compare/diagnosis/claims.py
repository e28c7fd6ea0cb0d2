"""The claims of images: this pixel, of this file, shows this triangle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.renderer_model.orientations import Orientation
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene

POINT_SIZE = 2.0**-24
"""Size of the triangle that stands for a claimed point, relative to the point's largest coordinate: the
rounding to float32, in which images store points."""

MAX_HOGEL_CLAIMS = 6000
"""Largest number of claims taken from one hogel, so that no hogel outvotes the others. Three hogels give more
than `geometry_fit` ever uses (16,000)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Claims:
    """Pixels and the triangles that they claim to show.

    Attributes
    ----------
    hogel
        (N, 2) column and row of the aperture that the file is named after.
    pixel
        (N, 2) column and row in the file.
    corners
        (N, 3, 3) corners of the triangles, scene units.
    size, hogels
        Columns and rows of the images, and of the plate.
    of_points
        Whether the triangles stand for claimed points. These lie in the scene as the renderer has it, moved
        or scaled; triangles lie in the scene as it was asked for.
    """

    hogel: Indices
    pixel: Indices
    corners: Floats
    size: tuple[int, int]
    hogels: tuple[int, int]
    of_points: bool = False

    def __len__(self) -> int:
        """Return the number of claims."""
        return len(self.hogel)

    def chosen(self, index: Indices | Mask) -> Claims:
        """Return some of the claims."""
        return Claims(
            hogel=self.hogel[index],
            pixel=self.pixel[index],
            corners=self.corners[index],
            size=self.size,
            hogels=self.hogels,
            of_points=self.of_points,
        )

    def thinned(self, count: int, seed: int = 0) -> Claims:
        """Return at most `count` claims, drawn at random with a fixed seed."""
        if len(self) <= count:
            return self
        return self.chosen(np.sort(np.random.default_rng(seed).choice(len(self), count, replace=False)))

    def film(self, orientation: Orientation) -> Floats:
        """Return film coordinates u and v (N, 2) of the pixels' centers after the images are made upright."""
        column, row = orientation.cells(self.pixel[:, 0], self.pixel[:, 1], self.size)
        return np.stack(
            ((2 * column + 1) / self.size[0] - 1, 1 - (2 * row + 1) / self.size[1]), axis=-1
        ).astype(np.float64)

    def apertures(self, order: Orientation, plate: tuple[float, float]) -> Floats:
        """Return x and y (N, 2) of the apertures after these are put in order, scene units."""
        column, row = order.cells(self.hogel[:, 0], self.hogel[:, 1], self.hogels)
        return np.stack(
            (
                (column + 0.5) * plate[0] / self.hogels[0] - plate[0] / 2,
                plate[1] / 2 - (row + 0.5) * plate[1] / self.hogels[1],
            ),
            axis=-1,
        )


def claims_of(scene: Scene, images: Sequence[HogelImage]) -> Claims:
    """Collect the claims of images at the outlines of triangles, where a small move of the geometry shows.

    From an image that names no triangles the surface points are taken as claims.
    """
    hogel, pixel, corners = [], [], []
    of_points = True
    for image in images:
        named = (image.triangle >= 0) & (image.triangle < len(scene.faces))
        if named.any():
            of_points = False
            rows, columns = np.nonzero(named & outlines(image.triangle))
            some = _some(len(rows))
            rows, columns = rows[some], columns[some]
            shown = scene.triangles[image.triangle[rows, columns]]
        else:
            rows, columns = np.nonzero(np.isfinite(image.position).all(axis=-1) & (image.height != 0))
            some = _some(len(rows))
            rows, columns = rows[some], columns[some]
            shown = _as_triangles(image.position[rows, columns].astype(np.float64))
        hogel.append(np.tile(np.array(image.camera.aperture.index, dtype=np.int64), (len(rows), 1)))
        pixel.append(np.stack((columns, rows), axis=-1))
        corners.append(shown)
    return Claims(
        hogel=np.concatenate(hogel),
        pixel=np.concatenate(pixel),
        corners=np.concatenate(corners),
        size=scene.frustum.resolution,
        hogels=scene.plate.hogels,
        of_points=of_points,
    )


def _some(count: int) -> Indices:
    """Return the numbers of at most `MAX_HOGEL_CLAIMS` claims of a hogel, drawn at random."""
    if count <= MAX_HOGEL_CLAIMS:
        return np.arange(count)
    return np.sort(np.random.default_rng(count).choice(count, MAX_HOGEL_CLAIMS, replace=False))


def outlines(labels: NDArray[np.integer]) -> Mask:
    """Return the pixels that have a neighbor with another label or beyond the image's border, (H, W)."""
    padded = np.pad(labels, 1, constant_values=NOTHING - 1)
    inner = padded[1:-1, 1:-1]
    beside = (padded[1:-1, :-2], padded[1:-1, 2:], padded[:-2, 1:-1], padded[2:, 1:-1])
    return np.asarray(np.any([inner != other for other in beside], axis=0))


def _as_triangles(points: Floats) -> Floats:
    """Return triangles (N, 3, 3) parallel to the plate around points, `POINT_SIZE` large."""
    size = POINT_SIZE * np.abs(points).max(axis=1, initial=0.0)
    corners = np.array([[1.0, 0.0, 0.0], [-0.5, 0.75, 0.0], [-0.5, -0.75, 0.0]])
    return np.asarray(points[:, None] + size[:, None, None] * corners)
