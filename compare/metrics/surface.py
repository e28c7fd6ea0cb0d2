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

from xfrustum.compare.metrics.displacement import DrawnPoints, beyond_film, existing_triangles, true_lines
from xfrustum.compare.rounding.positions import largest_tolerance, tolerance_by_size
from xfrustum.reference import Reference, SurfacePoints
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats, Mask, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Cull


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


def in_plate(image: HogelImage) -> Mask:
    """Return the pixels that show a surface point in the plate, (H, W)."""
    return np.asarray(image.covered & (image.height == 0))


def wrong_surface(truth: HogelImage, raster: HogelImage, reference: Reference) -> Mask:
    """Return the pixels that show the wrong surface, (H, W); see `surface_errors`."""
    return surface_errors(truth, raster, reference).wrong


def surface_errors(
    truth: HogelImage,
    raster: HogelImage,
    reference: Reference,
    located: tuple[DrawnPoints, tuple[Floats, Floats]] | None = None,
) -> SurfaceErrors:
    """Return the pixels that show the wrong surface.

    A pixel is wrong where only one of truth and raster shows a surface, where they show different objects,
    where the point that it shows belongs outside the true film, and where the true frustum does not see that
    point: something else is in front of it on its own true line. The true frustum sees a point in the plate
    only in the aperture's center, where all lines meet.

    The film ends half a pixel beyond the outermost pixels' centers, so that a picture that is displaced by
    less shows nothing from outside.

    Parameters
    ----------
    located
        The raster's points off the plate and their places on the true film, where they are known already.
    """
    scene, pencil = reference.scene, true_lines(truth.camera)
    if located is None:
        points = DrawnPoints.of(raster, np.flatnonzero(raster.off_plate))
        located = points, points.places(pencil)
    points, places = located
    # Row by row in memory, whatever the order of the images' arrays is: pixels are marked by flat numbers.
    wrong = np.ascontiguousarray(other_surfaces(truth, raster, scene))
    wrong |= in_plate(raster) & ~in_plate(truth)
    seen = _proven_seen(truth, points, scene) & ~wrong.reshape(-1)[points.pixels]
    beyond = beyond_film(points, places, pencil, scene) & ~seen
    outside = np.zeros_like(wrong)
    outside.reshape(-1)[points.pixels[beyond]] = True
    wrong |= outside
    doubtful = points.at(np.flatnonzero(~seen & ~wrong.reshape(-1)[points.pixels]))
    hidden = reference.hidden(truth.camera.aperture, doubtful.surface_points(scene))
    wrong.reshape(-1)[doubtful.pixels[hidden]] = True
    return SurfaceErrors(wrong=wrong, outside=outside)


def _proven_seen(truth: HogelImage, points: DrawnPoints, scene: Scene) -> Mask:
    """Return which points (N,) are, within rounding, those of the truth, which are proven to be seen.

    With a tiny near these are most points.
    """
    found = np.zeros(len(points.pixels), dtype=np.bool_)
    if truth.certainty is None:
        return found
    same = points.triangle == truth.triangle.reshape(-1)[points.pixels]
    same &= (points.triangle >= 0) & (points.triangle < len(scene.faces))
    same &= truth.certainty.reshape(-1)[points.pixels] <= Certainty.EXACT
    # With a larger near hardly a point is left after its height alone.
    height = truth.height.reshape(-1)[points.pixels]
    some = np.flatnonzero(same & (np.abs(points.coordinates[2] - height) <= largest_tolerance(scene)))
    drawn = points.at(some)
    apart = drawn.coordinates - DrawnPoints.of(truth, drawn.pixels).coordinates
    tolerance = tolerance_by_size(scene.largest_coordinates[drawn.triangle])
    found[some] = np.square(apart).sum(axis=0) <= np.square(tolerance)
    return found


def outside_film(asked: Mask, shown: HogelImage, scene: Scene, pencil: Pencil) -> Mask:
    """Return which of the asked pixels (H, W) show a point that belongs outside the film; see `beyond_film`.

    Parameters
    ----------
    asked
        (H, W) pixels that show a surface point off the plane of the pencil's center.
    """
    points = DrawnPoints.of(shown, np.flatnonzero(asked))
    found = np.zeros_like(asked)
    found.flat[points.pixels] = beyond_film(points, points.places(pencil), pencil, scene)
    return found


def turned_away(truth: HogelImage) -> Mask:
    """Return the pixels (H, W) whose true surface shows its back: its normal points away from the viewer.

    With culling such a pixel shows nothing, or what lies behind that surface: the wrong surface either way.
    """
    assert truth.normal is not None, "the reference gives normals"
    directions = true_lines(truth.camera).directions()
    with np.errstate(invalid="ignore"):
        return np.asarray(np.einsum("hwi,hwi->hw", truth.normal, directions) > 0)


def culled_pixels(truth: HogelImage, raster: HogelImage) -> Mask | None:
    """Return the pixels (H, W) whose true surface the raster's cameras leave out; None where nothing is."""
    settings = raster.camera.settings
    if settings is None or settings.cull is Cull.NONE or truth.normal is None:
        return None
    return turned_away(truth)
