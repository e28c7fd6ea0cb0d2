"""Lengths of three significant digits: what a plan is made of, so that it can be read and typed.

A plan in round numbers is also the same for meshes that differ by rounding alone, such as a refined one.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable

_FIRST_OF_DECADE, _PER_DECADE = 100, 900
"""Smallest whole number of three digits, and how many whole numbers have three digits."""


def round_number(index: int) -> float:
    """Return a length of three digits; successive indices give successive ones, index 0 gives 1."""
    decade, place = divmod(index, _PER_DECADE)
    # Parsed, not multiplied: the float nearest to the digits.
    return float(f"{_FIRST_OF_DECADE + place}e{decade - 2}")


def index_below(length: float, *, strictly: bool = False) -> int:
    """Return the index of the largest length of three digits up to a positive one, or strictly below it."""
    decade = math.floor(math.log10(length))
    place = int(length / float(f"1e{decade}") * _FIRST_OF_DECADE) - _FIRST_OF_DECADE
    # Logarithms and quotients round: begin above, and come down.
    index = decade * _PER_DECADE + place + 2
    while round_number(index) > length or (strictly and round_number(index) == length):
        index -= 1
    return index


def largest_index(low: int, high: int, holds: Callable[[float], bool]) -> int | None:
    """Return the largest index in low..high whose length a condition holds for; None where it never does.

    Parameters
    ----------
    low, high
        Inclusive.
    holds
        True up to some length, false beyond it.
    """
    if low > high or not holds(round_number(low)):
        return None
    while low < high:
        middle = (low + high + 1) // 2
        if holds(round_number(middle)):
            low = middle
        else:
            high = middle - 1
    return low


def smallest_index(low: int, high: int, holds: Callable[[float], bool]) -> int:
    """Return the smallest index in low..high whose length a condition holds for; `high` where it never does.

    Parameters
    ----------
    low, high
        Inclusive.
    holds
        False up to some length, true beyond it.
    """
    return low + bisect_left(range(low, high), True, key=lambda index: holds(round_number(index)))
