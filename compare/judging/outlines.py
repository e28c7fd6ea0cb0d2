"""Outlines of pictures in any shading: positions, gaps and displacement.

An outline runs between two neighboring pixels, and the place between them is called a step.
Displacement is measured by registration: the steps of the truth's outlines are moved by every whole
number of pixels up to `MAX_DISPLACEMENT_PX` along each axis, and the picture's contrast is read at
their new places. The displacement with the largest mean contrast is the result.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from xfrustum.compare.error_maps import Spread, true_lines
from xfrustum.compare.prediction.silhouettes import Kind, contours
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.images import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene

# Largest displacement that is searched, along each axis: 17 by 17 displacements are tried.
MAX_DISPLACEMENT_PX = 8

# Smallest number of steps for a measurement of displacement. A false peak arises if, at a wrong
# displacement, half of the steps are on edges by chance. If one step in five of a picture is an
# edge, the binomial distribution predicts 0.75 false peaks among the 289 displacements with 20
# steps, and 0.006 with 40.
MIN_STEPS = 40

# Largest number of steps that are evaluated. The contrast of one step is between 0 and a cap, so
# that the mean of 4000 has a standard error of at most 0.5 / sqrt(4000) = 0.8 % of the cap, less
# than the tolerance of `EQUAL_PEAK_RATIO`. Mean number of steps in a tile, and largest number of
# tiles along each side.
MAX_STEPS, STEPS_PER_TILE, MAX_TILES_PER_SIDE = 4000, 300, 4

# Smallest ratio of a peak to the median contrast over all displacements. In noise, contrast is
# equal everywhere: in 60 pictures of independent uniform pixels the ratio was at most 1.14 with
# `MIN_STEPS` steps (1.16 with half as many). The limit leaves the same margin again for other
# noise.
MIN_PEAK_RATIO = 1.3

# Smallest ratio to the peak at which another displacement counts as equal, as along a straight
# outline; the smallest of equal displacements is used. Rounding to 8 bits moves the contrast of one
# step by 1/255 at most, with a standard deviation of 1/255/sqrt(6), 1.6 % of the cap; for the
# mean of `MIN_STEPS` steps it is 0.25 %. The largest and the smallest contrast of 17 displacements
# along an outline then differ by 3.6 standard deviations, 0.9 %, on average. Twice that is allowed.
EQUAL_PEAK_RATIO = 0.98

# Distance from a true outline within which a picture must have an edge; otherwise the outline is
# missing. The outline is between two pixels, and rounding may move it across a center.
OUTLINE_TOLERANCE_PX = 1

# Smallest difference between two neighboring pixels that counts as an edge, in the square root of
# radiance, which is nearly the encoding of displays: 8 bits and dithering move one brightness by at
# most 2 steps on either side. Cap of contrast, above which all edges count equally.
MIN_EDGE_CONTRAST, MAX_EDGE_CONTRAST = 4 / 255, 0.1

Steps = tuple[Floats, Floats]
"""Quantity between neighboring pixels: (H, W - 1) along rows and (H - 1, W) along columns."""


def steps_of(values: NDArray[np.generic]) -> Steps:
    """Return absolute differences of neighboring numbers (H, W); 1 between different labels."""
    if np.issubdtype(values.dtype, np.floating):
        return np.abs(np.diff(values, axis=1)), np.abs(np.diff(values, axis=0))
    across, down = values[:, 1:] != values[:, :-1], values[1:] != values[:-1]
    return across.astype(np.float64), down.astype(np.float64)


def contrast(image: HogelImage, most: float = np.inf) -> Steps:
    """Return a picture's visible contrast: differences of the root of its mean radiance."""
    assert image.color is not None
    gray = np.nan_to_num(image.color.astype(np.float64), posinf=1.0, neginf=0.0).mean(axis=-1)
    across, down = steps_of(np.sqrt(np.clip(gray, 0.0, 1.0)))
    return np.minimum(across, most), np.minimum(down, most)


def true_outlines(scene: Scene, answer: HogelImage) -> Steps:
    """Return 1 along outlines of objects or of their parts, else 0."""
    # Neighboring points are on one surface if the normals of their triangles agree.
    result = contours(replace(answer, normal=_normals(scene, answer)))
    chosen = result.kind != Kind.SEAM
    first, second = (
        np.minimum(result.front, result.back)[chosen],
        np.maximum(result.front, result.back)[chosen],
    )
    across, down = np.zeros(answer.triangle.shape), np.zeros(answer.triangle.shape)
    pair = second - first == 1
    across.flat[first[pair]] = 1.0
    down.flat[first[~pair]] = 1.0
    return across[:, :-1], down[:-1]


def strongest_steps(steps: Steps) -> Floats:
    """Return the strongest step after each pixel (H, W): a step belongs to the pixel before it."""
    across, down = steps
    return np.maximum(np.pad(across, ((0, 0), (0, 1))), np.pad(down, ((0, 1), (0, 0))))


def missing_outlines(outlines: Steps, shown: Steps) -> Mask:
    """Return the pixels (H, W) at an outline where a picture has no edge near enough."""
    strongest = maximum_filter(strongest_steps(shown), size=2 * OUTLINE_TOLERANCE_PX + 1)
    return np.asarray((strongest_steps(outlines) > 0) & (strongest < MIN_EDGE_CONTRAST))


