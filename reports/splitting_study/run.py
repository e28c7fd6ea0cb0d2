"""Measure the study's cells, those that are not yet on disk, in blocks that any process may do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cache, lru_cache
from itertools import groupby
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.cluster.claims import Claims
from xfrustum.reports.cluster.job import Job, Session
from xfrustum.reports.cluster.run import Part, Team, run_blocks
from xfrustum.reports.common import provenance
from xfrustum.reports.splitting_study.grid import SIDES, Cell, Family, Grid, SheetCell
from xfrustum.reports.splitting_study.measure import (
    CellResult,
    PictureWorkbench,
    SheetResult,
    SheetWorkbench,
)
from xfrustum.reports.splitting_study.rows import StudyRow, joined
from xfrustum.reports.splitting_study.store import CLAIMS, PICTURES, SHEETS, Store, origin_hash
from xfrustum.reports.splitting_study.suitability import (
    Suitability,
    alike_but_depth,
    case_of,
    outcomes,
    straight_nears,
    suitability,
)
from xfrustum.reports.studies.origin import Origin
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.library.depth_family import CAR_RATIO, FARTHEST, REACH, cars
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Camera, Offset

MAX_SLABS = 6
"""Slabs on one side that are tried before a case is given up."""

FIRST_CUT_PER_NEAREST = 0.99
"""The first cut as a share of the nearest surface's |z|: close under it, so that the first slab is empty."""

CLAIMS_PER_JOB = 1 << 20
"""Claims that are set aside for the blocks of one job: no job has as many."""


@dataclass(frozen=True, kw_only=True)
class Cells:
    """Cells that are listed, as a `Grid` of its own."""

    listed: tuple[Cell, ...]

    def cells(self) -> Iterator[Cell]:
        """Yield every cell."""
        yield from self.listed


@dataclass(frozen=True, kw_only=True)
class StudyJob(Job):
    """Pictures or sheets of some cells.

    Attributes
    ----------
    asked
        The cells.
    kind
        Kind of results: `PICTURES` or `SHEETS`.
    stage
        Number of cuts of the cells, 0 for those of the grid, by which clients claim blocks.
    path
        File of the results, see `Store`.
    origin
        Hash of what measures, see `origin_hash`; a process that would measure with something else refuses.
        Empty for a job that only asks what that is.
    """

    asked: Grid | Cells
    kind: str
    stage: int
    path: Path
    origin: str

    @property
    def name(self) -> str:
        """Word by which the dashboard groups its tasks."""
        return f"study-{self.kind}"

    @property
    def unit(self) -> str:  # type: ignore[override]  # one class measures both kinds
        """Word for one cell, for the bar."""
        return "picture" if self.kind == PICTURES else "buffer"

    @property
    def blocks(self) -> tuple[tuple[Cell, ...] | tuple[SheetCell, ...], ...]:
        """The cells of each block: those that share what takes longest to make."""
        return _picture_blocks(self.asked) if self.kind == PICTURES else _sheet_blocks(self.asked)

    def size(self, number: int) -> int:
        """Return the number of cells of a block."""
        return len(self.blocks[number])

    def words(self, number: int) -> str:
        """Return a block by its first cell."""
        return f"block {number} of {self.kind} ({self.blocks[number][0].key})"

    def finished(self, number: int) -> bool:
        """Return whether all results of a block are kept."""
        if not self.path.exists():
            return False
        with Store(self.path, self.origin) as store:
            return not self.missing(number, store)

    def missing(self, number: int, store: Store) -> list[Cell | SheetCell]:
        """Return the cells of a block that have no result."""
        known = store.keys(self.kind)
        return [cell for cell in self.blocks[number] if cell.key not in known]

    def claims(self) -> Claims:
        """Return the claims to blocks of this kind and stage."""
        first = (2 * self.stage + (self.kind == PICTURES)) * CLAIMS_PER_JOB
        return Claims(self.path.with_name(CLAIMS), first)

    @contextmanager
    def open(self, scene: Scene | None = None) -> Iterator[StudySession]:
        """Provide what measures blocks; scenes are made from the cells.

        Raises
        ------
        InputError
            This process would measure with other sources, libraries or another device; or it has no usable
            OpenGL.
        """
        del scene
        origin = measured_by()
        if self.origin and origin_hash(origin) != self.origin:
            raise InputError(
                f"a worker measures with other sources, libraries or another device than the study was begun "
                f"with ({origin.devices.get('OpenGL renderer')}); give all workers the same"
            )
        yield StudySession(self, origin)


