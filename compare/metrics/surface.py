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

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from xfrustum.compare.metrics.film import (
    DrawnPoints,
    PointsOnFilm,
    beyond_film,
    existing_triangles,
)
from xfrustum.compare.rounding.positions import largest_tolerance, position_tolerance
from xfrustum.reference import Reference, SurfacePoints
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Indices, Mask, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty, HogelImage
from xfrustum.scenes.model.scene import Scene


def covered_by(image: HogelImage) -> Mask:
    """Return the pixels that show a surface, by whichever number or position an image has."""
    return np.asarray(image.covered | (image.object != NOTHING))


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
    found.flat[pixels] = hides(DrawnPoints.of(shown, pixels).surface_points(scene))
    return found


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
        Reference of the scene.
    """
    found = undecided(truth, raster, reference.scene, PointsOnFilm.of(raster, truth.camera))
    return found.decided(truth, reference)


@dataclass(frozen=True, kw_only=True, eq=False)
class Undecided:
    """Surface errors without the points that another surface hides, and the points that may be hidden.

    Attributes
    ----------
    errors
        Errors that are known.
    points
        Points that may be hidden, at pixels that are right so far.
    """

    errors: SurfaceErrors
    points: DrawnPoints

    def decided(self, truth: HogelImage, reference: Reference) -> SurfaceErrors:
        """Return the errors with the pixels whose points are hidden from the true frustum."""
        points = self.points.surface_points(reference.scene)
        hidden = reference.hidden(truth.camera.aperture, points)
        wrong = self.errors.wrong.copy()
        wrong.reshape(-1)[self.points.pixels[hidden]] = True
        return SurfaceErrors(wrong=wrong, outside=self.errors.outside)

    @classmethod
    def joined(cls, bands: Sequence[Undecided]) -> Undecided:
        """Return what is known of an image, given what is known of its bands of rows, from the top."""
        above, parts = 0, []
        for band in bands:
            height, width = band.errors.wrong.shape
            parts.append(band.points.moved_down(above, width))
            above += height
        errors = SurfaceErrors(
            wrong=np.concatenate([band.errors.wrong for band in bands]),
            outside=np.concatenate([band.errors.outside for band in bands]),
        )
        return cls(errors=errors, points=DrawnPoints.joined(parts))


def undecided(truth: HogelImage, raster: HogelImage, scene: Scene, shown: PointsOnFilm) -> Undecided:
    """Return the surface errors that are known without asking what hides points; see `surface_errors`.

    Parameters
    ----------
    truth, raster, scene
        The true image, the image that is judged by it, and the scene of both.
    shown
        All points that the raster shows.
    """
    # Flat numbers count along rows, in whatever order the images' arrays lie in memory.
    wrong = np.ascontiguousarray(other_surfaces(truth, raster, scene))
    at_plate = np.flatnonzero(raster.covered & ~raster.off_plate)
    at_plate = at_plate[raster.height.reshape(-1).take(at_plate) == 0]
    true_at_plate = truth.covered.take(at_plate) & (truth.height.reshape(-1).take(at_plate) == 0)
    wrong.reshape(-1)[at_plate[~true_at_plate]] = True
    # From here on every array has one entry for each point.
    points, pixels = shown.points, shown.points.pixels
    right = ~wrong.take(pixels)
    unproven = np.ones(len(pixels), dtype=np.bool_)
    unproven[_surely_seen(truth, points, right, scene)] = False
    beyond = beyond_film(points, (shown.columns, shown.rows), shown.pencil, scene) & unproven
    outside = np.zeros(wrong.shape, dtype=np.bool_)
    outside.reshape(-1)[pixels[beyond]] = True
    doubtful = np.flatnonzero(unproven & right & ~beyond)
    return Undecided(errors=SurfaceErrors(wrong=wrong | outside, outside=outside), points=points.at(doubtful))


def outside_film(asked: Mask, shown: HogelImage, scene: Scene, pencil: Pencil) -> Mask:
    """Return which of the asked pixels (H, W) show a point that belongs outside the film; see `beyond_film`.

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
    points = DrawnPoints.of(shown, np.flatnonzero(asked))
    found = np.zeros_like(asked)
    found.flat[points.pixels] = beyond_film(points, points.places(pencil), pencil, scene)
    return found


def _surely_seen(truth: HogelImage, points: DrawnPoints, asked: Mask, scene: Scene) -> Indices:
    """Return the places of the asked points that are, within rounding, the points that the truth shows.

    The truth has proven that these points are seen, so that the tracer need not be asked. With a tiny near
    they are most points of a picture.

    Parameters
    ----------
    truth
        True image, in whose pixels the points are shown.
    points
        All points of the image that is judged.
    asked
        (N,) which of them are asked about.
    scene
        Scene that they are on.
    """
    if truth.certainty is None:
        return np.zeros(0, dtype=np.int64)
    pixels, (x, y, z) = points.pixels, points.coordinates
    # Most points that are farther apart differ in height already: only the others need all coordinates.
    with np.errstate(invalid="ignore", over="ignore"):
        near = np.abs(z - truth.height.reshape(-1).take(pixels)) <= largest_tolerance(scene)
    near &= asked
    near &= points.triangle == truth.triangle.take(pixels)
    some = np.flatnonzero(near)
    triangle = points.triangle[some]
    decided = (truth.certainty.take(pixels[some]) <= Certainty.EXACT) & (triangle != NOTHING)
    some, triangle = some[decided], triangle[decided]
    known = truth.position.reshape(-1, 3).take(pixels[some], axis=0)
    apart = (x[some] - known[:, 0]) ** 2 + (y[some] - known[:, 1]) ** 2 + (z[some] - known[:, 2]) ** 2
    tolerance = position_tolerance(scene, triangle, known)
    return np.asarray(some[apart <= tolerance**2])
