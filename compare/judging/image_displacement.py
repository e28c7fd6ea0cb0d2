"""How far what an image shows has moved: by its surface points, or by its outlines."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from xfrustum.compare.judging.outline_shift import (
    MIN_EDGE_CONTRAST,
    Steps,
    contrast,
    outline_displacement,
    steps_of,
    true_outlines,
)
from xfrustum.compare.metrics.displacement import Spread, lengths
from xfrustum.compare.metrics.film import pixel_centers
from xfrustum.compare.metrics.surface import covered_by
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene

COLOR_ONLY = ("color", "outlines")
"""Values of `Figures.by` of pictures that name no surfaces."""

MAX_EDGE_CONTRAST = 0.1
"""Contrast, of the square root of the radiance, beyond which one edge counts no more than another."""


class MeasuredBy(StrEnum):
    """Means by which a displacement was measured."""

    POINTS = "surface points"
    """The surface point of each pixel; where a pixel's line misses the triangle that it names, the point of
    that triangle drawn nearest to it."""
    OUTLINES = "registration of outlines"
    NO_OUTLINES = "no outlines"
    """The truth has no outline, so that there is nothing to measure: wrong pixels alone judge the image."""
    NOTHING = "nothing"
    """The displacement cannot be known."""


def point_displacement(
    scene: Scene, question: DrawnModel, answer: HogelImage, image: HogelImage
) -> tuple[Spread | None, MeasuredBy]:
    """Return how far the surface points of an image's pixels have moved, and what that was measured by."""
    places = question.project(scene, answer.camera.aperture, image.position.astype(np.float64))
    length = lengths(places - pixel_centers(answer.camera))
    known = np.isfinite(length)
    # What most pixels do not say, the others do not say for them.
    if 2 * known.sum() < covered_by(image).sum():
        return None, MeasuredBy.NOTHING
    spread = Spread.of(length[known])
    return spread, MeasuredBy.NOTHING if spread is None else MeasuredBy.POINTS


def picture_displacement(
    answer: HogelImage, image: HogelImage, by: str, differs: Mask
) -> tuple[Spread | None, MeasuredBy]:
    """Return how far the outlines of an image have moved, and what that was measured by.

    An outline of an image that names objects, or shows where something is, runs between two neighboring
    pixels with different labels. If no judged pixel differs from the answer, both images have the same labels
    and hence the same outlines: they have moved by 0. So it is with colors that have the answer's contrast to
    the last bit. Registration would say less, because few or straight outlines do not fix a part of a pixel.
    Colors that are equal within a tolerance are registered, for a dim outline may have moved within it.

    An answer without an outline has nothing that could be seen to move. A right renderer could not do better,
    and what moves into the film from outside is wrong pixels. Soft shading has no outline: it does not say by
    how much it has moved. If there are outlines that cannot be registered, the displacement is not known.

    Parameters
    ----------
    answer, image
        Image that should be shown, and the image that is judged, upright.
    by
        `Figures.by`: object, coverage, color, or outlines.
    differs
        (H, W) judged pixels that differ in it.
    """
    expected, shown = _outlines(answer, image, by)
    # Contrast of colors is compared with the smallest edge, labels and true outlines with none at all.
    edge = MIN_EDGE_CONTRAST if by == "color" else 0.0
    if not any(bool((some > edge).any()) for some in (expected.across, expected.down)):
        return None, MeasuredBy.NO_OUTLINES
    same = np.array_equal(expected.across, shown.across) and np.array_equal(expected.down, shown.down)
    if not differs.any() and (same or by not in COLOR_ONLY):
        return Spread.of(np.zeros(1)), MeasuredBy.OUTLINES
    spread = outline_displacement(expected, shown)
    return spread, MeasuredBy.NOTHING if spread is None else MeasuredBy.OUTLINES


def _outlines(answer: HogelImage, image: HogelImage, by: str) -> tuple[Steps, Steps]:
    """Return where an answer has outlines, and where an image has."""
    if by in COLOR_ONLY:
        seen = contrast(image)
        capped = Steps(
            across=np.minimum(seen.across, MAX_EDGE_CONTRAST), down=np.minimum(seen.down, MAX_EDGE_CONTRAST)
        )
        if by == "outlines":
            return true_outlines(answer), capped
        expected = contrast(answer)
        return Steps(
            across=np.minimum(expected.across, MAX_EDGE_CONTRAST),
            down=np.minimum(expected.down, MAX_EDGE_CONTRAST),
        ), capped
    if by == "object":
        return steps_of(answer.object), steps_of(image.object)
    return steps_of(answer.covered.astype(np.int8)), steps_of(covered_by(image).astype(np.int8))
