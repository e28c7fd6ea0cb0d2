"""Answer the study's questions: closed forms for all cells, and replays of those that are not yet on disk."""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby
from typing import ClassVar

import numpy as np
from pydantic import TypeAdapter

from xfrustum.compare.eye.noticeable import (
    Content,
    Display,
    finest_separation,
    resolved_crack,
    stereo_change_arcsec,
)
from xfrustum.compare.planning.viewer import seen_content
from xfrustum.compare.planning.views import SEPARATION_PER_REACH
from xfrustum.compare.prediction.depth import smallest_separation
from xfrustum.compare.scouting.scout import Scout, scout
from xfrustum.reports.cluster.run import Part, Team
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.eye.replayed import Replayed, ReplayWorkbench
from xfrustum.reports.noticeable_study.grid import Cell, Grid
from xfrustum.reports.noticeable_study.rows import Measured, NoticedRow, Predicted, decisive
from xfrustum.reports.studies.cells import CellsJob, all_measured, measure_part
from xfrustum.reports.studies.store import Store
from xfrustum.scenes import open_scene
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum, Pivot
from xfrustum.tolerances import TOLERANCE_PX

REPLAYS = "replay"
"""Kind of the results in the store."""

REPLAYING_MODULES = ("noticeable_study/run.py", "eye/replayed.py", "eye/sources.py", "eye/viewing.py")
"""Modules of `reports` whose sources decide what a replay shows."""


@dataclass(frozen=True, kw_only=True)
class ReplayJob(CellsJob[Cell]):
    """Replays of some cells.

    Attributes
    ----------
    cells
        The cells that are replayed.
    grid
        Grid that they belong to, which says how many pixels the films have.
    """

    cells: tuple[Cell, ...]
    grid: Grid
    kind: str = REPLAYS
    unit: ClassVar[str] = "plate"

    @property
    def name(self) -> str:
        """Word by which the dashboard groups its tasks."""
        return "study-replay"

    @property
    def modules(self) -> Sequence[str]:
        """Modules of `reports` whose sources decide what a replay shows."""
        return REPLAYING_MODULES

    @property
    def blocks(self) -> tuple[tuple[Cell, ...], ...]:
        """The cells of each block: those of one seat, whose true views are traced once."""
        return _seats(self.cells)

    def key(self, cell: Cell) -> str:
        """Return the parameters of a cell, and the pixels of its films."""
        return f"{self.grid.pixels} {cell.key}"

    def measured(self, cells: Sequence[Cell]) -> Generator[Replayed]:
        """Yield the replays of some cells of one seat."""
        seat = cells[0].seat
        scene = seat.opened()
        workbench = ReplayWorkbench(scene, seat.viewer, self.grid.columns(scene.plate.size))
        for cell in cells:
            yield workbench.measure(cell.settings)


@lru_cache(maxsize=4)
def _seats(cells: tuple[Cell, ...]) -> tuple[tuple[Cell, ...], ...]:
    """Return some cells by seat and pivot, from the largest near of each down."""
    ordered = sorted(cells, key=_seat_and_near)
    return tuple(tuple(group) for _, group in groupby(ordered, key=lambda cell: cell.seat))


def _seat_and_near(cell: Cell) -> tuple[str, float, float, str, float]:
    """Return what cells are sorted by: those of one seat together, and of one near among them."""
    return cell.scene, cell.pitch, cell.distance, cell.pivot, -cell.near


def measure(
    grid: Grid, asking: ReplayJob, team: Team, part: Part, *, progress: bool = False
) -> tuple[NoticedRow, ...] | None:
    """Answer for every cell, and replay those that are not on disk.

    Parameters
    ----------
    grid
        What to ask.
    asking
        Job of these processes for any cells of the grid.
    team, part
        Processes that replay, and part of the seats that they replay.
    progress
        Show progress bars on standard error.

    Returns
    -------
    One row per cell in the grid's order; None where other parts are not replayed yet.
    """
    cells = list(grid.cells())
    rows = predicted_rows(cells, progress=progress)
    chosen = to_replay(grid, cells, rows)
    job = replace(asking, cells=tuple(cells[index] for index in chosen))
    measure_part(job, team, part, "replays", progress=progress)
    if not all_measured(job):
        return None
    with Store(job.path, job.origin) as store:
        found, reader = store.get(REPLAYS), TypeAdapter(Replayed)
    for index in chosen:
        replay = reader.validate_python(found[job.key(cells[index])])
        rows[index] = replace(rows[index], **vars(_measured(replay)))
    return tuple(rows)


