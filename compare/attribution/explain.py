"""Causes of pixels where our rasterizer shows another triangle than its own cameras, traced exactly."""

from __future__ import annotations

import numpy as np

from xfrustum.compare.rounding.cameras import Precision, RoundingCamera
from xfrustum.compare.rounding.causes import Causes, find_causes, misplaced_pixels
from xfrustum.reference.lines.lines import model_cameras
from xfrustum.scenes.arrays import Indices, Mask
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene


def explain(
    scene: Scene,
    model: HogelImage,
    raster: HogelImage,
    subpixel_bits: int,
    pixels: Indices | None = None,
) -> Causes:
    """Find the cause of every pixel where the raster shows another triangle than the traced model.

    Parameters
    ----------
    model
        Image that `Reference.trace_model` makes with the raster's settings; or a raster image with another
        depth buffer, to explain what depth alone has changed.
    subpixel_bits
        Subpixel bits of the device that drew it.
    pixels
        (N,) flat numbers of the pixels that are asked about; all where None.
    """
    wrong = differing_triangles(model, raster, pixels)
    cameras = drawing_cameras(scene, raster, subpixel_bits) if len(wrong) else []
    return find_causes(scene.triangles, cameras, model, raster, wrong)


def differing_triangles(one: HogelImage, other: HogelImage, pixels: Indices | None = None) -> Indices:
    """Return those of some pixels, or of all, at which two images show other triangles, by flat numbers."""
    if pixels is None:
        return np.flatnonzero(one.triangle != other.triangle)
    mine, its = (image.triangle.reshape(-1).take(pixels) for image in (one, other))
    return np.asarray(pixels[mine != its])


def misplaced(scene: Scene, raster: HogelImage, subpixel_bits: int) -> Mask:
    """Return the pixels whose centers the triangles drawn there do not reach, (H, W).

    Surface points of the raster are computed on the drawn triangle, for the pixel's center
    (docs/adr/0005): this is the other half of the measurement, that the triangle was drawn
    where its camera puts it.

    Parameters
    ----------
    subpixel_bits
        Subpixel bits of the device that drew it.
    """
    return misplaced_pixels(scene.triangles, drawing_cameras(scene, raster, subpixel_bits), raster)


def drawing_cameras(scene: Scene, raster: HogelImage, subpixel_bits: int) -> list[RoundingCamera]:
    """Return the cameras that drew an image of our rasterizer; each draws the heights of its own slab."""
    settings = raster.camera.settings
    assert settings is not None
    precision = Precision(subpixel_bits=subpixel_bits, depth=settings.depth, mapping=settings.mapping)
    return [
        RoundingCamera(pencil=camera.pencil, precision=precision, heights=camera.heights)
        for camera in model_cameras(scene.frustum, raster.camera.aperture, settings)
    ]
