"""Sentences of a plan: its reason, the answer that it gives, and the limits that bind near."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from xfrustum.compare.planning.plan import Cause, PlateResult
from xfrustum.compare.planning.requirement import (
    CRACK,
    SMALLEST_PER_REACH,
    STEREO,
    NearLimit,
    Quality,
    Requirement,
)
from xfrustum.compare.planning.search import (
    ENOUGH_MARGIN,
    MAX_CUTS,
    SEPARATION_MARGIN,
    BufferLimit,
)
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.scenes.representation import digits, percent
from xfrustum.tolerances import MAX_WRONG

if TYPE_CHECKING:
    from xfrustum.reports.planning import PlanReport

#: Names of the judges that may bind near.
PIXELS, EYE, DEPTH, NOTHING = "pixels", "eye", "depth buffer", "none"

#: Visible effects of near.
NOTICED = {STEREO: "change of depth", CRACK: "crack at the plate"}

#: Errors of a hogel, by the names of their fields.
MEASURES = {
    "displacement_p99_px": "displacement (99 %)",
    "surface_fraction": "wrong surfaces",
    "depth_wrong": "surfaces wrong by depth",
}

#: largest number of heights or apertures that a sentence lists
MAX_NAMED = 5

_NO_PLAN = {
    Cause.EYES: "No plan: eyes notice the smallest near.",
    Cause.IN_APERTURE: (
        "No plan: a surface lies in an aperture itself, and its displacement is undefined there. "
        "Move it "
        "before or behind the plate."
    ),
    Cause.EVERY_APERTURE: (
        "No plan: a surface lies in every aperture that sees anything, or so close to it that no "
        "near draws "
        "it. Move it before or behind the plate."
    ),
}


def reason(report: PlanReport) -> str:
    """Return the reason for a plan, or for the lack of one."""
    made, units = report.plan, report.scene.units
    if made.settings is None or made.outcome is None:
        return _reason_of_failure(report)
    parts = ["One pair of frusta is enough."]
    if made.cause is Cause.CUTS:
        # The plan has the fewest cuts: one cut fewer is the strongest choice that failed.
        cuts = len(made.slabs) - 1
        fewer = f"With {cuts} cut{'s' if cuts > 1 else ''}" if cuts else "Without cuts"
        parts = [f"{fewer}, even {_shortfall(report)}."]
    viewer, largest = made.requirement.viewer, made.outcome.largest_near or 0.0
    if viewer is not None and viewer.separation_limit is not None:
        cause, height = viewer.separation_limit
        side = "before" if height > 0 else "behind"
        parts.append(
            f"Depths {abs(height):.3g} {units} {side} the plate are distinguished from "
            f"{made.requirement.separation:.3g} {units} on ({cause})."
        )
    parts.append(f"Near may be up to {digits(largest)} {units}.")
    # Below the largest near every error has a margin; at it the binding one has none.
    if made.near != largest and made.outcome.best is not None:
        excess = made.outcome.best.excess
        if excess * 1.05 > 1:  # no margin worth a number
            margin = "keep to their limits"
        elif excess * ENOUGH_MARGIN > 1:
            margin = f"are {1 / excess:.2g} times smaller than their limits"
        else:
            margin = f"are at least {ENOUGH_MARGIN:g} times smaller than their limits"
        parts.append(
            f"Near is {digits(made.near or 0.0)} {units}, for a margin: predicted errors {margin}."
        )
    count, holding = len(made.requirement.buffers), made.outcome.holding
    if count > 1:
        parts.append(
            f"Of {count} depth buffers {holding} hold: {made.settings.depth_label} is the "
            "cheapest, and among the cheapest the most robust."
        )
    if made.measured is not None and not made.requirement.met_by(made.measured):
        parts.append(
            f"Measured it does not hold: it leaves {_amiss(made.measured, made.requirement)}."
        )
    return " ".join(parts)


def _reason_of_failure(report: PlanReport) -> str:
    cause, scene = report.plan.cause, report.scene
    if cause is Cause.TOO_MANY_CUTS:
        return f"No plan with up to {MAX_CUTS} cuts: even {_shortfall(report)}."
    if cause is Cause.SEPARATION:
        separation = report.plan.requirement.separation_in(scene.frustum)
        return (
            f"No plan: sheets {separation:.3g} {scene.units} apart are ordered by no depth buffer "
            "at the "
            "farthest visible surface, however the frusta are cut."
        )
    if cause is Cause.AT_PLATE:
        smallest = SMALLEST_PER_REACH * scene.frustum.longest_reach
        return (
            f"No plan: displacement exceeds {report.plan.requirement.tolerance_px:g} px at any "
            "near. Surfaces "
            f"lie closer to the plate than the smallest cut, {smallest:.2g} {scene.units}."
        )
    return _NO_PLAN[cause]


def _shortfall(report: PlanReport) -> str:
    """Return the failed settings that come nearest to holding, and their errors."""
    assert report.plan.outcome is not None and report.plan.outcome.failed is not None
    units, attempt = report.scene.units, report.plan.outcome.failed
    settings, requirement = attempt.settings, report.plan.requirement
    heights = [f"{height:g}" for height in settings.slabs]
    cuts = f", cut at {', '.join(heights)} {units}," if heights else ""
    if len(heights) > MAX_NAMED:
        cuts = f", cut at {heights[0]} {units} and {len(heights) - 1} times beyond,"
    separation = requirement.separation_in(report.scene.frustum)
    sheets = ""
    # The margin of the search applies here too, or the sentence would name a limit that holds.
    if attempt.predicted.separation * SEPARATION_MARGIN > separation:
        sheets = (
            f"sheets {separation:.3g} {units} apart out of order (ordered are "
            f"{SEPARATION_MARGIN * attempt.predicted.separation:.2g} {units}, with a margin of "
            f"{SEPARATION_MARGIN:g} for predictions)"
        )
    label = f"{settings.depth_label} with near {digits(settings.near)} {units}"
    return f"{label}{cuts} leaves {_amiss(attempt.predicted, requirement, sheets)}"


def _amiss(quality: Quality, requirement: Requirement, sheets: str = "") -> str:
    """Return the errors that exceed their limits."""
    parts, ratios = [], requirement.ratios(quality)
    if ratios["displacement_p99_px"] > 1:
        moved = f"displaced by {quality.displacement_p99_px:.2g} px"
        # Displacement is undefined in the plate: a figure would be wrong.
        if math.isinf(quality.displacement_p99_px):
            moved = "in the plate itself, where displacement is undefined"
        parts.append(f"one pixel in a hundred {moved}")
    if ratios["surface_fraction"] > 1:
        parts.append(f"{percent(quality.surface_fraction)} of all pixels with the wrong surface")
    if ratios["depth_wrong"] > 1:
        parts.append(f"{percent(quality.depth_wrong)} of all pixels wrong by depth")
    # Measured sheets are stated only if the prediction has not named them.
    if not sheets and quality.misordered > MAX_MISORDERED_FRACTION:
        sheets = f"{percent(quality.misordered)} of the sheets' pixels out of order"
    return " and ".join([*parts, sheets] if sheets else parts)


def sentence(report: PlanReport) -> str:
    """Return the answer: settings, whether they hold, the binding limit, and a coarser choice."""
    settings, units = report.plan.settings, report.scene.units
    if settings is None:
        return reason(report)
    cuts = "in one pair of frusta: splitting is not needed"
    if settings.slabs:
        heights = ", ".join(map(digits, settings.slabs))
        cuts = f"split at {heights} {units} from the plate: one pair of frusta is not enough"
    draw = (
        f"Draw {report.scene.name} with near {digits(settings.near)} {units} and "
        f"{settings.depth_label} depth, {cuts}."
    )
    return " ".join((draw, *_holds(report), *_what_binds(report), *_coarser(report)))


def _holds(report: PlanReport) -> list[str]:
    """Return where the plan was measured, and whether it holds there."""
    made, known = report.plan, report.plan.plate
    limits = limit_words(made.requirement)
    if known is None:
        count = len(report.apertures)
        where = f"the worst of {count} apertures" if count > 1 else "one aperture"
        return [f"It {'holds' if made.within else 'DOES NOT HOLD'}, measured at {where}."]
    parts = []
    if known.infeasible:
        parts.append(_infeasible(known))
    if not made.within and not known.infeasible:
        parts.append(f"This DOES NOT HOLD: {reason(report)}")
    counted = f"{known.beyond} of {known.sampled} random hogels are"
    # Every hogel was judged: the share is exact, and needs no bound.
    if known.confidence == 1:
        counted = f"of all {known.hogels:,} hogels {percent(known.share_beyond_at_most)} are"
    empty = f" ({known.empty} of them show nothing)" if known.empty else ""
    bound = ""
    if known.confidence < 1:
        share, certain = percent(known.share_beyond_at_most), percent(known.confidence)
        bound = f": at most {share} of all {known.hogels:,} ({certain} confidence)"
    parts.append(f"Drawn so, {counted} beyond {limits}{empty}{bound}.")
    if not made.requirement.pixels_count:
        parts.append("Eyes judge this plan, and not the pixels of hogels.")
    return parts


def _infeasible(known: PlateResult) -> str:
    named = [f"{i},{j}" for i, j in known.infeasible_apertures[:MAX_NAMED]]
    named += [".."] if known.infeasible > len(named) else []
    return (
        f"No settings hold for the whole plate: at {known.infeasible:,} of the {known.scouted:,} "
        "scanned "
        f"apertures ({'; '.join(named)}) a surface lies in the aperture itself, or so close to it "
        "that no "
        f"near draws it; for at least {math.floor(100 * known.share_within_at_least)} % of the "
        "plate this "
        "plan holds."
    )


def limit_words(requirement: Requirement) -> str:
    """Return the limits beyond which a hogel is beyond."""
    return f"{requirement.tolerance_px:g} px or {percent(MAX_WRONG)} wrong surfaces"


def buffer_words(limit: BufferLimit, units: str) -> str:
    """Return the smallest near of a depth buffer."""
    label = f"the depth buffer {str(limit.depth).upper()} {limit.mapping}"
    if limit.smallest_near is None:
        return f"{label} orders the visible surfaces at no near"
    if limit.any_near:
        return f"{label} orders the visible surfaces at any near"
    return f"{label} needs near from {digits(limit.smallest_near)} {units} on"


def eye_words(limit: NearLimit, units: str) -> str:
    """Return the largest unnoticed near of one visible effect."""
    near = f"near up to {digits(limit.largest_near or 0.0)} {units}"
    return f"{'any near' if limit.largest_near is None else near} ({NOTICED[limit.name]})"


def _what_binds(report: PlanReport) -> list[str]:
    """Return the near that each limit allows, beginning with the binding one."""
    made, units, parts = report.plan, report.scene.units, dict[str, str]()
    assert made.limits is not None
    if (pixels := made.limits.pixels) is not None:
        parts[PIXELS] = (
            f"pixels ({limit_words(made.requirement)}) allow near up to {digits(pixels)} {units}"
        )
        if np.isfinite(made.limits.hogels).any():
            # The median shows how much the worst hogel costs all others; NaN marks hogels without
            # content.
            ordinary = float(np.nanmedian(made.limits.hogels))
            parts[PIXELS] += f" at the worst hogel and up to {digits(ordinary)} at half of them"
        if not made.requirement.pixels_count:
            parts[PIXELS] += ", which counts only with --tolerance-px"
    if made.requirement.viewer is not None:
        distance, limit = made.requirement.viewer.viewer.distance, report.eye_limit
        allowed = "any near" if limit is None else eye_words(limit, units)
        parts[EYE] = f"eyes at {distance:g} {units} allow {allowed}"
    if report.buffer is not None:
        parts[DEPTH] = buffer_words(report.buffer, units)
    # The binding limit comes first; the others follow in fixed order.
    first, others = parts.pop(report.binds, None), "; ".join(parts.values())
    if first is not None and made.slabs:
        first = f"in one pair {first}"
    bound = [] if first is None else [f"What binds: {first}."]
    return [*bound, f"{others[0].upper()}{others[1:]}."] if others else bound


def _coarser(report: PlanReport) -> list[str]:
    """Return the cost of the cheapest depth buffer where the plan takes another one."""
    assert report.plan.limits is not None
    first, units = report.plan.limits.buffers[0], report.scene.units
    # The plan already takes the cheapest buffer.
    if first == report.buffer:
        return []
    if first.smallest_near is None or first.displacement_p99_px is None:
        return [f"With a coarser depth buffer {buffer_words(first, units)}."]
    return [
        f"A coarser choice costs error: {buffer_words(first, units)}, which displaces the worst "
        "hogel by "
        f"{digits(first.displacement_p99_px)} px."
    ]
