"""Frames that are alone with their cameras, compared in groups."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import Generic, TypeVar

from xfrustum.compare.judging.frames import Frames
from xfrustum.compare.metrics.comparison import Comparison

GROUP_FRAMES = 8
"""Number of frames that are compared together: one search finds what hides the points of all of them.

A search takes some 3 ms however few points are asked about, and a frame 8 ms besides (512 x 512): with eight
frames its share is a twentieth. Larger groups would save less than that, and hold their frames longer."""

Made = TypeVar("Made")

Compare = Callable[[Sequence[Future[Frames]]], list[Comparison]]
"""Function that compares the only frames of several cameras with the truth."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Batched(Generic[Made]):
    """What a task makes of one part, together with what it makes of others."""

    task: Future[list[Made]]
    place: int

    def result(self) -> Made:
        """Return it as soon as it is made."""
        return self.task.result()[self.place]


class ComparedGroups:
    """The comparisons of one turn's frames that are alone with their cameras.

    Kernels run one at a time, so several threads that compare wait for each other: groups stand in the queue
    of the threads behind frames that can be charged and shown meanwhile. The first group is one frame, which
    then can be so the sooner. Each has twice as many frames as the one before it, up to `GROUP_FRAMES`, lest
    threads wait long for the first ones.

    Parameters
    ----------
    compare, pool
        Function that compares frames, and the threads in which it does.
    frames
        The frames of the turn's parts that have one frame each, by the numbers of these parts, ascending.
    """

    def __init__(self, compare: Compare, pool: Executor, frames: Mapping[int, Future[Frames]]) -> None:
        self._compare, self._pool = compare, pool
        left, size = list(frames.items()), 1
        self._waiting: list[list[tuple[int, Future[Frames]]]] = []
        while left:
            self._waiting.append(left[:size])
            left, size = left[size:], min(2 * size, GROUP_FRAMES)
        self._begun: dict[int, Batched[Comparison]] = {}
        self._first: int | None = None
        self._begin()

    def of(self, number: int) -> Batched[Comparison] | None:
        """Return the comparison of a part; None where it has several frames. Parts are asked for in order."""
        # It is kept only by those who have asked for it.
        return self._begun.pop(number, None)

    def begin_behind(self, number: int) -> None:
        """Begin with the next group where a part is the first of its group.

        Call it for each part that has been asked for, when tasks that nobody shall wait for are submitted.
        """
        if number == self._first:
            self._begin()

    def _begin(self) -> None:
        """Begin with the next group, if there is one."""
        self._first = None
        if not self._waiting:
            return
        # Frames are kept only by those who compare them.
        group = self._waiting.pop(0)
        task = self._pool.submit(self._compare, [frames for _, frames in group])
        self._begun |= {number: Batched(task=task, place=place) for place, (number, _) in enumerate(group)}
        self._first = group[0][0]
