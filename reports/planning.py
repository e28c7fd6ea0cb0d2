"""`xfrustum plan`: settings that meet a requirement, measures, limits of near, and the command."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from xfrustum.compare.noticeable import MILLIMETERS, Display, Viewer, blur_arcmin, eyes_apart
from xfrustum.compare.planning.plan import Plan, PlatePlanner, plan_apertures
from xfrustum.compare.planning.requirement import (
    CRACK,
    SMALLEST_PER_REACH,
    STEREO,
    NearLimit,
    Quality,
    Requirement,
    ViewZone,
    binding,
    view_zone,
    with_viewer,
)
from xfrustum.compare.planning.search import (
    ENOUGH_MARGIN,
    MAX_CUTS,
    SEPARATION_MARGIN,
    BufferLimit,
)
from xfrustum.compare.planning.ways import PlateWay
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.compare.sampling import RandomSample
from xfrustum.compare.scout import AutoApertures, PlateScan, scout
from xfrustum.reference import Reference
from xfrustum.reports.common.outputs import (
    json_object,
    plate_command,
    progress_bar,
    raster_command,
    scene_command,
    settings_words,
    versions,
    write_files,
)
from xfrustum.reports.common.templates_environment import html_page, plain_text
from xfrustum.reports.notebook import NotebookRepr
from xfrustum.reports.plate.directions import DirectionsResult, measure_directions
from xfrustum.reports.plotting import choices, plate_cells, plate_map
from xfrustum.reports.text import aligned, require_seen
from xfrustum.scenes import Aperture, DoubleFrustum, InputError, Plate, Scene
from xfrustum.scenes.arguments import one_of
from xfrustum.scenes.representation import digits, percent
from xfrustum.tolerances import MAX_WRONG

FILES = PAGE, DATA = "index.html", "plan.json"

#: largest number of characters in a line of text
LINE_CHARACTERS = 100

#: Number of pixels of both eyes' films that confirm a plan, each in its own hogel; two cores take
#: at most a minute.
CONFIRMED_HOGELS = 20_000

#: near of timed hogels if there is no plan, as a share of the reach
USUAL_NEAR_PER_REACH = 1e-3

#: listed quantiles of the largest nears of the scanned hogels
QUANTILES = (0.01, 0.1, 0.5, 0.9)

#: Names of the constraints that may limit near.
PIXELS, EYE, DEPTH, NOTHING = "pixels", "eye", "depth buffer", "none"

#: Visible effects of near.
NOTICED = {STEREO: "change of depth", CRACK: "crack at the plate"}

#: Errors of a hogel, by the names of their fields.
MEASURES = {
    "displacement_p99_px": "displacement (99 %)",
    "surface_fraction": "wrong surfaces",
    "depth_wrong": "surfaces wrong by depth",
}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PlanReport(NotebookRepr):
    """A plan of a scene, with the limits that bind it and the commands that draw and confirm it."""

    scene: Scene
    plan: Plan
    #: apertures of the plan; the middle one for a plate
    apertures: tuple[Aperture, ...]
    #: choice of the apertures by a scan of the plate
    auto: AutoApertures | None = None
    #: scan of the plate; None for a plan of some apertures
    scan: PlateScan | None = None
    #: view zone at the viewer's distance; None without a viewer
    view_zone: ViewZone | None = None
    #: the plate drawn by directions; None for a plan of some apertures
    directions: DirectionsResult | None = None

    @property
    def settings(self) -> DoubleFrustum | None:
        """Settings of the plan; None if there is no plan."""
        return self.plan.settings

    @property
    def eye_limit(self) -> NearLimit | None:
        """Effect that a viewer notices first as near grows; None without a limit."""
        return None if self.plan.limits is None else binding(self.plan.limits.eyes)

    @property
    def buffer(self) -> BufferLimit | None:
        """Limit of the plan's depth buffer; None if there is no plan."""
        buffers = () if self.plan.limits is None else self.plan.limits.buffers
        own = self.plan.depth, self.plan.mapping
        return next((limit for limit in buffers if (limit.depth, limit.mapping) == own), None)

    @property
    def binds(self) -> str:
        """Name of the binding limit on near, or of the limit that rules out a single pair."""
        made = self.plan
        pixels = None if made.limits is None else made.limits.pixels
        # Cuts exist because one pair fails at any near: depth sets the lower limit, pixels the
        # upper.
        if made.settings is None or made.slabs:
            return PIXELS if pixels is None else DEPTH
        near = None if self.eye_limit is None else self.eye_limit.largest_near
        if not made.requirement.pixels_count:
            return NOTHING if near is None else EYE
        return EYE if near is not None and pixels is not None and near < pixels else PIXELS

    @property
    def near_range(self) -> tuple[float, float] | None:
        """Least and largest near. The plan measures the largest; with cuts the two are equal."""
        if self.plan.near is None:
            return None
        # Cuts were placed for one near: a smaller near needs other cuts.
        least = None if self.plan.slabs or self.buffer is None else self.buffer.smallest_near
        return min(least or self.plan.near, self.plan.near), self.plan.near

    @property
    def by_directions(self) -> str:
        """Error and times of the plate by directions, in words; "" for a plan of some apertures."""
        return "" if self.directions is None else self.directions.words(self.scene)

    @cached_property
    def _sentences(self) -> list[str]:
        """Answer and reason."""
        limits, mark = self.plan.limits, "\f"
        hogels = np.zeros(0) if limits is None else limits.hogels[np.isfinite(limits.hogels)]
        values = {
            "report": self,
            "amiss": self._amiss,
            "usual": float(np.median(hogels)) if hogels.size else None,
            "smallest": SMALLEST_PER_REACH * self.scene.frustum.longest_reach,
            "noticed": NOTICED,
            "max_wrong": MAX_WRONG,
            "max_cuts": MAX_CUTS,
            "enough_margin": ENOUGH_MARGIN,
            "enough_separation": SEPARATION_MARGIN,
            "paragraph": mark,
        }
        text = plain_text("plan-sentences.txt.j2", values)
        return [" ".join(part.split()) for part in text.split(mark)]

    @property
    def sentence(self) -> str:
        """Answer: settings, whether they suffice, the binding limit, and a coarser choice."""
        return self._sentences[0]

    @property
    def reason(self) -> str:
        """Reason for the plan, or for the lack of one."""
        return self._sentences[1]

    def _amiss(self, quality: Quality, sheets_named: bool = False) -> list[str]:
        """Return the errors that exceed their limits, in words."""
        moved = f"displaced by {quality.displacement_p99_px:.2g} px"
        # Displacement is undefined in the plate: a value would be wrong.
        if math.isinf(quality.displacement_p99_px):
            moved = "in the plate itself, where displacement is undefined"
        ratios = self.plan.requirement.ratios(quality)
        words = {
            "displacement_p99_px": f"one pixel in a hundred {moved}",
            "surface_fraction": f"{percent(quality.surface_fraction)} of all pixels with the "
            "wrong surface",
            "depth_wrong": f"{percent(quality.depth_wrong)} of all pixels wrong by depth",
        }
        parts = [words[name] for name, ratio in ratios.items() if ratio > 1]
        if not sheets_named and quality.misordered > MAX_MISORDERED_FRACTION:
            parts.append(f"{percent(quality.misordered)} of the sheets' pixels out of order")
        return parts

    @property
    def commands(self) -> tuple[str, ...]:
        """Commands that draw by the plan and, for a plate, confirm it; empty without a plan."""
        settings, requirement = self.plan.settings, self.plan.requirement
        if settings is None:
            return ()
        if self.plan.plate is None:
            return (raster_command(self.scene, self.apertures[0], settings),)
        verb, words = "survey", [*settings_words(settings), "--out", "survey"]
        if requirement.pixels_count:
            words += ["--tolerance-px", f"{requirement.tolerance_px:g}"]
        if requirement.viewer is not None:
            viewer, display = requirement.viewer.viewer, requirement.viewer.display
            half = viewer.eyes_apart_mm / (display.millimeters or 1) / 2
            # The eyes look from the axis of the plate, where the plan's stereo limit is evaluated.
            places = ";".join(f"{x:g},0,{viewer.distance:g}" for x in (-half, half))
            own = [*settings_words(settings), *self._film()]
            verb, words = "view", [f"--eye={places}", *own, "--out", "seen"]
        return plate_command(self.scene, settings), scene_command(verb, self.scene, *words)

    def _film(self) -> list[str]:
        """Return `--resolution` for a film drawn within a minute; empty for few hogels."""
        if math.prod(self.scene.plate.hogels) <= CONFIRMED_HOGELS:
            return []
        width, height = self.scene.plate.size
        # Every pixel of an eye's film lies in a hogel of its own, two eyes share the number of
        # hogels, and pixels are square.
        columns = math.sqrt(CONFIRMED_HOGELS / 2 * width / height)
        return ["--resolution", f"{round(columns)},{max(1, round(columns * height / width))}"]

    def summary(self) -> dict[str, Any]:
        """Return the plan as `plan --json` prints it."""
        made, limits = self.plan, self.plan.limits
        # Absent errors keep their keys, as null, so that readers need no special case.
        unknown = dict.fromkeys(measure.name for measure in fields(Quality))
        hogels = np.zeros(0) if limits is None else limits.hogels[np.isfinite(limits.hogels)]
        commands = dict(zip(("command", "confirm"), self.commands, strict=False))
        return json_object(
            {
                "near": made.near,
                "near_range": self.near_range,
                "slabs": made.slabs,
                "split": bool(made.slabs),
                "depth": made.depth,
                "mapping": made.mapping,
                "within": made.within,
                "sentence": self.sentence,
                "reason": self.reason,
                "binds": self.binds,
                "limits": {
                    "pixels": None if limits is None else limits.pixels,
                    "depth": self.buffer and self.buffer.smallest_near,
                    "eye": self.eye_limit and self.eye_limit.largest_near,
                },
                "command": None,
                "confirm": None,
                **commands,
                "predicted": made.predicted or unknown,
                "measured": made.measured or unknown,
                "plate": self._plate(),
                "ways": self._ways(),
                "directions": self.directions and self.directions.summary(),
                "apertures": self.auto and choices(self.auto),
                "buffers": () if limits is None else limits.buffers,
                "hogels": {f"{q:g}": np.quantile(hogels, q) for q in QUANTILES if hogels.size},
                "device_model": made.device_model,
            }
            | ({} if made.requirement.viewer is None else {"viewer": self._viewer()})
        )

    def _ways(self) -> list[dict[str, Any]]:
        """Return error and predicted seconds of the whole plate for each way to draw it."""
        settings, measured, turned = self.plan.settings, self.plan.measured, self.directions
        speeds = None if turned is None else turned.speeds
        hogels, ways = math.prod(self.scene.plate.hogels), list[dict[str, Any]]()

        def add(way: PlateWay, moved: float, wrong: float, seconds: float | None) -> None:
            errors = {"displacement_p99_px": moved, "surface_fraction": wrong}
            ways.append({"way": way, **errors, "seconds": seconds})

        if settings is not None and measured is not None:
            seconds = None if speeds is None else speeds.hogels_s(hogels)
            moved, wrong = measured.displacement_p99_px, measured.surface_fraction
            add(PlateWay.from_settings(settings), moved, wrong, seconds)
        if turned is not None and turned.errors is not None and speeds is not None:
            seconds = speeds.directions_s(hogels)
            add(PlateWay.DIRECTIONS, 0.0, turned.errors.fraction, seconds)
        return ways

    def _plate(self) -> dict[str, Any] | None:
        if (known := self.plan.plate) is None:
            return None
        worst = known.worst and {**asdict(known.worst), "aperture": known.worst.aperture.index}
        # `asdict` leaves out properties.
        within = known.share_within_at_least
        return {**asdict(known), "share_within_at_least": within, "worst": worst}

    def _viewer(self) -> dict[str, Any]:
        """Return the display's blurs, limits and visible effects for the viewer of the plan."""
        eyes, settings, limits = self.plan.requirement.viewer, self.plan.settings, self.plan.limits
        assert eyes is not None
        viewer, display = eyes.viewer, eyes.display
        farthest = max(eyes.content.farthest, key=abs, default=0.0)
        blurs = blur_arcmin(farthest, viewer, display)
        noticed = {} if settings is None else eyes.noticed(settings)
        rays = None
        if display.millimeters is not None:
            # Rays of adjacent pixels of a hogel diverge by the angle of a pixel: compare the pupil
            # with their distance at the eye.
            rays = viewer.pupil_mm / display.millimeters / (viewer.distance * display.pixel)
        return {
            "viewer": viewer,
            **{f"{name}_arcmin": blur for name, blur in blurs.items()},
            "rays_per_pupil": rays,
            "limits": () if limits is None else limits.eyes,
            "limits_with_cuts": eyes.limits(settings) if settings and settings.slabs else None,
            "binding": self.eye_limit and self.eye_limit.name,
            "stereo_change_arcsec": noticed[STEREO][0] if STEREO in noticed else None,
            "crack_arcmin": noticed[CRACK][0] if CRACK in noticed else None,
            "separation": self.plan.requirement.separation,
            "separation_limited_by": eyes.separation_limit and eyes.separation_limit[0],
            "view_zone": self.view_zone,
        }

    def table(self) -> str:
        """Return the plan as text that ends in the commands."""
        lines = [filled(self.sentence)]
        if self.plan.settings is not None:
            head = "", f"near from, {self.scene.units}", f"up to, {self.scene.units}", ""
            lines += ["", filled(self.reason), "", self._errors(), ""]
            lines += [aligned([head, *allowed(self)]), ""]
        if self.view_zone is not None:
            unit = MILLIMETERS.get(self.scene.units, 1.0)
            some, every = self.view_zone.some_eyes_apart, self.view_zone.all_eyes_apart
            lines.append(
                f"view zone: eyes up to {digits(some * unit)} mm apart see some hogels, up to "
                f"{digits(every * unit)} all"
            )
        if (known := self.plan.plate) is not None:
            counts = f"{known.hogels:,} hogels: {known.scouted} scanned, {known.measured} measured"
            infeasible = f", {known.infeasible} infeasible" if known.infeasible else ""
            lines.append(f"{counts}{infeasible}{self._worst()}")
        if self.by_directions:
            lines.append(filled(self.by_directions))
        return "\n".join([*lines, *self.commands])

    def _worst(self) -> str:
        known = self.plan.plate
        if known is None or known.worst is None or known.worst_by is None:
            return ""
        p99, (column, row) = known.worst.displacement_p99_px, known.worst.aperture.index
        moved = f"by {p99:.3g} px" if math.isfinite(p99) else "undefined"
        return (
            f"; worst by {MEASURES[known.worst_by]}: {column},{row}, displaced {moved}, "
            f"{percent(known.worst.surface_fraction)} wrong surface"
        )

    def _errors(self) -> str:
        """Return predicted and measured errors beside their limits."""
        made, units, required = self.plan, self.scene.units, self.plan.requirement
        apart = required.separation_in(self.scene.frustum)
        wrong = MAX_WRONG if required.pixels_count else math.inf
        limits = {
            "displacement_p99_px": ("displacement, 99 %, px", required.limit_px),
            "surface_fraction": ("wrong surface", wrong),
            "depth_wrong": ("wrong by depth", required.max_wrong),
            "misordered": (f"sheets {apart:.3g} {units} apart misordered", MAX_MISORDERED_FRACTION),
            "separation": (f"sheets are ordered from, {units}", apart),
        }
        rows = [("at the worst aperture", "at most", "predicted", "measured")]
        for name, (words, limit) in limits.items():
            predicted, result = (
                f"{getattr(quality, name):.3g}" for quality in (made.predicted, made.measured)
            )
            rows.append((words, "any" if math.isinf(limit) else f"{limit:.3g}", predicted, result))
        return f"{aligned(rows)}\nrounding by the model of {made.device_model}"

    def _said(self) -> str:
        # The whole answer has up to ten lines: show its first sentence.
        return self.sentence.partition(". ")[0].removesuffix(".") + "."

    def _facts(self) -> str:
        answer = filled(self.sentence)
        return answer if self.plan.settings is None else f"{answer}\n\n{self._errors()}"


