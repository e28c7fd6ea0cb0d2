"""The one place that takes time: wall seconds per named stage."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager


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
