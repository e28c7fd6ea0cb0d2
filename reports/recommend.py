"""`xfrustum recommend`: what the depth buffer, the pixels and a viewer's eyes each allow, in one answer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from xfrustum.compare.eye.noticeable import Viewer, stereo_change_arcsec
from xfrustum.compare.planning.limits import (
    COMPARED_BUFFERS,
    BufferLimit,
    buffer_limits,
    hogel_limits,
    traced_limits,
)
from xfrustum.compare.planning.plan import Plan, PlatePlanner
from xfrustum.compare.planning.reasons import exceptions
from xfrustum.compare.planning.search import DepthBuffer
from xfrustum.compare.planning.viewer import CRACK, STEREO, NearLimit, binding
from xfrustum.compare.planning.views import Requirement
from xfrustum.compare.sampling import RandomSample
from xfrustum.compare.scout import PlateScan
from xfrustum.raster import require_room
from xfrustum.reference import Reference
from xfrustum.reports import planning
from xfrustum.reports.common.figure_style import Figure, log_axis, look, styled
from xfrustum.reports.common.outputs import write_files
from xfrustum.reports.common.provenance import (
    plate_command,
    scene_command,
    settings_words,
    versions,
)
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.scout import MARK, plate_cells, plate_map
from xfrustum.reports.text import aligned
from xfrustum.scenes import DoubleFrustum, InputError, Scene
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.representation import digits, percent, sides
from xfrustum.tolerances import MAX_WRONG

FILES = PAGE, DATA = "index.html", "recommend.json"

PIXELS, EYE, DEPTH, NOTHING = "pixels", "eye", "depth buffer", "none"
"""Names of what may bind near: displacement in hogels' pixels, what a viewer notices, depth; or nothing."""

LIMIT_WORDS = {STEREO: "change of depth", CRACK: "crack at the plate"}
"""What a viewer may notice of near, in words."""

CONFIRMED_HOGELS = 20_000
"""Pixels of both eyes' films that confirm an answer, each of another hogel: a minute of two cores or less."""

MAX_COMPARED = 5  #: largest number of depth buffers to choose from that are all compared