def filled(text: str) -> str:
    """Return text in lines of `LINE_CHARACTERS`, none of which begins with a percent sign."""
    # A line that begins with a percent sign reads as another number.
    kept = text.replace(" %", "\N{NO-BREAK SPACE}%")
    wrapped = textwrap.fill(kept, LINE_CHARACTERS, break_on_hyphens=False)
    return wrapped.replace("\N{NO-BREAK SPACE}", " ")


def plan(
    scene: Scene,
    apertures: Sequence[Aperture] | AutoApertures | None = None,
    requirement: Requirement | None = None,
    *,
    viewer: Viewer | None = None,
    sample: RandomSample | None = None,
    progress: bool = False,
) -> PlanReport:
    """Plan settings for some apertures of a scene, by default the whole plate, and measure them.

    Parameters
    ----------
    scene
        The scene.
    apertures
        Apertures of which the worst counts; None for the whole plate.
    requirement
        Limits of the plan; by default the usual ones, or with a `viewer` only the viewer's limits.
    viewer
        Eyes in front of the plate that must not notice near; for whole plates only.
    sample
        Random hogels of the plate at which the plan is measured.
    progress
        Draw a bar on standard error.

    Raises
    ------
    InputError
        None of the apertures shows a surface, a viewer stands outside the view zone, or there is no
        usable OpenGL.
    """
    one_of(scene, Scene, "scene")
    if requirement is None:
        requirement = Requirement(pixels_count=viewer is None)
    one_of(requirement, Requirement, "requirement")
    if viewer is None and not requirement.pixels_count:
        raise InputError(
            "neither pixels nor a viewer limit near: let pixels count, or give a viewer"
        )
    if apertures is None:
        return _plate_plan(scene, requirement, viewer, sample or RandomSample(), progress)
    if viewer is not None:
        raise InputError("a viewer sees all hogels at once: leave out the viewer or the apertures")
    auto = apertures if isinstance(apertures, AutoApertures) else None
    chosen = tuple(apertures.apertures if isinstance(apertures, AutoApertures) else apertures)
    require_seen(scene, chosen)
    with progress_bar(2 * len(chosen), "plan", "hogel", shown=progress) as bar:
        made = plan_apertures(scene, chosen, requirement, bar.update)
    return PlanReport(scene=scene, plan=made, apertures=chosen, auto=auto)


