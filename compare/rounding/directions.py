"""Causes of wrong pixels in images by direction, which have one camera and no near offset.

A drawn image by direction differs from the truth only by rounding: vertices snap to subpixels in
the plate's plane, and depth is quantized, linearly in z for parallel lines. The cameras of `raster`
are affine, or have their center in a point of the screen. Here the same camera is described by the
lines of the reference.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from xfrustum.compare.rounding.causes import Causes, find_causes
from xfrustum.compare.rounding.triangles import PlateFilm, Precision, RoundingCamera
from xfrustum.raster.cameras.directions import direction_pass
from xfrustum.reference import Reference
from xfrustum.reference.lines.lines import TileLines
from xfrustum.scenes.arrays import Indices, Numbers
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.direction_image import DirectionImage
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping
from xfrustum.scenes.plate.plate import Frustum, Plate, PlateTile

Pixel = tuple[int, int]  #: column and row of a pixel of every hogel, or of a hogel


@dataclass(frozen=True, kw_only=True)
class _Shown:
    """Triangles (rows, columns) of an image by direction; one camera needs no heights."""

    triangle: Numbers
    height: None = None


def direction_camera(
    scene: Scene, tile: PlateTile, pixel: Pixel, precision: Precision
) -> RoundingCamera:
    """Return the camera of a pixel (column, row) of all hogels of a tile.

    The truth has the same lines. For a camera in a point of the screen, the rasterizer sets the
    distances of the near and far plane from this point.
    """
    lines = _tile_lines(scene.frustum, tile).of_pixel(pixel)
    planes = direction_pass(scene, tile, pixel).planes
    return RoundingCamera(bundle=PlateFilm.from_lines(lines, planes), precision=precision)


@lru_cache(maxsize=4)
def _tile_lines(frustum: Frustum, tile: PlateTile) -> TileLines:
    """Return the lines of a tile, of which neighboring hogels need the same."""
    return TileLines(frustum, tile)


def explain_direction(
    scene: Scene, truth: DirectionImage, triangle: Numbers, device: DeviceModel, depth: DepthFormat
) -> Causes:
    """Find the cause of every pixel at which the drawn triangle differs from the true triangle.

    `triangle` (rows, columns) is an image of `raster.plate.directions` with a depth buffer of this
    format.
    """
    camera = direction_camera(scene, truth.tile, truth.pixel, _precision(device, depth))
    return _explained(scene, camera, (truth.triangle, triangle))


def _precision(device: DeviceModel, depth: DepthFormat) -> Precision:
    return Precision(device=device, depth=depth, mapping=DepthMapping.STANDARD)


def _explained(
    scene: Scene,
    camera: RoundingCamera,
    images: tuple[Numbers, Numbers],
    pixels: Indices | None = None,
    corner: Pixel = (0, 0),
) -> Causes:
    """Find causes in the true and the drawn triangles of a part of a film that begins at a corner.

    `pixels` are the flat numbers of pixels of the part; None for all that differ.
    """
    expected, shown = (_Shown(triangle=triangle) for triangle in images)
    if pixels is None:
        pixels = np.flatnonzero(expected.triangle != shown.triangle)
    return find_causes(scene.triangles, [camera], expected, shown, pixels, corner)


@dataclass(frozen=True, kw_only=True, eq=False)
class DirectionPlate:
    """Stored plate that was drawn by directions."""

    #: format of the depth buffer
    depth: DepthFormat
    #: columns and rows of hogels of a tile, fewer at the ends of the plate
    tile: tuple[int, int]
    #: function that returns the stored triangles (rows, columns) of a pixel of some hogels
    shown: Callable[[PlateTile, Pixel], Numbers]

    def explain(
        self,
        reference: Reference,
        device: DeviceModel,
        images: tuple[HogelImage, HogelImage],
        pixels: Indices,
    ) -> Causes:
        """Find the cause of each wrong pixel (N,) of a hogel by the camera of its direction.

        `images` are the true and the stored one. A camera has the film of the tile that was drawn,
        of which only the hogel and its neighbors are compared.
        """
        triangles = [image.triangle for image in images]
        scene, index = reference.scene, images[0].camera.aperture.index
        tile, precision = self._tile_of(scene.plate, index), _precision(device, self.depth)
        heading = np.zeros(len(pixels), dtype=np.int8)
        for place, number in enumerate(pixels.tolist()):
            row, column = divmod(number, scene.frustum.resolution[0])
            true, drawn = (triangle[row, column] for triangle in triangles)
            # The neighbors count only where one of the images shows nothing.
            part = _cut(tile, index, int((true == NOTHING) != (drawn == NOTHING)))
            if part.size == (1, 1):
                pair = np.array([[true]]), np.array([[drawn]])
            else:
                (view,) = reference.by_directions(
                    part, [(column, row)], normals=False, colored=False
                )
                pair = view.triangle, self.shown(part, (column, row))
            camera = direction_camera(scene, tile, (column, row), precision)
            corner = part.columns[0] - tile.columns[0], part.rows[0] - tile.rows[0]
            here = part.rows.index(index[1]) * len(part.columns) + part.columns.index(index[0])
            heading[place] = _explained(scene, camera, pair, np.array([here]), corner).heading[0]
        return Causes(shape=triangles[0].shape, pixels=pixels, heading=heading)

    def _tile_of(self, plate: Plate, index: Pixel) -> PlateTile:
        """Return the tile of a hogel (column, row)."""
        columns, rows = (
            range(first := at // side * side, min(first + side, count))
            for at, side, count in zip(index, self.tile, plate.hogels, strict=True)
        )
        return PlateTile(plate=plate, columns=columns, rows=rows)


def _cut(tile: PlateTile, index: Pixel, around: int) -> PlateTile:
    """Return a hogel (column, row) of a tile, with some hogels of the tile around it."""
    columns, rows = (
        range(max(at - around, cells.start), min(at + around + 1, cells.stop))
        for at, cells in zip(index, (tile.columns, tile.rows), strict=True)
    )
    return PlateTile(plate=tile.plate, columns=columns, rows=rows)