class StudySession(Session):
    """What measures the blocks of one job.

    Attributes
    ----------
    origin
        What this process measures with.
    """

    def __init__(self, job: StudyJob, origin: Origin) -> None:
        self._job, self.origin = job, origin

    def make(self, number: int) -> None:
        """Measure what is missing of a block; each result is kept as soon as it is there."""
        job = self._job
        with Store(job.path, job.origin) as store:
            missing = job.missing(number, store)
            if pictures := [cell for cell in missing if isinstance(cell, Cell)]:
                with PictureWorkbench(pictures[0].picture) as pictured:
                    for cell in pictures:
                        store.put(PICTURES, cell.key, asdict(pictured.measure(cell)))
            if sheets := [cell for cell in missing if isinstance(cell, SheetCell)]:
                with SheetWorkbench(sheets[0]) as ordered:
                    for pair in sheets:
                        store.put(SHEETS, pair.key, asdict(ordered.measure(pair)))


def origin_of(session: StudySession) -> Origin:
    """Return what a process measures with; the question that a team of workers is asked."""
    return session.origin


@cache
def measured_by() -> Origin:
    """Return the versions and the device that would measure here and now.

    Raises
    ------
    InputError
        No usable OpenGL context.
    """
    scene = cars(CAR_RATIO, Camera.C, (1, 1))
    with Rasterizer(scene) as rasterizer:
        opengl = {f"OpenGL {name}": value for name, value in rasterizer.device.items()}
    versions = {**provenance.versions(), **Reference(scene).versions}
    return Origin(versions=versions, devices={**provenance.machine(), **opengl})


def sheets_of(cell: Cell) -> tuple[SheetCell, ...]:
    """Return the sheets that belong to a cell: those of each of its cameras, its near and depth buffer.

    The distance from a camera, and with it the stored depth, depends on neither shear nor fit.
    """
    sides = SIDES if cell.side is Camera.BOTH else (cell.side,)
    return tuple(
        SheetCell(
            side=side,
            near=cell.near,
            depth=cell.depth,
            mapping=cell.mapping,
            slabs=cell.slabs,
            offset=cell.offset,
        )
        for side in sides
    )


@lru_cache(maxsize=4)
def _picture_blocks(asked: Grid | Cells) -> tuple[tuple[Cell, ...], ...]:
    """Return the cells of each picture, whose truth is traced once."""
    return tuple(tuple(group) for _, group in groupby(asked.cells(), key=lambda cell: cell.picture))


@lru_cache(maxsize=4)
def _sheet_blocks(asked: Grid | Cells) -> tuple[tuple[SheetCell, ...], ...]:
    """Return the sheets of each camera and each place of it, which are uploaded once."""
    sheets = dict.fromkeys(sheets for cell in asked.cells() for sheets in sheets_of(cell))
    return tuple(tuple(group) for _, group in groupby(sorted(sheets, key=_far_camera), key=_far_camera))


def _far_camera(cell: SheetCell) -> tuple[Camera, float]:
    """Return which camera draws the far end, and how far it stands back as a share of the reach."""
    return cell.side, 0.0 if cell.slabs or cell.offset is Offset.NONE else cell.near