def _plate_plan(
    scene: Scene,
    requirement: Requirement,
    viewer: Viewer | None,
    sample: RandomSample,
    progress: bool,
) -> PlanReport:
    zone = None if viewer is None else seen_view_zone(scene, viewer)
    scan = scanned_plate(scene, progress)
    if viewer is not None:
        requirement = with_viewer(requirement, scan, viewer)
    with progress_bar(None, "plan", "hogel", shown=progress) as bar:
        planner = PlatePlanner(
            reference=Reference(scene),
            scan=scan,
            requirement=requirement,
            done=bar.update,
        )
        made = planner.plan(sample)
    middle = scene.plate.middle
    # Times hardly depend on near: without a plan, an ordinary near is timed.
    settings = made.settings or DoubleFrustum(
        near=USUAL_NEAR_PER_REACH * scene.frustum.longest_reach
    )
    return PlanReport(
        scene=scene,
        plan=made,
        apertures=(middle,),
        scan=scan,
        view_zone=zone,
        directions=measure_directions(planner.reference, (middle,), settings),
    )


def scanned_plate(scene: Scene, progress: bool) -> PlateScan:
    """Scan apertures all over a plate; InputError if none shows a surface."""
    with progress_bar(None, "scan", "hogel", shown=progress) as bar:
        scan = scout(scene, bar.update)
    # The coarse film may miss a small object: only the exact test may raise the error.
    if not any(math.isfinite(look.nearest) for look in scan.looks):
        require_seen(scene, scan.apertures)
    return scan


