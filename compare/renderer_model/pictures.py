"""Pictures without numbers of triangles: the reference's own color, and how far another may be off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from xfrustum.compare.renderer_model.drawn_color import colored
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.reference import Reference
from xfrustum.reference.averages import averages
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.frustum import Frustum, Screen
from xfrustum.scenes.plate.plate import Aperture

COLOR_TOLERANCE = 2.3 / 255
"""Differences of linear radiance that two 8-bit pictures of one surface may have.

Half a step of 8 bits is 0.5/255 in linear values and, where sRGB is steepest (2.4/1.055 at white), 1.14/255;
once for the renderer's own rounding, once for storing.
"""

SCREEN_HEIGHT = -1.0
"""Height of the screen that stands for a film: one unit behind the plate, where slopes are lengths."""


def reference_colors(reference: Reference, question: DrawnModel, answer: HogelImage) -> HogelImage:
    """Return the answer to a question with the reference's color.

    Where color is an average, near offsets bend nothing, and the viewer's half wins as it must.
    """
    aperture = answer.camera.aperture
    right = DrawnModel()
    nominal = question.parameters.tolist() == right.parameters.tolist()
    nominal &= question.recentering is right.recentering
    if question.plain and question.conjugated and nominal:
        return replace(answer, color=reference.trace(aperture).color)
    shared = replace(question, near=0.0).one_pencil
    if not (averages(reference.scene.sampling) and question.conjugated and shared):
        return colored(reference.scene, question, answer)
    return replace(answer, color=picture_of(reference, question, aperture).color)


def picture_of(
    reference: Reference, model: DrawnModel, aperture: Aperture, finer: int = 1, wider: float = 1.0
) -> HogelImage:
    """Return the reference's picture of an aperture under a model, without its near offset.

    Parameters
    ----------
    reference
        Reference of the scene.
    model
        Model of the renderer; all of its numbers but the near offset are used.
    aperture
        Aperture of the scene.
    finer
        Number of pixels for each pixel, along each side.
    wider
        Factor of the film's extent.
    """
    scene = reference.scene
    pencil = replace(model, near=0.0).pencil(scene, aperture, 0)
    width, height = scene.frustum.resolution
    frustum = Frustum(
        resolution=(round(width * finer * wider), round(height * finer * wider)),
        reach=(-pencil.s_range[0], pencil.s_range[1]),
        screen=Screen(
            height=SCREEN_HEIGHT,
            center=(pencil.center[0] + pencil.shear[0], pencil.center[1] + pencil.shear[1]),
            size=(2 * wider * pencil.half_extent[0], 2 * wider * pencil.half_extent[1]),
        ),
    )
    there = replace(aperture, x=pencil.center[0], y=pencil.center[1])
    # The plate of the picture is z = 0: where the scene lies higher or lower, it is its objects that move.
    below = np.array([0.0, 0.0, pencil.center[2]])
    moved = tuple(replace(part, vertices=part.vertices - below) for part in scene.objects)
    objects = moved if below.any() else scene.objects
    return Reference(replace(scene, frustum=frustum, objects=objects)).trace(there)


def shows_something(image: HogelImage) -> Mask:
    """Return the pixels of a picture that are not black, where backgrounds are."""
    assert image.color is not None
    return np.asarray((image.color > 0).any(axis=-1))


def colors_differ(answer: HogelImage, image: HogelImage, tolerance: float = COLOR_TOLERANCE) -> Mask:
    """Return the pixels whose colors differ by more than a tolerance, or are not numbers."""
    assert answer.color is not None
    assert image.color is not None
    # What is not a number is within no tolerance.
    return np.asarray(~(np.abs(answer.color - image.color) <= tolerance).all(axis=-1))


def as_gray(image: HogelImage) -> Floats:
    """Return what registration looks at: brightness, or one gray for each object, 0 for nothing."""
    if image.color is not None:
        return np.asarray(np.nan_to_num(image.color).mean(axis=-1), dtype=np.float64)
    count = int(image.object.max(initial=0)) + 1
    return np.asarray((image.object + 1) / count, dtype=np.float64)
