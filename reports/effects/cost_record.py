"""The time that one effect adds to an image, as it was measured, and how."""

from __future__ import annotations

from dataclasses import dataclass

from xfrustum.reports.common.timing import FEWEST_DIFFERENCES

PROCEDURE = (
    "each image with and without the effect, in turn, the first of a pair in alternation, "
    "after one of each that warms up; "
    "medians, of the differences for costs; color only, one sample unless samples are what is measured; "
    "light transport from its time for 4 paths a pixel"
)
"""How costs are measured, in words."""

RENDERERS = ("raster", "reference")
"""Names of the renderers whose costs are measured."""


@dataclass(frozen=True, kw_only=True)
class Cost:
    """The time that one effect adds to an image.

    Attributes
    ----------
    seconds
        Median of the differences between the image with the effect and the image without.
    spread
        Half the distance between the quartiles of the differences.
    interval
        Ends of the interval that holds the true median difference; see `timing.median_interval`.
    repetitions
        Number of differences.
    without
        Median time of the image without the effect.
    """

    seconds: float
    spread: float
    interval: tuple[float, float]
    repetitions: int
    without: float

    @property
    def resolved(self) -> bool:
        """Whether the effect is told to take time, or to save it: the interval is on one side of zero."""
        low, high = self.interval
        return self.repetitions >= FEWEST_DIFFERENCES and (low > 0 or high < 0)
