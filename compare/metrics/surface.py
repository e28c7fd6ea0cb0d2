"""Surface: the pixels that show the wrong one (docs/method.md, "What is compared").

Their number does not depend on how finely a mesh is tessellated: reports put it first. A picture that is
merely displaced shows no wrong surface.

A pixel can be wrong in three ways. It shows a surface where there is none, no surface where there is one, or
that of another object (`other_surfaces`); or the point that it shows belongs outside the film
(`outside_film`); or that point is hidden behind something else (`hidden_pixels`). The film, and the lines
along which points are hidden, depend on the question: here they are those of the true frustum, in
`xfrustum.compare.judging.judged` those of a renderer's own cameras.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from xfrustum.compare.metrics.film import true_lines
from xfrustum.compare.rounding.positions import largest_tolerance, position_tolerance
from xfrustum.reference import Reference, SurfacePoints
from xfrustum.reference.lines.lines import Pencil, pixel_places
from xfrustum.scenes.arrays import Indices, Mask, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty, HogelImage
from xfrustum.scenes.model.scene import Scene


def covered_by(image: HogelImage) -> Mask:
    """Return the pixels that show a surface, by whichever number or position an image has."""
    return np.asarray(image.covered | (image.object != NOTHING))


def existing_triangles(numbers: Numbers, scene: Scene) -> Numbers:
    """Return triangle numbers of any shape; `NOTHING` where a number is not one of the scene's."""
    return np.where((numbers >= 0) & (numbers < len(scene.faces)), numbers, np.int32(NOTHING))


def shown_objects(expected: HogelImage, shown: HogelImage, scene: Scene) -> Numbers:
    """Return the object that each pixel shows; where the image does not say it, the expected one."""
    objects = np.where(shown.object != NOTHING, shown.object, expected.object)
    unnamed = np.flatnonzero((shown.object == NOTHING) & (shown.triangle != NOTHING))
    number = existing_triangles(shown.triangle.ravel()[unnamed], scene)
    exists = number != NOTHING
    objects.flat[unnamed[exists]] = scene.object_of_triangle[number[exists]]
    return objects


def other_surfaces(expected: HogelImage, shown: HogelImage, scene: Scene) -> Mask:
    """Return the pixels (H, W) that show a surface where none is expected, none, or another object's."""
    wrong: Mask = expected.covered != covered_by(shown)
    wrong |= expected.covered & (expected.object != shown_objects(expected, shown, scene))
    return wrong


def hidden_pixels(
    asked: Mask, shown: HogelImage, scene: Scene, hides: Callable[[SurfacePoints], Mask]
) -> Mask:
    """Return which of the asked pixels show a hidden point, (H, W).

    Parameters
    ----------
    asked
        (H, W) pixels that show a surface point off the plate.
    shown
        Image that is judged.
    scene
        Scene that it shows.
    hides
        Says which of some surface points (N,) are hidden.
    """
    pixels = np.flatnonzero(asked)
    found = np.zeros_like(asked)
    found.flat[pixels] = hides(_shown_points(shown, pixels, scene))
    return found


def _shown_points(shown: HogelImage, pixels: Indices, scene: Scene) -> SurfacePoints:
    """Return the surface points of some pixels (N,), with how exactly they are known."""
    position = shown.position.reshape(-1, 3).take(pixels, axis=0).astype(np.float64)
    number = existing_triangles(shown.triangle.ravel()[pixels], scene)
    tolerance = position_tolerance(scene, number, position)
    return SurfacePoints(position=position, triangle=number, tolerance=tolerance)


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceErrors:
    """The pixels that show the wrong surface, and those of them that show what lies beside the true film.

    Attributes
    ----------
    wrong
        (H, W) pixels that show the wrong surface.
    outside
        (H, W) of these, the pixels whose point belongs outside the film [-1, 1]^2: no pixel of the true
        frustum shows it.
    """

    wrong: Mask
    outside: Mask


def wrong_surface(truth: HogelImage, raster: HogelImage, reference: Reference) -> Mask:
    """Return the pixels that show the wrong surface, (H, W); see `surface_errors`."""
    return surface_errors(truth, raster, reference).wrong


def surface_errors(truth: HogelImage, raster: HogelImage, reference: Reference) -> SurfaceErrors:
    """Return the pixels that show the wrong surface.

    A pixel is wrong where only one of truth and raster shows a surface, where they show different objects,
    where the point that it shows belongs outside the true film, and where the true frustum does not see that
    point: something else is in front of it on its own true line. The true frustum sees a point in the plate
    only in the aperture's center, where all lines meet.

    The film ends half a pixel beyond the outermost pixels' centers, so that a picture that is displaced by
    less shows nothing from outside.

    Parameters
    ----------
    truth, raster
        The true image, and the image that is judged by it.
    reference
        Tracer of the scene.
    """
    scene = reference.scene
    wrong = other_surfaces(truth, raster, scene)
    at_plate = raster.covered & (raster.height == 0)
    wrong |= at_plate & ~(truth.covered & (truth.height == 0))
    unproven = raster.off_plate.copy()
    unproven.flat[_surely_seen(truth, raster, unproven & ~wrong, scene)] = False
    outside = outside_film(unproven, raster, scene, true_lines(truth.camera))
    wrong |= outside
    wrong |= hidden_pixels(
        unproven & ~wrong, raster, scene, lambda points: reference.hidden(truth.camera.aperture, points)
    )
    return SurfaceErrors(wrong=wrong, outside=outside)


def outside_film(asked: Mask, shown: HogelImage, scene: Scene, pencil: Pencil) -> Mask:
    """Return which of the asked pixels show a point that belongs outside the film, however it was rounded.

    A point that is known to within a tolerance is known on the film to within that over w t, with w its depth
    from the center of the lines: |z| for the true frustum.

    Parameters
    ----------
    asked
        (H, W) pixels that show a surface point off the plane of the pencil's center.
    shown
        Image that is judged.
    scene
        Scene that it shows.
    pencil
        Lines of the film.
    """
    pixels = np.flatnonzero(asked)
    points = _shown_points(shown, pixels, scene)
    sides = np.asarray(pencil.resolution, dtype=np.float64)
    per_length = sides / (2 * np.asarray(pencil.half_extent))
    known_to = points.tolerance[:, None] * per_length / np.abs(points.position[:, 2:] - pencil.center[2])
    place = pixel_places(points.position, pencil)
    beyond = (place < -0.5 - known_to) | (place > sides - 0.5 + known_to)
    found = np.zeros_like(asked)
    found.flat[pixels] = beyond.any(axis=1)
    return found


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
