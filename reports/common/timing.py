"""Medians of repeated timings with intervals, and timing of alternatives in turns."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import comb

CONFIDENCE = 0.95
"""Smallest probability that an interval of six or more repetitions contains the true median.

With fewer, the interval from the lowest to the highest holds it with probability 1 - 2^(1 - n)."""

#: smallest number of paired differences whose interval has `CONFIDENCE`
FEWEST_DIFFERENCES = 6

FEWEST_REPETITIONS = 5
"""Fewest repetitions to distinguish two times.

With five repetitions each, the intervals of two equal times are disjoint by chance in 1 of 126
cases, the probability of a completely separated order of ten values (Mann and Whitney 1947); with
more repetitions, more rarely."""


def median_interval(values: Sequence[float]) -> tuple[float, float]:
    """Return the narrowest interval of order statistics that holds the median with `CONFIDENCE`.

    For any distribution, the probability that the i-th smallest of n values is above the median
    equals the probability of fewer than i heads in n tosses of a coin (David and Nagaraja, Order
    Statistics, section 7.1). With fewer than six values the interval is from the lowest to the
    highest, with less confidence.
    """
    ordered, count = sorted(values), len(values)
    outside, beyond = 0, 0
    # Integers keep the binomial sum exact for any number of repetitions.
    while 2 * (beyond + comb(count, outside)) <= (1 - CONFIDENCE) * 2**count:
        beyond += comb(count, outside)
        outside += 1
    # Few values allow no interval of this confidence: use the widest, between their extremes.
    outside = max(outside, 1)
    return ordered[outside - 1], ordered[count - outside]


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Repeated measurements of one thing: seconds, or a rate."""

    median: float
    lowest: float
    highest: float
    #: after the warm-up
    repetitions: int
    #: Ends of the median's interval if it is narrower than from `lowest` to `highest`, else None.
    low: float | None = None
    high: float | None = None

    @classmethod
    def from_values(cls, values: Sequence[float]) -> Timing:
        """Return the timing of at least one value."""
        lowest, highest = min(values), max(values)
        low, high = median_interval(values)
        return cls(
            median=statistics.median(values),
            lowest=lowest,
            highest=highest,
            repetitions=len(values),
            low=None if low == lowest else low,
            high=None if high == highest else high,
        )

    @property
    def interval(self) -> tuple[float, float]:
        """The interval that holds the true median; see `median_interval`."""
        low = self.lowest if self.low is None else self.low
        return low, self.highest if self.high is None else self.high

    def told_below(self, other: Timing) -> bool:
        """Return whether this timing is clearly less: disjoint intervals, enough repetitions."""
        enough = min(self.repetitions, other.repetitions) >= FEWEST_REPETITIONS
        return enough and self.interval[1] < other.interval[0]

    def divided_by(self, count: float) -> Timing:
        """Return the timing of each of `count` equal parts."""
        names = ("median", "lowest", "highest", "low", "high")
        shares = {
            name: value / count for name in names if (value := getattr(self, name)) is not None
        }
        return replace(self, **shares)


def race(
    contestants: Mapping[str, Callable[[], object]],
    repeat: int,
    done: Callable[[], object] = lambda: None,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, Timing]:
    """Return the seconds of each alternative; after a warm-up all run in turns, `repeat` times."""
    seconds: dict[str, list[float]] = {name: [] for name in contestants}
    for turn in range(repeat + 1):
        for name, run in contestants.items():
            begun = clock()
            run()
            taken = clock() - begun
            done()
            # The first turn warms caches and compiles shaders.
            if turn:
                seconds[name].append(taken)
    return {name: Timing.from_values(values) for name, values in seconds.items()}