def predicted_rows(cells: Sequence[Cell], *, progress: bool = False) -> list[NoticedRow]:
    """Return what closed forms say of some cells."""
    rows, forms = [], ClosedForms()
    with progress_bar(len(cells), "closed forms", "cell", shown=progress) as bar:
        for cell in cells:
            rows.append(NoticedRow(**vars(cell), **vars(forms.predicted(cell))))
            bar.update()
    return rows


def to_replay(grid: Grid, cells: Sequence[Cell], rows: Sequence[NoticedRow]) -> list[int]:
    """Return the indices of the cells that are replayed: those that decide, and those that are anyway."""
    decides = decisive(rows)
    return [index for index, cell in enumerate(cells) if index in decides or grid.is_replayed_anyway(cell)]


def _measured(replay: Replayed) -> Measured:
    return Measured(
        replayed_stereo_arcsec=replay.disparity_change_arcsec,
        replayed_points=replay.matched,
        replayed_wrong=replay.wrong,
        replayed_depth_wrong=replay.depth_wrong,
        replayed_pixels=replay.judged,
    )


class ClosedForms:
    """What viewers notice and what hogels' pixels show, in closed form; each plate is looked over once."""

    def __init__(self) -> None:
        self._scouts: dict[str, Scout] = {}
        self._displays: dict[tuple[str, float], Display] = {}
        self._moved: dict[tuple[str, DoubleFrustum], Floats] = {}

    def predicted(self, cell: Cell) -> Predicted:
        """Return the answers for a cell."""
        scouted, display, settings = self._scouted(cell.scene), self._display(cell), cell.settings
        content = seen_content(scouted)
        hidden_by, hidden, width = resolved_crack(cell.viewer, display, settings)
        resolved = finest_separation(content.farthest, cell.viewer, display)
        assert resolved is not None
        frustum = scouted.scene.frustum
        before = 0.0 if content.before is None else content.before[1]
        moved = self._displacements(cell.scene, DoubleFrustum(near=cell.near, pivot=cell.pivot))
        median, worst = float(np.median(moved)), float(moved.max())
        return Predicted(
            stereo_arcsec=stereo_change_arcsec(content, cell.viewer, display, settings),
            crack_arcmin=width if content.through else None,
            crack_hidden_arcmin=hidden,
            crack_hidden_by=hidden_by,
            ordered_separation=ordered_separation(scouted.scene, content, settings),
            resolved_separation=resolved[1],
            resolved_by=resolved[0],
            pixels_median=median if math.isfinite(median) else None,
            pixels_worst=worst if math.isfinite(worst) else None,
            pixels_beyond=float((moved > TOLERANCE_PX).mean()),
            asked_separation=SEPARATION_PER_REACH * frustum.longest_reach,
            nearest_distance=cell.distance - before,
            sheared=frustum.recentered and cell.pivot is Pivot.APERTURE,
        )

    def _scouted(self, name: str) -> Scout:
        if name not in self._scouts:
            self._scouts[name] = scout(open_scene(name))
        return self._scouts[name]

    def _display(self, cell: Cell) -> Display:
        plate = cell.scene, cell.pitch
        if plate not in self._displays:
            self._displays[plate] = Display.of(cell.opened())
        return self._displays[plate]

    def _displacements(self, name: str, settings: DoubleFrustum) -> Floats:
        """Return the 99th percentile of displacement of every aperture that was looked through, pixels."""
        if (name, settings) not in self._moved:
            self._moved[name, settings] = self._scouted(name).displacements(settings)
        return self._moved[name, settings]


def ordered_separation(scene: Scene, content: Content, settings: DoubleFrustum) -> float:
    """Return the smallest separation that is ordered at the farthest visible surfaces, the worse side."""
    near, found = settings.near, [0.0]
    for height in content.farthest:
        reach = scene.frustum.reach[0] if height > 0 else scene.frustum.reach[1]
        w = np.array(abs(height) + near)
        found.append(float(smallest_separation(w, near, near + reach, settings.depth, settings.mapping)))
    return max(found)
