"""Predicted and measured wrong surfaces of many hogels, summed by link."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from xfrustum.compare.attribution import Budget
from xfrustum.compare.prediction.predict import LinkPrediction
from xfrustum.compare.prediction.reasons import Reason, chance
from xfrustum.scenes.model.images import HogelCamera


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


def sums_by_link(budgets: Iterable[Budget]) -> tuple[LinkSum, ...]:
    """Sum measured and predicted wrong surfaces of each link over hogels and settings."""
    charges: dict[str, list[tuple[HogelCamera, int, LinkPrediction]]] = defaultdict(list)
    for budget in budgets:
        for cause, link in zip(budget.causes, budget.predicted, strict=True):
            charges[cause.name].append((budget.drawn.camera, cause.surface, link))
    return tuple(_sum(name, of_link) for name, of_link in charges.items())


def _sum(name: str, charges: Sequence[tuple[HogelCamera, int, LinkPrediction]]) -> LinkSum:
    """Return the sum of a link's charges.

    Few pixels in a hogel do not excuse a wrong sum: the sum has its own standard deviation. An edge
    parallel to the plate has the same place between two pixel rows in all hogels of a row, and
    between two pixel columns in all hogels of a column: the deviations of these hogels add up.
    Deviations of other hogels are independent.
    """
    surface = sum(measured for _, measured, _ in charges)
    predicted = sum(link.surface_pixels for _, _, link in charges)
    reasons = {link.reasons.surface for _, _, link in charges} - {Reason.FEW, Reason.ALIGNED}
    deviations: dict[object, float] = defaultdict(float)
    for camera, _, link in charges:
        lines = ("row", camera.aperture.row), ("column", camera.aperture.column)
        for line, deviation in zip(lines, link.flip_deviations, strict=True):
            deviations[camera.settings, line] += deviation
    if surface or predicted:
        reasons.add(chance(predicted, sum(deviation**2 for deviation in deviations.values())))
    return LinkSum(
        name=name,
        surface=surface,
        predicted=predicted,
        reasons=frozenset(filter(None, reasons)),
    )
