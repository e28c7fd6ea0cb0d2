"""Tests of many cases: some cases run every time, all of them with the slow tests."""

from collections.abc import Iterable, Sequence
from typing import Any

import pytest
from hypothesis import settings


def examples(count: int) -> settings:
    """Return settings with `count` examples, scaled like hypothesis's default in the profile."""
    usual = settings.get_profile("xfrustum").max_examples
    return settings(
        max_examples=max(1, count * usual // settings.get_profile("default").max_examples)
    )


def thinned(cases: Iterable[Any], step: int, first: int = 0) -> list[Any]:
    """Return cases as parameters: each `step`-th from `first` runs every time, others are slow.

    For a product of lists, choose a step that is coprime to the lengths of the lists: the cases
    that run every time then include all values of each list.
    """
    return [_parameter(case, number % step == first) for number, case in enumerate(cases)]


def kept(cases: Iterable[Any], every_time: Iterable[Any]) -> list[Any]:
    """Return cases as parameters: cases in `every_time` run every time, others are slow."""
    quick = list(every_time)
    return [_parameter(case, case in quick) for case in cases]


def _parameter(case: Any, quick: bool) -> Any:
    values: Sequence[Any] = case if isinstance(case, tuple) else (case,)
    return pytest.param(*values, marks=() if quick else pytest.mark.slow)
