"""Surface: the pixels that show the wrong one (docs/method.md, "What is compared").

Their number does not depend on how finely a mesh is tessellated: reports put it first. A picture that is
merely displaced shows no wrong surface.
"""

from __future__ import annotations

import numpy as np

from xfrustum.compare.rounding.positions import largest_tolerance, position_tolerance
from xfrustum.reference import Reference, SurfacePoints
from xfrustum.scenes.arrays import Indices, Mask, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty, HogelImage
from xfrustum.scenes.model.scene import Scene


def shown_objects(truth: HogelImage, raster: HogelImage, scene: Scene) -> Numbers:
    """Return the object that each raster pixel shows; the truth's where the raster image names none."""
    objects = np.where(raster.object != NOTHING, raster.object, truth.object)
    unnamed = np.flatnonzero((raster.object == NOTHING) & (raster.triangle != NOTHING))
    objects.flat[unnamed] = scene.object_of_triangle[raster.triangle.ravel()[unnamed]]
    return objects


def wrong_surface(truth: HogelImage, raster: HogelImage, reference: Reference) -> Mask:
    """Return the pixels that show the wrong surface, (H, W).

    A pixel is wrong where only one of truth and raster shows a surface, where they show different objects,
    and where the true frustum does not see the surface point: something else is in front of it on its own
    true line. The true frustum sees a point in the plate only in the aperture's center, where all lines meet.
    """
    objects = shown_objects(truth, raster, reference.scene)
    wrong: Mask = truth.covered != raster.covered
    wrong |= (truth.object != objects) & truth.covered
    at_plate = raster.covered & (raster.height == 0)
    wrong |= at_plate & ~(truth.covered & (truth.height == 0))

    asked = raster.off_plate & ~wrong
    asked.flat[_surely_seen(truth, raster, asked, reference.scene)] = False
    other = np.flatnonzero(asked)
    position = raster.position.reshape(-1, 3).take(other, axis=0).astype(np.float64)
    number = raster.triangle.ravel()[other]
    tolerance = position_tolerance(reference.scene, number, position)
    points = SurfacePoints(position=position, triangle=number, tolerance=tolerance)
    wrong.flat[other] = reference.hidden(truth.camera.aperture, points)
    return wrong


def _surely_seen(truth: HogelImage, raster: HogelImage, asked: Mask, scene: Scene) -> Indices:
    """Return the numbers of the pixels in `asked` that show, within rounding, the point that the truth shows.

    The truth has proven that this point is seen, so that the tracer need not be asked. With a small near
    these are most pixels of a picture.
    """
    if truth.certainty is None:
        return np.zeros(0, dtype=np.int64)
    same = asked & (truth.certainty <= Certainty.EXACT) & (truth.triangle == raster.triangle)
    # Most points that are farther apart differ in height already: only the others need all coordinates.
    with np.errstate(invalid="ignore", over="ignore"):
        same &= np.abs(raster.height - truth.height) <= largest_tolerance(scene)
    pixels = np.flatnonzero(same & (raster.triangle != NOTHING))
    triangle = raster.triangle.ravel()[pixels]
    tolerance = position_tolerance(scene, triangle, np.empty((len(pixels), 3)))
    drawn = raster.position.reshape(-1, 3).take(pixels, axis=0).astype(np.float64)
    apart = drawn - truth.position.reshape(-1, 3).take(pixels, axis=0)
    return np.asarray(pixels[np.einsum("ij,ij->i", apart, apart) <= tolerance**2])
