"""`xfrustum study splitting`: where one pair of frusta is enough, over scenes, nears and depth buffers.

A cell is one picture: a scene of `scenes.library.depth_family` through one aperture, drawn by cameras with
one near and one depth buffer, judged beside its truth; and a pair of sheets at the far end of its side, which
the depth buffer orders or does not. All lengths are shares of the reach.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import fields
from functools import cache
from itertools import groupby
from pathlib import Path

import numpy as np

from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.compare.metrics.error_maps import judged_pixels, lengths, wrong_surface
from xfrustum.compare.planning.measure import SheetFilm, SheetPair
from xfrustum.compare.prediction import predict
from xfrustum.compare.prediction.chain import with_exact_depth
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION, smallest_separation
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.lines.lines import model_cameras
from xfrustum.reports.blocks import HERE, Engine, Part, Workers, open_workers
from xfrustum.reports.studies.splitting_cells import (
    ASKED_SEPARATION,
    FULL,
    SIDES,
    Case,
    Cell,
    Family,
    Row,
    Study,
    Suitability,
    document,
    maps,
    outcomes,
    straight_nears,
    suitability,
    svg,
)
from xfrustum.reports.studies.sweep import StudyFiles, Sweep, check_folder, write_study
from xfrustum.scenes.library import depth_family
from xfrustum.scenes.library.depth_family import FARTHEST, REACH, SeenScene
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum, Offset, Pivot
from xfrustum.tolerances import TOLERANCE_PX

DEFAULT_FOLDER = Path("study") / "splitting"

SEPARATIONS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
"""Distances of two sheets, as shares of the reach."""

SHEET_CELLS, SHEET_CELL_PIXELS = 16, 4
"""Cells along each side of the film on which sheets are drawn, and pixels along each side of a cell."""

SHEET_PHASE = 0.05
"""Share by which the heights of a sheet's cells differ from their mean at most, so that not all their depths
round alike."""

SHEET_HEIGHT = FARTHEST / (1 + SHEET_PHASE)
"""Mean |z| of the sheets: the cells of the farther one end at the farthest surface."""

NEAREST_PERCENTILE = 1
"""Percentile of the visible |z| that counts as the nearest surface: what is nearer is a hundredth of the
picture, which the 99th percentile of displacement leaves out."""

MAX_SLABS = 6
"""Slabs on one side that are tried before a case is given up."""

FIRST_CUT_PER_NEAREST = 0.99
"""The first cut as a share of the nearest surface's |z|: close under it, so that the first slab is empty."""


def seen_scene(cell: Cell) -> SeenScene:
    """Return the scene of a picture, and the aperture that it is seen from."""
    resolution = (cell.resolution, cell.resolution)
    match cell.family:
        case Family.ONE_SIDE:
            scene = depth_family.cars(cell.ratio, cell.side, resolution)
            return SeenScene(scene=scene, aperture=scene.plate.middle)
        case Family.BOTH_SIDES:
            return depth_family.cars_on_both_sides(cell.ratio, resolution)
        case Family.OFF_MIDDLE | Family.IN_MIDDLE:
            in_middle = cell.family is Family.IN_MIDDLE
            return depth_family.cars_off_the_middle(cell.ratio, resolution, in_middle=in_middle)
        case Family.RECENTERED:
            return depth_family.recentered_cars(cell.ratio, resolution)
        case Family.THROUGH:
            return depth_family.car_through_plate(1 / cell.ratio, resolution)


