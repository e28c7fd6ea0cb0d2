"""Measure the study's cells, those that are not yet on disk."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from itertools import groupby
from typing import TypeVar

import numpy as np
from pydantic import TypeAdapter

from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.common import provenance
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.splitting_study.grid import Cell, Grid, SheetCell
from xfrustum.reports.splitting_study.measure import (
    CellResult,
    PictureWorkbench,
    SheetResult,
    SheetWorkbench,
)
from xfrustum.reports.splitting_study.rows import Origin, StudyRow, joined
from xfrustum.reports.splitting_study.store import Store
from xfrustum.reports.splitting_study.suitability import Suitability, case_of, outcomes, suitability
from xfrustum.scenes.library.depth_family import CAR_RATIO, FARTHEST, REACH, cars
from xfrustum.scenes.plate.double_frustum import Camera

C = TypeVar("C", Cell, SheetCell)

PICTURES, SHEETS = "picture", "sheets"
"""Kinds of results."""

MAX_SLABS = 6
"""Slabs on one side that are tried before a case is given up."""

FIRST_CUT_PER_NEAREST = 0.99
"""The first cut as a share of the nearest surface's |z|: close under it, so that the first slab is empty."""


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


def measure(grid: Grid, store: Store, *, progress: bool = False) -> tuple[StudyRow, ...]:
    """Measure every cell of a grid, and slabs where no near is enough.

    Returns
    -------
    One row per cell in the grid's order, then those with slabs.
    """
    cells = list(grid.cells())
    sheets = list(dict.fromkeys(map(sheets_of, cells)))
    _measure_sheets(sheets, store, progress)
    _measure_pictures(cells, store, progress)
    rows = _rows(cells, store)
    return rows + _split(rows, store, progress)


def sheets_of(cell: Cell) -> SheetCell:
    """Return the sheets that belong to a cell: those of its side, near and depth buffer."""
    return SheetCell(side=cell.side, near=cell.near, depth=cell.depth, mapping=cell.mapping, slabs=cell.slabs)


def _measure_sheets(cells: Iterable[SheetCell], store: Store, progress: bool) -> None:
    missing = sorted(_missing(cells, store, SHEETS), key=_far_camera)
    with progress_bar(len(missing), "pairs of sheets", "buffer", shown=progress and bool(missing)) as bar:
        for _, group in groupby(missing, key=_far_camera):
            cells_alike = list(group)
            with SheetWorkbench(cells_alike[0]) as workbench:
                for cell in cells_alike:
                    store.put(SHEETS, cell.key, asdict(workbench.measure(cell)))
                    bar.update()


def _far_camera(cell: SheetCell) -> tuple[Camera, float]:
    """Return which camera draws the far end, and how far it stands back as a share of the reach."""
    return cell.side, 0.0 if cell.slabs else cell.near


def _measure_pictures(cells: Iterable[Cell], store: Store, progress: bool) -> None:
    missing = _missing(cells, store, PICTURES)
    with progress_bar(len(missing), "pictures", "picture", shown=progress and bool(missing)) as bar:
        for picture, group in groupby(missing, key=_picture):
            bar.set_postfix_str(f"{picture[0]}, depth {picture[1]:g}, {picture[2]} px", refresh=False)
            with PictureWorkbench(*picture) as workbench:
                for cell in group:
                    store.put(PICTURES, cell.key, asdict(workbench.measure(cell)))
                    bar.update()


def _picture(cell: Cell) -> tuple[Camera, float, int, int]:
    return cell.side, cell.ratio, cell.resolution, cell.refined


def _missing(cells: Iterable[C], store: Store, kind: str) -> list[C]:
    done = store.get(kind).keys()
    return [cell for cell in cells if cell.key not in done]


def _rows(cells: Sequence[Cell], store: Store) -> tuple[StudyRow, ...]:
    pictures, sheets = store.get(PICTURES), store.get(SHEETS)
    picture, pair = TypeAdapter(CellResult), TypeAdapter(SheetResult)
    return tuple(
        joined(
            cell,
            picture.validate_python(pictures[cell.key]),
            pair.validate_python(sheets[sheets_of(cell).key]),
        )
        for cell in cells
    )


def _split(rows: Sequence[StudyRow], store: Store, progress: bool) -> tuple[StudyRow, ...]:
    """Measure one slab, then two, and so on, in all cases that no near can serve, until it is enough."""
    found: list[StudyRow] = []
    one_per_case = {case_of(row): row for row in rows}
    open_cases = [one_per_case[case] for case, outcome in outcomes(rows).items() if not outcome.one_pair]
    for count in range(1, MAX_SLABS + 1):
        cells = [_cut(row, count) for row in open_cases]
        _measure_sheets(dict.fromkeys(map(sheets_of, cells)), store, progress)
        _measure_pictures(cells, store, progress)
        tried = _rows(cells, store)
        found += tried
        open_cases = [row for row in tried if suitability(row) is not Suitability.ENOUGH]
    return tuple(found)


def _cut(row: StudyRow, count: int) -> Cell:
    """Return a case with so many slabs from just under its nearest surface outward, in equal ratios."""
    first = FIRST_CUT_PER_NEAREST * FARTHEST / REACH / row.ratio
    cuts = np.geomspace(first, 1.0, count + 1)[:-1]
    return Cell(
        side=row.side,
        ratio=row.ratio,
        resolution=row.resolution,
        # The near offset changes nothing: the slab that it belongs to is empty.
        near=first,
        depth=row.depth,
        mapping=row.mapping,
        slabs=tuple(float(cut) for cut in cuts),
        refined=row.refined,
    )
