"""How far what an image shows has moved: by its surface points, or by registration of its outlines.

An outline runs between two neighboring pixels, and the place between them is called a step. The steps of the
truth's outlines are moved by every whole number of pixels up to `MAX_DISPLACEMENT_PX` along each axis, and
the picture's contrast is looked up where they come to lie. The displacement with the largest mean contrast is
the displacement of the picture's outlines.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from xfrustum.compare.metrics.error_maps import Spread, covered_by, lengths, pixel_centers
from xfrustum.compare.prediction.contours import Kind, contours
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene

MAX_DISPLACEMENT_PX = 8
"""Largest displacement that is searched, along each axis. What has moved farther has no peak among the 17
by 17 displacements."""

MIN_STEPS = 40
"""Smallest number of steps from which a displacement is taken. A peak is an accident where by chance half
of the steps fall on edges at a wrong displacement. Where one step of a picture in five is an edge, the
binomial distribution expects that at 0.75 of the 289 displacements with 20 steps, and at 0.006 of them with
40."""

MAX_STEPS = 4000
"""Largest number of steps that are looked up. The contrast of one step lies between 0 and a cap, so that the
mean of 4000 has a standard error of at most 0.5 / sqrt(4000) = 0.8 % of the cap: less than what
`EQUAL_PEAK_RATIO` takes for equal anyway, and more steps would not change the result."""

STEPS_PER_TILE = 300
"""Mean number of steps in a tile, where a picture is cut into tiles."""

MAX_TILES_PER_SIDE = 4
"""Largest number of tiles along each side of a picture."""

MIN_PEAK_RATIO = 1.3
"""Smallest ratio of a peak to the median contrast over all displacements. In noise, contrast is as large
everywhere: in 60 pictures of independent uniform pixels the ratio was 1.14 at most with `MIN_STEPS` steps
(1.16 with half as many), which leaves as much again for noise of other kinds."""

EQUAL_PEAK_RATIO = 0.98
"""Smallest ratio to the peak at which the contrast of another displacement cannot be told from it, as along
a straight outline; the smallest of such displacements is taken. Rounding to 8 bits moves the contrast of
one step by 1/255 at most, with a standard deviation of 1/255/sqrt(6), 1.6 % of the largest that counts,
0.1; that of the mean of `MIN_STEPS` is 0.25 %. The largest and the smallest of 17 displacements along an
outline then differ by 3.6 standard deviations, 0.9 %, on the average; twice that is allowed."""

OUTLINE_TOLERANCE_PX = 1
"""Distance from a true outline within which a picture must have an edge, for the outline to be there: the
outline runs between two pixels, and rounding puts it on either side of a center."""

MIN_EDGE_CONTRAST = 4 / 255
"""Smallest difference between two neighboring pixels that is an edge, of the square root of the radiance,
which is nearly what a display encodes: 8 bits and dithering move one brightness by at most 2 steps on
either side."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Steps:
    """A quantity between neighboring pixels.

    Attributes
    ----------
    across, down
        (H, W - 1) between the columns and (H - 1, W) between the rows.
    """

    across: Floats
    down: Floats


def steps_of(values: NDArray[np.generic]) -> Steps:
    """Return absolute differences of neighboring pixels of numbers (H, W); of labels, 1 where they differ."""
    if np.issubdtype(values.dtype, np.floating):
        return Steps(across=np.abs(np.diff(values, axis=1)), down=np.abs(np.diff(values, axis=0)))
    return Steps(
        across=(values[:, 1:] != values[:, :-1]).astype(np.float64),
        down=(values[1:] != values[:-1]).astype(np.float64),
    )


def contrast(image: HogelImage) -> Steps:
    """Return a picture's contrast as it is seen: differences of the square root of its mean radiance."""
    assert image.color is not None
    gray = np.nan_to_num(image.color.astype(np.float64), posinf=1.0, neginf=0.0).mean(axis=-1)
    return steps_of(np.sqrt(np.clip(gray, 0.0, 1.0)))


def true_outlines(answer: HogelImage) -> Steps:
    """Return 1 where outlines of objects, or of one part of an object before another, run; else 0."""
    found = contours(answer)
    height, width = answer.triangle.shape
    chosen = found.kind != Kind.SEAM
    first, second = np.minimum(found.front, found.back)[chosen], np.maximum(found.front, found.back)[chosen]
    across, down = np.zeros((height, width)), np.zeros((height, width))
    beside = second - first == 1
    across.flat[first[beside]] = 1.0
    down.flat[first[~beside]] = 1.0
    return Steps(across=across[:, :-1], down=down[:-1])


