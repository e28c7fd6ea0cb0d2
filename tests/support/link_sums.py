"""Predicted and measured wrong surfaces of many hogels, summed by link."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field

from xfrustum.compare.attribution.budget import Budget
from xfrustum.compare.prediction.predict import LinkPrediction
from xfrustum.compare.prediction.reasons import Reason, chance


@dataclass(frozen=True, kw_only=True)
class LinkSum:
    """Wrong surfaces charged to a link, summed over hogels; `reasons` apply only to the sum."""

    name: str
    surface: int
    predicted: float
    reasons: frozenset[str]

    @property
    def ratio(self) -> float | None:
        """Measured over predicted; None if nothing is predicted."""
        return self.surface / self.predicted if self.predicted else None


@dataclass(kw_only=True)
class _Sum:
    """The sum of a link so far."""

    surface: int = 0
    predicted: float = 0.0
    reasons: set[str | None] = field(default_factory=set)
    #: standard deviations, by setting and by row or column of hogels
    deviations: dict[object, float] = field(default_factory=lambda: defaultdict(float))

    def add(self, budget: Budget, surface: int, link: LinkPrediction) -> None:
        """Add a budget's charge to the link."""
        camera = budget.drawn.camera
        self.surface += surface
        self.predicted += link.surface_pixels
        self.reasons.add(link.reasons.surface)
        lines = ("row", camera.aperture.row), ("column", camera.aperture.column)
        for line, deviation in zip(lines, link.flip_deviations, strict=True):
            self.deviations[camera.settings, line] += deviation

    def of(self, name: str) -> LinkSum:
        """Return the sum with its reasons."""
        reasons = self.reasons - {Reason.FEW, Reason.ALIGNED}
        if self.surface or self.predicted:
            reasons.add(
                chance(self.predicted, sum(deviation**2 for deviation in self.deviations.values()))
            )
        return LinkSum(
            name=name,
            surface=self.surface,
            predicted=self.predicted,
            reasons=frozenset(filter(None, reasons)),
        )


def sums_by_link(budgets: Iterable[Budget]) -> tuple[LinkSum, ...]:
    """Sum measured and predicted wrong surfaces of each link over hogels and settings.

    Few pixels in a hogel do not excuse a wrong sum: the sum has its own standard deviation. An edge
    parallel to the plate has the same place between two pixel rows in all hogels of a row, and
    between two pixel columns in all hogels of a column: the deviations of these hogels add up.
    Deviations of other hogels are independent.
    """
    sums: dict[str, _Sum] = defaultdict(_Sum)
    for budget in budgets:
        for cause, link in zip(budget.causes, budget.predicted, strict=True):
            sums[cause.name].add(budget, cause.surface, link)
    return tuple(link_sum.of(name) for name, link_sum in sums.items())