def seen_view_zone(scene: Scene, viewer: Viewer) -> ViewZone:
    """Return the view zone at a viewer's distance; InputError if an eye lies outside of it."""
    zone, display = view_zone(scene, viewer.distance), Display.from_scene(scene)
    if eyes_apart(viewer, display) <= zone.some_eyes_apart:
        return zone
    units, (x, y) = scene.units, zone.some
    widest = zone.some_eyes_apart * (display.millimeters or 1.0)
    advice = (
        f"eyes may be up to {widest:.3g} mm apart, and these are {viewer.eyes_apart_mm:g} (--ipd)"
    )
    if not widest:
        advice = "no eyes straight before the plate's middle lie in it"
    raise InputError(
        f"{scene.name}: no ray of an eye meets the film of a hogel. The view zone is "
        f"{x[1] - x[0]:.3g} x "
        f"{y[1] - y[0]:.3g} {units} at {zone.distance:g} {units} (x from {x[0]:.3g} to "
        f"{x[1]:.3g}, y from "
        f"{y[0]:.3g} to {y[1]:.3g}): {advice}; or choose another --viewer, or a larger film"
    )


def spread_apertures(plate: Plate, count: int) -> list[Aperture]:
    """Return apertures: middle, corners, then a Halton sequence, which a larger count extends."""
    columns, rows = plate.hogels
    count = min(count, columns * rows)
    corners = [(0, 0), (columns - 1, rows - 1), (columns - 1, 0), (0, rows - 1)]
    chosen = dict.fromkeys([plate.middle.index, *corners])
    # A low-discrepancy sequence extends: the first apertures stay when the count grows.
    pattern = scipy.stats.qmc.Halton(2, scramble=False)
    while len(chosen) < count:
        # Several points may fall into one hogel: the loop continues until enough are distinct.
        points = scipy.stats.qmc.scale(pattern.random(count), [0, 0], [columns, rows]).astype(int)
        chosen |= dict.fromkeys(map(tuple, points.tolist()))
    return [plate.aperture(*index) for index in list(chosen)[:count]]


