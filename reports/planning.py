"""`xfrustum plan`: settings that keep a requirement, measures, limits of near, and the command."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy

from xfrustum.compare.eye.noticeable import (
    MILLIMETERS,
    Display,
    Viewer,
    blur_arcmin,
    eyes_apart,
)
from xfrustum.compare.planning.plan import Plan, PlatePlanner, plan_apertures
from xfrustum.compare.planning.requirement import (
    CRACK,
    STEREO,
    NearLimit,
    Quality,
    Requirement,
    ViewZone,
    binding,
    view_zone,
    with_viewer,
)
from xfrustum.compare.planning.search import BufferLimit
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.compare.sampling import RandomSample
from xfrustum.compare.scout import AutoApertures, PlateScan, scout
from xfrustum.reference import Reference
from xfrustum.reports import plan_text
from xfrustum.reports.common.figure_style import Figure, log_axis, look, styled
from xfrustum.reports.common.outputs import json_object, progress_bar, write_files
from xfrustum.reports.common.provenance import (
    plate_command,
    raster_command,
    scene_command,
    settings_words,
    versions,
)
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.heat_map import MARK, choices, plate_cells, plate_map
from xfrustum.reports.notebook import NotebookRepr
from xfrustum.reports.plan_text import DEPTH, EYE, MEASURES, NOTHING, NOTICED, PIXELS
from xfrustum.reports.scene_check.sight import require_seen
from xfrustum.reports.text import aligned
from xfrustum.scenes import Aperture, DoubleFrustum, InputError, Plate, Scene
from xfrustum.scenes.arguments import one_of
from xfrustum.scenes.representation import digits, percent
from xfrustum.tolerances import MAX_WRONG

FILES = PAGE, DATA = "index.html", "plan.json"

#: largest number of characters in a line of text
LINE_CHARACTERS = 100

#: Pixels of both eyes' films that confirm a plan, each of another hogel: a minute of two cores or
#: less.
CONFIRMED_HOGELS = 20_000

#: shares of the scanned hogels whose largest near is listed
QUANTILES = (0.01, 0.1, 0.5, 0.9)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PlanReport(NotebookRepr):
    """A plan of a scene, with the limits that bind it and the commands that draw and confirm it."""

    scene: Scene
    plan: Plan
    #: apertures of the plan; the middle one for a plate
    apertures: tuple[Aperture, ...]
    #: choice of the apertures by a scan of the plate
    auto: AutoApertures | None = None
    #: None for a plan of some apertures
    scan: PlateScan | None = None
    #: at the viewer's distance; None without a viewer
    view_zone: ViewZone | None = None

    @property
    def settings(self) -> DoubleFrustum | None:
        """Settings of the plan; None without one."""
        return self.plan.settings

    @property
    def eye_limit(self) -> NearLimit | None:
        """Effect of a growing near that a viewer notices first; None for none."""
        return None if self.plan.limits is None else binding(self.plan.limits.eyes)

    @property
    def buffer(self) -> BufferLimit | None:
        """Limit of the plan's depth buffer; None without a plan."""
        buffers = () if self.plan.limits is None else self.plan.limits.buffers
        own = self.plan.depth, self.plan.mapping
        return next((limit for limit in buffers if (limit.depth, limit.mapping) == own), None)

    @property
    def binds(self) -> str:
        """Name of the judge that keeps near from being larger, or that one pair of frusta fails."""
        made = self.plan
        # Cuts exist because one pair fails at any near: depth sets the lower limit, pixels the
        # upper.
        if made.settings is None or made.slabs:
            return DEPTH if made.limits is not None and made.limits.pixels is not None else PIXELS
        near = None if self.eye_limit is None else self.eye_limit.largest_near
        if made.requirement.pixels_count:
            pixels = made.limits.pixels if made.limits is not None else None
            return EYE if near is not None and pixels is not None and near < pixels else PIXELS
        return NOTHING if near is None else EYE

    @property
    def near_range(self) -> tuple[float, float] | None:
        """Least and largest near; the measured one is the largest, and cuts belong to one near."""
        if self.plan.near is None:
            return None
        # Cuts were placed for one near: a smaller one needs other cuts.
        least = None if self.plan.slabs or self.buffer is None else self.buffer.smallest_near
        return min(least or self.plan.near, self.plan.near), self.plan.near

    @property
    def commands(self) -> tuple[str, ...]:
        """Commands that draw by the plan, and that confirm it for a plate; none without a plan."""
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
        """Return the option of a film that is drawn in a minute; nothing for few hogels."""
        if math.prod(self.scene.plate.hogels) <= CONFIRMED_HOGELS:
            return []
        width, height = self.scene.plate.size
        # Each pixel of an eye's film lies in another hogel; two eyes share the budget, and pixels
        # are square.
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
                "sentence": plan_text.sentence(self),
                "reason": plan_text.reason(self),
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
                "apertures": self.auto and choices(self.auto),
                "buffers": () if limits is None else limits.buffers,
                "hogels": {f"{q:g}": np.quantile(hogels, q) for q in QUANTILES if hogels.size},
                "device_model": made.device_model,
            }
            | ({} if made.requirement.viewer is None else {"viewer": self._viewer()})
        )

    def _plate(self) -> dict[str, Any] | None:
        if (known := self.plan.plate) is None:
            return None
        worst = known.worst and {**asdict(known.worst), "aperture": known.worst.aperture.index}
        # A property, which `asdict` leaves out.
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
            # Rays leave adjacent pixels of a hogel at the angle of a pixel: their distance at the
            # eye is compared with the pupil.
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
        lines = [filled(plan_text.sentence(self))]
        if self.plan.settings is not None:
            lines += ["", filled(plan_text.reason(self)), "", self._errors(), ""]
            lines += [aligned([_head(self.scene.units), *(row.cells for row in allowed(self))]), ""]
        if self.view_zone is not None:
            zone, unit = self.view_zone, MILLIMETERS.get(self.scene.units, 1.0)
            some, every = zone.some_eyes_apart * unit, zone.all_eyes_apart * unit
            lines.append(
                f"view zone: eyes up to {digits(some)} mm apart see some hogels, up to "
                f"{digits(every)} all"
            )
        if (known := self.plan.plate) is not None:
            counts = f"{known.hogels:,} hogels: {known.scouted} scanned, {known.measured} measured"
            infeasible = f", {known.infeasible} infeasible" if known.infeasible else ""
            lines.append(f"{counts}{infeasible}{self._worst()}")
        return "\n".join([*lines, *self.commands])

    def _worst(self) -> str:
        known = self.plan.plate
        if known is None or known.worst is None or known.worst_by is None:
            return ""
        worst, p99 = known.worst, known.worst.displacement_p99_px
        moved = f"by {p99:.3g} px" if math.isfinite(p99) else "undefined"
        column, row = worst.aperture.index
        return (
            f"; worst by {MEASURES[known.worst_by]}: {column},{row}, displaced {moved}, "
            f"{percent(worst.surface_fraction)} wrong surface"
        )

    def _errors(self) -> str:
        """Return predicted and measured errors beside their limits."""
        made, units = self.plan, self.scene.units
        requirement, frustum = made.requirement, self.scene.frustum
        separation = requirement.separation_in(frustum)
        limits = (
            ("displacement, 99 %, px", requirement.limit_px, "displacement_p99_px"),
            (
                "wrong surface",
                MAX_WRONG if requirement.pixels_count else math.inf,
                "surface_fraction",
            ),
            ("wrong by depth", requirement.max_wrong, "depth_wrong"),
            (
                f"sheets {separation:.3g} {units} apart misordered",
                MAX_MISORDERED_FRACTION,
                "misordered",
            ),
            (f"sheets are ordered from, {units}", separation, "separation"),
        )
        rows: list[tuple[str, ...]] = [
            ("at the worst aperture", "at most", "predicted", "measured")
        ]
        for words, limit, name in limits:
            both = (f"{getattr(quality, name):.3g}" for quality in (made.predicted, made.measured))
            rows.append((words, "any" if math.isinf(limit) else f"{limit:.3g}", *both))
        return f"{aligned(rows)}\nrounding by the model of {made.device_model}"

    def _said(self) -> str:
        return plan_text.sentence(self)

    def _facts(self) -> str:
        return "" if self.plan.settings is None else self._errors()


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
        Limits of the plan; by default the usual ones, or with a `viewer` the viewer's limits alone.
    viewer
        Eyes before the plate that must not notice near; for whole plates only.
    sample
        Random hogels of the plate at which the plan is measured.
    progress
        Draw a bar on standard error.

    Raises
    ------
    InputError
        None of the apertures sees anything, a viewer stands outside the view zone, or there is no
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
    middle = (scene.plate.middle,)
    return PlanReport(scene=scene, plan=made, apertures=middle, scan=scan, view_zone=zone)


