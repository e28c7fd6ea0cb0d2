"""Definition of a hogel beyond a tolerance, shared by every command that judges hogels.

A hogel is beyond the tolerance if the 99th percentile of its displacements exceeds it or is
undefined, or if more than 1 % of its judged pixels show the wrong surface (`CONVENTIONS.md`,
"Beyond").
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from xfrustum.tolerances import MAX_WRONG

if TYPE_CHECKING:
    from xfrustum.compare.metrics.comparison import ComparisonNumbers

PERCENTILE = 99.0  #: percentile of displacement that a tolerance limits

#: Largest share of pixels in the plate itself, where displacement is undefined, that leaves the
#: percentile defined: the same pixels that the percentile leaves out.
MAX_UNDEFINED = 1 - PERCENTILE / 100


def displacement_p99(numbers: ComparisonNumbers) -> float:
    """Return a hogel's 99th percentile of displacement, pixels; 0 for a drawing without surface.

    Infinite if the percentile is undefined: if all surfaces lie in the plate itself, or if surfaces
    in the plate fill more than `MAX_UNDEFINED` of the judged pixels.
    """
    spread = numbers.displacement_px
    if numbers.at_plate > MAX_UNDEFINED * numbers.judged or (numbers.at_plate and spread is None):
        return math.inf
    return 0.0 if spread is None else spread.p99


def is_beyond(
    displacement_p99_px: float | None,
    surface_fraction: float,
    tolerance_px: float,
    max_wrong: float = MAX_WRONG,
) -> bool:
    """Return whether a hogel is beyond a tolerance.

    A displacement of None or NaN is undefined and counts as beyond.
    """
    if displacement_p99_px is None or not math.isfinite(displacement_p99_px):
        return True
    return displacement_p99_px > tolerance_px or surface_fraction > max_wrong
