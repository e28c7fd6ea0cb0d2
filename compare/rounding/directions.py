"""Causes of wrong pixels in images by direction, which have one camera and no near offset.

A drawn image by direction differs from the truth only by rounding: vertices snap to subpixels in
the plate's plane, and depth is quantized, linearly in z for parallel lines. The cameras of `raster`
are affine, or have their center in a point of the screen. This module describes the same cameras by
the lines of the reference.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from xfrustum.compare.rounding.causes import HEADINGS, Causes, find_causes
from xfrustum.compare.rounding.triangles import PlateFilm, Precision, RoundingCamera
from xfrustum.raster.cameras import direction_pass
from xfrustum.reference import Reference
from xfrustum.reference.lines import TileLines
from xfrustum.scenes.arrays import Indices, Numbers
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.images import NOTHING, DirectionImage, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import DepthFormat, DepthMapping, Frustum, Plate, PlateTile

#: number of pixels that are explained together, each by its own camera
PIXELS_AT_ONCE = 64

Pixel = tuple[int, int]  #: column and row, of a pixel in its hogel or of a hogel on the plate


@dataclass(frozen=True, kw_only=True)
class _Shown:
    """Triangles (rows, columns) of an image by direction; one camera needs no heights."""

    triangle: Numbers
    height: None = None


def direction_camera(
    scene: Scene, tile: PlateTile, pixel: Pixel, precision: Precision
) -> RoundingCamera:
    """Return the camera that draws a pixel (column, row) of every hogel in a tile.

    The truth has the same lines. For a camera in a point of the screen, the rasterizer sets the
    distances of the near and far plane from this point.
    """
    lines = _tile_lines(scene.frustum, tile).of_pixel(pixel)
    planes = direction_pass(scene, tile, pixel).planes
    return RoundingCamera(bundle=PlateFilm.from_lines(lines, planes), precision=precision)


@lru_cache(maxsize=4)
def _tile_lines(frustum: Frustum, tile: PlateTile) -> TileLines:
    """Return the lines of a tile, with a cache, because neighboring hogels are in one tile."""
    return TileLines(frustum, tile)


def explain_direction(
    scene: Scene, truth: DirectionImage, triangle: Numbers, device: DeviceModel, depth: DepthFormat
) -> Causes:
    """Find the cause of every pixel at which the drawn triangle differs from the true triangle.

    `triangle` (rows, columns) is an image of `raster.plate.directions` with a depth buffer of the
    format `depth`.
    """
    camera = direction_camera(scene, truth.tile, truth.pixel, _precision(device, depth))
    pixels = np.flatnonzero(truth.triangle != triangle)
    expected, shown = _Shown(triangle=truth.triangle), _Shown(triangle=triangle)
    return find_causes(scene.triangles, [camera], expected, shown, pixels)


def _precision(device: DeviceModel, depth: DepthFormat) -> Precision:
    return Precision(device=device, depth=depth, mapping=DepthMapping.STANDARD)


@dataclass(frozen=True, kw_only=True, eq=False)
class DirectionPlate:
    """Stored plate that was drawn by directions."""

    #: format of the depth buffer
    depth: DepthFormat
    #: columns and rows of hogels of a tile, fewer at the ends of the plate
    tile: tuple[int, int]
    #: function that returns the stored triangles (rows, columns) of one pixel in a tile of hogels
    shown: Callable[[PlateTile, Pixel], Numbers]

    def explain(
        self,
        reference: Reference,
        device: DeviceModel,
        images: tuple[HogelImage, HogelImage],
        pixels: Indices,
    ) -> Causes:
        """Find the cause of each wrong pixel (N,) of a hogel, with the camera of its direction.

        `images` are the true and the stored image. The film of a camera is the whole tile that was
        drawn. Only the hogel and its neighbors are compared.
        """
        scene, index = reference.scene, images[0].camera.aperture.index
        tile, precision = self._tile_of(scene.plate, index), _precision(device, self.depth)
        place = index[0] - tile.columns[0], index[1] - tile.rows[0]
        true, drawn = (image.triangle.reshape(-1)[pixels] for image in images)
        heading = np.zeros(len(pixels), dtype=np.int8)
        for start in range(0, len(pixels), PIXELS_AT_ONCE):
            part = slice(start, start + PIXELS_AT_ONCE)
            cameras = [
                replace(
                    direction_camera(scene, tile, _pixel(scene, number), precision), pixel=2 * k
                )
                for k, number in enumerate(pixels[part].tolist())
            ]
            # An empty pixel follows each pixel in both images, so that all pixels pass
            # `causes._beside_likeness`.
            expected, shown = (
                _Shown(
                    triangle=np.stack((some, np.full_like(some, NOTHING)), axis=1).reshape(1, -1)
                )
                for some in (true[part], drawn[part])
            )
            own = 2 * np.arange(len(cameras))
            causes = find_causes(scene.triangles, cameras, expected, shown, own, place)
            heading[part] = causes.heading
        # If only one image is covered, an edge is the cause only if the hogel or a neighbor is
        # covered in both images, or empty in both: find the cause again, with the neighbors.
        edge = (heading == HEADINGS.index("edge")) & ((true == NOTHING) != (drawn == NOTHING))
        for number in np.flatnonzero(edge).tolist():
            pixel = _pixel(scene, int(pixels[number]))
            camera = direction_camera(scene, tile, pixel, precision)
            heading[number] = self._beside_others(reference, camera, (tile, index, pixel))
        return Causes(shape=images[0].triangle.shape, pixels=pixels, heading=heading)

    def _beside_others(
        self, reference: Reference, camera: RoundingCamera, where: tuple[PlateTile, Pixel, Pixel]
    ) -> int:
        """Return the heading of a hogel's pixel, from images of the hogel and its neighbors."""
        tile, index, pixel = where
        part = _cut(tile, index)
        (view,) = reference.by_directions(part, [pixel], normals=False, colored=False)
        expected = _Shown(triangle=view.triangle)
        shown = _Shown(triangle=self.shown(part, pixel))
        here = part.rows.index(index[1]) * len(part.columns) + part.columns.index(index[0])
        place = index[0] - tile.columns[0], index[1] - tile.rows[0]
        triangles = reference.scene.triangles
        causes = find_causes(triangles, [camera], expected, shown, np.array([here]), place)
        return int(causes.heading[0])

    def _tile_of(self, plate: Plate, index: Pixel) -> PlateTile:
        """Return the tile of a hogel (column, row)."""
        columns, rows = (
            range(first := at // side * side, min(first + side, count))
            for at, side, count in zip(index, self.tile, plate.hogels, strict=True)
        )
        return PlateTile(plate=plate, columns=columns, rows=rows)


def _pixel(scene: Scene, number: int) -> Pixel:
    """Return the column and row of a pixel by its flat number."""
    row, column = divmod(number, scene.frustum.resolution[0])
    return column, row


def _cut(tile: PlateTile, index: Pixel) -> PlateTile:
    """Return the part of a tile with a hogel (column, row) and its neighbors."""
    columns, rows = (
        range(max(at - 1, cells.start), min(at + 2, cells.stop))
        for at, cells in zip(index, (tile.columns, tile.rows), strict=True)
    )
    return PlateTile(plate=tile.plate, columns=columns, rows=rows)
