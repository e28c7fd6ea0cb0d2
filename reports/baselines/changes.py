"""What changed from accepted runs to the present one, beyond noise."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

from xfrustum.reports.baselines.measures import (
    NAMES,
    WORDS,
    HogelMeasures,
    Measures,
    Place,
    is_count,
    total,
)
from xfrustum.reports.baselines.tolerance import MIN_FREEDOM, Allowed, Noise, Stated, learnt
from xfrustum.reports.common.formatting import digits


class Change(StrEnum):
    """How a measure, or a whole run, is beside what was accepted."""

    WORSE = "worse"
    BETTER = "better"
    SAME = "same"
    """No difference beyond the tolerance."""
    NEW = "new"
    """Nothing is accepted that it could be compared with."""


@dataclass(frozen=True, kw_only=True)
class MeasureChange:
    """One measure of a hogel, or of the plate, beside what was accepted.

    Attributes
    ----------
    measure
        Name of the measure.
    aperture
        Column and row of the hogel; None for the plate.
    accepted, limit
        Mean of the accepted runs, and the largest value that is not worse; None where nothing is accepted.
    now
        Present value; None where it cannot be known any more.
    change
        Direction of the change.
    """

    measure: str
    aperture: Place | None
    accepted: float | None
    limit: float | None
    now: float | None
    change: Change

    @property
    def increase(self) -> float:
        """The present value minus the accepted one; infinite where it cannot be known any more."""
        return math.inf if self.now is None else self.now - (self.accepted or 0.0)

    @property
    def place_words(self) -> str:
        """The place, in words."""
        return "plate" if self.aperture is None else f"hogel {self.aperture[0]},{self.aperture[1]}"

    @property
    def words(self) -> str:
        """Which measure, where, and how much."""
        was, now = in_units(self.measure, self.accepted), in_units(self.measure, self.now)
        place = "the plate" if self.aperture is None else self.place_words
        return f"{WORDS[self.measure]} of {place}: {was} accepted, {now} now"


SHOWN_AS_ZERO_PX = 1e-5
"""Displacement, in pixels, below which nobody wants to read digits; `tolerance.ROUNDING_PX` is less."""


def is_shown(measure: str, value: float | None) -> bool:
    """Return whether a value is known, and other than zero as people read it."""
    return bool(value) if is_count(measure) else (value or 0.0) >= SHOWN_AS_ZERO_PX


def in_units(measure: str, value: float | None) -> str:
    """Return the value of a measure as people read it."""
    if value is None:
        return "unknown"
    if is_count(measure):
        return f"{value:,.0f}" if value == round(value) else f"{value:,.1f}"
    return "0 px" if abs(value) < SHOWN_AS_ZERO_PX else f"{digits(value)} px"


@dataclass(frozen=True, kw_only=True)
class Changes:
    """The present run beside the accepted ones.

    Attributes
    ----------
    plate, hogels
        Every measure of the plate, and of each hogel.
    runs
        Largest number of accepted runs that a hogel is compared with; 0 where nothing is accepted.
    noisy
        Whether repeated runs differ from one another.
    uncertain
        Number of measures whose limits are learnt from noise with less than `MIN_FREEDOM` degrees of freedom.
    """

    plate: tuple[MeasureChange, ...]
    hogels: tuple[MeasureChange, ...]
    runs: int
    noisy: bool
    uncertain: int = 0

    def of_kind(self, change: Change) -> tuple[MeasureChange, ...]:
        """Return the changes of hogels, then those of the plate; the largest of each measure first."""
        found = [one for one in (*self.hogels, *self.plate) if one.change is change]
        return ranked(found)

    @property
    def change(self) -> Change:
        """The worst of all changes."""
        there = {one.change for one in (*self.plate, *self.hogels)}
        order = (Change.WORSE, Change.BETTER, Change.SAME)
        return next((change for change in order if change in there), Change.NEW)


def ranked(changes: Iterable[MeasureChange]) -> tuple[MeasureChange, ...]:
    """Return changes of hogels, then those of the plate, by measure; the largest of each measure first."""

    def rank(one: MeasureChange) -> tuple[bool, int, float]:
        sign = -1 if one.change is Change.WORSE else 1
        return one.aperture is None, NAMES.index(one.measure), sign * one.increase

    return tuple(sorted(changes, key=rank))


@dataclass(frozen=True, kw_only=True)
class Edition:
    """One hogel in the runs of one accepted state: `runs` has their names, `kept` what they measured."""

    runs: tuple[str, ...]
    kept: Sequence[HogelMeasures]


Accepted = Mapping[Place, Sequence[Edition]]
"""Editions of each hogel, the newest first: hogels are compared with it, the others tell of noise only."""


@dataclass(frozen=True, kw_only=True)
class _Compared:
    """One measure of one place that can be compared.

    `editions` has the accepted values, one for each run, the newest edition first; `now` is the present one.
    """

    measure: str
    aperture: Place | None
    editions: tuple[tuple[float, ...], ...]
    now: float | None

    @property
    def values(self) -> tuple[float, ...]:
        return self.editions[0]


def changes_of(now: Sequence[HogelMeasures], accepted: Accepted, stated: Stated | None = None) -> Changes:
    """Compare the present run with accepted ones, hogel by hogel and as a whole.

    The plate's measures are compared over the hogels that were accepted in the same runs and are there. A
    number that was known and is not any more got worse; one that was not known is new.

    Parameters
    ----------
    now
        Hogels of the present run.
    accepted
        Accepted runs of each hogel.
    stated
        Tolerances that the user states, which go before those that are learnt.
    """
    hogels, fresh = _hogels(now, accepted)
    plate, fresh_of_plate = _plate(now, accepted)
    noises = _noises(plate, hogels)
    compared = sum(noise.deviation > 0 for noise in noises)
    uncertain = 0

    def judged(one: _Compared, noise: Noise) -> MeasureChange:
        nonlocal uncertain
        allowed = stated.allowed(one.measure, one.values) if stated is not None else None
        uncertain += allowed is None and noise.deviation > 0 and noise.freedom < MIN_FREEDOM
        return _judged(one, allowed or learnt(one.measure, one.values, noise, compared))

    found = [judged(one, noise) for one, noise in zip((*plate, *hogels), noises, strict=True)]
    return Changes(
        plate=(*found[: len(plate)], *fresh_of_plate),
        hogels=(*found[len(plate) :], *fresh),
        runs=max((len(accepted[one.place][0].runs) for one in now if one.place in accepted), default=0),
        noisy=compared > 0,
        uncertain=uncertain,
    )


def _noises(plate: Sequence[_Compared], hogels: Sequence[_Compared]) -> list[Noise]:
    """Return the noise of each measure of the plate, then of the hogels: no less than all hogels tell."""
    of_hogels = [Noise.of(one.editions) for one in hogels]
    by_name: dict[str, list[Noise]] = {name: [] for name in NAMES}
    for one, noise in zip(hogels, of_hogels, strict=True):
        by_name[one.measure].append(noise)
    floors = {name: Noise.over_hogels(several) for name, several in by_name.items()}
    sums = {name: Noise.of_sum(several) for name, several in by_name.items() if is_count(name)}
    return [Noise.of(one.editions).at_least({**floors, **sums}[one.measure]) for one in plate] + [
        noise.at_least(floors[one.measure], len(by_name[one.measure]))
        for one, noise in zip(hogels, of_hogels, strict=True)
    ]


def _hogels(now: Sequence[HogelMeasures], accepted: Accepted) -> tuple[list[_Compared], list[MeasureChange]]:
    """Return what can be compared of hogels, and what is new."""
    compared, fresh = [], []
    for hogel in now:
        editions = accepted.get(hogel.place, ())
        kept = [tuple(edition.kept) for edition in editions]
        newest = kept[0] if kept else ()
        # What counts another kind of wrong pixels is another measure.
        alike = len({one.by for one in (hogel, *newest)} - {None}) <= 1
        for name in NAMES:
            value = hogel.measures.value(name)
            known = [_known(name, [one.measures for one in edition]) for edition in kept]
            if known and known[0] and (alike or name != "wrong_pixels"):
                # A missing hogel is counted as such, and not once more for each of its other measures.
                if value is not None or not hogel.measures.missing:
                    groups = tuple(values for values in known if values)
                    compared.append(_Compared(measure=name, aperture=hogel.place, editions=groups, now=value))
            elif value is not None:
                fresh.append(_fresh(name, hogel.place, value))
    return compared, fresh


def _known(name: str, several: Sequence[Measures]) -> tuple[float, ...]:
    """Return the values of a measure that are known."""
    return tuple(value for one in several if (value := one.value(name)) is not None)


def _plate(now: Sequence[HogelMeasures], accepted: Accepted) -> tuple[list[_Compared], list[MeasureChange]]:
    """Return what can be compared of the plate; all is new where its hogels were accepted in several runs."""
    common = [one for one in now if one.place in accepted]
    if len({accepted[one.place][0].runs for one in common}) != 1:
        numbers = total([one.measures for one in now])
        return [], [_fresh(name, None, value) for name in NAMES if (value := numbers.value(name)) is not None]
    whole = {
        one.place
        for one in common
        if not one.measures.missing and not any(kept.measures.missing for kept in accepted[one.place][0].kept)
    }
    present = _totals(common, whole)
    totals = []
    for several in zip(*(accepted[one.place] for one in common), strict=False):
        if len({one.runs for one in several}) > 1:
            break
        kept = zip(*(one.kept for one in several), strict=True)
        totals.append([_totals(run, whole) for run in kept])
    compared = []
    for name in NAMES:
        known = [_known(name, one) for one in totals]
        value = present.value(name)
        if known[0] and value is not None:
            groups = tuple(values for values in known if values)
            compared.append(_Compared(measure=name, aperture=None, editions=groups, now=value))
    return compared, []


def _totals(hogels: Sequence[HogelMeasures], whole: Collection[Place]) -> Measures:
    """Return the totals over hogels that are there, now and in the accepted runs; all missing ones count."""
    there = [one.measures for one in hogels if one.place in whole]
    missing = total([Measures(missing=one.measures.missing) for one in hogels])
    return replace(total(there), missing=missing.missing)


def _judged(one: _Compared, allowed: Allowed) -> MeasureChange:
    if one.now is None or one.now > allowed.high:
        change = Change.WORSE
    else:
        change = Change.BETTER if one.now < allowed.low else Change.SAME
    return MeasureChange(
        measure=one.measure,
        aperture=one.aperture,
        accepted=allowed.mean,
        limit=allowed.high,
        now=one.now,
        change=change,
    )


def _fresh(name: str, place: Place | None, value: float) -> MeasureChange:
    return MeasureChange(
        measure=name, aperture=place, accepted=None, limit=None, now=value, change=Change.NEW
    )
