"""Images compared with rational arithmetic: all pixels of small images, some of others."""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from tests.support.brute_force import exact_first
from tests.support.views import lines_by_definition
from xfrustum.scenes import NOTHING, Aperture, Certainty, Scene
from xfrustum.scenes.arrays import Floats, Indices, Mask

SURELY = 1e-12
"""Margin relative to the sum of absolute products: a thousand times a dozen roundings."""


class ExactPixel(NamedTuple):
    """The first surface on one line."""

    winners: list[int]
    """All triangles that the line meets there, in ascending order; empty if there are none."""
    s: float
    """s at which the line meets the winners; NaN if there are none."""


def hold_to_fractions(
    image: Any, triangles: Floats, d: Floats, cameras: Sequence[tuple[Floats, tuple[float, float]]]
) -> Floats:
    """Compare triangle and ties of every pixel with rational arithmetic on its line.

    Cameras are centers and ranges of s; the first camera whose line meets a surface decides. Return
    the points (H, W, 3) on the surfaces, NaN where there is none.
    """
    ties = defaultdict(list)
    for row, column, triangle in image.tied_triangles.tolist():
        ties[row, column].append(triangle)
    points = np.full(d.shape, np.nan)
    for pixel in np.ndindex(image.triangle.shape):
        met = [(c, *exact_first(triangles, c, d[pixel], s_range)) for c, s_range in cameras]
        center, s, first = next((m for m in met if m[2]), met[-1])
        assert image.triangle[pixel] == min(first, default=NOTHING)
        assert image.certainty[pixel] != Certainty.UNEXAMINED
        assert (image.certainty[pixel] == Certainty.TIE) == (len(first) > 1)
        assert sorted(ties[pixel]) == (first if len(first) > 1 else [])
        if s is not None:
            points[pixel] = center + float(s) * d[pixel]
    return points


def exact_pixels(scene: Scene, aperture: Aperture, pixels: Indices) -> list[ExactPixel]:
    """Return the exact surface of some pixels of a true image, pixel number row * W + column."""
    center = np.array([aperture.x, aperture.y, 0.0])
    lines = lines_by_definition(scene, aperture).reshape(-1, 3)[pixels]
    s_range = (-scene.frustum.reach[0], scene.frustum.reach[1])
    decided = []
    for line in lines:
        numbers = np.flatnonzero(possible_pairs(scene.triangles - center, line[None])[0])
        s, chosen = exact_first(scene.triangles[numbers], center, line, s_range)
        decided.append(ExactPixel(numbers[chosen].tolist(), float("nan" if s is None else s)))
    return decided


def possible_pairs(corners: Floats, d: Floats) -> Mask:
    """Return pairs (N, F) of lines (N, 3) through one point and triangles that may meet."""
    following = np.roll(corners, -1, axis=1)
    cross = np.cross(corners, following)
    a, b = np.abs(corners), np.abs(following)
    magnitude = np.roll(a, -1, -1) * np.roll(b, -2, -1) + np.roll(a, -2, -1) * np.roll(b, -1, -1)
    side = np.einsum("fki,ni->knf", cross, d)
    doubt = SURELY * np.einsum("fki,ni->knf", magnitude, np.abs(d))
    return np.asarray(~((side > doubt).any(axis=0) & (side < -doubt).any(axis=0)))
