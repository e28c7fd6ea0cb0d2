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
from xfrustum.reports.splitting_study.grid import SIDES, Cell, Family, Grid, Picture, SheetCell
from xfrustum.reports.splitting_study.measure import (
    CellResult,
    PictureWorkbench,
    SheetResult,
    SheetWorkbench,
)
from xfrustum.reports.splitting_study.rows import Origin, StudyRow, joined
from xfrustum.reports.splitting_study.store import Store
from xfrustum.reports.splitting_study.suitability import (
    Suitability,
    alike_but_depth,
    case_of,
    outcomes,
    straight_nears,
    suitability,
)
from xfrustum.scenes.library.depth_family import CAR_RATIO, FARTHEST, REACH, cars
from xfrustum.scenes.plate.double_frustum import Camera, Offset

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
    _measure_sheets(_all_sheets(cells), store, progress)
    _measure_pictures(cells, store, progress)
    rows = _rows(cells, store)
    return rows + _split(rows, store, progress)


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


def _all_sheets(cells: Iterable[Cell]) -> list[SheetCell]:
    return list(dict.fromkeys(sheets for cell in cells for sheets in sheets_of(cell)))


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
    return cell.side, 0.0 if cell.slabs or cell.offset is Offset.NONE else cell.near


def _measure_pictures(cells: Iterable[Cell], store: Store, progress: bool) -> None:
    missing = _missing(cells, store, PICTURES)
    with progress_bar(len(missing), "pictures", "picture", shown=progress and bool(missing)) as bar:
        for picture, group in groupby(missing, key=_picture):
            words = f"{picture.family}, {picture.side}, depth {picture.ratio:g}, {picture.resolution} px"
            bar.set_postfix_str(words, refresh=False)
            with PictureWorkbench(picture) as workbench:
                for cell in group:
                    store.put(PICTURES, cell.key, asdict(workbench.measure(cell)))
                    bar.update()


def _picture(cell: Cell) -> Picture:
    return cell.picture


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
            [pair.validate_python(sheets[own.key]) for own in sheets_of(cell)],
        )
        for cell in cells
    )


def _split(rows: Sequence[StudyRow], store: Store, progress: bool) -> tuple[StudyRow, ...]:
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
        _measure_sheets(_all_sheets(cells), store, progress)
        _measure_pictures(cells, store, progress)
        tried = _rows(cells, store)
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
