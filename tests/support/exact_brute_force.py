"""The answer of rational arithmetic for chosen pixels, without triangles that cannot matter."""

from dataclasses import dataclass

import numpy as np

from tests.support.brute_force import exact_first
from tests.support.views import lines_by_definition
from xfrustum.scenes import Aperture, Scene
from xfrustum.scenes.arrays import Floats, Indices, Mask

SURELY = 1e-12
"""Margin relative to the sum of absolute products: a thousand times a dozen roundings."""

LINES_AT_ONCE = 64


@dataclass(frozen=True, kw_only=True)
class ExactPixel:
    """The first surface on one line.

    Attributes
    ----------
    winners
        All triangles met there, in ascending order; empty where it meets none.
    s
        The s at which the line meets them; NaN where it meets none.
    """

    winners: list[int]
    s: float


def exact_pixels(scene: Scene, aperture: Aperture, pixels: Indices) -> list[ExactPixel]:
    """Decide pixels (N,), row * W + column, of a scene's true image from an aperture."""
    center = np.array([aperture.x, aperture.y, 0.0])
    lines = lines_by_definition(scene, aperture).reshape(-1, 3)[pixels]
    s_range = (-scene.frustum.reach[0], scene.frustum.reach[1])
    decided = []
    for start in range(0, len(lines), LINES_AT_ONCE):
        part = lines[start : start + LINES_AT_ONCE]
        for line, possible in zip(
            part, possible_pairs(scene.triangles - center, part), strict=True
        ):
            numbers = np.flatnonzero(possible)
            s, chosen = exact_first(scene.triangles[numbers], center, line, s_range)
            winners = numbers[chosen].tolist()
            decided.append(ExactPixel(winners=winners, s=float("nan") if s is None else float(s)))
    return decided


def possible_pairs(corners: Floats, d: Floats) -> Mask:
    """Return which lines (N, 3) may meet which triangles about their common point, (N, F)."""
    following = np.roll(corners, -1, axis=1)
    cross = np.cross(corners, following)
    a, b = np.abs(corners), np.abs(following)
    magnitude = np.roll(a, -1, -1) * np.roll(b, -2, -1) + np.roll(a, -2, -1) * np.roll(b, -1, -1)
    side = np.einsum("fki,ni->knf", cross, d)
    doubt = SURELY * np.einsum("fki,ni->knf", magnitude, np.abs(d))
    return np.asarray(~((side > doubt).any(axis=0) & (side < -doubt).any(axis=0)))
