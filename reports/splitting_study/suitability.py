"""What the study's rows say: where one pair of frusta is enough, and what helps where it is not."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import dropwhile, takewhile

from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.reports.splitting_study.grid import DepthBuffer, Family
from xfrustum.reports.splitting_study.rows import ASKED_SEPARATION, StudyRow
from xfrustum.scenes.plate.double_frustum import Camera, Fit, Offset, Pivot
from xfrustum.tolerances import MAX_DEPTH_WRONG, TOLERANCE_PX


class Suitability(StrEnum):
    """Whether one setting is enough, and if it is not, why."""

    ENOUGH = "enough"
    BENT = "bent"
    STARVED = "starved"
    BOTH = "both"


def suitability(row: StudyRow) -> Suitability:
    """Judge one cell by what was measured.

    It is bent where displacement exceeds `TOLERANCE_PX`: that of what was drawn, as measured, or that of what
    should have been drawn, in closed form, for what is bent out of the film or behind something else is not
    drawn. What the near plane clips, without an offset, counts as displaced. It is starved of depth where
    more than `MAX_DEPTH_WRONG` of the pixels show a wrong surface because of it, or where sheets
    `ASKED_SEPARATION` apart at the far end are not ordered.
    """
    # A picture in which nothing is left to be displaced has lost everything to depth.
    bent = row.displacement_p99 is not None and row.displacement_p99 > TOLERANCE_PX
    bent |= _should_be_bent(row)
    starved = row.depth_fraction > MAX_DEPTH_WRONG or row.misordered > MAX_MISORDERED_FRACTION
    return _named(bent, starved)


def predicted_suitability(row: StudyRow) -> Suitability:
    """Judge one cell by the closed forms alone: displacement, and the smallest ordered separation."""
    return _named(_should_be_bent(row), row.predicted_separation > ASKED_SEPARATION)


def _should_be_bent(row: StudyRow) -> bool:
    """Return whether over 1 % of what the truth shows is displaced too far or clipped, in closed form."""
    displaced = row.predicted_p99 is not None and row.predicted_p99 > TOLERANCE_PX
    # The nearest |z| of a row is that of its nearest hundredth.
    return displaced or (row.offset is Offset.NONE and row.nearest < row.near)


def _named(bent: bool, starved: bool) -> Suitability:
    if bent:
        return Suitability.BOTH if starved else Suitability.BENT
    return Suitability.STARVED if starved else Suitability.ENOUGH


@dataclass(frozen=True, kw_only=True)
class Case:
    """A scene, an image and a depth buffer: what a person has before choosing near and slabs.

    Pivot, fit and offset are parts of it: each is a case of its own.
    """

    side: Camera
    ratio: float
    resolution: int
    buffer: DepthBuffer
    family: Family = Family.ONE_SIDE
    pivot: Pivot = Pivot.APERTURE
    fit: Fit | None = None
    offset: Offset = Offset.PLATE


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What is enough in a case.

    Attributes
    ----------
    case
        The case.
    nears
        Offsets with which one pair of frusta is enough, largest first; empty where no offset is.
    slabs
        Heights of the fewest slabs that were enough, where no offset is; None where no number of slabs that
        was tried was enough, or none was tried.
    """

    case: Case
    nears: tuple[float, ...]
    slabs: tuple[float, ...] | None

    @property
    def one_pair(self) -> bool:
        """Whether one pair of frusta is enough."""
        return bool(self.nears)


def unbroken(nears: Iterable[float], measured: Iterable[float]) -> tuple[float, ...]:
    """Return the largest of some nears and those below it that follow without a gap, largest first.

    Parameters
    ----------
    nears
        Any of those measured.
    measured
        All of them.
    """
    chosen = set(nears)
    from_largest = dropwhile(lambda near: near not in chosen, sorted(measured, reverse=True))
    return tuple(takewhile(lambda near: near in chosen, from_largest))


def alike_but_depth(row: StudyRow, other: StudyRow) -> bool:
    """Return whether two rows show one picture with the same pivot, fit and offset."""
    return (row.picture, row.pivot, row.fit, row.offset) == (
        other.picture,
        other.pivot,
        other.fit,
        other.offset,
    )


def straight_nears(rows: Iterable[StudyRow]) -> set[float]:
    """Return the nears of some rows at which no picture is bent; no depth buffer moves the picture."""
    rows = list(rows)
    bent = {row.near for row in rows if suitability(row) in {Suitability.BENT, Suitability.BOTH}}
    return {row.near for row in rows} - bent


def case_of(row: StudyRow) -> Case:
    """Return the case that a row belongs to."""
    return Case(
        side=row.side,
        ratio=row.ratio,
        resolution=row.resolution,
        buffer=row.buffer,
        family=row.family,
        pivot=row.pivot,
        fit=row.fit,
        offset=row.offset,
    )


def outcomes(rows: Iterable[StudyRow]) -> dict[Case, Outcome]:
    """Return what is enough in each case, in the order in which cases first appear."""
    grouped: dict[Case, list[StudyRow]] = {}
    for row in rows:
        grouped.setdefault(case_of(row), []).append(row)
    return {case: _outcome(case, group) for case, group in grouped.items()}


def _outcome(case: Case, rows: Sequence[StudyRow]) -> Outcome:
    good = [row for row in rows if suitability(row) is Suitability.ENOUGH]
    cuts = sorted((row.slabs for row in good if row.slabs), key=len)
    return Outcome(
        case=case,
        nears=tuple(sorted((row.near for row in good if not row.slabs), reverse=True)),
        slabs=cuts[0] if cuts else None,
    )