QUANTILES = (0.01, 0.1, 0.5, 0.9)
"""Shares of the hogels that were looked through of which the largest near is told."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Recommendation:
    """How to draw a plate, and what decides it; lengths in scene units.

    Without a viewer pixels judge near. With one eyes do, and pixels besides where their tolerance
    was asked for (`pixels_count`).
    """

    scene: Scene
    scouted: PlateScan
    requirement: Requirement
    pixels: Plan
    eyes: planning.ViewerPlan | None
    pixels_count: bool
    buffers: tuple[BufferLimit, ...]
    hogel_limits: Floats  #: (A,) largest near of each scouted aperture; see `hogel_limits`

    @property
    def chosen(self) -> Plan:
        """The plan that is recommended: of those that count, the one with the smaller near."""
        plans = [self.pixels] if self.pixels_count or self.eyes is None else []
        plans += [self.eyes.plan] if self.eyes is not None else []
        return min(plans, key=lambda one: -math.inf if one.near is None else one.near)

    @property
    def binds(self) -> str:
        """What keeps near from being larger; of a plan with cuts, and of none, what one pair fails by."""
        if self.chosen.settings is None or self.chosen.slabs:
            return DEPTH if self.pixel_limit is not None else PIXELS
        if self.chosen is self.pixels:
            return PIXELS
        return NOTHING if self.eye_limit is None or self.eye_limit.largest_near is None else EYE

    @property
    def eye_limit(self) -> NearLimit | None:
        """What the viewer notices first of a near that grows; None where nothing."""
        return None if self.eyes is None else binding(self.eyes.requirement.limits)

    @property
    def pixel_limit(self) -> float | None:
        """Largest near within the tolerance at all scouted apertures that some near can draw; else None.

        A plan without cuts has drawn hogels with its largest near, which counts where it is
        smaller.
        """
        possible = self.hogel_limits[self.hogel_limits > 0].tolist()
        if possible and self.pixels.near is not None and not self.pixels.slabs:
            possible.append(self.pixels.largest.near if self.pixels.largest else self.pixels.near)
        return min(possible, default=None)

    @property
    def buffer(self) -> BufferLimit | None:
        """What the depth buffer of the recommended plan asks for; None without a plan."""
        drawn = self.chosen.depth_buffer
        return next((one for one in self.buffers if (one.depth, one.mapping) == drawn), None)

    @property
    def nears(self) -> tuple[float, float] | None:
        """The least and the largest near to draw with: the plan's own is the largest, for it was measured.

        One pair of frusta may come down to what its depth buffer asks for; cuts belong to one near.
        """
        largest, buffer = self.chosen.near, self.buffer
        if largest is None:
            return None
        least = largest if self.chosen.slabs or buffer is None else buffer.smallest_near or largest
        return min(least, largest), largest

    @property
    def paragraph(self) -> str:
        """The answer: what to draw with, whether to split, what binds, and what a coarser choice costs."""
        settings = self.chosen.settings
        if settings is None:
            return self.chosen.reason
        return " ".join((*self._to_draw_with(settings), *self._what_binds(), *self._coarser()))

    def _to_draw_with(self, settings: DoubleFrustum) -> list[str]:
        chosen, units, known = self.chosen, self.scene.units, self.chosen.plate
        assert known is not None
        cuts = "in one pair of frusta: splitting is not needed"
        if chosen.slabs:
            heights = " and ".join(map(digits, chosen.slabs))
            cuts = f"split at {heights} {units} from the plate: one pair of frusta is not enough"
        first = f"Draw {self.scene.name} with near {digits(settings.near)} {units} and "
        first += f"{settings.depth_label} depth, {cuts}."
        if not known.covers_the_plate:
            return [first, f"{exceptions(known).removesuffix(':')}, these do."]
        if not chosen.within:
            return [first, f"This does not hold for the whole plate: {chosen.reason}"]
        if self.eyes is not None and chosen is self.eyes.plan:
            distance = self.eyes.requirement.viewer.distance
            seen = f"Replayed so to two eyes {distance:g} {units} before it, they notice no error."
            return [first, seen, *planning.beside_words(chosen, units, self._limits)]
        held = f"Drawn so, none of the {known.measured} hogels that were measured is beyond {self._limits}"
        if known.confidence < 1:
            share, certain = percent(known.share_beyond_at_most), percent(known.confidence)
            held += f", so that at most {share} of all {known.hogels:,} are ({certain} confidence)"
        if known.empty:
            held += f"; {known.empty} of the {known.sampled} drawn at random show nothing"
        return [first, f"{held}.", *planning.beside_words(chosen, units, self._limits)]

    @property
    def _limits(self) -> str:
        """The limits from which on a hogel is beyond, in words."""
        return f"{self.requirement.tolerance_px:g} px or {percent(MAX_WRONG)} wrong surfaces"

    def _what_binds(self) -> list[str]:
        """Say what each judge allows, the one that binds first."""
        units, limit, said = self.scene.units, self.pixel_limit, {}
        if limit is not None:
            ordinary = float(np.nanmedian(self.hogel_limits))
            said[PIXELS] = f"pixels ({self._limits}) allow near up to {digits(limit)} "
            said[PIXELS] += (
                f"{units} at the worst hogel and up to {digits(ordinary)} at half of them"
            )
            if self.eyes is not None and not self.pixels_count:
                said[PIXELS] += ", which counts only with --tolerance-px"
        if self.eyes is not None:
            found, distance = self.eye_limit, self.eyes.requirement.viewer.distance
            largest = None if found is None else found.largest_near
            allowed = "any near" if largest is None else f"near up to {digits(largest)} {units}"
            said[EYE] = f"eyes at {distance:g} {units} allow {allowed}"
            if found is not None:
                said[EYE] += f" ({LIMIT_WORDS[found.name]})"
        assert self.buffer is not None
        said[DEPTH] = self.buffer.words(units)
        first = said.pop(self.binds, None)
        others = "; ".join(said.values())
        if first is not None and self.chosen.slabs:
            first = f"in one pair {first}"
        elif first is not None:
            largest = self.eye_limit.largest_near if self.binds == EYE and self.eye_limit else None
            # A crack has a closed form: where a change of depth would allow more, there is no
            # margin.
            if largest is None or digits(largest) != digits(self.chosen.near or 0.0):
                first += ", and near is smaller for a margin"
                first += ": the noise of a replay" if self.binds == EYE else ""
        bound = [] if first is None else [f"What binds: {first}."]
        return [*bound, f"{others[0].upper()}{others[1:]}."] if others else bound

    def _coarser(self) -> list[str]:
        """Say what the cheapest depth buffer would cost where another one is recommended."""
        first, units = self.buffers[0], self.scene.units
        if self.chosen.depth_buffer == (first.depth, first.mapping):
            return []
        if first.smallest_near is None or first.displacement_p99_px is None:
            return [f"With a coarser depth buffer {first.words(units)}."]
        cost = f"displaces the worst hogel by {digits(first.displacement_p99_px)} px"
        seen = ""
        if self.eyes is not None:
            asked = self.eyes.requirement
            coarse = DoubleFrustum(near=first.smallest_near)
            change = stereo_change_arcsec(asked.content, asked.viewer, asked.display, coarse)
            seen = f" and changes disparity by {digits(change)} arc seconds"
        return [f"A coarser choice costs error: {first.words(units)}, which {cost}{seen}."]

    @property
    def commands(self) -> tuple[str, ...]:
        """The commands that draw the plate so, and that confirm it; none without a plan."""
        settings = self.chosen.settings
        if settings is None:
            return ()
        verb, words = "survey", [*settings_words(settings), "--out", "survey"]
        if self.chosen is self.pixels:
            words += ["--tolerance-px", f"{self.requirement.tolerance_px:g}"]
        if self.eyes is not None:
            viewer, display = self.eyes.requirement.viewer, self.eyes.requirement.display
            half = viewer.eyes_apart_mm / (display.millimeters or 1) / 2
            places = ";".join(f"{x:g},0,{viewer.distance:g}" for x in (-half, half))
            seen = [f"--eye={places}"]
            verb, words = "view", [*seen, *settings_words(settings), *self._film(), "--out", "seen"]
        return plate_command(self.scene, settings), scene_command(verb, self.scene, *words)

    def _film(self) -> list[str]:
        """Return the option of a film that a minute draws; of a plate with fewer hogels, nothing."""
        if math.prod(self.scene.plate.hogels) <= CONFIRMED_HOGELS:
            return []
        width, height = self.scene.plate.size
        columns = math.sqrt(CONFIRMED_HOGELS / 2 * width / height)
        return ["--resolution", f"{round(columns)},{max(1, round(columns * height / width))}"]

    @property
    def plate_bytes(self) -> int:
        """Bytes of the colors that `plate` draws by default, before they are compressed."""
        pixels = math.prod((*self.scene.plate.hogels, *self.scene.frustum.resolution))
        return pixels * 3 * np.dtype(np.float16).itemsize

    @property
    def size_words(self) -> str:
        """How much the first command draws."""
        hogels, film = math.prod(self.scene.plate.hogels), sides(self.scene.frustum.resolution)
        unit, name = (1e9, "GB") if self.plate_bytes >= 1e9 else (1e6, "MB")
        size = f"{digits(self.plate_bytes / unit)} {name} before compression"
        return f"The whole plate is {hogels:,} hogels of {film} pixels, {size}:"

    def summary(self) -> dict[str, Any]:
        """Return what `recommend --json` prints."""
        chosen, known = self.chosen, self.hogel_limits[np.isfinite(self.hogel_limits)]
        draw, confirm = self.commands or (None, None)
        return {
            "sentence": self.paragraph,
            "binds": self.binds,
            "near": self.nears and list(self.nears),
            "depth": chosen.depth,
            "mapping": chosen.mapping,
            "slabs": list(chosen.slabs),
            "split": bool(chosen.slabs),
            "within": chosen.within,
            "limits": {
                "pixels": self.pixel_limit,
                "depth": self.buffer and self.buffer.smallest_near,
                "eye": self.eye_limit and self.eye_limit.largest_near,
            },
            "plate": chosen.plate and chosen.plate.summary(),
            "command": draw,
            "plate_bytes": self.plate_bytes,
            "confirm": confirm,
            "hogels": {
                f"{share:g}": float(np.quantile(known, share)) for share in QUANTILES if known.size
            },
            "buffers": self.buffers,
            "plans": {"pixels": self.pixels.summary(), "eye": self.eyes and self.eyes.summary()},
        }


def for_display(scene: Scene, pitch: float) -> Scene:
    """Return a scene with the hogels of a display of another pitch, scene units, on a plate of its size.

    Its name says how many, for they are to be written into the scene file before anything is drawn.
    InputError where hogels of this pitch are wider than the plate.
    """
    width, height = scene.plate.size
    if pitch > min(width, height):
        raise InputError(
            f"--display {pitch:g}: hogels are wider than the plate of {width:g} x {height:g} {scene.units}"
        )
    hogels = (round(width / pitch), round(height / pitch))
    name = f"{scene.name} (hogels = {list(hogels)})"
    return replace(scene, name=name, plate=replace(scene.plate, hogels=hogels))


def recommend(
    scene: Scene,
    viewer: Viewer | None = None,
    tolerance_px: float | None = None,
    choices: Sequence[DepthBuffer] | None = None,
    *,
    sample: RandomSample | None = None,
    progress: bool = False,
) -> Recommendation:
    """Return how to draw a plate: what depth buffer, pixels and eyes allow, and which of them binds.

    Without a `viewer`, eyes before the display, hogels' pixels are all that counts. `tolerance_px`
    is the largest 99th percentile of displacement; None for the usual, by which no viewer's display
    is judged. `choices` are the depth buffers to choose from, None for all.

    InputError where nobody sees anything of the objects, the scene's unit is not known to a viewer,
    or there is no usable OpenGL.
    """
    # The plans are measured by drawing them, but only after searches that trace and predict for
    # long.
    require_room(scene)
    scouted = planning.scouted_plate(scene, progress)
    requirement = Requirement() if tolerance_px is None else Requirement(tolerance_px=tolerance_px)
    eyes = None
    if viewer is not None:
        how: dict[str, Any] = {"sample": sample, "progress": progress}
        eyes = planning.make_viewer_plan(scouted, viewer, Requirement(), choices, **how)
    # Who judges decides what depth is asked for: eyes tell fewer depths apart than a plan for
    # pixels orders.
    judging = requirement if eyes is None or tolerance_px is not None else eyes.requirement
    reference = Reference(scene)
    planner = PlatePlanner(
        reference=reference, scouted=scouted, requirement=requirement, choices=()
    )
    views = planner.first_views()
    found = Recommendation(
        scene=scene,
        scouted=scouted,
        requirement=requirement,
        pixels=planning.planned(scouted, requirement, choices, sample, progress),
        eyes=eyes,
        pixels_count=tolerance_px is not None,
        buffers=(),
        hogel_limits=traced_limits(
            reference,
            scouted,
            hogel_limits(scouted, requirement.tolerance_px),
            requirement.tolerance_px,
        ),
    )
    compared = [*(COMPARED_BUFFERS if choices is None or len(choices) > MAX_COMPARED else choices)]
    if (
        settings := found.chosen.settings
    ) is not None and found.chosen.depth_buffer not in compared:
        compared.append((settings.depth, settings.mapping))
    return replace(found, buffers=buffer_limits(views, scouted, judging, compared))


def table(found: Recommendation) -> str:
    """Return the answer as text: the paragraph, what each judge allows, and the commands."""
    head = ("", f"near from, {found.scene.units}", f"up to, {found.scene.units}", "")
    rows = aligned([head, *(one.cells for one in _allowed(found))])
    size = [found.size_words] if found.commands else []
    return "\n".join([planning.filled(found.paragraph), "", rows, "", *size, *found.commands])


class Allowed(NamedTuple):
    """The nears that one judge allows by itself, scene units; `low` is infinite where it allows none."""

    name: str
    low: float = 0.0
    high: float = math.inf
    binds: bool = False

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """It as people read it: an end that bounds nothing is left out."""
        low = "none" if math.isinf(self.low) else digits(self.low) if self.low else ""
        high = "" if math.isinf(self.high) else digits(self.high)
        return self.name, low, high, "binds" if self.binds else ""


def _allowed(found: Recommendation) -> list[Allowed]:
    """Return what each judge allows, for the table and the figure."""
    rows = []
    if found.pixel_limit is not None:
        name = f"pixels, {found.requirement.tolerance_px:g} px at the worst hogel"
        rows.append(Allowed(name, high=found.pixel_limit, binds=found.binds == PIXELS))
    if found.eyes is not None:
        for one in found.eyes.requirement.limits:
            high = math.inf if one.largest_near is None else one.largest_near
            binds = found.binds == EYE and one == found.eye_limit
            rows.append(Allowed(f"eyes, {LIMIT_WORDS[one.name]}", high=high, binds=binds))
    for buffer in found.buffers:
        low = (
            0.0
            if buffer.any_near
            else math.inf
            if buffer.smallest_near is None
            else buffer.smallest_near
        )
        rows.append(Allowed(f"depth buffer, {str(buffer.depth).upper()} {buffer.mapping}", low))
    return rows


def write_recommendation(found: Recommendation, out: Path) -> tuple[Path, ...]:
    """Write the page and recommend.json, all or nothing."""
    figures, rows = {"limits": limits_figure(found)}, [one.cells for one in _allowed(found)]
    if np.isfinite(found.hogel_limits).any():
        figures["map"] = map_figure(found)
    values = {"found": found, "figures": figures, "rows": rows, "versions": versions()}
    return write_files(out, {PAGE: html_page("recommend.html.j2", values), DATA: found.summary()})


def limits_figure(found: Recommendation) -> Figure:
    """Draw the nears that each judge allows as bars on a logarithmic axis, and the chosen one as a line."""
    reach, near, rows = found.scene.frustum.longest_reach, found.chosen.near, _allowed(found)
    ends = [end for row in rows for end in (row.low, row.high) if 0 < end < math.inf]
    low = min([*ends, near or reach]) / 30
    bars = [
        (
            row.name.replace(", ", ",<br>"),
            row.low or low,
            reach if math.isinf(row.high) else row.high,
        )
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
            "title": f"near, {found.scene.units}",
            **log_axis([low, reach]),
            "dtick": max(1, round(math.log10(reach / low) / 5)),
            "range": [math.log10(low), math.log10(reach)],
        },
        "yaxis": {"type": "category", "autorange": "reversed"},
        "shapes": [] if near is None else [{**line, "line": {"color": MARK, "width": 2}}],
    }
    return styled([bar], layout)


def map_figure(found: Recommendation) -> Figure:
    """Draw the largest near that each hogel allows over the plate, on a logarithmic color scale."""
    plate, units = found.scene.plate, found.scene.units
    places = [one.index for one in found.scouted.apertures]
    values, looked = plate_cells(plate.hogels, places, found.hogel_limits, np.fmin)
    title = f"largest near that keeps {found.requirement.tolerance_px:g} px, {units}"
    figure = plate_map(plate, values, title, known=looked, logarithmic=True)
    figure["data"][0] |= {"colorscale": "Viridis", "reversescale": True}
    return figure
