"""Pictures that are made in turns until their times are told apart, within a bounded time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import compress

from xfrustum.reports.common.timing import FEWEST_REPETITIONS, Stopwatch, Timing

NARROW = 0.05
"""Length of a median's interval, as a share of the median, below which more repetitions are not worth
their time: ways whose intervals overlap then are equally fast to within a tenth."""

MAX_REPETITIONS = 25
"""Repetitions after which nothing is repeated further: an interval narrows with the square root of
their number."""

CLEARLY_SLOWER = 2.0
"""Ratio of medians beyond which a way is not repeated further: no slow minute makes it the fastest."""

Unsettled = Callable[[Sequence[Timing]], Sequence[bool]]
"""Says of each contestant, from the times of all, whether further turns could change its place."""


def take_turn(runs: Sequence[Callable[[], object]], seconds: Sequence[list[float]]) -> None:
    """Run each contestant once, one after the other, and append its wall seconds to its list."""
    for run, taken in zip(runs, seconds, strict=True):
        watch = Stopwatch()
        with watch.stage("run"):
            run()
        taken.append(watch.seconds["run"])


def take_turns_until_settled(
    runs: Sequence[Callable[[], object]],
    seconds: Sequence[list[float]],
    unsettled: Unsettled,
    budget_s: float,
) -> None:
    """Let contestants take turns until nobody's place can change, or the time is spent.

    A slow minute is everybody's, for all that are unsettled run in every turn; a turn that would not fit
    into what is left of the time does not begin.

    Parameters
    ----------
    runs, seconds
        One each per contestant; each has run at least once, and its wall seconds are in its list.
    unsettled
        Asked before every turn.
    budget_s
        Wall seconds that all turns together may take.
    """
    watch = Stopwatch()
    while True:
        timings = [Timing.of(taken) for taken in seconds]
        racing = list(unsettled(timings))
        expected = sum(timing.median for timing in compress(timings, racing))
        if not any(racing) or watch.seconds.get("turns", 0.0) + expected > budget_s:
            return
        with watch.stage("turns"):
            take_turn(list(compress(runs, racing)), list(compress(seconds, racing)))


def open_races(tied: Sequence[Timing], timings: Sequence[Timing]) -> list[bool]:
    """Return which of some timings take a further turn, given those that are not told apart from the fastest.

    Nobody does where one is the fastest, or all that are tied are known well. Else all do that are not
    clearly slower, those told apart by now included: times are compared that come from the same minutes.
    """
    if len(tied) < 2 or all(map(settled, tied)):
        return [False] * len(timings)
    medians = [one.median for one in tied]
    limit = max(CLEARLY_SLOWER * min(medians), *medians)
    return [one.median <= limit for one in timings]


def settled(timing: Timing) -> bool:
    """Return whether more repetitions of one thing are not worth their time."""
    low, high = timing.interval
    if timing.repetitions >= MAX_REPETITIONS:
        return True
    return timing.repetitions >= FEWEST_REPETITIONS and high - low <= NARROW * timing.median
