"""Causes of wrong pixels in images by direction, which have one camera and no near offset.

A drawn image by direction differs from the truth only by rounding: vertices snap to subpixels in
the plate's plane, and depth is quantized, linearly in z for parallel lines. The cameras of `raster`
are affine, or have their center in a point of the screen. Here the same camera is described by the
lines of the reference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.compare.rounding.causes import Causes, find_causes
from xfrustum.compare.rounding.triangles import PlateFilm, Precision, RoundingCamera
from xfrustum.raster.cameras.directions import direction_pass
from xfrustum.reference.lines.lines import TileLines
from xfrustum.scenes.arrays import Numbers
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.direction_image import DirectionImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping
from xfrustum.scenes.plate.plate import PlateTile


@dataclass(frozen=True, kw_only=True)
class _Shown:
    """Triangles (rows, columns) of an image by direction; one camera needs no heights."""

    triangle: Numbers
    height: None = None


def direction_camera(
    scene: Scene, tile: PlateTile, pixel: tuple[int, int], precision: Precision
) -> RoundingCamera:
    """Return the camera of a pixel (column, row) of all hogels of a tile.

    The truth has the same lines. For a camera in a point of the screen, the rasterizer sets the
    distances of the near and far plane from this point.
    """
    lines = TileLines(scene.frustum, tile).of_pixel(pixel)
    planes = direction_pass(scene, tile, pixel).planes
    return RoundingCamera(bundle=PlateFilm.from_lines(lines, planes), precision=precision)


def explain_direction(
    scene: Scene, truth: DirectionImage, triangle: Numbers, device: DeviceModel, depth: DepthFormat
) -> Causes:
    """Find the cause of every pixel at which the drawn triangle differs from the true triangle.

    `triangle` (rows, columns) is an image of `raster.plate.directions` with a depth buffer of this
    format.
    """
    pixels = np.flatnonzero(truth.triangle != triangle)
    precision = Precision(device=device, depth=depth, mapping=DepthMapping.STANDARD)
    camera = direction_camera(scene, truth.tile, truth.pixel, precision)
    expected, shown = _Shown(triangle=truth.triangle), _Shown(triangle=triangle)
    return find_causes(scene.triangles, [camera], expected, shown, pixels)