def missing_outlines(outlines: Steps, shown: Steps) -> Mask:
    """Return the pixels (H, W) beside an outline where a picture has no edge near enough."""
    height, width = outlines.down.shape[0] + 1, outlines.across.shape[1] + 1
    strongest = np.zeros((height, width))
    for some, place in _both(shown):
        strongest[place] = np.maximum(strongest[place], some)
    strongest = maximum_filter(strongest, size=2 * OUTLINE_TOLERANCE_PX + 1)
    missing = np.zeros((height, width), dtype=np.bool_)
    for some, place in _both(outlines):
        missing[place] |= (some > 0) & (strongest[place] < MIN_EDGE_CONTRAST)
    return missing


def _both(steps: Steps) -> Iterator[tuple[Floats, tuple[slice, slice]]]:
    """Yield the steps of both axes, with the pixels before them."""
    yield steps.across, (slice(None), slice(0, steps.across.shape[1]))
    yield steps.down, (slice(0, steps.down.shape[0]), slice(None))


def outline_displacement(expected: Steps, shown: Steps) -> Spread | None:
    """Measure by how much outlines have moved, over a picture as a whole and each of its tiles.

    Parameters
    ----------
    shown
        Contrast of the picture that is judged, capped, so that a strong edge counts no more than another.

    Returns
    -------
    Spread of the lengths of displacements, px; None where no displacement has clearly the most contrast.
    """
    places, axis, weights = _strongest(expected)
    if len(places) < MIN_STEPS:
        return None
    height, width = expected.down.shape[0] + 1, expected.across.shape[1] + 1
    whole = _peak(places, axis, weights, shown)
    if whole is None:
        return None
    found = [whole]
    side = int(np.clip(np.sqrt(len(places) / STEPS_PER_TILE), 1, MAX_TILES_PER_SIDE))
    tile = places * side // (height, width)
    for number in range(side * side) if side > 1 else ():
        here = tile[:, 0] * side + tile[:, 1] == number
        if here.sum() >= MIN_STEPS:
            moved = _peak(places[here], axis[here], weights[here], shown)
            found += [] if moved is None else [moved]
    return Spread.of(np.hypot(*np.array(found).T))


def _strongest(expected: Steps) -> tuple[Indices, Indices, Floats]:
    """Return row and column (N, 2), axis and weight of the `MAX_STEPS` strongest steps."""
    rows, weights = [], []
    for axis, some in enumerate((expected.across, expected.down)):
        here = np.argwhere(some > 0)
        rows.append(np.column_stack((here, np.full(len(here), axis))))
        weights.append(some[some > 0])
    places, weight = np.concatenate(rows), np.concatenate(weights)
    if len(places) > MAX_STEPS and np.ptp(weight) > 0:
        kept = weight >= np.partition(weight, -MAX_STEPS)[-MAX_STEPS]
        places, weight = places[kept], weight[kept]
    every = -(-len(places) // MAX_STEPS) if len(places) else 1
    return places[::every, :2], places[::every, 2], weight[::every]


def _peak(places: Indices, axis: Indices, weights: Floats, shown: Steps) -> tuple[float, float] | None:
    """Return the displacement (rows, columns) with the most contrast at steps; None if none stands out."""
    reach = MAX_DISPLACEMENT_PX
    scores = np.zeros((2 * reach + 1, 2 * reach + 1))
    counted = np.zeros_like(scores)
    for number, grid in enumerate((shown.across, shown.down)):
        mine = places[axis == number] + reach
        weight = weights[axis == number]
        padded = np.pad(grid, reach)
        inside = np.pad(np.ones_like(grid), reach)
        for row, column in np.ndindex(*scores.shape):
            at = (mine[:, 0] + row - reach, mine[:, 1] + column - reach)
            scores[row, column] += weight @ padded[at]
            counted[row, column] += weight @ inside[at]
    scores /= np.maximum(counted, counted.max() / 2)
    best = float(scores.max())
    if best <= 0 or best < MIN_PEAK_RATIO * float(np.median(scores)):
        return None
    alike = np.argwhere(scores >= EQUAL_PEAK_RATIO * best)
    row, column = alike[np.argmin(np.square(alike - reach).sum(axis=1))].tolist()
    down = row - reach + _between(scores[max(row - 1, 0) : row + 2, column])
    right = column - reach + _between(scores[row, max(column - 1, 0) : column + 2])
    return down, right


def _between(three: Floats) -> float:
    """Return where a parabola through a peak and its two neighbors is highest, from -0.5 to 0.5."""
    if len(three) < 3:
        return 0.0
    before, here, after = three.tolist()
    bend = before - 2 * here + after
    return float(np.clip((before - after) / (2 * bend), -0.5, 0.5)) if bend < 0 else 0.0


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
