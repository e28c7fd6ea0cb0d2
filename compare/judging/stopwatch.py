"""The one place that takes time: wall seconds per named stage, of one task or of several side by side."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass


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


class SharedStopwatch:
    """Wall seconds of tasks that run side by side in threads, shared among them.

    While k tasks run, each is given 1/k of the time that passes. So the seconds of all tasks add up to
    the wall time in which at least one of them ran, however many processors there are.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._running: list[tuple[Stopwatch, str]] = []
        self._last = 0.0

    @contextmanager
    def stage(self, watch: Stopwatch, name: str) -> Iterator[None]:
        """Give the block's share of the wall time to a stage of a stopwatch, also when the block raises."""
        task = (watch, name)
        with self._lock:
            self._share()
            self._running.append(task)
        try:
            yield
        finally:
            with self._lock:
                self._share()
                self._running.remove(task)

    def _share(self) -> None:
        """Share the time since the last beginning or end of a task among those that ran in it."""
        now = self._clock()
        for watch, name in self._running:
            watch.record(name, (now - self._last) / len(self._running))
        self._last = now


@dataclass(frozen=True, kw_only=True)
class StageTimes:
    """Wall seconds of the stages of one drawing; no stage is a part of another.

    Stages that run side by side share the time that passes: while k of them run, each is given 1/k of it.

    Attributes
    ----------
    trace
        The hogel's certified truth, the same for all its drawings.
    raster
        A frame with read-back.
    compare, predict
        Judging and predicting the frame.
    causes
        Charging its wrong pixels to causes. What the frames of one hogel have in common is not in it.
        This stage and `predict` take no time where causes were not asked for.
    """

    trace: float
    raster: float
    compare: float
    predict: float
    causes: float

    @classmethod
    def of(cls, trace_s: float, lap: Stopwatch) -> StageTimes:
        """Return the seconds of a frame, given those of its hogel's truth and its own."""
        return cls(trace=trace_s, **{"predict": 0.0, "causes": 0.0, **lap.seconds})


class Machine:
    """A machine whose processors tasks share, unless one of them is to run undisturbed.

    A frame that is drawn, or a truth that is traced, beside other work takes longer than it does by itself.
    Where its wall time is to be its own, it runs undisturbed: it begins when all tasks that run side by side
    have ended, and others begin when it has ended. Without `apart` nothing waits, and tasks only share their
    time.

    Parameters
    ----------
    apart
        Whether tasks that are to run undisturbed do so.

    Attributes
    ----------
    cpu
        CPU seconds by stage: those of all threads of the process where a task runs undisturbed, and those of
        the task's own thread where it runs beside others, whose helpers' time cannot be told apart.
    """

    def __init__(self, *, apart: bool) -> None:
        self.cpu = Stopwatch()
        self._apart = apart
        self._changed = threading.Condition()
        self._beside = 0
        self._asking = 0
        self._clock = SharedStopwatch()
        self._counting = threading.Lock()

    @contextmanager
    def stage(self, watch: Stopwatch, name: str) -> Iterator[None]:
        """Run the block beside others, and give its share of the wall time to a stage of a stopwatch.

        Within the block nothing may be waited for that runs in such a block itself, or undisturbed.
        """
        with self._entered(), self._clock.stage(watch, name), self._counted(name, time.thread_time):
            yield

    @contextmanager
    def undisturbed(self) -> Iterator[None]:
        """Run the block alone; its parts are timed with `timed`."""
        if not self._apart:
            yield
            return
        with self._changed:
            self._asking += 1
            try:
                while self._beside:
                    self._changed.wait()
                # The lock stays taken: nothing else begins until the block has ended.
                yield
            finally:
                self._asking -= 1
                self._changed.notify_all()

    @property
    def apart(self) -> bool:
        """Whether tasks that are to run undisturbed do so."""
        return self._apart

    @contextmanager
    def timed(self, watch: Stopwatch, name: str) -> Iterator[None]:
        """Give the time of the block, which is its share where others run, to a stage of a stopwatch."""
        clock = time.process_time if self._apart else time.thread_time
        with self._clock.stage(watch, name), self._counted(name, clock):
            yield

    @contextmanager
    def _counted(self, name: str, clock: Callable[[], float]) -> Iterator[None]:
        """Give the block's CPU seconds by a clock to a stage of `cpu`, also when the block raises."""
        begun = clock()
        try:
            yield
        finally:
            spent = clock() - begun
            with self._counting:
                self.cpu.record(name, spent)

    @contextmanager
    def _entered(self) -> Iterator[None]:
        """Count a task that runs beside others, which begins where nobody runs or asks to run undisturbed."""
        if not self._apart:
            yield
            return
        with self._changed:
            while self._asking:
                self._changed.wait()
            self._beside += 1
        try:
            yield
        finally:
            with self._changed:
                self._beside -= 1
                self._changed.notify_all()
