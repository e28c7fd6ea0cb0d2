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

from xfrustum.compare.metrics.film import DrawnPoints, beyond_film, existing_triangles
from xfrustum.compare.metrics.pixel_findings import SurfaceFindings, pixel_findings
from xfrustum.reference import Reference, SurfacePoints
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Indices, Mask, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
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
    found = pixel_findings(truth, raster, reference.scene).surface
    assert found is not None, "the scene is at hand"
    return decided([Undecided.of(found, raster, reference.scene)], truth, reference)[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class Undecided:
    """Surface errors without the points that another surface hides, and the points that may be hidden.

    Attributes
    ----------
    errors
        Errors that are known.
    pixels
        (N,) flat numbers of pixels that are right so far, and whose points may be hidden.
    points
        Their points.
    """

    errors: SurfaceErrors
    pixels: Indices
    points: SurfacePoints

    @classmethod
    def of(cls, found: SurfaceFindings, image: HogelImage, scene: Scene) -> Undecided:
        """Return what formulas have found of an image."""
        pixels = np.flatnonzero(found.doubtful)
        shape = image.triangle.shape
        return cls(
            errors=SurfaceErrors(wrong=found.wrong.reshape(shape), outside=found.outside.reshape(shape)),
            pixels=pixels,
            points=DrawnPoints.of(image, pixels).surface_points(scene),
        )

    def decided(self, hidden: Mask) -> SurfaceErrors:
        """Return the errors, given which of the points (N,) are hidden."""
        wrong = self.errors.wrong.copy()
        wrong.reshape(-1)[self.pixels[hidden]] = True
        return SurfaceErrors(wrong=wrong, outside=self.errors.outside)


def decided(images: Sequence[Undecided], truth: HogelImage, reference: Reference) -> list[SurfaceErrors]:
    """Return the surface errors of some images of one aperture; what hides points is asked once."""
    points = [image.points for image in images]
    together = SurfacePoints(
        position=np.concatenate([one.position for one in points]),
        triangle=np.concatenate([one.triangle for one in points]),
        tolerance=np.concatenate([one.tolerance for one in points]),
    )
    hidden = reference.hidden(truth.camera.aperture, together)
    ends = np.cumsum([len(image.pixels) for image in images])[:-1]
    return [image.decided(behind) for image, behind in zip(images, np.split(hidden, ends), strict=True)]


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
