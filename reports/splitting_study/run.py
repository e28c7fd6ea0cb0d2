"""Measure the study's cells, those that are not yet on disk, in blocks that any process may do."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from xfrustum.reports.cluster.run import Part, Team
from xfrustum.reports.splitting_study.grid import SIDES, Cell, Family, Grid, SheetCell
from xfrustum.reports.splitting_study.measure import (
    CellResult,
    PictureWorkbench,
    SheetResult,
    SheetWorkbench,
)
from xfrustum.reports.splitting_study.rows import StudyRow, joined
from xfrustum.reports.splitting_study.suitability import (
    Suitability,
    alike_but_depth,
    case_of,
    outcomes,
    straight_nears,
    suitability,
)
from xfrustum.reports.studies.cells import CellsJob, all_measured, measure_part
from xfrustum.reports.studies.store import Store
from xfrustum.scenes.library.depth_family import FARTHEST, REACH
from xfrustum.scenes.plate.double_frustum import Camera, Offset

MAX_SLABS = 6
"""Slabs on one side that are tried before a case is given up."""

FIRST_CUT_PER_NEAREST = 0.99
"""The first cut as a share of the nearest surface's |z|: close under it, so that the first slab is empty."""

PICTURES, SHEETS = "picture", "sheets"
"""Kinds of results."""

MEASURING_MODULES = ("splitting_study/measure.py",)
"""Modules of `reports` whose sources decide what is measured."""

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
class StudyJob(CellsJob[Cell | SheetCell]):
    """Pictures or sheets of some cells; its kind is `PICTURES` or `SHEETS`.

    Attributes
    ----------
    asked
        The cells.
    stage
        Number of cuts of the cells, 0 for those of the grid, by which clients claim blocks.
    """

    asked: Grid | Cells
    stage: int

    @property
    def name(self) -> str:
        """Word by which the dashboard groups its tasks."""
        return f"study-{self.kind}"

    @property
    def unit(self) -> str:  # type: ignore[override]  # one class measures both kinds
        """Word for one cell, for the bar."""
        return "picture" if self.kind == PICTURES else "buffer"

    @property
    def modules(self) -> Sequence[str]:
        """Modules of `reports` whose sources decide what is measured."""
        return MEASURING_MODULES

    @property
    def blocks(self) -> tuple[tuple[Cell, ...] | tuple[SheetCell, ...], ...]:
        """The cells of each block: those that share what takes longest to make."""
        return _picture_blocks(self.asked) if self.kind == PICTURES else _sheet_blocks(self.asked)

    @property
    def first_claim(self) -> int:
        """Claim of block 0 of this kind and stage."""
        return (2 * self.stage + (self.kind == PICTURES)) * CLAIMS_PER_JOB

    def key(self, cell: Cell | SheetCell) -> str:
        """Return the parameters of a cell."""
        return cell.key

    def measured(self, cells: Sequence[Cell | SheetCell]) -> Generator[CellResult | SheetResult]:
        """Yield what is measured of some cells of one block."""
        if pictures := [cell for cell in cells if isinstance(cell, Cell)]:
            with PictureWorkbench(pictures[0].picture) as pictured:
                yield from map(pictured.measure, pictures)
        if sheets := [cell for cell in cells if isinstance(cell, SheetCell)]:
            with SheetWorkbench(sheets[0]) as ordered:
                yield from map(ordered.measure, sheets)


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
            words = "pictures" if job.kind == PICTURES else "pairs of sheets"
            measure_part(job, self.team, part, words, progress=self.progress)
        return all(map(all_measured, jobs))

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
