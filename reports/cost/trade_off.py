"""Error against time: which configurations are worth it, and which is the cheapest within a tolerance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
    """One way to make a picture: its error and its time."""

    renderer: str
    label: str
    family: str  #: group of options that it belongs to: a depth buffer, or whatever else was varied
    configuration: Mapping[str, Any]
    displacement_p99_px: float
    surface_fraction: float  #: share of judged pixels with the wrong surface
    #: Seconds of a whole picture with read-back, over repetitions; and of these in which the device drew, and
    #: read back: None for a tracer, which does neither.
    time_s: Timing
    gpu_s: Timing | None = None
    read_s: Timing | None = None

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
class FastestWithin:
    """The options within a tolerance than which no other option is told to be faster.

    `fastest` are those whose timing intervals overlap with that of the least median, which comes first; all
    options within the tolerance where nothing was repeated often enough to rank it (`ranked` is false), and
    none where nothing keeps it.
    """

    tolerance_px: float
    fastest: tuple[Option, ...]
    ranked: bool
    sentence: str = ""  #: the answer in words

    @property
    def option(self) -> Option | None:
        """The fastest option with the least displacement, then the fewest wrong surfaces."""

        def error(one: Option) -> tuple[float, ...]:
            moved = max(one.displacement_p99_px, DISPLACEMENT_TIE_PX)
            return moved, one.surface_fraction, one.time_s.median

        return min(self.fastest, key=error, default=None)


def pareto(options: Sequence[Option]) -> list[bool]:
    """Return which options no other one beats in time, displacement and wrong surfaces together."""
    return [not any(other.beats(option) for other in options) for option in options]


def rank(options: Sequence[Option], tolerance_px: float) -> FastestWithin:
    """Return the fastest options within a tolerance, ties included; without a sentence."""
    ascending = sorted(options, key=lambda one: one.time_s.median)
    allowed = tuple(
        one for one in ascending if not is_beyond(one.displacement_p99_px, one.surface_fraction, tolerance_px)
    )
    repeated = [one for one in allowed if one.time_s.repetitions >= FEWEST_REPETITIONS]
    if len(allowed) < 2 or not repeated:
        return FastestWithin(tolerance_px=tolerance_px, fastest=allowed, ranked=len(allowed) == 1)
    tied = tuple(one for one in repeated if not repeated[0].time_s.told_below(one.time_s))
    return FastestWithin(tolerance_px=tolerance_px, fastest=tied, ranked=True)


# In words ------------------------------------------------------------------------------------------------


def answers(options: Sequence[Option], tolerance_px: float = TOLERANCE_PX) -> tuple[FastestWithin, ...]:
    """Return what a tolerance costs, and what a fifth of it would cost, in words."""
    loose, strict = (rank(options, share * tolerance_px) for share in (1.0, STRICTER_FRACTION))
    return replace(loose, sentence=_fastest(loose)), replace(strict, sentence=_stricter(loose, strict))


def _fastest(ranking: FastestWithin) -> str:
    under, count = f"under {digits(ranking.tolerance_px)} px", len(ranking.fastest)
    if not count:
        return f"Nothing that was measured stays {under} with at most {percent(MAX_WRONG)} of wrong surfaces."
    if count == 1:
        return f"The fastest way to stay {under}: {_described(ranking.fastest[0])}."
    if ranking.ranked:
        return f"The fastest way to stay {under} is one of these {count}, {_tie(ranking)}"
    return (
        f"{count} ways stay {under}, {_milliseconds(ranking)} a picture; they are not ranked by time, which "
        f"takes {FEWEST_REPETITIONS} repetitions. {_least(ranking)}"
    )


def _stricter(loose: FastestWithin, strict: FastestWithin) -> str:
    if not (loose.ranked and strict.ranked):
        return _fastest(strict)
    asked, count = f"{digits(strict.tolerance_px)} px would cost", len(strict.fastest)
    one, other = loose.fastest[0].time_s, strict.fastest[0].time_s
    cost = "nothing more that can be told"
    if one.told_below(other):
        low, high = other.interval[0] / one.interval[1], other.interval[1] / one.interval[0]
        cost = f"{other.median / one.median:.2f} times ({low:.2f} to {high:.2f}) the time of that"
    elif loose.fastest == strict.fastest:
        same = "configuration keeps" if count == 1 else f"{count} configurations keep"
        return f"{asked} nothing more: the same {same} it."
    if count > 1:
        return f"{asked} {cost}: one of these {count} keeps it fastest, {_tie(strict)}"
    said = f"{asked} {cost}: {_described(strict.fastest[0])}."
    return said if one.told_below(other) else f"{said} {_least(strict)}"


def _tie(ranking: FastestWithin) -> str:
    """Say of several options how long they take, which they are, and which one is to be taken."""
    fewest, most = (pick(one.time_s.repetitions for one in ranking.fastest) for pick in (min, max))
    repetitions = f"{fewest} repetitions" if fewest == most else f"{fewest} to {most} repetitions"
    named = "; ".join(option.label for option in ranking.fastest)
    if len(ranking.fastest) > MAX_NAMED_OPTIONS:
        families = Counter(option.family for option in ranking.fastest)
        named = ", ".join(f"{count} of {family}" for family, count in families.items())
    times = f"{_milliseconds(ranking)} a picture"
    return f"{times}, which {repetitions} do not tell apart: {named}. {_least(ranking)}"


def _least(ranking: FastestWithin) -> str:
    assert ranking.option is not None, "there are several options"
    return f"The least error among them is that of {_described(ranking.option)}."


def _described(option: Option) -> str:
    """Write an option with its time and the interval of its median, and its error."""
    low, high = option.time_s.interval
    spread = f" ({1000 * low:.3g} to {1000 * high:.3g})" if option.time_s.repetitions > 1 else ", taken once,"
    return (
        f"{option.label}, {1000 * option.time_s.median:.3g} ms{spread} a picture; "
        f"{where_it_lies(option.displacement_p99_px)}, "
        f"and {percent(option.surface_fraction)} of the judged pixels show the wrong surface"
    )


def _milliseconds(ranking: FastestWithin) -> str:
    """Write the least and the largest median of the fastest options."""
    medians = [1000 * one.time_s.median for one in ranking.fastest]
    low, high = f"{min(medians):.3g}", f"{max(medians):.3g}"
    return f"{low} ms" if low == high else f"{low} to {high} ms"
