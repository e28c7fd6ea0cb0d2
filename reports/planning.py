"""`xfrustum plan`: which settings to draw with, what they keep, what a viewer notices, and the command."""

import math
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import scipy

from xfrustum.compare.extent import require_seen
from xfrustum.compare.eye import loss
from xfrustum.compare.eye.noticeable import (
    MILLIMETERS,
    Display,
    Viewer,
    blur_arcmin,
    eyes_apart,
    replay_noise_arcsec,
)
from xfrustum.compare.planning.plan import Alternative, Plan, PlatePlanner, depth_buffers
from xfrustum.compare.planning.plan import plan as plan_apertures
from xfrustum.compare.planning.search import DepthBuffer
from xfrustum.compare.planning.viewer import (
    CRACK,
    STEREO,
    NearLimit,
    ViewerRequirement,
    ViewZone,
    binding,
    eye_requirement,
    view_zone,
)
from xfrustum.compare.planning.views import Requirement
from xfrustum.compare.prediction.chain import with_exact_depth
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.compare.sampling import CONFIDENCE, RandomSample, share_at_most
from xfrustum.compare.scout import AutoApertures, PlateScan, scout
from xfrustum.reference import Reference
from xfrustum.reference.eye.view import EyeReference, replay
from xfrustum.reports.common.outputs import progress_bar
from xfrustum.reports.common.provenance import plate_command, raster_command
from xfrustum.reports.common.templates_environment import plain_text
from xfrustum.reports.view import Drawing
from xfrustum.scenes import Aperture, DoubleFrustum, Plate, Scene
from xfrustum.scenes.arguments import one_of
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.eye import Eye
from xfrustum.scenes.representation import digits, percent
from xfrustum.tolerances import MAX_WRONG

LINE_CHARACTERS = 100  #: largest number of characters in a line of a reason
MEASURE_WORDS = {
    "displacement_p99_px": "displacement (99 %)",
    "surface_fraction": "wrong surfaces",
    "depth_wrong": "surfaces wrong by depth",
}
"""Errors of a hogel in words, by the names of their fields."""

FILM_COLUMNS = (
    64  #: columns of the films of both eyes: of no more hogels than pixels a part is drawn
)


def make_plan(
    scene: Scene,
    apertures: Sequence[Aperture] | AutoApertures | None = None,
    requirement: Requirement | None = None,
    choices: Sequence[DepthBuffer] | None = None,
    *,
    sample: RandomSample | None = None,
    progress: bool = False,
) -> Plan:
    """Plan how to draw some apertures of a scene, by default the whole plate, and measure the plan.

    `choices` are the depth buffers to choose from, None for all. InputError where none of the
    apertures sees anything of the objects, or there is no usable OpenGL.
    """
    one_of(scene, Scene, "scene")
    requirement = Requirement() if requirement is None else requirement
    one_of(requirement, Requirement, "requirement")
    if apertures is None:
        return planned(scouted_plate(scene, progress), requirement, choices, sample, progress)
    auto = apertures if isinstance(apertures, AutoApertures) else None
    chosen = list(apertures.apertures if isinstance(apertures, AutoApertures) else apertures)
    require_seen(scene, chosen)
    with progress_bar(2 * len(chosen), "plan", "hogel", shown=progress) as bar:
        return replace(plan_apertures(scene, chosen, requirement, choices, bar.update), auto=auto)


plan = make_plan  #: the name of `make_plan` in the public API, beside the other commands


def scouted_plate(scene: Scene, progress: bool) -> PlateScan:
    """Look through apertures all over a plate; InputError where none sees anything."""
    with progress_bar(None, "scout", "hogel", shown=progress) as bar:
        scouted = scout(scene, bar.update)
    if not any(math.isfinite(look.nearest) for look in scouted.looks):
        require_seen(scene, scouted.apertures)
    return scouted