def measure(cells: Sequence[Cell]) -> Iterator[Row]:
    """Yield the rows of some cells of one picture: its truth is traced once."""
    seen = seen_scene(cells[0])
    scene, aperture, reference = seen.scene, seen.aperture, Reference(seen.scene)
    truth = reference.trace(aperture)
    heights = np.abs(truth.height[truth.covered].astype(np.float64)) / REACH
    sheets = _misordered(cells)
    with Rasterizer(scene) as rasterizer:
        exact: DoubleFrustum | None = None
        for cell in cells:
            if with_exact_depth(cell.settings) != exact:
                # What a frame with exact depth shows rightly is charged to the depth buffer.
                exact = with_exact_depth(cell.settings)
                control = rasterizer.render(aperture, exact, normals=False, color=False)
                control_wrong = wrong_surface(truth, control, reference) & judged_pixels(truth)
                predicted = predict.displacement(truth, scene.frustum, exact)
            drawn = rasterizer.render(aperture, cell.settings, normals=False, color=False)
            judged = compare_images(truth, drawn, reference)
            wrong, spread = judged.maps.surface, judged.displacement_px
            assert wrong is not None and judged.surface is not None
            by_depth = wrong & ~control_wrong
            moved = lengths(judged.maps.displacement)[drawn.off_plate]
            own = _sheets_of(cell)
            # Of the sheets of several cameras the worst count.
            misordered = [max(shares) for shares in zip(*(sheets[one] for one in own), strict=True)]
            ordered = itertools.takewhile(
                lambda pair: pair[1] <= MAX_MISORDERED_FRACTION, zip(SEPARATIONS, misordered, strict=True)
            )
            yield Row(
                **vars(cell),
                nearest=float(np.percentile(heights, NEAREST_PERCENTILE)),
                farthest=float(heights.max()),
                judged=judged.judged,
                covered=judged.covered,
                surface_wrong=int(wrong.sum()),
                outside=judged.surface.outside,
                depth_wrong=int(by_depth.sum()),
                lost=int((by_depth & control.covered & ~drawn.covered).sum()),
                displacement_rms=spread.rms if spread else None,
                displacement_p99=spread.p99 if spread else None,
                displacement_max=spread.max if spread else None,
                displaced=int((moved > TOLERANCE_PX).sum()),
                predicted_rms=predicted.rms if predicted else None,
                predicted_p99=predicted.p99 if predicted else None,
                misordered=misordered[SEPARATIONS.index(ASKED_SEPARATION)],
                ordered_separation=min((separation for separation, _ in ordered), default=None),
                predicted_separation=max(map(predicted_separation, own)),
            )


# Pairs of sheets at the far end


def _sheets_of(cell: Cell) -> tuple[Cell, ...]:
    """Return cells that stand for the sheets of each camera, which depend on neither shear nor fit."""
    plain = {"family": Family.ONE_SIDE, "ratio": 1.0, "resolution": 1, "pivot": Pivot.APERTURE, "fit": None}
    own = {one.name: getattr(cell, one.name) for one in fields(Cell)} | plain
    return tuple(
        Cell(**{**own, "side": side}) for side in (SIDES if cell.side is Camera.BOTH else (cell.side,))
    )


def _stands_back(sheets: Cell) -> float:
    """Return how far the camera that draws the far end stands back, as a share of the reach."""
    return 0.0 if sheets.slabs or sheets.offset is Offset.NONE else sheets.near


@cache
def _measured_sheets() -> dict[Cell, tuple[float, ...]]:
    """Return what this process has measured of sheets: cells of many pictures share them."""
    return {}


def _misordered(cells: Iterable[Cell]) -> dict[Cell, tuple[float, ...]]:
    """Return the share of pixels that do not show the right sheet, for each of `SEPARATIONS`."""
    known = _measured_sheets()
    missing = {sheets for cell in cells for sheets in _sheets_of(cell)} - set(known)

    def camera(sheets: Cell) -> tuple[Camera, float]:
        return sheets.side, _stands_back(sheets)

    for _, group in groupby(sorted(missing, key=camera), key=camera):
        own = list(group)
        with ExitStack() as stack:
            films = [_film(own[0], separation * REACH) for separation in SEPARATIONS]
            drawn = [(film, stack.enter_context(Rasterizer(film.scene))) for film in films]
            for sheets in own:
                shares = (film.wrong_shares(rasterizer, sheets.settings) for film, rasterizer in drawn)
                known[sheets] = tuple(share for (share,) in shares)
    return known


