"""`xfrustum study noticeable`: near offsets and depth buffers that viewers notice.

Closed forms evaluate every plate, distance, pivot, near and depth buffer; some of these cells are
also replayed to two eyes. Lengths are in millimeters, the unit of the scenes.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import groupby, pairwise, product
from pathlib import Path
from typing import Any

import numpy as np

from xfrustum.compare import noticeable
from xfrustum.compare.planning.requirement import SEPARATION_PER_REACH, seen_content
from xfrustum.compare.prediction.depth import smallest_separation
from xfrustum.compare.scout import PlateScan, scout
from xfrustum.reports.blocks import HERE, Engine, open_workers
from xfrustum.reports.common.outputs import json_object, json_ready, progress_bar
from xfrustum.reports.common.templates_environment import plain_text
from xfrustum.research.replays import ReplayWorkbench
from xfrustum.research.sweep import Origin, StudyFiles, Sweep, check_folder, write_study
from xfrustum.scenes import DepthFormat, DepthMapping, DoubleFrustum, Pivot, Scene, open_scene
from xfrustum.scenes.representation import digits
from xfrustum.tolerances import TOLERANCE_PX

DEFAULT_FOLDER = Path("study") / "noticeable"
#: viewing distance in the summary, mm: an arm's length, as in reading a page
USUAL_DISTANCE = 600.0
#: smallest predicted change of disparity at which a replay is compared, a twentieth of stereo
#: acuity
SEEN_ARCSEC = 1.0

#: Number of replayed pixels. If only one is wrong by depth, the exact bound of Clopper and Pearson
#: at 95 % is at most `tolerances.MAX_DEPTH_WRONG`, 0.1 %. If no pixel is wrong, 2,995 pixels would
#: suffice.
PIXELS = 4742


@dataclass(frozen=True)
class Cell:
    """One combination: a viewer, a plate of some pitch, and the settings that draw it."""

    scene: str
    pitch: float
    distance: float
    near: float
    depth: DepthFormat
    mapping: DepthMapping
    pivot: Pivot

    viewer = property(lambda self: noticeable.Viewer(distance=self.distance))
    seat = property(lambda self: (self.scene, self.pitch, self.distance))
    case = property(
        lambda self: (*self.seat, self.pivot, self.depth, self.mapping)
    )  # everything but near

    @property
    def settings(self) -> DoubleFrustum:
        """Settings of the rasterizer."""
        return DoubleFrustum(
            near=self.near, depth=self.depth, mapping=self.mapping, pivot=self.pivot
        )

    def opened(self) -> Scene:
        """Return the scene with hogels of this pitch, as nearly as the plate's size allows."""
        scene = open_scene(self.scene)
        width, height = scene.plate.size
        hogels = (round(width / self.pitch), round(height / self.pitch))
        return replace(scene, plate=replace(scene.plate, hogels=hogels))


@dataclass(frozen=True, kw_only=True)
class Replay:
    """Measures of a replay to two eyes; None if a cell was not replayed."""

    #: change of disparity
    replayed_stereo_arcsec: float | None = None
    #: number of points visible to both eyes
    replayed_points: int | None = None
    #: share of pixels with wrong surfaces
    replayed_wrong: float | None = None
    #: share of pixels whose surface is wrong, but right with exact depth
    replayed_depth_wrong: float | None = None
    #: number of pixels to which the shares refer
    replayed_pixels: int | None = None


@dataclass(frozen=True, kw_only=True)
class Row(Replay, Cell):
    """A cell with its results; lengths in millimeters."""

    #: largest change of disparity between two visible points
    stereo_arcsec: float
    #: width of the crack in surfaces that run through the plate; None without such surfaces
    crack_arcmin: float | None
    #: largest unnoticed width of a crack
    crack_hidden_arcmin: float
    crack_hidden_by: str
    #: smallest separation that the depth buffer orders at the farthest visible surfaces
    ordered_separation: float
    #: smallest separation at these surfaces that both the viewer and the display resolve
    resolved_separation: float
    resolved_by: str
    #: p99 of displacement at the median and at the worst aperture, pixels; None if infinite
    pixels_median: float | None
    pixels_worst: float | None
    #: share of apertures whose displacement exceeds `TOLERANCE_PX`
    pixels_beyond: float
    #: separation required by `plan` without a viewer
    asked_separation: float
    #: distance from the eyes to the nearest surface in front of the plate, or to the plate
    nearest_distance: float
    #: whether the frustum is recentered and the pivot is `aperture`
    sheared: bool

    @property
    def offset_seen(self) -> bool:
        """True if the viewer notices the near offset, by depth or by a crack."""
        by_depth = self.stereo_arcsec > noticeable.STEREO_ACUITY_ARCSEC
        return by_depth or (self.crack_arcmin or 0.0) > self.crack_hidden_arcmin