def planned(
    scouted: PlateScan,
    requirement: Requirement,
    choices: Sequence[DepthBuffer] | None,
    sample: RandomSample | None,
    progress: bool,
) -> Plan:
    """Plan how to draw a plate that was looked at, and measure the plan."""
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
    """Return some apertures: the middle, the corners, then a Halton sequence, which more only continue."""
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

    `exceeded` is what a replay to a viewer's eyes shows beyond what is required; None where nothing
    was replayed.
    """
    lines, settings = [filled(made.reason)], made.settings
    if settings is None or made.predicted is None or made.measured is None:
        if (known := made.plate) is not None:
            none = f"{known.scouted} of the plate's {known.hogels:,} hogels were looked through"
            if known.infeasible:
                none += f"; at {known.infeasible} of them a surface lies in the aperture or too close to it"
            lines.append(filled(f"{none}."))
        return "\n".join(lines)
    cuts = ", ".join(f"{height:g}" for height in made.slabs)
    cuts = f"{cuts} {scene.units}" if cuts else "none"
    lines += [f"near {made.near:g} {scene.units}, cuts {cuts}, {settings.depth_label}", ""]
    separation = requirement.separation_in(scene.frustum)
    apart = f"sheets {separation:.3g} {scene.units} apart misordered"
    rows = [
        ("displacement, 99 %", "px", requirement.tolerance_px, "displacement_p99_px"),
        (
            "wrong surface",
            "of the pixels",
            math.inf if requirement.SEEN_BY_EYES else MAX_WRONG,
            "surface_fraction",
        ),
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
    lines.append(f"rounding by the model of {made.device_model}")
    draw = (
        plate_command(scene, settings)
        if made.plate
        else raster_command(scene, apertures[0], settings)
    )
    return "\n".join([*lines, _answer(made, scene, apertures, requirement, exceeded), "", draw])


def _answer(
    made: Plan,
    scene: Scene,
    apertures: Sequence[Aperture],
    requirement: Requirement,
    exceeded: Sequence[str] | None,
) -> str:
    """Say whether a plan holds, and where that is known."""
    known = made.plate
    replayed = "replayed to two eyes and " if exceeded is not None else ""
    answer = f"The plan {'holds' if made.within else 'DOES NOT HOLD'}, {replayed}measured at "
    if known is None:
        count = (
            "one aperture" if len(apertures) == 1 else f"the worst of {len(apertures)} apertures"
        )
        about = f"{requirement.beyond_px:g} px or {percent(MAX_WRONG)} wrong surfaces"
        return filled(" ".join([f"{answer}{count}.", *beside_words(made, scene.units, about)]))
    worst, share = known.worst, known.share_beyond_at_most
    assert worst is not None and made.measured is not None
    if exceeded:
        answer = "The plan DOES NOT HOLD for two eyes that it was replayed to. Its hogels were measured at "
    elif not made.within and requirement.met_by(made.measured) and not requirement.missed_by(worst):
        # What the reason began with is all that is amiss.
        answer = "Without these apertures the plan holds, measured at "
    p99 = worst.displacement_p99_px
    moved = f"by {p99:.3g} px" if math.isfinite(p99) else "undefined"
    sentences = [
        f"{answer}{known.measured} of {known.hogels:,} hogels, {known.scouted} looked through; worst by "
        f"{MEASURE_WORDS[known.worst_by or 'surface_fraction']}: {worst.aperture.column},"
        f"{worst.aperture.row}, displaced {moved}, {percent(worst.surface_fraction)} wrong surface."
    ]
    limits = f"{requirement.beyond_px:g} px or {percent(MAX_WRONG)} wrong surfaces"
    empty = f", {known.empty} of which show nothing," if known.empty else ""
    if known.confidence == 1:
        sentences.append(f"{percent(share)} of all hogels are beyond {limits}.")
    else:
        sentences.append(
            f"{known.beyond} of {known.sampled} drawn at random{empty} are beyond {limits}: at most "
            f"{percent(share)} of all ({percent(known.confidence)})."
        )
    if requirement.SEEN_BY_EYES:
        sentences.append("Eyes judge this plan, and not the pixels of hogels.")
    return filled(" ".join([*sentences, *beside_words(made, scene.units, limits)]))


def beside_words(made: Plan, units: str, limits: str) -> list[str]:
    """Say how many of the measured hogels are beyond with the largest near, and without cuts."""
    said = []
    if (one := made.largest) is not None and one.judged:
        said.append(
            f"Drawn with near {digits(one.near)} {units}, the largest, {_count(one)} beyond {limits}"
            + ("." if not one.beyond else ": keep to a smaller one.")
        )
    if (one := made.without_cuts) is not None and one.judged:
        said.append(
            "Hypothetical sheets alone ask for cuts: without any, with near "
            f"{digits(one.near)} {units} and {one.settings.depth_label}, {_count(one)} beyond {limits}."
        )
    return said


def _count(found: Alternative) -> str:
    """Return how many of the hogels that were drawn are, with the verb."""
    count = f"{found.beyond} of" if found.beyond else "none of"
    if found.judged == 1:
        return (
            "the one hogel that was measured is"
            if found.beyond
            else "the one hogel that was measured is not"
        )
    return f"{count} the {found.judged} hogels that were measured {'is' if found.beyond < 2 else 'are'}"


def filled(text: str) -> str:
    """Return text in lines of `LINE_CHARACTERS`, none of which begins with a percent sign."""
    kept = text.replace(" %", "\N{NO-BREAK SPACE}%")
    return textwrap.fill(kept, LINE_CHARACTERS, break_on_hyphens=False).replace(
        "\N{NO-BREAK SPACE}", " "
    )


@dataclass(frozen=True, kw_only=True)
class Replayed:
    """What two eyes are shown of drawn hogels, measured."""

    hogels: int  #: Number of hogels of which pixels were drawn
    matched: int  #: Number of surface points that both eyes are shown
    #: Largest difference of the changes of disparity of two points, or of one and the plate's
    #: border, from the 1st to the 99th percentile; None where both eyes are shown no point
    disparity_change_arcsec: float | None
    depth: (
        loss.DepthShift | None
    )  #: By how much farther away than they are points are seen, scene units
    #: Share of both eyes' judged pixels with a wrong surface, and share of those right with exact
    #: depth
    wrong: float
    depth_wrong: float
    judged: int  #: Number of both eyes' judged pixels


def two_eyes(scene: Scene, viewer: Viewer, columns: int = FILM_COLUMNS) -> tuple[Eye, ...]:
    """Return a viewer's left and right eye, their films with so many columns over the plate."""
    width, height = scene.plate.size
    film = (columns, max(1, round(columns * height / width)))
    half = eyes_apart(viewer, Display.from_scene(scene)) / 2
    return tuple(Eye(position=(x, 0.0, viewer.distance), resolution=film) for x in (-half, half))