def _film(sheets: Cell, separation: float) -> SheetFilm:
    """Return one pair of sheets at the far end of a side, which covers the film.

    The sheet that must not show comes first, so that equal depths show it.
    """
    scene = depth_family.empty_scene((SHEET_CELLS, SHEET_CELLS))
    cameras = model_cameras(scene.frustum, scene.plate.middle, sheets.settings)
    outermost = max(cameras, key=lambda camera: max(map(abs, camera.heights)))
    phases = np.random.default_rng(4).uniform(-SHEET_PHASE, SHEET_PHASE, SHEET_CELLS**2)
    pair = SheetPair(
        camera=outermost, heights=SHEET_HEIGHT * (1 + phases), separation=separation, loser_first=True
    )
    owner = np.zeros((SHEET_CELLS, SHEET_CELLS), dtype=np.int64)
    return SheetFilm.of(scene, scene.plate.middle, [pair], owner, SHEET_CELL_PIXELS)


def predicted_separation(sheets: Cell) -> float:
    """Return the smallest separation ordered at the farthest surface, by the closed form."""
    near = (sheets.slabs[-1] if sheets.slabs else sheets.near) * REACH
    offset, buffer = _stands_back(sheets) * REACH, sheets.buffer
    return float(smallest_separation(np.array(FARTHEST + offset), near, offset + REACH, *buffer)) / REACH


# The whole study


def make_study(
    out: Path = DEFAULT_FOLDER, study: Study = FULL, engine: Engine = HERE, *, progress: bool = False
) -> StudyFiles | None:
    """Measure where one pair of frusta is enough, and write document, figures and data.

    The engine says where cells are measured. Every block is kept in the folder as soon as it is measured;
    what is there already, from the same libraries and device, is not measured again. Returns None where other
    parts of a job array are not measured yet.
    """
    check_folder(out, "when-to-split")
    sweep = Sweep.of("splitting", out, Row, measure)
    nears, grids = study
    blocks = [block for grid in grids for block in grid.blocks(nears)]
    with open_workers(engine, len(blocks)) as workers:
        rows = sweep.rows(blocks, workers, engine.part, progress=progress)
        if rows is None:
            return None
        rows += _split(rows, sweep, workers, progress=progress)
    figures = {name: svg(drawn) for name, drawn in maps(rows).items()}
    return write_study(out, "when-to-split", rows, sweep.origin, document, figures)


def _split(rows: Sequence[Row], sweep: Sweep, workers: Workers, *, progress: bool) -> list[Row]:
    """Measure one slab, then two, and so on, in all cases that no near can serve, until it is enough."""
    found: list[Row] = []
    # Slabs have no gap at the plate: they are drawn with the offset.
    open_cases = [
        next(row for row in rows if Case.of(row) == case)
        for case, outcome in outcomes(rows).items()
        if not outcome.one_pair and case.offset is Offset.PLATE
    ]
    for count in range(1, MAX_SLABS + 1):
        cells = [_cut(row, rows, count) for row in open_cases]
        blocks = [tuple(group) for _, group in groupby(cells, key=lambda cell: cell.picture)]
        # What follows from all rows is measured by whoever has seen them all.
        tried = sweep.rows(blocks, workers, Part(), progress=progress and bool(blocks))
        assert tried is not None
        found += tried
        open_cases = [row for row in tried if suitability(row) is not Suitability.ENOUGH]
    return found


def _cut(row: Row, rows: Sequence[Row], count: int) -> Cell:
    """Return a case with so many cuts, in equal ratios, from the first one up to the reach.

    The first cut lies just under the nearest surface, so that the slab that touches the plate is empty. Where
    a surface runs through the plate that slab never is: then the near is the largest that does not bend in
    one pair, whatever depth buffer drew it, and it, the cuts and the reach form one sequence.
    """
    if row.family is Family.THROUGH:
        alike = [r for r in rows if (r.picture, r.drawing, r.slabs) == (row.picture, row.drawing, ())]
        near = max(straight_nears(alike), default=min(r.near for r in alike))
        cuts = np.geomspace(near, 1.0, count + 2)[1:-1]
    else:
        near = FIRST_CUT_PER_NEAREST * FARTHEST / REACH / row.ratio
        cuts = np.geomspace(near, 1.0, count + 1)[:-1]
    own = {one.name: getattr(row, one.name) for one in fields(Cell)}
    return Cell(**{**own, "near": near, "slabs": tuple(map(float, cuts))})
