"""The numbers that the study's document states, each counted in the rows or computed in closed form."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from xfrustum.compare.prediction.depth import smallest_separation
from xfrustum.reports.splitting_study.grid import SIDES, DepthBuffer
from xfrustum.reports.splitting_study.rows import ASKED_SEPARATION, StudyRow
from xfrustum.reports.splitting_study.suitability import (
    Case,
    Suitability,
    case_of,
    outcomes,
    predicted_suitability,
    suitability,
    unbroken,
)
from xfrustum.tolerances import MAX_DEPTH_WRONG, TOLERANCE_PX

Rows = Sequence[StudyRow]

_LEAST_NEAR, _LARGEST_NEAR = 1e-12, 0.5
"""Nears between which the smallest that orders a separation is looked for, shares of the reach."""


@dataclass(frozen=True, kw_only=True)
class BufferFacts:
    """One depth buffer over all cases.

    Attributes
    ----------
    buffer
        Format and mapping.
    cases, one_pair
        Number of cases, and number of those in which one pair of frusta is enough.
    picture_alone
        Number of cases in which one pair would be enough, were no separation asked for.
    always
        Nears that are enough in every case, largest first and without a gap.
    least_near
        Smallest near that orders sheets `ASKED_SEPARATION` apart at the reach, by the closed form; None
        where every near does.
    slabs
        Largest number of slabs that a case needed where one pair is not enough; 0 where one pair always is,
        None where a case stayed open.
    """

    buffer: DepthBuffer
    cases: int
    one_pair: int
    picture_alone: int
    always: tuple[float, ...]
    least_near: float | None
    slabs: int | None

    @property
    def name(self) -> str:
        """As people write it."""
        return f"{self.buffer[0].upper()} {self.buffer[1]}"

    @property
    def always_enough(self) -> bool:
        """Whether one pair is enough in every case."""
        return self.one_pair == self.cases

    @property
    def largest_product(self) -> float | None:
        """Image width in pixels times depth of the scene up to which one pair is enough, None: any.

        Displacement is largest in the corner of the film, W / 2 sqrt(2) n / (|z| + n), and stays under
        `TOLERANCE_PX` for n up to about sqrt(2) `TOLERANCE_PX` |z| / W. At the nearest surface, |z| is
        the reach over the depth of the scene.
        """
        return None if self.least_near is None else math.sqrt(2) * TOLERANCE_PX / self.least_near


def whole(rows: Iterable[StudyRow]) -> list[StudyRow]:
    """Return the rows of one pair of frusta."""
    return [row for row in rows if not row.slabs]


def buffer_facts(rows: Rows) -> list[BufferFacts]:
    """Return the facts of every depth buffer, in the order of the rows."""
    found = outcomes(rows)
    pictures = {
        case: any(_picture_will_do(row) for row in group) for case, group in _grouped(whole(rows)).items()
    }
    measured = {row.near for row in whole(rows)}
    facts = []
    for buffer in dict.fromkeys(row.buffer for row in rows):
        own = [outcome for case, outcome in found.items() if case.buffer == buffer]
        common = set.intersection(*(set(outcome.nears) for outcome in own))
        split = [outcome.slabs for outcome in own if not outcome.one_pair]
        facts.append(
            BufferFacts(
                buffer=buffer,
                cases=len(own),
                one_pair=sum(outcome.one_pair for outcome in own),
                picture_alone=sum(good for case, good in pictures.items() if case.buffer == buffer),
                always=unbroken(common, measured),
                least_near=least_near(buffer),
                slabs=None if None in split else max((len(cuts) for cuts in split if cuts), default=0),
            )
        )
    return facts


def least_near(buffer: DepthBuffer) -> float | None:
    """Return the smallest near, as a share of the reach, that orders `ASKED_SEPARATION` at the reach.

    By the closed form; None where even a trillionth of the reach does. In units in which the reach is one,
    where 32-bit numbers are coarsest for their size: in other units it may be up to half as large.
    """

    def excess(logarithm: float) -> float:
        near = math.exp(logarithm)
        far = near + 1.0
        return float(smallest_separation(np.array(far), near, far, *buffer)) - ASKED_SEPARATION

    low, high = math.log(_LEAST_NEAR), math.log(_LARGEST_NEAR)
    return None if excess(low) <= 0 else math.exp(brentq(excess, low, high, xtol=1e-3))


def by_the_rule(case: Case, facts: Sequence[BufferFacts]) -> bool:
    """Return whether one pair is enough by the closed form of `BufferFacts.largest_product`."""
    limit = next(f.largest_product for f in facts if f.buffer == case.buffer)
    return limit is None or case.resolution * case.ratio <= limit


def _picture_will_do(row: StudyRow) -> bool:
    """Return whether a cell is neither bent nor wrong by depth, whatever becomes of the sheets."""
    return suitability(replace(row, misordered=0.0)) is Suitability.ENOUGH


def _grouped(rows: Iterable[StudyRow]) -> dict[Case, list[StudyRow]]:
    grouped: dict[Case, list[StudyRow]] = {}
    for row in rows:
        grouped.setdefault(case_of(row), []).append(row)
    return grouped


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """Closed forms beside what was measured.

    Attributes
    ----------
    cells, same, in_gaps
        Number of settings; number of those in which the closed forms say what was measured; and number of
        the others that have one of the nears and depth buffers of `gaps`.
    cases, same_by_rule
        Number of cases, and number of those in which the rule of thumb says what was measured.
    lowest, highest
        Measured over predicted 99th percentile of displacement, where a tenth to ten times the
        tolerance is predicted and depth does no harm.
    """

    cells: int
    same: int
    in_gaps: int
    cases: int
    same_by_rule: int
    lowest: float
    highest: float


def agreement(rows: Rows, facts: Sequence[BufferFacts]) -> Agreement:
    """Compare the closed forms with all rows of one pair of frusta."""
    single, found = whole(rows), outcomes(rows)
    gap_nears, gap_buffers = gaps(rows)
    ratios = [
        row.displacement_p99 / row.predicted_p99
        for row in single
        if row.displacement_p99 is not None
        and row.predicted_p99 is not None
        and TOLERANCE_PX / 10 <= row.predicted_p99 <= 10 * TOLERANCE_PX
        and row.depth_fraction <= MAX_DEPTH_WRONG
    ]
    return Agreement(
        cells=len(single),
        in_gaps=sum(
            suitability(row) is not predicted_suitability(row)
            and row.near in gap_nears
            and row.buffer in gap_buffers
            for row in single
        ),
        same=sum(suitability(row) is predicted_suitability(row) for row in single),
        cases=len(found),
        same_by_rule=sum(outcome.one_pair == by_the_rule(case, facts) for case, outcome in found.items()),
        lowest=min(ratios, default=math.nan),
        highest=max(ratios, default=math.nan),
    )


def rule_exceptions(rows: Rows, facts: Sequence[BufferFacts], *, one_pair: bool) -> dict[str, int]:
    """Return how often the rule of thumb is wrong, by depth buffer, where one pair is enough or is not."""
    wrong = [
        case.buffer
        for case, outcome in outcomes(rows).items()
        if outcome.one_pair is one_pair and by_the_rule(case, facts) is not one_pair
    ]
    return {f.name: wrong.count(f.buffer) for f in facts if f.buffer in wrong}


def side_differences(rows: Rows) -> list[Case]:
    """Return the cases of C that C* answers differently."""
    found = outcomes(rows)
    one, other = SIDES
    pairs = [(a, found.get(replace(case, side=other))) for case, a in found.items() if case.side is one]
    return [a.case for a, b in pairs if b is not None and (a.nears, a.slabs) != (b.nears, b.slabs)]


def gaps(rows: Rows) -> tuple[list[float], list[DepthBuffer]]:
    """Return nears that are not enough between two that are, for the same side and picture; and buffers."""
    nears, buffers = set(), []
    measured = {row.near for row in whole(rows)}
    for case, outcome in outcomes(rows).items():
        if outcome.one_pair:
            inside = {n for n in measured if outcome.nears[-1] < n < outcome.nears[0]} - set(outcome.nears)
            nears |= inside
            buffers += [case.buffer] if inside else []
    return sorted(nears, reverse=True), list(dict.fromkeys(buffers))