def seen_view_zone(scene: Scene, viewer: Viewer) -> ViewZone:
    """Return the view zone at a viewer's distance; InputError where one of his eyes sees no hogel."""
    zone, eyes = view_zone(scene, viewer.distance), two_eyes(scene, viewer)
    shown = [replay(scene, eye).shown for eye in eyes]
    if all(one.columns.size and one.rows.size for one in shown):
        return zone
    units, (x, y) = scene.units, zone.some
    widest = zone.some_eyes_apart * (Display.from_scene(scene).millimeters or 1.0)
    advice = (
        f"eyes may be up to {widest:.3g} mm apart, and these are {viewer.eyes_apart_mm:g} (--ipd)"
    )
    if not widest:
        advice = "no eyes straight before the plate's middle lie in it"
    raise InputError(
        f"{scene.name}: no ray of an eye meets the film of a hogel. The view zone is {x[1] - x[0]:.3g} x "
        f"{y[1] - y[0]:.3g} {units} at {zone.distance:g} {units} (x from {x[0]:.3g} to {x[1]:.3g}, y from "
        f"{y[0]:.3g} to {y[1]:.3g}): {advice}; or choose another --viewer, or a larger film"
    )


class ReplayWorkbench:
    """Two eyes straight before a scene's plate, what they truly see, and what they are shown."""

    def __init__(self, scene: Scene, viewer: Viewer, columns: int = FILM_COLUMNS) -> None:
        self._scene = scene
        self._reference = EyeReference(scene)
        self._views = [
            loss.Views(
                true=self._reference.true_view(eye, shaded=False),
                replayed=self._reference.replayed(eye, shaded=False),
                drawn=None,
                taken=self._reference.replay(eye),
            )
            for eye in two_eyes(scene, viewer, columns)
        ]
        self._control: tuple[DoubleFrustum, list[Mask]] | None = None

    @property
    def eye_pixel(self) -> float:
        """Width that a pixel of the eyes' films has on the plate, scene units."""
        return self._scene.plate.size[0] / self._views[0].eye.resolution[0]

    @property
    def hogels(self) -> int:
        """Number of hogels that the eyes are shown."""
        return len(loss.hogels_of(view.taken for view in self._views))

    def measure(
        self, settings: DoubleFrustum, done: Callable[[int], object] = lambda hogels: None
    ) -> Replayed:
        """Draw what the eyes are shown, and with exact depth, which settings may share; judge both."""
        exact = with_exact_depth(settings)
        if self._control is None or self._control[0] != exact:
            self._control = exact, self._wrong(self._drawn(exact, done))
        views = self._drawn(settings, done)
        wrong = self._wrong(views)
        judged = sum(one.size for one in wrong)
        by_depth = sum(int((a & ~b).sum()) for a, b in zip(wrong, self._control[1], strict=True))
        pair = loss.disparity(self._reference, *views)
        change = pair.change_arcsec
        return Replayed(
            hogels=self.hogels,
            matched=pair.matched,
            disparity_change_arcsec=None
            if change is None
            else max(change.p99, 0.0) - min(change.p1, 0.0),
            depth=pair.depth,
            wrong=sum(int(one.sum()) for one in wrong) / judged,
            depth_wrong=by_depth / judged,
            judged=judged,
        )

    def _drawn(self, settings: DoubleFrustum, done: Callable[[int], object]) -> list[loss.Views]:
        collectors = [
            loss.Collector(self._scene, view.eye, view.taken, settings) for view in self._views
        ]
        hogels = Drawing(self._scene, settings).hogels(
            loss.film_parts(view.taken for view in self._views)
        )
        images = loss.collected(hogels, collectors)
        done(self.hogels)
        return [replace(view, drawn=image) for view, image in zip(self._views, images, strict=True)]

    def _wrong(self, views: Sequence[loss.Views]) -> list[Mask]:
        """Return the judged pixels that show a wrong surface, for each eye."""
        found = []
        for view in views:
            maps = loss.renderer_loss(self._reference, view, numbered=True)
            assert maps.wrong is not None
            found.append(maps.wrong[maps.judged])
        return found


