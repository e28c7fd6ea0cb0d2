"""Reasons of a plan, or for having none, in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from xfrustum.compare.beyond import MAX_UNDEFINED
from xfrustum.compare.planning.cuts import SMALLEST_PER_REACH
from xfrustum.compare.planning.numbers import index_below, round_number
from xfrustum.compare.planning.robust import ENOUGH_MARGIN
from xfrustum.compare.planning.search import (
    MAX_CUTS,
    SEPARATION_MARGIN,
    Attempt,
    DepthBuffer,
)
from xfrustum.compare.planning.views import Quality, Requirement, Views
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.scenes.plate.double_frustum import DoubleFrustum

MAX_SPELLED_HEIGHTS = 4
"""Largest number of heights that a sentence lists."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Result of a search.

    Attributes
    ----------
    choices
        Depth buffers to choose from.
    finest
        The smallest separation that any of them orders at the farthest surface, however it is cut.
    failed
        Attempts with one cut less, or with the most there may be; empty where nothing was tried.
    holding
        Those that are predicted to hold, the best first.
    """

    choices: Sequence[DepthBuffer]
    finest: float
    failed: Sequence[Attempt]
    holding: Sequence[Attempt]

    @property
    def best(self) -> Attempt | None:
        """The plan; None where there is none."""
        return self.holding[0] if self.holding else None


def why(found: Outcome, best: Attempt, views: Views, requirement: Requirement) -> str:
    """Say why a plan is the best there is.

    Parameters
    ----------
    found, best
        What a search came to, and which of that is planned, its near moved to where the margin is largest.
    """
    largest = next(
        one
        for one in found.holding
        if (one.settings.depth, one.settings.mapping) == (best.settings.depth, best.settings.mapping)
    )
    parts = [
        _of_slabs(found, views, requirement),
        requirement.separation_reason(views.scene.units),
        _of_near(largest.settings, views, requirement),
        _of_margin(largest, best, views.scene.units),
        _of_depth(found, best.settings),
    ]
    return " ".join(part for part in parts if part)


def _of_margin(largest: Attempt, best: Attempt, units: str) -> str:
    """Say which near is planned instead of the largest one, and what that leaves."""
    if best.settings.near == largest.settings.near:
        return ""
    margin = 1 / best.excess if best.excess else math.inf
    times = f"{margin:.2g}" if margin < ENOUGH_MARGIN else f"at least {ENOUGH_MARGIN:g}"
    # The errors of depth grow as near falls, so that the margin is not the ratio of both nears.
    return (
        f"Near is {best.settings.near:g} {units}, a margin for what was not looked at: displacement and "
        f"errors of depth are predicted to be {times} times smaller than what is allowed."
    )


def why_not(found: Outcome, views: Views, requirement: Requirement) -> str:
    """Say which requirement fails, and what can be had instead."""
    separation, units = requirement.separation_in(views.scene.frustum), views.scene.units
    if found.finest * SEPARATION_MARGIN > separation:
        return (
            f"No plan: sheets {separation:.3g} {units} apart are not ordered at the farthest visible "
            "surface, however it is cut, for want of digits; from "
            f"{SEPARATION_MARGIN * found.finest:.2g} {units} on they could be."
        )
    if not found.failed:
        if requirement.SEEN_BY_EYES:
            return "No plan: eyes see what the smallest near does to depth."
        return (
            f"No plan: displacement exceeds {requirement.tolerance_px:g} px at any near. {_at_plate(views)}"
        )
    nearest = min(found.failed, key=lambda attempt: attempt.excess)
    return (
        f"No plan with up to {MAX_CUTS} cuts: even {_spelled(nearest.settings, units)} "
        f"would {_shortfall(nearest, requirement, separation, units)}."
    )


def disproved(measured: Quality, requirement: Requirement) -> str:
    """Say which requirement a plan that was predicted to hold does not meet when it is measured."""
    parts = []
    if measured.displacement_p99_px > requirement.tolerance_px:
        moved = "lies in the plate itself, where displacement is undefined"
        if math.isfinite(measured.displacement_p99_px):
            moved = f"is displaced by {measured.displacement_p99_px:.2g} px "
            moved += "(the rounding of 32-bit positions is in it)"
        parts.append(f"one pixel in a hundred {moved}")
    if requirement.missed_by(replace(measured, displacement_p99_px=0.0, depth_wrong=0.0)):
        parts.append(f"{measured.surface_fraction:.2g} of all pixels show the wrong surface")
    if measured.depth_wrong > requirement.max_wrong:
        parts.append(f"{measured.depth_wrong:.2g} of all pixels are wrong by depth")
    if measured.misordered > MAX_MISORDERED_FRACTION:
        parts.append(f"{measured.misordered:.2g} of the sheets' pixels are out of order")
    return f"But measured it does not hold: {' and '.join(parts)}."


def _at_plate(views: Views) -> str:
    """Say what is so close to the plate that no near is small enough."""
    shares = []
    for view in views.views:
        seen = view.truth.height[view.truth.covered]
        shares.append(np.count_nonzero(seen == 0) / max(seen.size, 1))
    worst = int(np.argmax(shares))
    if shares[worst] > MAX_UNDEFINED:
        column, row = views.views[worst].aperture.index
        return (
            f"At {column},{row} a surface lies in the aperture itself and makes up "
            f"{100 * shares[worst]:.0f} % of what is seen: its displacement is undefined there, and no "
            "near is small enough. Move it before or behind the plate."
        )
    smallest = SMALLEST_PER_REACH * views.scene.frustum.longest_reach
    return f"What is seen lies closer to the plate than the smallest cut, {smallest:.2g} {views.scene.units}."


def _of_slabs(found: Outcome, views: Views, requirement: Requirement) -> str:
    assert found.best is not None
    count = len(found.best.settings.slabs)
    if not count:
        return "One pair of frusta is enough."
    nearest = min(found.failed, key=lambda attempt: attempt.excess)
    separation, units = requirement.separation_in(views.scene.frustum), views.scene.units
    fewer = ("Without cuts", "With one cut")[count - 1] if count <= 2 else f"With {count - 1} cuts"
    shortfall = _shortfall(nearest, requirement, separation, units)
    return f"{fewer}, even {_spelled(nearest.settings, units)} would {shortfall}."


def _of_near(settings: DoubleFrustum, views: Views, requirement: Requirement) -> str:
    """Say how large near may be, and why no larger."""
    up_to = f"Near may be up to {settings.near:g} {views.scene.units}"
    if settings.slabs and settings.near == settings.slabs[0]:
        lowest, highest = views.scene.height_ranges
        if np.any((highest >= -settings.near) & (lowest <= settings.near)):
            return f"{up_to}, the height of the first cut, which is the most that makes sense."
        return (
            f"{up_to}, the height of the first cut: the first slab is empty, and no near displaces anything."
        )
    larger = round_number(index_below(settings.near) + 1)
    if larger >= views.scene.frustum.longest_reach:
        return f"{up_to}, which is as large as the reach allows."
    more = requirement.limit_of_near(replace(settings, near=larger), views.scene.units)
    return f"{up_to}: with a larger one {more}."


def _of_depth(found: Outcome, settings: DoubleFrustum) -> str:
    if len(found.choices) == 1:
        return f"{settings.depth_label} as asked for."
    equal = len(found.holding)
    if equal == 1:
        return f"Of {len(found.choices)} depth buffers only {settings.depth_label} can do with this."
    return (
        f"Of {len(found.choices)} depth buffers {equal} can do with this: {settings.depth_label} is the "
        "cheapest, and of those as cheap the most robust."
    )


def _shortfall(attempt: Attempt, requirement: Requirement, separation: float, units: str) -> str:
    """Say what an attempt that does not hold would get wrong."""
    predicted, parts = attempt.predicted, []
    if predicted.displacement_p99_px > requirement.tolerance_px:
        parts.append(f"displace one pixel in a hundred by {predicted.displacement_p99_px:.2g} px")
    if requirement.missed_by(replace(predicted, displacement_p99_px=0.0, depth_wrong=0.0)):
        parts.append(f"show the wrong surface in {predicted.surface_fraction:.2g} of all pixels")
    if predicted.depth_wrong > requirement.max_wrong:
        parts.append(f"show up to {predicted.depth_wrong:.2g} of all pixels wrongly by depth")
    if predicted.separation * SEPARATION_MARGIN > separation:
        parts.append(
            f"order sheets {predicted.separation:.2g} {units} apart, "
            f"but not {separation / SEPARATION_MARGIN:.2g} {units} (asked for are {separation:.3g} {units}, "
            f"and predictions may be off by a factor of {SEPARATION_MARGIN:g})"
        )
    return " and ".join(parts)


def _spelled(settings: DoubleFrustum, units: str) -> str:
    heights = [f"{height:g}" for height in settings.slabs]
    listed = f"{', '.join(heights)} {units}"
    if len(heights) > MAX_SPELLED_HEIGHTS:
        listed = f"{heights[0]} {units} and {len(heights) - 1} times beyond"
    cuts = f", cut at {listed}," if heights else ""
    return f"{settings.depth_label} with near {settings.near:g} {units}{cuts}"
