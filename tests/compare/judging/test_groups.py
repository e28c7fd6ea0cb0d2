"""Groups of frames are compared in order, each as soon as the frames of the one before it are asked for."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from itertools import pairwise
from typing import Any, cast

import pytest

from xfrustum.compare.judging.frames import Frames
from xfrustum.compare.judging.groups import GROUP_FRAMES, ComparedGroups
from xfrustum.compare.metrics.comparison import Comparison


class Begun:
    """An executor that does each task at once, and remembers which parts were compared together."""

    def __init__(self) -> None:
        self.groups: list[list[int]] = []

    def submit(self, compare: Any, frames: list[Future[Any]]) -> Future[Any]:
        self.groups.append([one.result() for one in frames])
        done: Future[Any] = Future()
        done.set_result(compare(frames))
        return done


def comparisons(numbers: list[int]) -> tuple[ComparedGroups, Begun]:
    """Return groups of frames that are drawn already; the number of a part stands for its frames."""
    pool = Begun()
    drawn: dict[int, Future[Frames]] = {number: Future() for number in numbers}
    for number, frames in drawn.items():
        frames.set_result(cast(Frames, number))

    def compare(frames: Any) -> list[Comparison]:
        return [cast(Comparison, f"comparison of {one.result()}") for one in frames]

    return ComparedGroups(compare, cast(Executor, pool), drawn), pool


@pytest.mark.parametrize("count", [0, 1, GROUP_FRAMES, GROUP_FRAMES + 1, 3 * GROUP_FRAMES - 1])
def test_each_part_has_its_own_comparison(count: int) -> None:
    numbers = [2 * place for place in range(count)]
    groups, pool = comparisons(numbers)
    for number in range(2 * count):
        found = groups.of(number)
        groups.begin_behind(number)
        if number in numbers:
            assert found is not None and str(found.result()) == f"comparison of {number}"
        else:
            assert found is None
    assert [number for group in pool.groups for number in group] == numbers
    assert all(len(group) <= GROUP_FRAMES for group in pool.groups)


def test_groups_grow_up_to_the_largest_size() -> None:
    groups, pool = comparisons(list(range(3 * GROUP_FRAMES)))
    for number in range(3 * GROUP_FRAMES):
        groups.begin_behind(number)
    sizes = [len(group) for group in pool.groups]
    assert sizes[0] == 1
    assert all(larger == min(2 * size, GROUP_FRAMES) for size, larger in pairwise(sizes[:-1]))
    assert sizes[-2] == GROUP_FRAMES


def test_a_group_is_begun_behind_the_first_frame_of_the_one_before_it() -> None:
    groups, pool = comparisons([10 + number for number in range(8)])
    assert pool.groups == [[10]]
    groups.begin_behind(9)
    assert len(pool.groups) == 1
    groups.begin_behind(10)
    assert pool.groups[1:] == [[11, 12]]
    groups.begin_behind(10)
    assert len(pool.groups) == 2
    groups.begin_behind(11)
    assert pool.groups[2:] == [[13, 14, 15, 16]]
    groups.begin_behind(12)
    assert len(pool.groups) == 3
    groups.begin_behind(13)
    assert pool.groups[3:] == [[17]]