def scanned_plate(scene: Scene, progress: bool) -> PlateScan:
    """Scan apertures all over a plate; InputError where none sees anything."""
    with progress_bar(None, "scan", "hogel", shown=progress) as bar:
        scan = scout(scene, bar.update)
    # The coarse film may miss a small object: the exact test decides before the error.
    if not any(math.isfinite(look.nearest) for look in scan.looks):
        require_seen(scene, scan.apertures)
    return scan


def seen_view_zone(scene: Scene, viewer: Viewer) -> ViewZone:
    """Return the view zone at a viewer's distance; InputError where an eye lies outside of it."""
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


class Allowed(NamedTuple):
    """Range of near that one judge allows, scene units; `low` is infinite where it allows none."""

    name: str
    low: float = 0.0
    high: float = math.inf
    binds: bool = False

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Text of a row; an end that bounds nothing is left out."""
        low = "none" if math.isinf(self.low) else digits(self.low) if self.low else ""
        high = "" if math.isinf(self.high) else digits(self.high)
        return self.name, low, high, "binds" if self.binds else ""


def _head(units: str) -> tuple[str, str, str, str]:
    return "", f"near from, {units}", f"up to, {units}", ""


def allowed(report: PlanReport) -> list[Allowed]:
    """Return the range of near that each judge allows, for tables and figures."""
    limits, requirement, rows = report.plan.limits, report.plan.requirement, list[Allowed]()
    if limits is None:
        return rows
    if limits.pixels is not None:
        name = f"pixels, {requirement.tolerance_px:g} px at the worst hogel"
        rows.append(Allowed(name, high=limits.pixels, binds=report.binds == PIXELS))
    for eye in limits.eyes:
        high = math.inf if eye.largest_near is None else eye.largest_near
        binds = report.binds == EYE and eye == report.eye_limit
        rows.append(Allowed(f"eyes, {NOTICED[eye.name]}", high=high, binds=binds))
    for buffer in limits.buffers:
        low = math.inf if buffer.smallest_near is None else buffer.smallest_near
        name = f"depth buffer, {str(buffer.depth).upper()} {buffer.mapping}"
        rows.append(Allowed(name, 0.0 if buffer.any_near else low))
    return rows


def write_plan(report: PlanReport, out: Path) -> tuple[Path, ...]:
    """Write the page and plan.json, all or nothing."""
    figures, limits = {"limits": limits_figure(report)}, report.plan.limits
    if report.scan is not None and limits is not None and np.isfinite(limits.hogels).any():
        tolerance_px = report.plan.requirement.tolerance_px
        title = f"largest near that keeps {tolerance_px:g} px, {report.scene.units}"
        places = [aperture.index for aperture in report.scan.apertures]
        # A cell shows the strictest of its hogels.
        values, known = plate_cells(report.scene.plate.hogels, places, limits.hogels, np.fmin)
        figure = plate_map(report.scene.plate, values, title, known=known, logarithmic=True)
        figure["data"][0] |= {"colorscale": "Viridis", "reversescale": True}
        figures["map"] = figure
    page = {
        "found": report,
        "sentence": plan_text.sentence(report),
        "reason": plan_text.reason(report),
        "figures": figures,
        "rows": [row.cells for row in allowed(report)],
        "versions": versions(),
    }
    return write_files(out, {PAGE: html_page("plan.html.j2", page), DATA: report.summary()})


def limits_figure(report: PlanReport) -> Figure:
    """Draw the range of near that each judge allows as bars, and the near of the plan as a line."""
    reach, near, rows = report.scene.frustum.longest_reach, report.plan.near, allowed(report)
    ends = [end for row in rows for end in (row.low, row.high) if 0 < end < math.inf]
    # A logarithmic axis has no zero: bars without a lower limit begin one and a half decades below.
    low = min([*ends, near or reach]) / 30
    bars = [
        (row.name.replace(", ", ",<br>"), row.low or low, min(row.high, reach))
        # A limit that allows no near has no bar.
        for row in rows
        if math.isfinite(row.low)
    ]
    bar = {
        "type": "bar",
        "orientation": "h",
        "y": [name for name, *_ in bars],
        "base": [start for _, start, _ in bars],
        "x": [end - start for _, start, end in bars],
        "customdata": [end for *_, end in bars],
        "hovertemplate": "%{y}: %{base:.3g} to %{customdata:.3g}<extra></extra>",
        "marker": {"color": look(1)[0]},
    }
    line = {"type": "line", "x0": near, "x1": near, "yref": "y domain", "y0": 0, "y1": 1}
    layout = {
        "height": 110 + 40 * len(bars),
        "showlegend": False,
        "xaxis": {
            "title": f"near, {report.scene.units}",
            **log_axis([low, reach]),
            "dtick": max(1, round(math.log10(reach / low) / 5)),
            "range": [math.log10(low), math.log10(reach)],
        },
        "yaxis": {"type": "category", "autorange": "reversed"},
        "shapes": [] if near is None else [{**line, "line": {"color": MARK, "width": 2}}],
    }
    return styled([bar], layout)
