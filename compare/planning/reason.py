"""Reasons of a plan, or for having none, in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from xfrustum.compare.beyond import MAX_UNDEFINED
from xfrustum.compare.planning.search import (
    ENOUGH_MARGIN,
    MAX_CUTS,
    SEPARATION_MARGIN,
    SMALLEST_PER_REACH,
    Attempt,
    DepthBuffer,
    index_below,
    round_number,
)
from xfrustum.compare.planning.views import Quality, Requirement, Views
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.scenes.plate.double_frustum import DoubleFrustum

if TYPE_CHECKING:
    from xfrustum.compare.planning.plan import PlateResult

MAX_SPELLED_HEIGHTS, MAX_NAMED_APERTURES = 4, 5
"""Largest numbers of heights and of apertures that a sentence lists."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Result of a search.

    Attributes
    ----------
    finest
        The smallest separation that any of `choices` orders at the farthest surface, however it is cut.
    failed
        Attempts with one cut less, or with the most there may be; empty where nothing was tried.
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
    """Say why a plan is the best there is; `best` has its near moved to where the margin is largest."""
    buffer, units = (best.settings.depth, best.settings.mapping), views.scene.units
    largest = next(one for one in found.holding if (one.settings.depth, one.settings.mapping) == buffer)
    parts = [
        _of_slabs(found, views, requirement),
        requirement.separation_reason(units),
        _of_near(largest.settings, views, requirement),
        _of_margin(largest, best, units),
        _of_depth(found, best.settings),
    ]
    return " ".join(part for part in parts if part)


def why_not(found: Outcome, views: Views, requirement: Requirement) -> str:
    """Say which requirement fails, and what can be had instead."""
    separation, units = requirement.separation_in(views.scene.frustum), views.scene.units
    if found.finest * SEPARATION_MARGIN > separation:
        return (
            f"No plan: sheets {separation:.3g} {units} apart are not ordered at the farthest visible "
            "surface, however it is cut, for want of digits; from "
            f"{SEPARATION_MARGIN * found.finest:.2g} {units} on they could be."
        )
    if not found.failed and requirement.SEEN_BY_EYES:
        return "No plan: eyes see what the smallest near does to depth."
    if not found.failed:
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
    if _wrong_surfaces(measured, requirement):
        parts.append(f"{measured.surface_fraction:.2g} of all pixels show the wrong surface")
    if measured.depth_wrong > requirement.max_wrong:
        parts.append(f"{measured.depth_wrong:.2g} of all pixels are wrong by depth")
    if measured.misordered > MAX_MISORDERED_FRACTION:
        parts.append(f"{measured.misordered:.2g} of the sheets' pixels are out of order")
    return f"But measured it does not hold: {' and '.join(parts)}."


def exceptions(plate: PlateResult) -> str:
    """Begin a reason: the apertures that a plan was not made for, and the share that is left."""
    if plate.covers_the_plate:
        return ""
    looked = f"of the {plate.scouted:,} apertures that were looked through"
    parts = []
    if plate.hopeless:
        named = _named(plate.hopeless_apertures, plate.hopeless)
        parts.append(
            f"at {plate.hopeless:,} {looked} ({named}) a surface lies in the aperture itself, or so close "
            "to it that no near draws it"
        )
    if plate.set_aside:
        counted = f"{plate.set_aside:,} others" if plate.hopeless else f"{plate.set_aside:,} {looked}"
        verb, named = (
            "is" if plate.set_aside == 1 else "are",
            _named(plate.set_aside_apertures, plate.set_aside),
        )
        parts.append(f"{counted} ({named}) {verb} set aside, since none hold for them together with the rest")
    # Rounded down, for it is a lower bound.
    share = f"{math.floor(100 * plate.share_within_at_least)} %"
    certain = "" if plate.confidence == 1 else f" ({100 * plate.confidence:.0f} %)"
    return (
        f"No settings hold for the whole plate: {'; and '.join(parts)}. "
        f"For the others, at least {share} of the plate{certain}:"
    )


def _named(apertures: tuple[tuple[int, int], ...], count: int) -> str:
    """Return the first of so many apertures, as options name them, and an ellipsis where there are more."""
    words = [f"{column},{row}" for column, row in apertures[:MAX_NAMED_APERTURES]]
    return "; ".join([*words, ".."] if count > len(words) else words)


def _wrong_surfaces(found: Quality, requirement: Requirement) -> bool:
    """Return whether more surfaces are wrong than a requirement allows."""
    return requirement.missed_by(replace(found, displacement_p99_px=0.0, depth_wrong=0.0))


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
    count, units = len(found.best.settings.slabs), views.scene.units
    if not count:
        return "One pair of frusta is enough."
    nearest = min(found.failed, key=lambda attempt: attempt.excess)
    fewer = ("Without cuts", "With one cut")[count - 1] if count <= 2 else f"With {count - 1} cuts"
    shortfall = _shortfall(nearest, requirement, requirement.separation_in(views.scene.frustum), units)
    return f"{fewer}, even {_spelled(nearest.settings, units)} would {shortfall}."


def _of_near(settings: DoubleFrustum, views: Views, requirement: Requirement) -> str:
    """Say how large near may be, and why no larger."""
    units = views.scene.units
    up_to = f"Near may be up to {settings.near:g} {units}"
    if settings.slabs and settings.near == settings.slabs[0]:
        lowest, highest = views.scene.height_ranges
        up_to += ", the height of the first cut"
        if np.any((highest >= -settings.near) & (lowest <= settings.near)):
            return f"{up_to}, which is the most that makes sense."
        return f"{up_to}: the first slab is empty, and no near displaces anything."
    larger = round_number(index_below(settings.near) + 1)
    if larger >= views.scene.frustum.longest_reach:
        return f"{up_to}, which is as large as the reach allows."
    return f"{up_to}: with a larger one {requirement.limit_of_near(replace(settings, near=larger), units)}."


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


def _of_depth(found: Outcome, settings: DoubleFrustum) -> str:
    label, equal = settings.depth_label, len(found.holding)
    if len(found.choices) == 1:
        return f"{label} as asked for."
    if equal == 1:
        return f"Of {len(found.choices)} depth buffers only {label} can do with this."
    return (
        f"Of {len(found.choices)} depth buffers {equal} can do with this: {label} is the "
        "cheapest, and of those as cheap the most robust."
    )


def _shortfall(attempt: Attempt, requirement: Requirement, separation: float, units: str) -> str:
    """Say what an attempt that does not hold would get wrong."""
    predicted, parts = attempt.predicted, []
    if predicted.displacement_p99_px > requirement.tolerance_px:
        parts.append(f"displace one pixel in a hundred by {predicted.displacement_p99_px:.2g} px")
    if _wrong_surfaces(predicted, requirement):
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
