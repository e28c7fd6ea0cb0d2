"""Reasons of a plan in words: why it is the best there is, why there is none, and where it does not hold."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from xfrustum.compare.beyond import MAX_UNDEFINED
from xfrustum.compare.planning.search import (
    ENOUGH_MARGIN,
    MAX_CUTS,
    SEPARATION_MARGIN,
    SMALLEST_PER_REACH,
    Attempt,
    Outcome,
    index_below,
    round_number,
)
from xfrustum.compare.planning.views import Quality, Requirement, Views
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.representation import digits

if TYPE_CHECKING:
    from xfrustum.compare.planning.plan import PlateResult

Index = tuple[int, int]

MAX_SPELLED_HEIGHTS, MAX_NAMED_APERTURES = 4, 5
"""Largest numbers of heights and of apertures that a sentence lists."""


def why(
    found: Outcome, best: Attempt, largest: DoubleFrustum, views: Views, requirement: Requirement
) -> str:
    """Say why a plan is the best there is; `best` has its near moved to where the margin is largest."""
    units, label, parts = views.scene.units, best.settings.depth_label, []
    near = digits(best.settings.near)
    if cuts := len(best.settings.slabs):
        fewer = ("Without cuts", "With one cut")[cuts - 1] if cuts <= 2 else f"With {cuts - 1} cuts"
        parts.append(f"{fewer}, even {_shortfall(found, views, requirement)}.")
    else:
        parts.append("One pair of frusta is enough.")
    parts.append(requirement.separation_reason(units))
    limit = _limit(largest, views, requirement)
    parts.append(f"Near may be up to {digits(largest.near)} {units}{limit}.")
    if best.settings.near != largest.near:
        margin = 1 / best.excess if best.excess else math.inf
        times = f"{margin:.2g}" if margin < ENOUGH_MARGIN else f"at least {ENOUGH_MARGIN:g}"
        # The errors of depth grow as near falls, so that the margin is not the ratio of both nears.
        parts.append(
            f"Near is {near} {units}, a margin for what was not looked at: displacement and "
            f"errors of depth are predicted to be {times} times smaller than what is allowed."
        )
    choices, equal = len(found.choices), len(found.holding)
    if choices == 1:
        parts.append(f"{label} as asked for.")
    elif equal == 1:
        parts.append(f"Of {choices} depth buffers only {label} can do with this.")
    else:
        parts.append(
            f"Of {choices} depth buffers {equal} can do with this: {label} is the cheapest, and of those as "
            "cheap the most robust."
        )
    return " ".join(part for part in parts if part)


def _limit(settings: DoubleFrustum, views: Views, requirement: Requirement) -> str:
    scene = views.scene
    if settings.slabs and settings.near == settings.slabs[0]:
        lowest, highest = scene.height_ranges
        if np.any((highest >= -settings.near) & (lowest <= settings.near)):
            return ", the height of the first cut, which is the most that makes sense"
        return (
            ", the height of the first cut: the first slab is empty, and no near displaces anything"
        )
    larger = round_number(index_below(settings.near) + 1)
    if larger >= scene.frustum.longest_reach:
        return ", which is as large as the reach allows"
    return f": with a larger one {requirement.limit_of_near(replace(settings, near=larger), scene.units)}"


def why_not(found: Outcome, views: Views, requirement: Requirement) -> str:
    """Say why no settings hold."""
    separation, units = requirement.separation_in(views.scene.frustum), views.scene.units
    if found.finest * SEPARATION_MARGIN > separation:
        return (
            f"No plan: sheets {separation:.3g} {units} apart are not ordered at the farthest visible "
            "surface, however it is cut, for want of digits; from "
            f"{SEPARATION_MARGIN * found.finest:.2g} {units} on they could be."
        )
    if found.failed:
        return f"No plan with up to {MAX_CUTS} cuts: even {_shortfall(found, views, requirement)}."
    if requirement.SEEN_BY_EYES:
        return "No plan: eyes see what the smallest near does to depth."
    reason = f"No plan: displacement exceeds {requirement.tolerance_px:g} px at any near."
    seen = [(view.truth.height[view.truth.covered], view.aperture) for view in views.views]
    in_aperture = ((np.count_nonzero(height == 0) / max(height.size, 1), at) for height, at in seen)
    share, aperture = max(in_aperture, key=lambda one: one[0])
    if share > MAX_UNDEFINED:
        return (
            f"{reason} At {aperture.column},{aperture.row} a surface lies in the aperture itself and makes "
            f"up {100 * share:.0f} % of what is seen: its displacement is undefined there, and no near is "
            "small enough. Move it before or behind the plate."
        )
    smallest = SMALLEST_PER_REACH * views.scene.frustum.longest_reach
    return f"{reason} What is seen lies closer to the plate than the smallest cut, {smallest:.2g} {units}."


def _shortfall(outcome: Outcome, views: Views, requirement: Requirement) -> str:
    """Name the failed attempt that comes nearest to holding, and say what it would get wrong."""
    separation, units = requirement.separation_in(views.scene.frustum), views.scene.units
    nearest = min(outcome.failed, key=lambda attempt: attempt.excess)
    settings, predicted = nearest.settings, nearest.predicted
    heights = [f"{height:g}" for height in settings.slabs]
    listed = f"{', '.join(heights)} {units}"
    if len(heights) > MAX_SPELLED_HEIGHTS:
        listed = f"{heights[0]} {units} and {len(heights) - 1} times beyond"
    cuts = f", cut at {listed}," if heights else ""
    sheets = ""
    if predicted.separation * SEPARATION_MARGIN > separation:
        sheets = (
            f"sheets out of order that are {separation / SEPARATION_MARGIN:.2g} {units} apart (from "
            f"{predicted.separation:.2g} {units} on they are in order; asked for are {separation:.3g} "
            f"{units}, and predictions may be off by a factor of {SEPARATION_MARGIN:g})"
        )
    found = _amiss(predicted, requirement, sheets)
    return f"{settings.depth_label} with near {digits(settings.near)} {units}{cuts} would leave {found}"


def disproved(measured: Quality, requirement: Requirement) -> str:
    """Say which requirement a plan that was predicted to hold does not meet when it is measured."""
    sheets = ""
    if measured.misordered > MAX_MISORDERED_FRACTION:
        sheets = f"{measured.misordered:.2g} of the sheets' pixels out of order"
    return f"But measured it does not hold: it leaves {_amiss(measured, requirement, sheets)}."


def _amiss(found: Quality, requirement: Requirement, sheets: str) -> str:
    """Name what is not as required, with words on the order of sheets, empty where that is."""
    parts = []
    if math.isinf(found.displacement_p99_px) and not requirement.SEEN_BY_EYES:
        parts.append("one pixel in a hundred in the plate itself, where displacement is undefined")
    elif found.displacement_p99_px > requirement.tolerance_px:
        parts.append(f"one pixel in a hundred displaced by {found.displacement_p99_px:.2g} px")
    if requirement.by_pixels(replace(found, displacement_p99_px=0.0)) > 1:
        parts.append(f"{found.surface_fraction:.2g} of all pixels with the wrong surface")
    if found.depth_wrong > requirement.max_wrong:
        parts.append(f"{found.depth_wrong:.2g} of all pixels wrong by depth")
    return " and ".join([*parts, sheets] if sheets else parts)


def exceptions(plate: PlateResult) -> str:
    """Begin a reason: the apertures that a plan was not made for, and the share that is left."""
    if plate.covers_the_plate:
        return ""
    looked, parts = f"of the {plate.scouted:,} apertures that were looked through", []
    if plate.infeasible:
        named = _named(plate.infeasible_apertures, plate.infeasible)
        parts.append(
            f"at {plate.infeasible:,} {looked} ({named}) a surface lies in the aperture itself, or so close "
            "to it that no near draws it"
        )
    if plate.set_aside:
        counted = f"{plate.set_aside:,} {'others' if plate.infeasible else looked}"
        named = _named(plate.set_aside_apertures, plate.set_aside)
        verb = "is" if plate.set_aside == 1 else "are"
        parts.append(
            f"{counted} ({named}) {verb} set aside, since none hold for them together with the rest"
        )
    # Rounded down, for it is a lower bound.
    share = f"{math.floor(100 * plate.share_within_at_least)} %"
    certain = "" if plate.confidence == 1 else f" ({100 * plate.confidence:.0f} %)"
    return (
        f"No settings hold for the whole plate: {'; and '.join(parts)}. "
        f"For the others, at least {share} of the plate{certain}:"
    )


def _named(apertures: tuple[Index, ...], count: int) -> str:
    """Return the first of so many apertures, as options name them, and an ellipsis where there are more."""
    words = [f"{column},{row}" for column, row in apertures[:MAX_NAMED_APERTURES]]
    return "; ".join([*words, ".."] if count > len(words) else words)