@dataclass(frozen=True, kw_only=True)
class PlannedRecord:
    """What `plan --viewer` adds: the key `viewer` of the JSON object."""

    viewer: Viewer
    #: Blurs of the display: of pitch, and of pixels and diffraction at the farthest surface
    pitch_arcmin: float
    pixel_arcmin: float
    diffraction_arcmin: float
    rays_per_pupil: float | None  #: Pixels of a hogel that a pupil catches along an axis
    #: What the viewer may notice of a near without cuts, and how large near may be for each
    limits: tuple[NearLimit, ...]
    binding: (
        str | None
    )  #: Name of the limit that leaves the smallest near; None where no near is noticed
    #: Predicted of the plan: change of disparity, and width of the crack in a surface that runs
    #: through the plate; None without a plan, and without such a surface
    stereo_change_arcsec: float | None
    crack_arcmin: float | None
    separation: float | None  #: Distance of sheets that must be ordered, scene units
    separation_limited_by: str | None  #: What decides it; None where it was asked for
    measured: Replayed | None  #: What a replay of the plan shows to two eyes; None without a plan
    #: The same with the plan's cuts; None without a plan, and where it has no cuts
    limits_with_cuts: tuple[NearLimit, ...] | None = None
    noise_arcsec: float | None = (
        None  #: of the replay's change (`replay_noise_arcsec`); None without a plan
    )
    exceeded: tuple[str, ...] = ()  #: what the replay shows beyond what is required, in words
    view_zone: ViewZone | None = None  #: at the viewer's distance


def exceeded(
    found: Replayed, requirement: ViewerRequirement, noise_arcsec: float
) -> tuple[str, ...]:
    """Return what a replay shows beyond what a viewer requires, in words.

    A change of disparity counts where it is beyond stereo acuity by more than the replay's own
    noise. A plan keeps that noise as a margin, so that a replay that is off by it shows no more
    than acuity.
    """
    parts = []
    change, acuity = found.disparity_change_arcsec, requirement.viewer.stereo_acuity_arcsec
    if change is not None and change > acuity + noise_arcsec:
        parts.append(
            f"two eyes see depths off by {digits(change)} arc seconds of disparity, more than "
            f"{digits(acuity)} and the replay's noise of {digits(noise_arcsec)}"
        )
    if found.depth_wrong > requirement.max_wrong:
        parts.append(
            f"{percent(found.depth_wrong)} of {found.judged:,} pixels are wrong by depth, more than "
            f"{percent(requirement.max_wrong)}"
        )
    return tuple(parts)


