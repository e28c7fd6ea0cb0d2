"""How far what an image shows has moved: by its surface points, or by registration of its outlines.

An outline runs between two neighboring pixels, and the place between them is called a step. The steps of the
truth's outlines are moved by every whole number of pixels up to `MAX_DISPLACEMENT_PX` along each axis, and
the picture's contrast is looked up where they come to lie. The displacement with the largest mean contrast is
the displacement of the picture's outlines.
"""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from xfrustum.compare.metrics.error_maps import Spread, covered_by, lengths, pixel_centers
from xfrustum.compare.prediction.silhouettes import Kind, contours
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene

# Largest displacement that is searched, along each axis. What has moved farther has no peak among the 17 by
# 17 displacements.
MAX_DISPLACEMENT_PX = 8

# Smallest number of steps from which a displacement is taken. A peak is an accident where by chance half of
# the steps fall on edges at a wrong displacement. Where one step of a picture in five is an edge, the
# binomial distribution expects that at 0.75 of the 289 displacements with 20 steps, and at 0.006 of them with
# 40.
MIN_STEPS = 40

# Largest number of steps that are looked up. The contrast of one step lies between 0 and a cap, so that the
# mean of 4000 has a standard error of at most 0.5 / sqrt(4000) = 0.8 % of the cap: less than what
# `EQUAL_PEAK_RATIO` takes for equal anyway, and more steps would not change the result.
MAX_STEPS = 4000

# Mean number of steps in a tile, and largest number of tiles along each side, where a picture is cut.
STEPS_PER_TILE, MAX_TILES_PER_SIDE = 300, 4

# Smallest ratio of a peak to the median contrast over all displacements. In noise, contrast is as large
# everywhere: in 60 pictures of independent uniform pixels the ratio was 1.14 at most with `MIN_STEPS` steps
# (1.16 with half as many), which leaves as much again for noise of other kinds.
MIN_PEAK_RATIO = 1.3

# Smallest ratio to the peak at which the contrast of another displacement cannot be told from it, as along a
# straight outline; the smallest of such displacements is taken. Rounding to 8 bits moves the contrast of one
# step by 1/255 at most, with a standard deviation of 1/255/sqrt(6), 1.6 % of the largest that counts, 0.1;
# that of the mean of `MIN_STEPS` is 0.25 %. The largest and the smallest of 17 displacements along an outline
# then differ by 3.6 standard deviations, 0.9 %, on the average; twice that is allowed.
EQUAL_PEAK_RATIO = 0.98

# Distance from a true outline within which a picture must have an edge, for the outline to be there: the
# outline runs between two pixels, and rounding puts it on either side of a center.
OUTLINE_TOLERANCE_PX = 1

# Smallest difference between two neighboring pixels that is an edge, of the square root of the radiance,
# which is nearly what a display encodes: 8 bits and dithering move one brightness by at most 2 steps on
# either side.
MIN_EDGE_CONTRAST = 4 / 255

# Contrast, of the square root of the radiance, beyond which one edge counts no more than another.
MAX_EDGE_CONTRAST = 0.1

COLOR_ONLY = ("color", "outlines")
"""Values of `HogelNumbers.by` of pictures that name no surfaces."""

Steps = tuple[Floats, Floats]
"""A quantity between neighboring pixels: (H, W - 1) between the columns and (H - 1, W) between the rows."""


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


def steps_of(values: NDArray[np.generic]) -> Steps:
    """Return absolute differences of neighboring pixels of numbers (H, W); of labels, 1 where they differ."""
    if np.issubdtype(values.dtype, np.floating):
        return np.abs(np.diff(values, axis=1)), np.abs(np.diff(values, axis=0))
    across, down = values[:, 1:] != values[:, :-1], values[1:] != values[:-1]
    return across.astype(np.float64), down.astype(np.float64)


def contrast(image: HogelImage, most: float = np.inf) -> Steps:
    """Return a picture's contrast as it is seen: differences of the square root of its mean radiance."""
    assert image.color is not None
    gray = np.nan_to_num(image.color.astype(np.float64), posinf=1.0, neginf=0.0).mean(axis=-1)
    across, down = steps_of(np.sqrt(np.clip(gray, 0.0, 1.0)))
    return np.minimum(across, most), np.minimum(down, most)


def true_outlines(answer: HogelImage) -> Steps:
    """Return 1 where outlines of objects, or of one part of an object before another, run; else 0."""
    found = contours(answer)
    chosen = found.kind != Kind.SEAM
    first, second = np.minimum(found.front, found.back)[chosen], np.maximum(found.front, found.back)[chosen]
    across, down = np.zeros(answer.triangle.shape), np.zeros(answer.triangle.shape)
    beside = second - first == 1
    across.flat[first[beside]] = 1.0
    down.flat[first[~beside]] = 1.0
    return across[:, :-1], down[:-1]


def missing_outlines(outlines: Steps, shown: Steps) -> Mask:
    """Return the pixels (H, W) beside an outline where a picture has no edge near enough."""
    # The pixels before the steps of either axis.
    before = (slice(None), slice(-1)), (slice(-1), slice(None))
    strongest = np.zeros((len(outlines[0]), outlines[1].shape[1]))
    for some, place in zip(shown, before, strict=True):
        strongest[place] = np.maximum(strongest[place], some)
    strongest = maximum_filter(strongest, size=2 * OUTLINE_TOLERANCE_PX + 1)
    missing = np.zeros(strongest.shape, dtype=np.bool_)
    for some, place in zip(outlines, before, strict=True):
        missing[place] |= (some > 0) & (strongest[place] < MIN_EDGE_CONTRAST)
    return missing


