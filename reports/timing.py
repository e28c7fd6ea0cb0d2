"""The one place that takes time: wall seconds per named stage, and what repetitions come to."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace


class Stopwatch:
    """Seconds per named stage; a stage entered again adds up.

    Attributes
    ----------
    seconds
        Wall seconds per stage, in the order in which the stages were first entered.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the wall time of the block to the stage, also when the block raises."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.record(name, time.perf_counter() - start)

    def record(self, name: str, seconds: float) -> None:
        """Add seconds that another clock measured, such as a timer query of the GPU."""
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds

    def add(self, seconds: Mapping[str, float]) -> None:
        """Add the stages of another stopwatch."""
        for name, value in seconds.items():
            self.record(name, value)


@dataclass(frozen=True, kw_only=True)
class Spread:
    """What repetitions of one thing came to: seconds, or whatever was measured.

    Attributes
    ----------
    median, lowest, highest
        Over the repetitions.
    repetitions
        How many, after the warm-up.
    """

    median: float
    lowest: float
    highest: float
    repetitions: int

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Return the spread of at least one value."""
        return cls(
            median=statistics.median(values),
            lowest=min(values),
            highest=max(values),
            repetitions=len(values),
        )

    def divided_by(self, count: float) -> Spread:
        """Return the spread of each of so many equal parts."""
        return replace(
            self, median=self.median / count, lowest=self.lowest / count, highest=self.highest / count
        )


def race(
    contestants: Mapping[str, Callable[[], object]], repeat: int, done: Callable[[], object] = lambda: None
) -> dict[str, Spread]:
    """Return the wall seconds of each contestant; all take turns, so that a slow minute is everybody's.

    Parameters
    ----------
    contestants
        Each runs once to warm up, and then `repeat` times.
    repeat
        At least 1.
    done
        Called after every run, for progress.
    """
    seconds: dict[str, list[float]] = {name: [] for name in contestants}
    for turn in range(repeat + 1):
        for name, run in contestants.items():
            watch = Stopwatch()
            with watch.stage(name):
                run()
            done()
            if turn:
                seconds[name].append(watch.seconds[name])
    return {name: Spread.of(values) for name, values in seconds.items()}
