"""What the study's rows say of the other families: what they share with the first, and what helps them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from xfrustum.reports.splitting_study.advice import buffer_name, span
from xfrustum.reports.splitting_study.facts import least_near
from xfrustum.reports.splitting_study.figures import near_words
from xfrustum.reports.splitting_study.grid import SIDES, DepthBuffer, Family
from xfrustum.reports.splitting_study.rows import StudyRow
from xfrustum.reports.splitting_study.suitability import (
    Case,
    Outcome,
    Suitability,
    case_of,
    outcomes,
    straight_nears,
    suitability,
)
from xfrustum.scenes.library.depth_family import SHEAR_PER_SLOPE
from xfrustum.scenes.plate.double_frustum import Camera, Fit, Offset, Pivot
from xfrustum.tolerances import MAX_DEPTH_WRONG, TOLERANCE_PX

Rows = Sequence[StudyRow]
Outcomes = Mapping[Case, Outcome]


def of_family(rows: Iterable[StudyRow], *families: Family) -> list[StudyRow]:
    """Return the rows of some families."""
    return [row for row in rows if row.family in families]


@dataclass(frozen=True, kw_only=True)
class Help:
    """How many cases of one family are served by what.

    Attributes
    ----------
    family
        The family.
    cases, one_pair
        Number of cases drawn as in the paper, and number of those in which one pair of frusta is enough.
    other_buffer
        Number of the other cases in which one pair is enough with another of the depth buffers.
    fit, no_offset
        Number of the other cases in which one pair is enough with a fit at the screen, or without an offset;
        None where that was not drawn.
    slabs
        Number of the other cases in which slabs are enough.
    most_slabs
        Largest number of cuts that such a case needed.
    """

    family: Family
    cases: int
    one_pair: int
    other_buffer: int
    fit: int | None
    no_offset: int | None
    slabs: int
    most_slabs: int

    @property
    def failed(self) -> int:
        """Number of cases in which one pair is not enough at any near."""
        return self.cases - self.one_pair


@dataclass(frozen=True, kw_only=True)
class Likeness:
    """How far a family has the windows and the cuts of the first one.

    Attributes
    ----------
    cases, same
        Number of cases, and number of those in which the same nears, or the same cuts, are enough.
    others
        The other cases, in words.
    """

    cases: int
    same: int
    others: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Agreed:
    """The closed forms beside the measurement, in one family.

    Attributes
    ----------
    lowest, highest
        Measured over predicted 99th percentile of displacement, where a tenth of the tolerance to the
        tolerance is predicted and depth does no harm; NaN where there is no such picture.
    cases, by_rule
        Number of cases drawn as in the paper, and number of those in which the rule of thumb, with the
        nearest |z| that the aperture sees, gives the measured answer.
    """

    lowest: float
    highest: float
    cases: int
    by_rule: int


@dataclass(frozen=True, kw_only=True)
class OffMiddle:
    """The same scene from the middle aperture and from one off the middle.

    Attributes
    ----------
    depths
        For each scene its depth, and the reach over the nearest |z| that the middle aperture sees and over
        the one that the other aperture sees.
    cases
        Number of cases in which one pair is enough at the middle aperture.
    deceived, apart
        Number of these in which the largest near that is enough there is not enough at the other aperture;
        and number of those in which no near is enough at both.
    worst_px
        Largest displacement (99th percentile) at the other aperture with such a near.
    """

    depths: tuple[tuple[float, float, float], ...]
    cases: int
    deceived: int
    apart: int
    worst_px: float


@dataclass(frozen=True, kw_only=True)
class Shear:
    """The recentered family, by pivot and fit.

    Attributes
    ----------
    shear
        The shear over the film's half-extent slope, k / t.
    lowest, highest
        Displacement (99th percentile) with pivot `camera` over that with pivot `aperture`, at the same near.
    lines
        For each scene: its depth; the largest near that does not bend, for pivot `aperture` with fit `angle`
        and with fit `screen`, then both for pivot `camera`; and by what factor the fit reduces displacement,
        measured with pivot `aperture` and in closed form.
    enough
        Number of cases in which one pair is enough, in the order of the nears in `lines`.
    cases
        Number of cases of each.
    """

    shear: float
    lowest: float
    highest: float
    lines: tuple[tuple[float, tuple[float | None, ...], float | None, float], ...]
    enough: tuple[int, ...]
    cases: int


@dataclass(frozen=True, kw_only=True)
class ThroughLine:
    """What an aperture at one distance from the crossing sees, and what is enough there.

    Attributes
    ----------
    distance
        Distance from where the surface crosses the plate, as a share of the reach.
    nearest
        The |z| that a hundredth of the picture lies below, as a share of the reach.
    straight, without_offset
        Largest near at which the picture is not bent, with the offset and without; None where there is none.
    displaced, wrong
        Shares of the film that are displaced by more than the tolerance, and that show a wrong surface, at
        the nears of `Through.nears`.
    rounding_px
        Displacement (99th percentile) without an offset at the smallest near, which is that of rounding; None
        where nothing was drawn without an offset.
    windows, slabs
        For each buffer the nears that are enough for one pair, in words; and the number of cuts that are.
    open_windows
        For each buffer the nears that are enough without an offset, in words.
    """

    distance: float
    nearest: float
    straight: float | None
    without_offset: float | None
    displaced: tuple[float, ...]
    wrong: tuple[float, ...]
    rounding_px: float | None
    windows: tuple[str, ...]
    open_windows: tuple[str, ...]
    slabs: tuple[int | None, ...]


@dataclass(frozen=True, kw_only=True)
class Through:
    """The family whose surface runs through the plate.

    Attributes
    ----------
    lines
        One for each distance, the largest first.
    nears
        The nears of `ThroughLine.displaced` and of `ThroughLine.wrong`.
    buffers
        Names of the depth buffers, in the order of `ThroughLine.windows`.
    lowest, highest
        Distance over the largest near that does not bend, over all distances at which there is one.
    expected_lowest, expected_highest
        The same in closed form, for a point at the nearest |z| in the film's corner, over all distances.
    gain_lowest, gain_highest
        Largest near that is not bent without an offset over that with it; None where there is no such pair.
    """

    lines: tuple[ThroughLine, ...]
    nears: tuple[float, ...]
    buffers: tuple[str, ...]
    lowest: float
    highest: float
    expected_lowest: float
    expected_highest: float
    gain_lowest: float | None
    gain_highest: float | None


def helps(rows: Rows) -> list[Help]:
    """Return what helps in each family, in the order of the rows."""
    found = outcomes(rows)
    families = dict.fromkeys(row.family for row in rows)
    return [_help(found, family) for family in families]


def _help(found: Outcomes, family: Family) -> Help:
    paper = [a for case, a in found.items() if case.family is family and _as_in_the_paper(case)]
    failed = [a for a in paper if not a.one_pair]

    def served(**drawn: object) -> int | None:
        """Return in how many failed cases another way of drawing is enough; None where none was drawn."""
        ways = [found.get(replace(a.case, **drawn)) for a in failed]  # type: ignore[arg-type]
        drawn_ways = [way for way in ways if way is not None]
        return sum(way.one_pair for way in drawn_ways) if drawn_ways else None

    easy = {(a.case.side, a.case.ratio, a.case.resolution) for a in paper if a.one_pair}
    cuts = [a.slabs for a in failed if a.slabs]
    return Help(
        family=family,
        cases=len(paper),
        one_pair=len(paper) - len(failed),
        other_buffer=sum((a.case.side, a.case.ratio, a.case.resolution) in easy for a in failed),
        fit=served(fit=Fit.SCREEN),
        no_offset=served(offset=Offset.NONE),
        slabs=len(cuts),
        most_slabs=max(map(len, cuts), default=0),
    )


def _as_in_the_paper(case: Case) -> bool:
    return (case.pivot, case.fit, case.offset) == (Pivot.APERTURE, None, Offset.PLATE)


def likeness(rows: Rows, family: Family) -> Likeness | None:
    """Compare a family, drawn as in the paper, with the first; None where they have no case in common."""
    found = outcomes(rows)
    others, cases = [], 0
    for case, outcome in found.items():
        if case.family is not family or not _as_in_the_paper(case):
            continue
        sides = SIDES if case.side is Camera.BOTH else (case.side,)
        first = [found.get(replace(case, family=Family.ONE_SIDE, side=side)) for side in sides]
        known = [one for one in first if one is not None]
        if len(known) < len(sides):
            continue
        cases += 1
        nears = set.intersection(*(set(one.nears) for one in known))
        cuts = max((one.slabs or () for one in known), key=len)
        name = f"{buffer_name(case.buffer)} at depth {case.ratio:g}"
        if nears != set(outcome.nears):
            others.append(f"{name} ({_words(outcome.nears)} instead of {_words(nears)})")
        elif not nears and cuts != (outcome.slabs or ()):
            others.append(f"{name} ({len(outcome.slabs or ())} cuts instead of {len(cuts)})")
    return Likeness(cases=cases, same=cases - len(others), others=tuple(others)) if cases else None


def _words(nears: Iterable[float]) -> str:
    found = sorted(nears, reverse=True)
    return span(found) if found else "none"


def agreed(rows: Rows, family: Family) -> Agreed:
    """Compare the closed forms with what was measured in one family."""
    own = of_family(rows, family)
    ratios = [
        row.displacement_p99 / row.predicted_p99
        for row in own
        if row.displacement_p99 is not None
        and row.predicted_p99 is not None
        and TOLERANCE_PX / 10 <= row.predicted_p99 <= TOLERANCE_PX
        and row.depth_fraction <= MAX_DEPTH_WRONG
        and row.offset is Offset.PLATE
        and not row.slabs
    ]
    found = {case: a for case, a in outcomes(own).items() if _as_in_the_paper(case)}
    seen = {case_of(row): row.nearest for row in own}
    least = {buffer: least_near(buffer) for buffer in dict.fromkeys(row.buffer for row in own)}
    return Agreed(
        lowest=min(ratios, default=math.nan),
        highest=max(ratios, default=math.nan),
        cases=len(found),
        by_rule=sum(
            a.one_pair == _by_rule(case, seen[case], least[case.buffer]) for case, a in found.items()
        ),
    )


def _by_rule(case: Case, nearest: float, least: float | None) -> bool:
    """Return whether one pair is enough by the rule of thumb, for the nearest |z| as a share of the reach."""
    return least is None or case.resolution / nearest <= math.sqrt(2) * TOLERANCE_PX / least


def off_middle(rows: Rows) -> OffMiddle | None:
    """Compare the middle aperture with the one off the middle; None where they were not measured."""
    single = [row for row in rows if not row.slabs]
    middle, aside = of_family(single, Family.IN_MIDDLE), of_family(single, Family.OFF_MIDDLE)
    if not (middle and aside):
        return None
    found = outcomes(single)
    at = {(case_of(row), row.near): row for row in aside}
    seen = {row.ratio: row.nearest for row in middle}
    other = {row.ratio: row.nearest for row in aside}
    cases, deceived, apart, worst = 0, 0, 0, 0.0
    for case, outcome in found.items():
        twin = found.get(replace(case, family=Family.OFF_MIDDLE))
        if case.family is not Family.IN_MIDDLE or not outcome.one_pair or twin is None:
            continue
        cases += 1
        if outcome.nears[0] not in twin.nears:
            deceived += 1
            worst = max(worst, at[twin.case, outcome.nears[0]].displacement_p99 or 0.0)
        apart += not set(outcome.nears) & set(twin.nears)
    return OffMiddle(
        depths=tuple((ratio, 1 / seen[ratio], 1 / other[ratio]) for ratio in sorted(seen)),
        cases=cases,
        deceived=deceived,
        apart=apart,
        worst_px=worst,
    )


_DRAWINGS = tuple((pivot, fit) for pivot in Pivot for fit in (None, Fit.SCREEN))


def shear(rows: Rows) -> Shear | None:
    """Return what pivot and fit do to recentered frusta; None where none was measured."""
    own = [row for row in of_family(rows, Family.RECENTERED) if not row.slabs]
    if not own:
        return None
    by_drawing = {
        (row.ratio, row.near, row.pivot, row.fit): row.displacement_p99
        for row in own
        if row.displacement_p99 is not None and row.depth_fraction <= MAX_DEPTH_WRONG
    }

    def compared(one: tuple[Pivot, Fit | None], other: tuple[Pivot, Fit | None], ratio: float) -> list[float]:
        """Return the displacement of one drawing over that of another, at every near that both have."""
        nears = {near for r, near, _, _ in by_drawing if r == ratio}
        pairs = [
            (by_drawing.get((ratio, n, *one)), by_drawing.get((ratio, n, *other))) for n in sorted(nears)
        ]
        within = TOLERANCE_PX / 10, TOLERANCE_PX * 10
        return [a / b for a, b in pairs if a and b and min(a, b) >= within[0] and max(a, b) <= within[1]]

    ratios = sorted({row.ratio for row in own})
    pivots = [x for r in ratios for x in compared((Pivot.CAMERA, None), (Pivot.APERTURE, None), r)]
    lines = []
    for ratio in ratios:
        nears = tuple(
            _largest_straight([r for r in own if (r.ratio, r.pivot, r.fit) == (ratio, *drawing)])
            for drawing in _DRAWINGS
        )
        gains = compared((Pivot.APERTURE, None), (Pivot.APERTURE, Fit.SCREEN), ratio)
        gain = sum(gains) / len(gains) if gains else None
        lines.append((ratio, nears, gain, 2 / (1 - 1 / ratio)))
    found = outcomes(own)
    enough = [[a for c, a in found.items() if (c.pivot, c.fit) == drawing] for drawing in _DRAWINGS]
    return Shear(
        shear=SHEAR_PER_SLOPE,
        lowest=min(pivots, default=math.nan),
        highest=max(pivots, default=math.nan),
        lines=tuple(lines),
        enough=tuple(sum(a.one_pair for a in group) for group in enough),
        cases=max(map(len, enough)),
    )


def _largest_straight(rows: Rows) -> float | None:
    return max(straight_nears(rows), default=None)


def through(rows: Rows) -> Through | None:
    """Return what is enough beside a surface that runs through the plate; None where it was not measured."""
    own = of_family(rows, Family.THROUGH)
    if not own:
        return None
    found = outcomes(own)
    buffers = tuple(dict.fromkeys(row.buffer for row in own))
    single = [row for row in own if not row.slabs]
    nears = _example_nears(single)
    lines = tuple(
        _through_line([row for row in own if row.ratio == ratio], found, buffers, nears)
        for ratio in sorted({row.ratio for row in own})
    )
    steps = [line.distance / line.straight for line in lines if line.straight]
    # In the corner of the film |u| is sqrt(2), and W/2 sqrt(2) n/|z| is the tolerance.
    in_corner = own[0].resolution / (math.sqrt(2) * TOLERANCE_PX)
    expected = [in_corner * line.distance / line.nearest for line in lines]
    gains = [x.without_offset / x.straight for x in lines if x.straight and x.without_offset]
    return Through(
        lines=lines,
        nears=nears,
        buffers=tuple(map(buffer_name, buffers)),
        lowest=min(steps, default=math.nan),
        highest=max(steps, default=math.nan),
        expected_lowest=min(expected),
        expected_highest=max(expected),
        gain_lowest=min(gains, default=None),
        gain_highest=max(gains, default=None),
    )


def _example_nears(single: Rows) -> tuple[float, ...]:
    """Return up to three nears, two decades apart, from a thousandth of the reach down."""
    wanted = (1e-3, 1e-5, 1e-7)
    measured = {row.near for row in single}
    return tuple(n for want in wanted for n in measured if math.isclose(n, want))


def _through_line(
    rows: Rows, found: Outcomes, buffers: Sequence[DepthBuffer], nears: Sequence[float]
) -> ThroughLine:
    single = [row for row in rows if not row.slabs]
    offset = [row for row in single if row.offset is Offset.PLATE]
    gap = [row for row in single if row.offset is Offset.NONE]
    paper = case_of(offset[0])
    outcome = [found[replace(paper, buffer=buffer)] for buffer in buffers]
    gaps = [found.get(replace(paper, buffer=buffer, offset=Offset.NONE)) for buffer in buffers]
    # The last buffer is the one that the picture itself depends on least.
    shown = {row.near: row for row in offset if row.buffer == buffers[-1]}
    least = min((row for row in gap if row.buffer == buffers[-1]), key=lambda row: row.near, default=None)
    return ThroughLine(
        distance=1 / paper.ratio,
        nearest=offset[0].nearest,
        straight=_largest_straight(offset),
        without_offset=_largest_straight(gap) if gap else None,
        displaced=tuple(shown[near].displaced / shown[near].judged for near in nears),
        wrong=tuple(shown[near].surface_wrong / shown[near].judged for near in nears),
        rounding_px=least.displacement_p99 if least else None,
        windows=tuple(_words(one.nears) for one in outcome),
        open_windows=tuple("-" if one is None else _words(one.nears) for one in gaps),
        slabs=tuple(None if one.slabs is None else len(one.slabs) for one in outcome),
    )


@dataclass(frozen=True, kw_only=True)
class OutsideShares:
    """Largest shares of judged pixels that show a point from outside the film.

    Attributes
    ----------
    anywhere, enough
        Over all settings of one pair, and over those that are enough.
    """

    anywhere: float
    enough: float


def outside_shares(rows: Rows) -> OutsideShares:
    """Return how many pixels of one pair's pictures show points from outside the film."""
    single = [row for row in rows if not row.slabs]
    good = [row for row in single if suitability(row) is Suitability.ENOUGH]
    return OutsideShares(
        anywhere=max((row.outside / row.judged for row in single), default=0.0),
        enough=max((row.outside / row.judged for row in good), default=0.0),
    )


def near_or_none(near: float | None) -> str:
    """Write a near as in the tables; `none` where there is none."""
    return "none" if near is None else near_words(near)
