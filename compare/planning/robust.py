"""The most robust of some settings that all hold: with a margin for what was not looked at.

A plan that just holds at the apertures it was made from fails at the next one that sees something nearer to
the plate. Displacement falls in proportion to n, and errors of depth grow as n falls: between the two lies
the near that is farthest from either limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import assert_never

from xfrustum.compare.planning.numbers import index_below, round_number
from xfrustum.compare.planning.search import Attempt, Search
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum

BYTES = {DepthFormat.D16: 2, DepthFormat.D24: 3, DepthFormat.D32F: 4}
"""Bytes of a depth value."""

ENOUGH_MARGIN = 10.0
"""Margin beyond which more is worth nothing: a tenth of what is allowed. What no scout has seen takes little
of it: of all 4,941 hogels of `beetle` the worst is displaced 1.2 times as much as the worst of the 605 that a
scout looked through, of `asymmetric` as much (`scout` with `LATTICE_APERTURES` of the whole plate)."""


def price(settings: DoubleFrustum) -> tuple[bool, int]:
    """Return what a depth buffer costs, to be compared: written by fragments or not, then bytes."""
    return written_by_fragment(settings.mapping), BYTES[settings.depth]


def written_by_fragment(mapping: DepthMapping) -> bool:
    """Return whether fragments write a mapping's depth, which costs the early depth test."""
    match mapping:
        case DepthMapping.LOGARITHMIC | DepthMapping.LINEAR:
            return True
        case DepthMapping.STANDARD | DepthMapping.GL | DepthMapping.REVERSED:
            return False
        case _:
            assert_never(mapping)


def most_robust(search: Search, holding: Sequence[Attempt]) -> Attempt:
    """Return the attempt with the largest margin among the cheapest that hold, its near moved to that end.

    Parameters
    ----------
    search
        What predicts.
    holding
        Attempts that hold with the fewest cuts, each with its largest near; at least one.
    """
    cheapest = min(price(one.settings) for one in holding)
    cheap = [one for one in holding if price(one.settings) == cheapest]
    # What eyes see of near holds for all hogels, looked at or not, and depth gains by a larger near.
    balanced = cheap if search.requirement.SEEN_BY_EYES else [with_margin(search, one) for one in cheap]
    return min(balanced, key=lambda one: (_margin_missing(one), -one.settings.near))


def with_margin(search: Search, largest: Attempt) -> Attempt:
    """Return an attempt with the near that is farthest from the limits, up to `ENOUGH_MARGIN`.

    That is the largest near that displaces no more than a tenth of what is allowed, or, where depth would
    then be worse off than displacement, the near at which both have the same margin.
    """
    low, high = search.cutter.lowest, index_below(largest.settings.near)

    def at(index: int) -> Attempt:
        return search.judged(replace(largest.settings, near=round_number(index)))

    best = largest
    # Displacement grows with near, and what depth gets wrong falls with it: the interval is halved.
    while low < high:
        middle = (low + high) // 2
        one = at(middle)
        if one.holds and _margin_missing(one) <= _margin_missing(best):
            best = one
        if one.near_excess > max(one.depth_excess, 1 / ENOUGH_MARGIN):
            high = middle
        else:
            low = middle + 1
    return best


def _margin_missing(attempt: Attempt) -> float:
    """Return the larger excess, but no less than what is enough."""
    return max(attempt.excess, 1 / ENOUGH_MARGIN)