def replayed_plan(made: Plan, record: PlannedRecord) -> Plan:
    """Return a plan that holds only where its replay does too."""
    reason = f"{made.reason} But replayed it does not hold: {' and '.join(record.exceeded)}."
    return replace(made, within=False, reason=reason) if record.exceeded else made


@dataclass(frozen=True, kw_only=True)
class ViewerPlan:
    """A plan for a viewer, what it was made for, and what a replay of it shows."""

    plan: Plan
    requirement: ViewerRequirement
    record: PlannedRecord

    def summary(self) -> dict[str, Any]:
        """Return the plan as `plan --viewer --json` prints it."""
        return {**self.plan.summary(), "viewer": self.record}


def make_viewer_plan(
    scouted: PlateScan,
    viewer: Viewer,
    requirement: Requirement,
    choices: Sequence[DepthBuffer] | None = None,
    *,
    sample: RandomSample | None = None,
    progress: bool = False,
) -> ViewerPlan:
    """Plan how to draw a plate so that a viewer notices nothing, measure the plan, and replay it to his eyes.

    The separation of `requirement`, where it has one, and its share of pixels wrong by depth are
    kept.
    """
    eye_pixel = scouted.scene.plate.size[0] / FILM_COLUMNS
    seen = eye_requirement(
        scouted, viewer, requirement.separation, requirement.max_wrong, eye_pixel
    )
    seen = replace(seen, device=requirement.device)
    zone = seen_view_zone(scouted.scene, viewer)
    made = planned(scouted, seen, choices, sample, progress)
    record = replace(planned_record(scouted.scene, made, seen, progress=progress), view_zone=zone)
    return ViewerPlan(plan=replayed_plan(made, record), requirement=seen, record=record)


def planned_record(
    scene: Scene, made: Plan, requirement: ViewerRequirement, *, progress: bool = False
) -> PlannedRecord:
    """Return what a viewer notices of a plan that was made for his eyes, measured by a replay."""
    settings, viewer, display = made.settings, requirement.viewer, requirement.display
    blurs = blur_arcmin(max(requirement.content.farthest, key=abs, default=0.0), viewer, display)
    binds, limit = binding(requirement.limits), requirement.separation_limit
    rays = None
    if display.millimeters is not None:
        rays = viewer.pupil_mm / display.millimeters / (viewer.distance * display.pixel)
    measured = noise = with_cuts = None
    noticed, beyond = dict[str, float](), tuple[str, ...]()
    if settings is not None:
        noticed = {name: there for name, (there, _, _) in requirement.noticed(settings).items()}
        workbench = ReplayWorkbench(scene, viewer)
        with progress_bar(None, "eyes", "hogel", shown=progress) as bar:
            measured = workbench.measure(settings, bar.update)
        noise = replay_noise_arcsec(
            requirement.content, viewer, display, settings, workbench.eye_pixel
        )
        beyond = exceeded(measured, requirement, noise)
        with_cuts = requirement.limits_with(settings) if settings.slabs else None
    return PlannedRecord(
        viewer=viewer,
        pitch_arcmin=blurs["pitch"],
        pixel_arcmin=blurs["pixel"],
        diffraction_arcmin=blurs["diffraction"],
        rays_per_pupil=rays,
        limits=requirement.limits,
        binding=None if binds is None else binds.name,
        stereo_change_arcsec=noticed.get(STEREO),
        crack_arcmin=noticed.get(CRACK),
        separation=requirement.separation,
        separation_limited_by=None if limit is None else limit[0],
        measured=measured,
        limits_with_cuts=with_cuts,
        noise_arcsec=noise,
        exceeded=beyond,
    )


def planned_table(record: PlannedRecord, units: str) -> str:
    """Return the same as lines of text."""
    found, kinds = record.measured, []
    for words, limits in (
        ("without cuts", record.limits),
        ("with these cuts", record.limits_with_cuts or ()),
    ):
        kinds.append((words, limits, binding(limits)))
    values = {
        "record": record,
        "viewer": record.viewer,
        "units": units,
        "kinds": kinds,
        "found": found,
    }
    values["millimeters"] = MILLIMETERS.get(units, 1.0)
    if found is not None:
        # As if pixels were drawn at random.
        at_most = share_at_most(round(found.depth_wrong * found.judged), found.judged)
        values |= {"depth_wrong_at_most": at_most, "confidence": CONFIDENCE}
    return plain_text("plan-viewer.txt.j2", values).removesuffix("\n")
