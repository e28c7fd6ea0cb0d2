"""Error against time: which configurations are worth it, and which is the cheapest within a tolerance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from xfrustum.compare.beyond import is_beyond
from xfrustum.reports.common.timing import FEWEST_REPETITIONS, Timing
from xfrustum.reports.error_report.best import DISPLACEMENT_TIE_PX, where_it_lies
from xfrustum.scenes.notebook import digits, percent
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

STRICTER_FRACTION = 0.2
"""Share of the tolerance that is answered for too: a tenth of a pixel where half a pixel is asked for."""

MAX_NAMED_OPTIONS = 3
"""Largest number of options that a sentence names one by one; more are counted."""


@dataclass(frozen=True, kw_only=True)
class Option:
    """One way to make a picture: its error and its time.

    Attributes
    ----------
    family
        Group of options that it belongs to: a depth buffer, or whatever else was varied.
    displacement_p99_px, surface_fraction
        99th percentile of displacement, and share of judged pixels with the wrong surface.
    time_s
        Seconds of a whole picture with read-back, over repetitions.
    gpu_s, read_s
        Seconds of these in which the device drew, and read back; None for a tracer, which does neither.
    """

    renderer: str
    label: str
    family: str
    configuration: Mapping[str, Any]
    displacement_p99_px: float
    surface_fraction: float
    time_s: Timing
    gpu_s: Timing | None = None
    read_s: Timing | None = None

    def within(self, tolerance_px: float) -> bool:
        """Whether the hogel that was measured is not beyond a tolerance."""
        return not is_beyond(self.displacement_p99_px, self.surface_fraction, tolerance_px)

    def beats(self, other: Option) -> bool:
        """Whether this option is in nothing worse than another, and in something better.

        Its time is no worse where its median is not beyond the other's interval, and better where the two
        times are told apart.
        """
        mine, others = ((one.displacement_p99_px, one.surface_fraction) for one in (self, other))
        if self.time_s.median > other.time_s.interval[1] or mine[0] > others[0] or mine[1] > others[1]:
            return False
        return mine != others or self.time_s.told_below(other.time_s)


@dataclass(frozen=True, kw_only=True)
class Ranking:
    """The options within a tolerance than which no other option is told to be faster.

    Attributes
    ----------
    fastest
        Options whose timing intervals overlap with that of the least median, which comes first; all options
        within the tolerance where nothing was repeated often enough to rank it.
    ranked
        Whether there were enough repetitions.
    """

    fastest: tuple[Option, ...]
    ranked: bool

    @property
    def least_error(self) -> Option:
        """The fastest option with the least displacement, then the fewest wrong surfaces."""
        return min(
            self.fastest,
            key=lambda one: (
                max(one.displacement_p99_px, DISPLACEMENT_TIE_PX),
                one.surface_fraction,
                one.time_s.median,
            ),
        )

    @property
    def range_s(self) -> tuple[float, float]:
        """The least and the largest median of the fastest options."""
        medians = [one.time_s.median for one in self.fastest]
        return min(medians), max(medians)


@dataclass(frozen=True, kw_only=True)
class FastestWithin:
    """The fastest options within a tolerance; None where nothing keeps it."""

    tolerance_px: float
    ranking: Ranking | None
    sentence: str

    @property
    def option(self) -> Option | None:
        """The fastest option with the least error."""
        return self.ranking.least_error if self.ranking else None


def pareto(options: Sequence[Option]) -> list[bool]:
    """Return which options no other one beats in time, displacement and wrong surfaces together."""
    return [not any(other.beats(option) for other in options) for option in options]


def rank(options: Sequence[Option], tolerance_px: float) -> Ranking | None:
    """Return the fastest options within a tolerance, ties included; None where nothing keeps it."""
    allowed = [option for option in options if option.within(tolerance_px)]
    if not allowed:
        return None
    if len(allowed) == 1:
        return Ranking(fastest=tuple(allowed), ranked=True)
    repeated = [option for option in allowed if option.time_s.repetitions >= FEWEST_REPETITIONS]
    if not repeated:
        return Ranking(fastest=tuple(sorted(allowed, key=lambda one: one.time_s.median)), ranked=False)
    repeated.sort(key=lambda option: option.time_s.median)
    tied = (option for option in repeated if not repeated[0].time_s.told_below(option.time_s))
    return Ranking(fastest=tuple(tied), ranked=True)


def answers(options: Sequence[Option], tolerance_px: float = TOLERANCE_PX) -> tuple[FastestWithin, ...]:
    """Return what a tolerance costs, and what a fifth of it would cost, in words."""
    tolerances = (tolerance_px, STRICTER_FRACTION * tolerance_px)
    loose, strict = (rank(options, tolerance) for tolerance in tolerances)
    sentences = (
        _none(tolerance_px) if loose is None else _fastest(tolerance_px, loose),
        _none(tolerances[1]) if strict is None else _stricter(tolerances[1], loose, strict),
    )
    return tuple(
        FastestWithin(tolerance_px=tolerance, ranking=ranking, sentence=sentence)
        for tolerance, ranking, sentence in zip(tolerances, (loose, strict), sentences, strict=True)
    )


def _fastest(tolerance_px: float, ranking: Ranking) -> str:
    under = f"under {digits(tolerance_px)} px"
    if len(ranking.fastest) == 1:
        return f"The fastest way to stay {under}: {_described(ranking.fastest[0])}."
    count = len(ranking.fastest)
    if not ranking.ranked:
        return (
            f"{count} ways stay {under}, {_milliseconds(*ranking.range_s)} a picture; they are not ranked "
            f"by time, which takes {FEWEST_REPETITIONS} repetitions. {_least(ranking)}"
        )
    return (
        f"The fastest way to stay {under} is one of these {count}, "
        f"{_milliseconds(*ranking.range_s)} a picture, which {_repetitions(ranking)} do not tell apart: "
        f"{_listed(ranking.fastest)}. {_least(ranking)}"
    )


def _stricter(tolerance_px: float, loose: Ranking | None, strict: Ranking) -> str:
    asked = f"{digits(tolerance_px)} px would cost"
    if loose is None or not (loose.ranked and strict.ranked):
        return _fastest(tolerance_px, strict)
    one, other = loose.fastest[0].time_s, strict.fastest[0].time_s
    if not one.told_below(other):
        if loose.fastest == strict.fastest:
            return f"{asked} nothing more: {_same(len(strict.fastest))}."
        return f"{asked} nothing more that can be told: {_fewer(strict)}. {_least(strict)}"
    low, high = other.interval[0] / one.interval[1], other.interval[1] / one.interval[0]
    times = f"{other.median / one.median:.2f} times ({low:.2f} to {high:.2f}) the time of that"
    if len(strict.fastest) == 1:
        return f"{asked} {times}: {_described(strict.fastest[0])}."
    return f"{asked} {times}: {_fewer(strict)}. {_least(strict)}"


def _same(count: int) -> str:
    return "the same configuration keeps it" if count == 1 else f"the same {count} configurations keep it"


def _fewer(ranking: Ranking) -> str:
    if len(ranking.fastest) == 1:
        return _described(ranking.fastest[0])
    return (
        f"one of these {len(ranking.fastest)} keeps it fastest, {_milliseconds(*ranking.range_s)} a picture, "
        f"which {_repetitions(ranking)} do not tell apart: {_listed(ranking.fastest)}"
    )


def _least(ranking: Ranking) -> str:
    """Say which one of several options is to be taken."""
    return f"The least error among them is that of {_described(ranking.least_error)}."


def _listed(options: Sequence[Option]) -> str:
    """Name a few options; count many by their families."""
    if len(options) <= MAX_NAMED_OPTIONS:
        return "; ".join(option.label for option in options)
    families = Counter(option.family for option in options)
    return ", ".join(f"{count} of {family}" for family, count in families.items())


def _repetitions(ranking: Ranking) -> str:
    fewest, most = (pick(one.time_s.repetitions for one in ranking.fastest) for pick in (min, max))
    return f"{fewest} repetitions" if fewest == most else f"{fewest} to {most} repetitions"


def _none(tolerance_px: float) -> str:
    return (
        f"Nothing that was measured stays under {digits(tolerance_px)} px with at most "
        f"{percent(MAX_WRONG)} of wrong surfaces."
    )


def _described(option: Option) -> str:
    return (
        f"{option.label}, {_taken(option.time_s)} a picture; {where_it_lies(option.displacement_p99_px)}, "
        f"and {percent(option.surface_fraction)} of the judged pixels show the wrong surface"
    )


def _taken(time_s: Timing) -> str:
    """Write a time with the interval of its median."""
    low, high = time_s.interval
    spread = f" ({1000 * low:.3g} to {1000 * high:.3g})" if time_s.repetitions > 1 else ", taken once,"
    return f"{1000 * time_s.median:.3g} ms{spread}"


def _milliseconds(low: float, high: float) -> str:
    one, other = f"{1000 * low:.3g}", f"{1000 * high:.3g}"
    return f"{one} ms" if one == other else f"{one} to {other} ms"