def seen_outlines(scene: Scene, answer: HogelImage, outlines: Steps) -> Steps:
    """Return the outlines of an image that are visible with any reasonable shading.

    Such an outline is visible in the image's own colors and, inside one object, under a light at
    the camera. Parallel faces, and faces that lean to opposite sides, may be equally bright.
    """
    lines = true_lines(answer.camera).directions()
    lines /= np.linalg.norm(lines, axis=2, keepdims=True)
    facing = np.abs(np.einsum("hwi,hwi->hw", _normals(scene, answer), lines))
    lit = steps_of(np.sqrt(np.nan_to_num(facing)))
    across, down = (np.maximum(*pair) for pair in zip(lit, steps_of(answer.object), strict=True))
    seen = ~missing_outlines(outlines, contrast(answer)) & ~missing_outlines(
        outlines, (across, down)
    )
    return outlines[0] * seen[:, :-1], outlines[1] * seen[:-1]


def _normals(scene: Scene, answer: HogelImage) -> Floats:
    """Return the normals (H, W, 3) of an image's triangles, NaN without a triangle."""
    normals = scene.normals.take(answer.triangle, axis=0, mode="clip")
    return np.where((answer.triangle == NOTHING)[..., None], np.nan, normals)


def unlike_shading(scene: Scene, shown: HogelImage, picture: HogelImage, chosen: Mask) -> float:
    """Return the variation of brightness in some pixels that distant lights do not explain.

    Diffuse light is nearly a polynomial of the second degree of the normal (Ramamoorthi and
    Hanrahan, 2001); light at the camera is nearly such a polynomial of the cosine. Each object has
    its own coefficients.
    """
    assert picture.color is not None
    bright = np.sqrt(np.clip(np.nan_to_num(picture.color.mean(axis=2)[chosen]), 0.0, 1.0))
    normal, part = np.nan_to_num(_normals(scene, shown)[chosen]), shown.object[chosen]
    lines = true_lines(shown.camera).directions()[chosen]
    facing = np.einsum("ni,ni->n", normal, lines) / np.linalg.norm(lines, axis=1)
    x, y, z = (normal * -np.sign(facing)[:, None]).T
    every = (np.ones_like(x), x, y, z, x * x, y * y, x * y, x * z, y * z, np.abs(facing), facing**2)
    terms = np.stack(every, axis=1)
    left = 0.0
    for number in np.unique(part):
        some = part == number
        fitted = terms[some] @ np.linalg.lstsq(terms[some], bright[some])[0]
        left += float(np.square(bright[some] - fitted).sum())
    return left


def outline_displacement(expected: Steps, shown: Steps) -> Spread | None:
    """Measure the displacement of outlines, px, over a whole picture and over each of its tiles.

    `shown` is the judged picture's contrast, capped so that a strong edge counts no more than other
    edges. The result is None if no displacement clearly has the most contrast.
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

    def moved(chosen: Mask) -> tuple[float, float] | None:
        some = places[chosen], axis[chosen], weights[chosen]
        result = _peak(*some, shown) if len(some[0]) >= MIN_STEPS else None
        if result is None or max(map(abs, result)) <= 0.5:
            return result
        # A tile of dim outlines beside a strong outline has more contrast at the strong one, even
        # in a right picture. Tiles that do not register with themselves, within half a pixel, are
        # therefore not used.
        own = _peak(*some, expected)
        return result if own is not None and max(map(abs, own)) <= 0.5 else None

    whole = moved(np.ones(len(places), dtype=np.bool_))
    if whole is None:
        return None
    displacements = [whole]
    side = int(np.clip(np.sqrt(len(places) / STEPS_PER_TILE), 1, MAX_TILES_PER_SIDE))
    tile = places * side // (len(expected[0]), expected[1].shape[1])
    for number in range(side * side) if side > 1 else ():
        of_tile = moved(tile[:, 0] * side + tile[:, 1] == number)
        displacements += [] if of_tile is None else [of_tile]
    return Spread.from_values(np.hypot(*np.array(displacements).T))


def _peak(
    places: Indices, axis: Indices, weights: Floats, shown: Steps
) -> tuple[float, float] | None:
    """Return the displacement (rows, columns) with most contrast; None without a clear maximum."""
    reach = MAX_DISPLACEMENT_PX
    scores = counted = np.zeros((2 * reach + 1, 2 * reach + 1))
    moves = np.indices(scores.shape)[:, None]
    for number, grid in enumerate(shown):
        mine, weight = places[axis == number], weights[axis == number]
        row, column = mine.T[:, :, None, None] + moves
        padded, inside = np.pad(grid, reach), np.pad(np.ones_like(grid), reach)
        scores = scores + np.tensordot(weight, padded[row, column], 1)
        counted = counted + np.tensordot(weight, inside[row, column], 1)
    scores = scores / np.maximum(counted, counted.max() / 2)
    best = float(scores.max())
    if best <= 0 or best < MIN_PEAK_RATIO * float(np.median(scores)):
        return None
    alike = np.argwhere(scores >= EQUAL_PEAK_RATIO * best)
    row, column = alike[np.argmin(np.square(alike - reach).sum(axis=1))].tolist()

    def between(three: Floats) -> float:
        """Return the vertex of a parabola through a peak and its neighbors, -0.5 to 0.5."""
        before, here, after = three.tolist() if len(three) == 3 else (0.0, 0.0, 0.0)
        bend = before - 2 * here + after
        return float(np.clip((before - after) / (2 * bend), -0.5, 0.5)) if bend < 0 else 0.0

    down = row - reach + between(scores[max(row - 1, 0) : row + 2, column])
    return down, column - reach + between(scores[row, max(column - 1, 0) : column + 2])