@dataclass(frozen=True, kw_only=True)
class Study:
    """Every combination is evaluated in closed form; some cells are also replayed."""

    scenes: tuple[
        tuple[str, tuple[Pivot, ...]], ...
    ]  # names of scenes, with the pivots of each scene
    nears: tuple[float, ...]
    buffers: tuple[tuple[DepthFormat, DepthMapping], ...]
    pitches: tuple[float, ...]
    distances: tuple[float, ...]
    #: nears that are replayed with all depth buffers at the middle pitch and distance
    replayed_nears: tuple[float, ...]
    pixels: int = PIXELS

    def cells(self) -> Iterator[Cell]:
        """Yield every cell, scene by scene."""
        for name, pivots in self.scenes:
            cells = product(pivots, self.pitches, self.distances, self.nears, self.buffers)
            for pivot, pitch, distance, near, buffer in cells:
                yield Cell(name, pitch, distance, near, *buffer, pivot)

    def replayed(self, cells: Sequence[Cell], rows: Sequence[Row]) -> list[int]:
        """Return the indices of replayed cells: decisive cells, and cells with `replayed_nears`.

        The largest near whose offset is not noticed decides a case: larger nears are noticed, and
        with smaller nears more pixels are wrong by depth.
        """
        middle = self.pitches[len(self.pitches) // 2], self.distances[len(self.distances) // 2]
        decisive, anyway = dict[object, int](), set[int]()
        for index, (cell, row) in enumerate(zip(cells, rows, strict=True)):
            # The largest unnoticed near decides its case.
            if not row.offset_seen and row.near > rows[decisive.setdefault(cell.case, index)].near:
                decisive[cell.case] = index
            if (cell.pitch, cell.distance) == middle and cell.near in self.replayed_nears:
                anyway.add(index)
        return sorted(anyway | set(decisive.values()))


_NEARS = tuple(float(f"{near:.3g}") for near in np.geomspace(10.0, 1e-3, 9))

FULL = Study(
    scenes=(
        ("car", (Pivot.APERTURE,)),
        ("asymmetric", (Pivot.APERTURE,)),
        ("car-recentered", (Pivot.APERTURE, Pivot.CAMERA)),
        ("car-transfer", (Pivot.APERTURE, Pivot.CAMERA)),
    ),
    nears=_NEARS,
    buffers=(
        (DepthFormat.D16, DepthMapping.STANDARD),
        (DepthFormat.D24, DepthMapping.STANDARD),
        (DepthFormat.D32F, DepthMapping.REVERSED),
    ),
    pitches=(0.25, 0.5, 1.0),
    distances=(300.0, 600.0, 1200.0),
    replayed_nears=(_NEARS[1], _NEARS[3], _NEARS[5]),
)
QUICK = replace(
    FULL,
    scenes=FULL.scenes[1:2],
    nears=_NEARS[1:6:2],
    pitches=(1.0,),
    distances=(600.0,),
    buffers=(FULL.buffers[0], FULL.buffers[2]),
    pixels=384,
)


@cache
def _scouted(name: str) -> PlateScan:
    return scout(open_scene(name))


@cache
def _displacements(name: str, near: float, pivot: Pivot) -> Any:
    return _scouted(name).displacements(DoubleFrustum(near=near, pivot=pivot))


def predicted(cell: Cell) -> Row:
    """Return the row of a cell by closed forms, without a replay."""
    scouted, display, settings = (
        _scouted(cell.scene),
        noticeable.Display.from_scene(cell.opened()),
        cell.settings,
    )
    content, frustum = seen_content(scouted), scouted.scene.frustum
    hidden_by, hidden, width = noticeable.resolved_crack(cell.viewer, display, settings)
    resolved = noticeable.finest_separation(content.farthest, cell.viewer, display)
    assert resolved is not None
    moved = _displacements(cell.scene, cell.near, cell.pivot)
    # Infinite where a surface passes through the aperture.
    median, worst = float(np.median(moved)), float(moved.max())
    # The depth buffer is coarsest at the farthest surface of each side.
    ordered = [0.0]
    for height in content.farthest:
        far = cell.near + frustum.reach[0 if height > 0 else 1]
        w = np.array(abs(height) + cell.near)
        ordered.append(float(smallest_separation(w, cell.near, far, cell.depth, cell.mapping)))
    return Row(
        **vars(cell),
        stereo_arcsec=noticeable.stereo_change_arcsec(content, cell.viewer, display, settings),
        crack_arcmin=width if content.through else None,
        crack_hidden_arcmin=hidden,
        crack_hidden_by=hidden_by,
        ordered_separation=max(ordered),
        resolved_separation=resolved[1],
        resolved_by=resolved[0],
        pixels_median=median if math.isfinite(median) else None,
        pixels_worst=worst if math.isfinite(worst) else None,
        pixels_beyond=float((moved > TOLERANCE_PX).mean()),
        asked_separation=SEPARATION_PER_REACH * frustum.longest_reach,
        nearest_distance=cell.distance - (0.0 if content.before is None else content.before[1]),
        sheared=frustum.recentered and cell.pivot is Pivot.APERTURE,
    )


def replay(cells: Sequence[Cell], pixels: int = PIXELS) -> Iterator[Replay]:
    """Yield the replays of cells of one viewing position; true views are traced once."""
    scene = cells[0].opened()
    workbench = ReplayWorkbench(scene, cells[0].viewer, film_columns(scene.plate.size, pixels))
    for shown in (workbench.measure(cell.settings) for cell in cells):
        yield Replay(
            replayed_stereo_arcsec=shown.disparity_change_arcsec,
            replayed_points=shown.matched,
            replayed_wrong=shown.wrong,
            replayed_depth_wrong=shown.depth_wrong,
            replayed_pixels=shown.judged,
        )


def film_columns(size: tuple[float, float], pixels: int) -> int:
    """Return the fewest columns of an eye's film for which two eyes have `pixels` pixels."""
    width, height = size
    # Start just below the solution of 2 columns rows = pixels.
    columns = max(1, math.isqrt(round(pixels / 2 * width / height)) - 1)
    while 2 * columns * max(1, round(columns * height / width)) < pixels:
        columns += 1
    return columns


def make_study(
    out: Path = DEFAULT_FOLDER,
    study: Study = FULL,
    engine: Engine = HERE,
    *,
    progress: bool = False,
) -> StudyFiles | None:
    """Make a study and write its document and data; this process evaluates the closed forms.

    A block of replays that is in the folder already, from the same libraries and device, is not
    made again. Returns None if other parts of a job array are not replayed yet.
    """
    sweep = Sweep.from_measure(
        f"noticeable-{study.pixels}", out, Replay, partial(replay, pixels=study.pixels)
    )
    check_folder(out, "noticeable")
    cells = list(study.cells())
    with progress_bar(len(cells), "closed forms", "cell", shown=progress) as bar:
        bar.iterable = cells
        rows = list(map(predicted, bar))
    chosen = sorted(
        study.replayed(cells, rows), key=lambda i: (cells[i].seat, cells[i].pivot, -cells[i].near)
    )
    seats = groupby((cells[index] for index in chosen), key=lambda cell: cell.seat)
    blocks = [tuple(group) for _, group in seats]
    with open_workers(engine, len(blocks)) as workers:
        replays = sweep.rows(blocks, workers, engine.part, progress=progress)
    if replays is None:
        return None
    for index, shown in zip(chosen, replays, strict=True):
        rows[index] = replace(rows[index], **vars(shown))
    return write_study(out, "noticeable", rows, sweep.origin, document)


def record(files: StudyFiles) -> dict[str, Any]:
    """Return the study as `xfrustum study noticeable --json` prints it."""
    rows = files.rows
    own = [row for row in rows if row.replayed_stereo_arcsec is not None]
    ratios = [
        r.replayed_stereo_arcsec / r.stereo_arcsec for r in own if r.stereo_arcsec >= SEEN_ARCSEC
    ]
    answer = {
        **files.record,
        "sentence": sentence(rows),
        "thresholds": thresholds(rows),
        "quarters": quarters(rows),
        "replays": len(own),
        "replayed_over_predicted": (min(ratios, default=math.nan), max(ratios, default=math.nan)),
        "disagreement": disagreement(rows),
    }
    return json_object(answer)


def sentence(rows: Sequence[Row]) -> str:
    """Return the result in one sentence."""
    usual = min({row.distance for row in rows}, key=lambda distance: abs(distance - USUAL_DISTANCE))
    viewer = noticeable.Viewer(distance=usual)
    # L^2/n of the rule, without the small second-order term.
    metres = 2 * viewer.eyes_apart_mm / math.radians(viewer.stereo_acuity_arcsec / 3600) / 1000
    return (
        f"From {usual:g} mm nobody notices a near offset of up to {digits(rule_near(usual))} mm "
        f"at the plate: n = L^2 / ({metres:.3g} m) at the distance L, whatever resolution and "
        "depth are."
    )


def rule_near(distance: float) -> float:
    """Return the largest near whose gap changes disparity by no more than stereo acuity, mm."""
    viewer = noticeable.Viewer(distance=distance)
    acuity, apart = math.radians(viewer.stereo_acuity_arcsec / 3600), viewer.eyes_apart_mm
    return acuity * distance**2 / (apart + math.hypot(apart, acuity * distance))


def largest_near(rows: Iterable[Row], name: str, limit: float) -> float | None:
    """Return the near at which an increasing field reaches its limit, interpolating logarithms.

    None if the smallest near already exceeds the limit, infinite if the largest near does not.
    """
    line = sorted({row.near: row for row in rows}.values(), key=lambda row: row.near)
    ratios = [math.inf if (value := getattr(row, name)) is None else value / limit for row in line]
    if ratios[0] > 1:
        return None
    for (low, below), (high, above) in pairwise(zip(line, ratios, strict=True)):
        if above > 1:
            if math.isinf(above) or below == 0:
                return low.near
            # Power laws are lines on logarithmic scales: interpolate logarithms.
            share = -math.log(below) / math.log(above / below)
            return math.exp((1 - share) * math.log(low.near) + share * math.log(high.near))
    return math.inf


def thresholds(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the largest unnoticed nears, mm, of each scene and pivot, and the limits by pixels."""
    limits = []
    for scene, pivot in dict.fromkeys((row.scene, row.pivot) for row in rows):
        own = [row for row in rows if (row.scene, row.pivot) == (scene, pivot)]
        stereo = {}
        for distance in dict.fromkeys(row.distance for row in own):
            some = [row for row in own if row.distance == distance]
            stereo[f"{distance:g}"] = largest_near(
                some, "stereo_arcsec", noticeable.STEREO_ACUITY_ARCSEC
            )
        pixels = {
            name: largest_near(own, name, TOLERANCE_PX)
            for name in ("pixels_worst", "pixels_median")
        }
        limits.append({"scene": scene, "pivot": pivot, "stereo": stereo, **pixels})
    return limits


def quarters(rows: Sequence[Row]) -> list[dict[str, float]]:
    """Return the failures of the rule near <= pitch / 4 at every distance.

    `near` is the largest unnoticed near, `pitch` the largest pitch whose quarter is unnoticed. The
    rule allows `kept` combinations of plate and near; viewers notice `failed` of these.
    """
    results = []
    for distance in sorted({row.distance for row in rows}):
        own = [row for row in rows if row.distance == distance and row.near <= row.pitch / 4]
        kept = {(row.scene, row.pivot, row.pitch, row.near): row.offset_seen for row in own}
        near, counts = rule_near(distance), {"kept": len(kept), "failed": sum(kept.values())}
        results.append({"distance": distance, "near": near, "pitch": 4 * near, **counts})
    return results


def disagreement(rows: Sequence[Row]) -> dict[str, int]:
    """Count settings beyond the limit of pixels, of eyes, of both or of neither, in closed form."""
    own = {(r.scene, r.pivot, r.pitch, r.distance, r.near): r for r in rows}.values()
    seen = [
        (row.pixels_worst is None or row.pixels_worst > TOLERANCE_PX, row.offset_seen)
        for row in own
    ]
    kinds = {"pixels_only": (True, False), "eyes_only": (False, True)}
    kinds |= {"both": (True, True), "neither": (False, False)}
    return {name: seen.count(kind) for name, kind in kinds.items()}


def document(rows: Sequence[Row], origin: Origin) -> str:
    """Return the study as Markdown."""
    values = {
        "sentence": sentence(rows),
        "thresholds": json_ready(thresholds(rows)),
        "quarters": quarters(rows),
        "disagreement": disagreement(rows),
        "cells": len(rows),
        "replays": sum(row.replayed_pixels is not None for row in rows),
        "devices": origin.devices,
    }
    length = {"length": lambda near: "-" if near is None else digits(near)}
    return plain_text("noticeable.md.j2", values, length)
