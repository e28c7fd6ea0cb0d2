"""Measure the study's cells, those that are not yet on disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from xfrustum.reports.cluster.run import Part, Team, run_blocks
from xfrustum.reports.splitting_study.grid import Cell, Family, Grid
from xfrustum.reports.splitting_study.job import Cells, StudyJob, sheets_of
from xfrustum.reports.splitting_study.measure import CellResult, SheetResult
from xfrustum.reports.splitting_study.rows import StudyRow, joined
from xfrustum.reports.splitting_study.store import PICTURES, SHEETS, Store
from xfrustum.reports.splitting_study.suitability import (
    Suitability,
    alike_but_depth,
    case_of,
    outcomes,
    straight_nears,
    suitability,
)
from xfrustum.scenes.library.depth_family import FARTHEST, REACH
from xfrustum.scenes.plate.double_frustum import Offset

MAX_SLABS = 6
"""Slabs on one side that are tried before a case is given up."""

FIRST_CUT_PER_NEAREST = 0.99
"""The first cut as a share of the nearest surface's |z|: close under it, so that the first slab is empty."""


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
