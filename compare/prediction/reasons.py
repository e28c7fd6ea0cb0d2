"""Reasons for errors of prediction above a factor of 3 (docs/answers.md, "Predictions")."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Reason(StrEnum):
    """Reason why a prediction is not valid."""

    CROSSES = "crosses-plate"  #: surfaces cross the plate, showing points from outside the film
    STARVED = "starved-depth"  #: the depth buffer makes too many pixels wrong
    ROUNDED = "below-float32"  #: the displacement is smaller than the rounding of positions
    LARGE = "large-triangles"  #: float32 rounds the depth of triangles far larger than the plate
    PARALLEL = "parallel-to-plate"  #: the depth of all pixels of a surface is rounded equally
    FEW = "few-pixels"  #: fewer than `MIN_PIXELS` are predicted
    OUTSIDE = "outside-film"  #: points from outside the film are shown
    STEPS = "two-depth-steps"  #: all depths lie within two float32 steps below one
    ALIGNED = "aligned-edges"  #: all pixels along an edge in a row or column become wrong together
    THIN = "thin-surfaces"  #: surfaces thinner than a pixel, of which the truth shows a part


@dataclass(frozen=True, kw_only=True)
class Reasons:
    """Reasons for invalid predictions of displacement and wrong surfaces; None if valid."""

    displacement: str | None = None
    surface: str | None = None


NO_REASONS = Reasons()  #: record of valid predictions

#: Smallest number of predicted pixels for which the factor of 3 is required: a Poisson number of
#: mean 10 deviates by this factor in one of 100 cases, and pixels become wrong in pairs.
MIN_PIXELS = 20

#: Share of points from outside the film above which the factor of 3 is not required of
#: displacement: five times the 1 % above the 99th percentile. The smallest share with a larger
#: error on the built-in scenes is 7 %.
MAX_OUTSIDE = 0.05

#: Largest share of the picture with large triangles, and their sides in plate diagonals.
MAX_LARGE, LARGE_SIDE = 0.01, 8.0

#: Largest share of contours beside surfaces that are a single pixel wide. A surface of width w < 1
#: px appears in a share w of the rows that it crosses, so that its true contours are 1 / w times
#: longer than the visible ones. With this share, surfaces 1/20 px wide make a prediction three
#: times too small.
MAX_THIN = 0.1


def chance(pixels: float, together: float = 0.0) -> Reason | None:
    """Return the reason for a number of wrong pixels dominated by chance, or None.

    The number of independent pixels has the variance `pixels` (Poisson). Pixels along an edge in a
    row or column are not independent, and add the variance `together`. The factor of 3 is required
    of predictions with at most the relative variance of `MIN_PIXELS` independent pixels.
    """
    if pixels > 0 and pixels**2 >= MIN_PIXELS * (pixels + together):
        return None
    return Reason.FEW if pixels < MIN_PIXELS and together <= pixels else Reason.ALIGNED


def first_reason(*cases: tuple[bool, Reason | None]) -> Reason | None:
    """Return the first reason whose condition holds, or None."""
    return next((reason for holds, reason in cases if holds), None)