def outline_displacement(expected: Steps, shown: Steps) -> Spread | None:
    """Measure by how much outlines have moved, over a picture as a whole and each of its tiles.

    `shown` is the contrast of the picture that is judged, capped, so that a strong edge counts no more than
    another. Returned are the lengths of displacements, px; None where none has clearly the most contrast.
    """
    # Row and column (N, 2), axis and weight of the strongest steps.
    rows = [np.argwhere(some > 0) for some in expected]
    places, weights = np.concatenate(rows), np.concatenate([some[some > 0] for some in expected])
    axis = np.repeat([0, 1], [len(some) for some in rows])
    if len(places) > MAX_STEPS and np.ptp(weights) > 0:
        kept = weights >= np.partition(weights, -MAX_STEPS)[-MAX_STEPS]
        places, weights, axis = places[kept], weights[kept], axis[kept]
    every = -(-len(places) // MAX_STEPS) or 1
    places, weights, axis = places[::every], weights[::every], axis[::every]
    whole = _peak(places, axis, weights, shown) if len(places) >= MIN_STEPS else None
    if whole is None:
        return None
    found = [whole]
    side = int(np.clip(np.sqrt(len(places) / STEPS_PER_TILE), 1, MAX_TILES_PER_SIDE))
    tile = places * side // (len(expected[0]), expected[1].shape[1])
    for number in range(side * side) if side > 1 else ():
        here = tile[:, 0] * side + tile[:, 1] == number
        if here.sum() >= MIN_STEPS:
            moved = _peak(places[here], axis[here], weights[here], shown)
            found += [] if moved is None else [moved]
    return Spread.of(np.hypot(*np.array(found).T))


def _peak(places: Indices, axis: Indices, weights: Floats, shown: Steps) -> tuple[float, float] | None:
    """Return the displacement (rows, columns) with the most contrast at steps; None if none stands out."""
    reach = MAX_DISPLACEMENT_PX
    scores = np.zeros((2 * reach + 1, 2 * reach + 1))
    counted = np.zeros_like(scores)
    for number, grid in enumerate(shown):
        mine, weight = places[axis == number], weights[axis == number]
        padded, inside = np.pad(grid, reach), np.pad(np.ones_like(grid), reach)
        for row, column in np.ndindex(*scores.shape):
            at = (mine[:, 0] + row, mine[:, 1] + column)
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


def point_displacement(
    scene: Scene, question: DrawnModel, answer: HogelImage, image: HogelImage
) -> tuple[Spread | None, MeasuredBy]:
    """Return how far the surface points of an image's pixels have moved, and what that was measured by."""
    places = question.project(scene, answer.camera.aperture, image.position.astype(np.float64))
    length = lengths(places - pixel_centers(answer.camera))
    known = np.isfinite(length)
    # What most pixels do not say, the others do not say for them.
    if not known.any() or 2 * known.sum() < covered_by(image).sum():
        return None, MeasuredBy.NOTHING
    return Spread.of(length[known]), MeasuredBy.POINTS


def picture_displacement(
    answer: HogelImage, image: HogelImage, by: str, differs: Mask
) -> tuple[Spread | None, MeasuredBy]:
    """Return how far the outlines of an image have moved, and what that was measured by.

    An outline of an image that names objects, or shows where something is, runs between two neighboring
    pixels with different labels. If no judged pixel differs from the answer (`differs`, (H, W)), both images
    have the same labels and hence the same outlines: they have moved by 0. So it is with colors that have the
    answer's contrast to the last bit. Registration would say less, because few or straight outlines do not
    fix a part of a pixel. Colors that are equal within a tolerance are registered, for a dim outline may have
    moved within it.

    An answer without an outline has nothing that could be seen to move. A right renderer could not do better,
    and what moves into the film from outside is wrong pixels. Soft shading has no outline: it does not say by
    how much it has moved. If there are outlines that cannot be registered, the displacement is not known.
    """
    if by in COLOR_ONLY:
        shown = contrast(image, MAX_EDGE_CONTRAST)
        expected = true_outlines(answer) if by == "outlines" else contrast(answer, MAX_EDGE_CONTRAST)
    elif by == "object":
        expected, shown = steps_of(answer.object), steps_of(image.object)
    else:
        expected, shown = steps_of(answer.covered), steps_of(covered_by(image))
    # Contrast of colors is compared with the smallest edge, labels and true outlines with none at all.
    edge = MIN_EDGE_CONTRAST if by == "color" else 0.0
    if not any(bool((some > edge).any()) for some in expected):
        return None, MeasuredBy.NO_OUTLINES
    same = all(np.array_equal(one, other) for one, other in zip(expected, shown, strict=True))
    if not differs.any() and (same or by not in COLOR_ONLY):
        return Spread.of(np.zeros(1)), MeasuredBy.OUTLINES
    spread = outline_displacement(expected, shown)
    return spread, MeasuredBy.NOTHING if spread is None else MeasuredBy.OUTLINES