def allowed(report: PlanReport) -> list[tuple[str, str, str, str]]:
    """Return the range of near that each limit allows: name, ends, and whether it binds.

    An end without a bound is empty.
    """
    limits, rows = report.plan.limits, list[tuple[str, str, str, str]]()
    if limits is None:
        return rows
    if limits.pixels is not None:
        name = f"pixels, {report.plan.requirement.tolerance_px:g} px at the worst hogel"
        rows.append((name, "", digits(limits.pixels), "binds" if report.binds == PIXELS else ""))
    for eye in limits.eyes:
        high = "" if eye.largest_near is None else digits(eye.largest_near)
        binds = report.binds == EYE and eye == report.eye_limit
        rows.append((f"eyes, {NOTICED[eye.name]}", "", high, "binds" if binds else ""))
    for buffer in limits.buffers:
        low = "none" if buffer.smallest_near is None else digits(buffer.smallest_near)
        name = f"depth buffer, {buffer.depth.upper()} {buffer.mapping}"
        rows.append((name, "" if buffer.any_near else low, "", ""))
    return rows


def write_plan(report: PlanReport, out: Path) -> tuple[Path, ...]:
    """Write the page and plan.json, all or nothing."""
    figures, limits, plate = {}, report.plan.limits, report.scene.plate
    if report.scan is not None and limits is not None and np.isfinite(limits.hogels).any():
        tolerance_px = report.plan.requirement.tolerance_px
        title = f"largest near that keeps {tolerance_px:g} px, {report.scene.units}"
        places = [aperture.index for aperture in report.scan.apertures]
        # A cell shows the strictest of its hogels.
        values, known = plate_cells(plate.hogels, places, limits.hogels, np.fmin)
        figures["map"] = plate_map(plate, values, title, known=known, logarithmic=True)
        figures["map"]["data"][0] |= {"colorscale": "Viridis", "reversescale": True}
    page = {"made": report, "figures": figures, "rows": allowed(report), "versions": versions()}
    return write_files(out, {PAGE: html_page("plan.html.j2", page), DATA: report.summary()})
