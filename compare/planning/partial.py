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

    What is hard is told by closed forms. Apertures that see nearer to the plate than all others need the
    smallest near; those that see farthest lose digits; and where z^2 over near is largest, the steps of
    standard depth are. Each way is tried, and the one that leaves most apertures counts.

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
    best: tuple[tuple[Look, ...], Found] | None = None
    aside = len(looks) - 1
    for hardness in (_nearness, _distance, _depth_steps):
        ordered = sorted(looks, key=hardness, reverse=True)
        found = planned(tuple(ordered[aside:])) if ordered else None
        if found is None:
            continue
        best, low = (tuple(ordered[aside:]), found), 0
        for _ in range(MAX_HALVINGS):
            if aside - low <= 1:
                break
            middle = (low + aside) // 2
            tried = planned(tuple(ordered[middle:]))
            if tried is None:
                low = middle
            else:
                best, aside = (tuple(ordered[middle:]), tried), middle
    return best


def _nearness(look: Look) -> float:
    return look.pixels_per_near


def _distance(look: Look) -> float:
    return max(look.farthest(camera) for camera in (Camera.C, Camera.C_STAR))


def _depth_steps(look: Look) -> float:
    """Return the step of standard depth at the farthest surface with the largest near, but for a factor."""
    if math.isinf(look.pixels_per_near):
        return math.inf
    return look.pixels_per_near * _distance(look) ** 2