@dataclass(frozen=True, kw_only=True)
class Measuring:
    """A study under way.

    Attributes
    ----------
    team
        Processes that measure.
    part
        Part of the grid's cells that is measured here.
    path, origin
        File of the results, and hash of what measures; see `Store`.
    progress
        Whether to draw bars on standard error.
    """

    team: Team
    part: Part
    path: Path
    origin: str
    progress: bool = False

    def rows(self, grid: Grid) -> tuple[StudyRow, ...] | None:
        """Measure every cell of a grid, and slabs where no near is enough.

        Returns
        -------
        One row per cell in the grid's order, then those with slabs; None where other parts of the grid are
        not measured yet. Whoever finds all of them measured goes on with the slabs.
        """
        if not self._measured(grid, 0, self.part):
            return None
        rows = self._rows(list(grid.cells()))
        return rows + self._split(rows)

    def _measured(self, asked: Grid | Cells, stage: int, part: Part) -> bool:
        """Measure what is missing of some cells, and return whether all of them are measured."""
        jobs = [
            StudyJob(asked=asked, kind=kind, stage=stage, path=self.path, origin=self.origin)
            for kind in (SHEETS, PICTURES)
        ]
        for job in jobs:
            numbers = [n for n in part.of(range(len(job.blocks))) if not job.finished(n)]
            total = sum(map(job.size, numbers))
            words = "pictures" if job.kind == PICTURES else "pairs of sheets"
            run_blocks(job, numbers, self.team, total, words, progress=self.progress and bool(numbers))
        return all(job.finished(number) for job in jobs for number in range(len(job.blocks)))

    def _rows(self, cells: Sequence[Cell]) -> tuple[StudyRow, ...]:
        with Store(self.path, self.origin) as store:
            pictures, sheets = store.get(PICTURES), store.get(SHEETS)
        picture, pair = TypeAdapter(CellResult), TypeAdapter(SheetResult)
        return tuple(
            joined(
                cell,
                picture.validate_python(pictures[cell.key]),
                [pair.validate_python(sheets[own.key]) for own in sheets_of(cell)],
            )
            for cell in cells
        )

    def _split(self, rows: Sequence[StudyRow]) -> tuple[StudyRow, ...]:
        """Measure one slab, then two, and so on, in all cases that no near can serve, until it is enough."""
        found: list[StudyRow] = []
        one_per_case = {case_of(row): row for row in rows}
        # Slabs have no gap at the plate: they are drawn with the offset.
        open_cases = [
            one_per_case[case]
            for case, outcome in outcomes(rows).items()
            if not outcome.one_pair and case.offset is Offset.PLATE
        ]
        for count in range(1, MAX_SLABS + 1):
            cells = [_cut(row, rows, count) for row in open_cases]
            # What follows from all cells of the grid is measured by whoever has seen them all.
            self._measured(Cells(listed=tuple(cells)), count, Part())
            tried = self._rows(cells)
            found += tried
            open_cases = [row for row in tried if suitability(row) is not Suitability.ENOUGH]
        return tuple(found)


def _cut(row: StudyRow, rows: Sequence[StudyRow], count: int) -> Cell:
    """Return a case with so many cuts, in equal ratios, from the first one up to the reach.

    The first cut lies just under the nearest surface, so that the slab that touches the plate is empty. Where
    a surface runs through the plate that slab never is: then the near is the largest that does not bend
    (`straight_near`), and it, the cuts and the reach form one sequence.
    """
    if row.family is Family.THROUGH:
        near = straight_near(row, rows)
        cuts = np.geomspace(near, 1.0, count + 2)[1:-1]
    else:
        near = FIRST_CUT_PER_NEAREST * FARTHEST / REACH / row.ratio
        cuts = np.geomspace(near, 1.0, count + 1)[:-1]
    return Cell(
        family=row.family,
        side=row.side,
        ratio=row.ratio,
        resolution=row.resolution,
        near=near,
        depth=row.depth,
        mapping=row.mapping,
        slabs=tuple(float(cut) for cut in cuts),
        pivot=row.pivot,
        fit=row.fit,
        refined=row.refined,
    )


def straight_near(row: StudyRow, rows: Sequence[StudyRow]) -> float:
    """Return the largest near at which a picture was drawn by one pair without bending, the smallest if none.

    Any depth buffer may have drawn it, for none moves the picture.
    """
    alike = [r for r in rows if not r.slabs and alike_but_depth(r, row)]
    return max(straight_nears(alike), default=min(r.near for r in alike))
