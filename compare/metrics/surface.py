"""Surface: which pixels show the wrong one? (docs/method.md, "What is compared")

Independent of how finely a mesh is tessellated, hence the headline. A picture merely displaced
is not a wrong surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.compare.metrics.film import film_coordinates
from xfrustum.compare.rounding.positions import largest_tolerance, position_tolerance
from xfrustum.reference import Reference, SurfacePoints
from xfrustum.scenes.arrays import Indices, Mask, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty, HogelCamera, HogelImage
from xfrustum.scenes.model.scene import Scene


def shown_objects(truth: HogelImage, raster: HogelImage, scene: Scene) -> Numbers:
    """Return the object that each raster pixel shows; where that is not said, the truth's."""
    objects = np.where(raster.object != NOTHING, raster.object, truth.object)
    unnamed = np.flatnonzero((raster.object == NOTHING) & (raster.triangle != NOTHING))
    objects.flat[unnamed] = scene.object_of_triangle[raster.triangle.ravel()[unnamed]]
    return objects


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceErrors:
    """Which pixels show the wrong surface, and which of these show what lies beside the true film.

    Attributes
    ----------
    wrong
        (H, W) pixels that show the wrong surface.
    outside
        (H, W) of these, the ones whose point belongs outside the film [-1, 1]^2: the true frustum shows it
        in no pixel.
    """

    wrong: Mask
    outside: Mask


def wrong_surface(truth: HogelImage, raster: HogelImage, reference: Reference) -> Mask:
    """Return the pixels that show the wrong surface, (H, W); see `surface_errors`."""
    return surface_errors(truth, raster, reference).wrong


def surface_errors(truth: HogelImage, raster: HogelImage, reference: Reference) -> SurfaceErrors:
    """Return the pixels that show the wrong surface.

    Wrong is hit against miss, another object, or a surface point that the true frustum does not
    see: something else is in front of it on its own true line, or that line is none of the frustum's,
    because the point belongs outside the film. A point in the plate is seen by the true frustum only
    through the aperture, where every line meets it.

    A point belongs outside from half a pixel beyond the border's outermost pixel centers on, so that
    a picture displaced by less shows none.
    """
    objects = shown_objects(truth, raster, reference.scene)
    wrong: Mask = truth.covered != raster.covered
    wrong |= (truth.object != objects) & truth.covered
    at_plate = raster.covered & (raster.height == 0)
    wrong |= at_plate & ~(truth.covered & (truth.height == 0))

    outside = np.zeros(wrong.shape, dtype=np.bool_)
    unsure = raster.off_plate.copy()
    unsure.flat[_surely_seen(truth, raster, raster.off_plate & ~wrong, reference.scene)] = False
    unsure_pixels = np.flatnonzero(unsure)
    points = _points(raster, unsure_pixels, reference.scene)
    outside.flat[unsure_pixels] = _outside_film(points, truth.camera)
    wrong |= outside

    asked = ~wrong.ravel()[unsure_pixels]
    other = unsure_pixels[asked]
    shown = SurfacePoints(
        position=points.position[asked], triangle=points.triangle[asked], tolerance=points.tolerance[asked]
    )
    wrong.flat[other] = reference.hidden(truth.camera.aperture, shown)
    return SurfaceErrors(wrong=wrong, outside=outside)


def _points(raster: HogelImage, pixels: Indices, scene: Scene) -> SurfacePoints:
    """Return the surface points that some pixels show, with how exactly they are known."""
    position = raster.position.reshape(-1, 3).take(pixels, axis=0).astype(np.float64)
    number = raster.triangle.ravel()[pixels]
    tolerance = position_tolerance(scene, number, position)
    return SurfacePoints(position=position, triangle=number, tolerance=tolerance)


def _outside_film(points: SurfacePoints, camera: HogelCamera) -> Mask:
    """Return which points (N,) belong outside the film, however their positions were rounded.

    A point that is known to within a tolerance is known on the film to within that over |z| t.
    """
    u = film_coordinates(points.position, camera)
    known_to = points.tolerance[:, None] / (np.abs(points.position[:, 2:]) * camera.half_extent)
    return np.asarray((np.abs(u) > 1 + known_to).any(axis=1))


def _surely_seen(truth: HogelImage, raster: HogelImage, asked: Mask, scene: Scene) -> Indices:
    """Return which of the pixels asked for show, as exactly as that is known, the point that the truth shows.

    What the truth has proven to be seen need not be asked again: most of a picture with a small near.
    """
    if truth.certainty is None:
        return np.zeros(0, dtype=np.int64)
    same = asked & (truth.certainty <= Certainty.EXACT) & (truth.triangle == raster.triangle)
    # Most that are farther apart are so in height already: only the others need all coordinates.
    with np.errstate(invalid="ignore", over="ignore"):
        same &= np.abs(raster.height - truth.height) <= largest_tolerance(scene)
    pixels = np.flatnonzero(same & (raster.triangle != NOTHING))
    triangle = raster.triangle.ravel()[pixels]
    tolerance = position_tolerance(scene, triangle, np.empty((len(pixels), 3)))
    drawn = raster.position.reshape(-1, 3).take(pixels, axis=0).astype(np.float64)
    apart = drawn - truth.position.reshape(-1, 3).take(pixels, axis=0)
    return np.asarray(pixels[np.einsum("ij,ij->i", apart, apart) <= tolerance**2])
