"""Timer queries of the GPU beside wall time, stage by stage."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from OpenGL import GL

NANOSECOND = 1e-9
"""Seconds in a nanosecond, the unit of OpenGL's timestamps."""


@dataclass(frozen=True, kw_only=True)
class StageTime:
    """The time of one stage."""

    #: Seconds between two timestamps in the device's own queue: the time that the device needed, whenever
    #: that was
    gpu_s: float
    #: Seconds that the processor spent on giving the orders. A software renderer transforms vertices in this
    #: time; a GPU works in parallel.
    wall_s: float


class GpuTimer:
    """Seconds per named stage of drawing in the current context; a stage that is entered again adds up.

    Timestamps enclose each stage, because elapsed-time queries may not overlap. They do not wait for the
    device; only `collect` does, once.
    """

    def __init__(self) -> None:
        self._queries: list[tuple[str, int, int]] = []
        self._wall: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Charge the orders that the block gives to the stage, also when the block raises."""
        begin, end = (int(query) for query in GL.glGenQueries(2))
        self._queries.append((name, begin, end))
        start = time.perf_counter()
        GL.glQueryCounter(begin, GL.GL_TIMESTAMP)
        try:
            yield
        finally:
            GL.glQueryCounter(end, GL.GL_TIMESTAMP)
            self._wall[name] = self._wall.get(name, 0.0) + time.perf_counter() - start

    def collect(self) -> dict[str, StageTime]:
        """Return the time of each stage, in the order in which the stages were first entered; forget them."""
        gpu: dict[str, float] = dict.fromkeys(self._wall, 0.0)
        for name, *queries in self._queries:
            begin, end = (_nanoseconds(query) for query in queries)
            GL.glDeleteQueries(2, queries)
            gpu[name] += max(end - begin, 0) * NANOSECOND
        wall, self._queries, self._wall = self._wall, [], {}
        return {name: StageTime(gpu_s=gpu[name], wall_s=seconds) for name, seconds in wall.items()}


def _nanoseconds(query: int) -> int:
    # PyOpenGL does not know how to allocate a 64-bit result by itself.
    result = ctypes.c_uint64()
    GL.glGetQueryObjectui64v(query, GL.GL_QUERY_RESULT, ctypes.byref(result))
    return result.value
