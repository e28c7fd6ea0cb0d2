"""The largest share of a plate that one plan can hold for, where none holds for all of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

from xfrustum.compare.scouting.scout import Look
from xfrustum.scenes.plate.double_frustum import Camera

MAX_HALVINGS = 5
"""Times that the number of apertures to be set aside is halved: it is known to a 32nd of all. Each time a
plan is searched for, among all depth buffers."""

Found = TypeVar("Found")


def largest_share(
    looks: Sequence[Look], planned: Callable[[tuple[Look, ...]], Found | None]
) -> tuple[tuple[Look, ...], Found] | None:
    """Set aside the hardest apertures, as few as need be, until a plan is found for the others.

    What is hard is told by closed form, first by what a depth buffer is asked for: near must fall as
    displacement grows, and a step of standard depth at |z| is as z^2 over near. Where that leads to no plan
    at all, distance alone counts, which is what digits of positions are lost by.

    Parameters
    ----------
    looks
        Looks at apertures that see something, for all of which together there is no plan.
    planned
        Function that returns a plan for some looks, None where there is none.

    Returns
    -------
    The looks that are kept, and their plan; None where not even the easiest aperture alone has one.
    """
    for hardness in (_depth_steps, _distance):
        ordered = sorted(looks, key=hardness, reverse=True)
        kept = tuple(ordered[-1:])
        found = planned(kept) if kept else None
        if found is None:
            continue
        low, high = 0, len(ordered) - 1
        for _ in range(MAX_HALVINGS):
            if high - low <= 1:
                break
            middle = (low + high) // 2
            tried = planned(tuple(ordered[middle:]))
            if tried is None:
                low = middle
            else:
                high, kept, found = middle, tuple(ordered[middle:]), tried
        return kept, found
    return None


def _depth_steps(look: Look) -> float:
    """Return the step of standard depth at the farthest surface with the largest near, but for a factor."""
    if math.isinf(look.pixels_per_near):
        return math.inf
    return look.pixels_per_near * _distance(look) ** 2


def _distance(look: Look) -> float:
    return max(look.farthest(camera) for camera in (Camera.C, Camera.C_STAR))
