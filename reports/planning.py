"""`xfrustum plan`: which settings to draw with, what they keep, and the command that draws so."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import replace

import scipy

from xfrustum.compare.extent import require_seen
from xfrustum.compare.eye.noticeable import Viewer
from xfrustum.compare.planning.plan import Plan, PlatePlanner, depth_buffers
from xfrustum.compare.planning.plan import plan as plan_apertures
from xfrustum.compare.planning.search import DepthBuffer
from xfrustum.compare.planning.viewer import EyeRequirement, eye_requirement
from xfrustum.compare.planning.views import Requirement
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.compare.sampling import RandomSample
from xfrustum.compare.scout import AutoApertures, Scout, scout
from xfrustum.reference import Reference
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.provenance import plate_command, raster_command
from xfrustum.scenes.arguments import one_of
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook import percent
from xfrustum.scenes.plate.plate import Aperture, Plate
from xfrustum.tolerances import MAX_WRONG

LINE_CHARACTERS = 100
"""Largest number of characters in a line of a reason."""


def make_plan(
    scene: Scene,
    apertures: Sequence[Aperture] | AutoApertures | None = None,
    requirement: Requirement | None = None,
    choices: Sequence[DepthBuffer] | None = None,
    *,
    sample: RandomSample | None = None,
    progress: bool = False,
) -> Plan:
    """Plan how to draw some apertures of a scene, and measure the plan.

    Parameters
    ----------
    apertures
        The ones that the plan is to hold for; None for the whole plate (`PlatePlanner`).
    requirement
        None for the usual.
    choices
        Depth buffers to choose from, None for all.

    Raises
    ------
    InputError
        None of the apertures sees anything of the objects, or there is no usable OpenGL.
    """
    one_of(scene, Scene, "scene")
    requirement = Requirement() if requirement is None else requirement
    one_of(requirement, Requirement, "requirement")
    if apertures is None:
        return _planned(_scouted(scene, progress), requirement, choices, sample, progress)
    auto = apertures if isinstance(apertures, AutoApertures) else None
    chosen = list(apertures.apertures if isinstance(apertures, AutoApertures) else apertures)
    require_seen(scene, chosen)
    with progress_bar(2 * len(chosen), "plan", "hogel", shown=progress) as bar:
        return replace(plan_apertures(scene, chosen, requirement, choices, bar.update), auto=auto)


plan = make_plan
"""The name of `make_plan` in the public API, beside the other commands."""


def make_viewer_plan(
    scene: Scene,
    viewer: Viewer,
    requirement: Requirement,
    choices: Sequence[DepthBuffer] | None = None,
    *,
    sample: RandomSample | None = None,
    progress: bool = False,
) -> tuple[Plan, EyeRequirement]:
    """Plan how to draw a plate so that a viewer notices nothing, and measure the plan; see `make_plan`.

    The separation of `requirement`, where it has one, and its share of pixels wrong by depth are kept. The
    requirement that the plan was made for is returned besides.
    """
    scouted = _scouted(scene, progress)
    seen = eye_requirement(scouted, viewer, requirement.separation, requirement.max_wrong)
    return _planned(scouted, seen, choices, sample, progress), seen


def _scouted(scene: Scene, progress: bool) -> Scout:
    with progress_bar(None, "scout", "hogel", shown=progress) as bar:
        scouted = scout(scene, bar.update)
    if not any(math.isfinite(look.nearest) for look in scouted.looks):
        require_seen(scene, scouted.apertures)
    return scouted


def _planned(
    scouted: Scout,
    requirement: Requirement,
    choices: Sequence[DepthBuffer] | None,
    sample: RandomSample | None,
    progress: bool,
) -> Plan:
    with progress_bar(None, "plan", "hogel", shown=progress) as bar:
        planner = PlatePlanner(
            reference=Reference(scouted.scene),
            scouted=scouted,
            requirement=requirement,
            choices=choices or depth_buffers(),
            done=bar.update,
        )
        return planner.plan(sample or RandomSample())


def spread_apertures(plate: Plate, count: int) -> list[Aperture]:
    """Return some apertures of a plate: the middle, the corners, then a low-discrepancy pattern between them.

    Fewer where the plate has fewer. The first of a larger number are those of a smaller.
    """
    columns, rows = plate.hogels
    count = min(count, columns * rows)
    corners = [(0, 0), (columns - 1, rows - 1), (columns - 1, 0), (0, rows - 1)]
    chosen = dict.fromkeys([plate.middle.index, *corners])
    pattern = scipy.stats.qmc.Halton(2, scramble=False)
    while len(chosen) < count:
        points = scipy.stats.qmc.scale(pattern.random(count), [0, 0], [columns, rows]).astype(int)
        chosen |= dict.fromkeys(map(tuple, points.tolist()))
    return [plate.aperture(*index) for index in list(chosen)[:count]]


def table(
    made: Plan,
    scene: Scene,
    apertures: Sequence[Aperture],
    requirement: Requirement,
    exceeded: Sequence[str] | None = None,
) -> str:
    """Return a plan as aligned lines that end in the command that draws so.

    `exceeded` is what a replay to a viewer's eyes shows beyond what is required; None where nothing was
    replayed.
    """
    lines = [_filled(made.reason)]
    settings = made.settings
    if settings is None or made.predicted is None or made.measured is None:
        if (known := made.plate) is not None:
            none = f"{known.scouted} of the plate's {known.hogels:,} hogels were looked through"
            if known.hopeless:
                none += f"; at {known.hopeless} of them a surface lies in the aperture or too close to it"
            lines.append(_filled(f"{none}."))
        return "\n".join(lines)
    cuts = ", ".join(f"{height:g}" for height in made.slabs)
    cuts = f"{cuts} {scene.units}" if cuts else "none"
    lines += [f"near {made.near:g} {scene.units}, cuts {cuts}, {settings.depth_label}", ""]
    separation = requirement.separation_in(scene.frustum)
    apart = f"sheets {separation:.3g} {scene.units} apart misordered"
    rows = [
        ("displacement, 99 %", "px", requirement.tolerance_px, "displacement_p99_px"),
        ("wrong surface", "of the pixels", MAX_WRONG, "surface_fraction"),
        ("wrong by depth", "of the pixels", requirement.max_wrong, "depth_wrong"),
        (apart, "of the pixels", MAX_MISORDERED_FRACTION, "misordered"),
        ("sheets are ordered from", scene.units, separation, "separation"),
    ]
    width = max(len(title) for title, *_ in rows)
    lines.append(f"{'':<{width}}  {'at most':>9}  {'predicted':>9}  {'measured':>9}")
    for title, unit, limit, key in rows:
        predicted, measured = getattr(made.predicted, key), getattr(made.measured, key)
        allowed = "any" if math.isinf(limit) else f"{limit:.3g}"
        lines.append(f"{title:<{width}}  {allowed:>9}  {predicted:>9.3g}  {measured:>9.3g}  {unit}")
    draw = (
        raster_command(scene, apertures[0], settings)
        if made.plate is None
        else plate_command(scene, settings)
    )
    return "\n".join([*lines, _answer(made, apertures, requirement, exceeded), "", draw])


def _answer(
    made: Plan, apertures: Sequence[Aperture], requirement: Requirement, exceeded: Sequence[str] | None
) -> str:
    """Say whether a plan holds, and where that is known."""
    known = made.plate
    replayed = "replayed to two eyes and " if exceeded is not None else ""
    answer = f"The plan {'holds' if made.within else 'DOES NOT HOLD'}, {replayed}measured at "
    if known is None:
        count = "one aperture" if len(apertures) == 1 else f"the worst of {len(apertures)} apertures"
        return f"{answer}{count}."
    worst, share = known.worst, known.share_beyond_at_most
    assert worst is not None and made.measured is not None
    if exceeded:
        answer = "The plan DOES NOT HOLD for two eyes that it was replayed to. Its hogels were measured at "
    elif not made.within and requirement.met_by(made.measured) and not requirement.missed_by(worst):
        # What the reason began with is all that is amiss.
        answer = "Without these apertures the plan holds, measured at "
    moved = (
        f"by {worst.displacement_p99_px:.3g} px" if math.isfinite(worst.displacement_p99_px) else "undefined"
    )
    sentences = [
        f"{answer}{known.measured} of {known.hogels:,} hogels, {known.scouted} looked through; worst: "
        f"{worst.aperture.column},{worst.aperture.row}, displaced {moved}, "
        f"{percent(worst.surface_fraction)} wrong surface."
    ]
    pixels = "" if math.isinf(requirement.tolerance_px) else f"{requirement.tolerance_px:g} px or "
    limits = f"{pixels}{percent(MAX_WRONG)} wrong surfaces"
    if known.confidence == 1:
        sentences.append(f"{percent(share)} of all hogels are beyond {limits}.")
    else:
        sentences.append(
            f"{known.beyond} of {known.sampled} drawn at random are beyond {limits}: at most "
            f"{percent(share)} of all ({percent(known.confidence)})."
        )
    return _filled(" ".join(sentences))


def _filled(text: str) -> str:
    """Return text in lines of `LINE_CHARACTERS`, none of which begins with a percent sign."""
    kept = text.replace(" %", "\N{NO-BREAK SPACE}%")
    return textwrap.fill(kept, LINE_CHARACTERS).replace("\N{NO-BREAK SPACE}", " ")
