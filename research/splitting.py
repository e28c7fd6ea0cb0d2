"""`xfrustum study splitting`: scenes, nears and depth buffers for which one frustum pair is enough.

A cell is one judged picture: a scene of `research.depth_family` through one aperture, drawn with
one near and one depth buffer. A cell also measures two close sheets at the far end of its side of
the plate, to test whether the depth buffer orders them. All lengths are shares of the reach.
"""

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from enum import StrEnum
from itertools import dropwhile, groupby, product, takewhile
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from scipy.optimize import brentq

from xfrustum.compare.comparison import compare_images
from xfrustum.compare.error_maps import judged_pixels, lengths, surface_errors
from xfrustum.compare.planning.views import SheetFilm, SheetPair
from xfrustum.compare.prediction.depth import EXPRESSION_ROUNDINGS as BY_FRAGMENT
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION, smallest_separation
from xfrustum.compare.prediction.displacement import TruePoints, spread_of
from xfrustum.compare.prediction.predict import with_exact_depth
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.lines import model_cameras
from xfrustum.reports.blocks import HERE, Engine, Part, Workers, open_workers
from xfrustum.reports.common.outputs import json_object
from xfrustum.reports.common.templates_environment import fragment, plain_text
from xfrustum.research import depth_family
from xfrustum.research.depth_family import FARTHEST, REACH
from xfrustum.research.sweep import Origin, StudyFiles, Sweep, check_folder, write_study
from xfrustum.scenes import Camera, DepthFormat, DepthMapping, DoubleFrustum, Fit, Offset, Pivot
from xfrustum.tolerances import MAX_DEPTH_WRONG, TOLERANCE_PX

DepthBuffer = tuple[DepthFormat, DepthMapping]
Drawing = tuple[Pivot, Fit | None, Offset]
Kind = TypeVar("Kind", bound="Case")

DEFAULT_FOLDER = Path("study") / "splitting"
SIDES = (Camera.C, Camera.C_STAR)
AS_IN_THE_PAPER: Drawing = (Pivot.APERTURE, None, Offset.PLATE)

#: distances between two sheets
SEPARATIONS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
#: smallest distance between two surfaces whose order a depth buffer must keep at the far end
ASKED_SEPARATION = 1e-3

#: number of cells along each side of the film of sheets, and of pixels along each side of a cell
SHEET_CELLS, SHEET_CELL_PIXELS = 16, 4
#: relative spread of the heights of a sheet's cells, so that their depths round differently
SHEET_PHASE = 0.05
SHEET_HEIGHT = FARTHEST / (
    1 + SHEET_PHASE
)  # mean |z| of the farther sheet: its cells lie at `FARTHEST` at most

#: Percentile of visible |z| that counts as the nearest surface. Nearer surfaces fill a hundredth of
#: the picture, and the 99th percentile of displacement leaves them out.
NEAREST_PERCENTILE = 1

#: largest number of cuts on one side of the plate that are tried for a case
MAX_SLABS = 6
#: height of the first cut over the nearest |z|: just under one, so that the first slab is empty
FIRST_CUT_PER_NEAREST = 0.99
_LEAST_NEAR, _LARGEST_NEAR = (
    1e-12,
    0.5,
)  # bounds of the smallest near that orders a separation


class Family(StrEnum):
    """Kinds of scenes; each kind but the first differs from the first in one property."""

    # cars on one side of the plate, as the middle aperture of a centered frustum sees them
    ONE_SIDE = "one side"
    BOTH_SIDES = "both sides"  # cars on both sides at once
    OFF_MIDDLE = "off the middle"  # cars of ONE_SIDE, as an aperture off the middle sees them
    IN_MIDDLE = "in the middle"  # scene of OFF_MIDDLE, as the middle aperture sees it
    RECENTERED = "recentered"  # the picture of ONE_SIDE through a sheared frustum
    THROUGH = "through the plate"  # a car that runs through the plate
    RECENTERED_THROUGH = "recentered, through the plate"  # the same car, sheared frustum


_CROSSING = {Family.THROUGH, Family.RECENTERED_THROUGH}


@dataclass(frozen=True)
class Case:
    """A scene, an image and a depth buffer, before near and slabs are chosen.

    `side` is the camera that images the content, or `BOTH`. `ratio` is the depth of the scene:
    farthest over nearest |z| of its surfaces. If a surface runs through the plate, `ratio` is the
    reach over the distance between the aperture and the crossing.
    """

    family: Family
    side: Camera
    ratio: float
    resolution: int
    depth: DepthFormat
    mapping: DepthMapping
    pivot: Pivot
    fit: Fit | None
    offset: Offset

    buffer = property(lambda self: (self.depth, self.mapping))
    picture = property(lambda self: (self.family, self.side, self.ratio, self.resolution))
    drawing = property(lambda self: (self.pivot, self.fit, self.offset))


@dataclass(frozen=True)
class Cell(Case):
    """One picture of the study: a case with a near and the heights of cuts."""

    near: float
    slabs: tuple[float, ...] = ()

    @property
    def settings(self) -> DoubleFrustum:
        """Settings of the rasterizer, in scene units."""
        names = ("depth", "mapping", "pivot", "fit", "offset")
        options = {name: getattr(self, name) for name in names}
        slabs = tuple(cut * REACH for cut in self.slabs)
        return DoubleFrustum(near=self.near * REACH, camera=self.side, slabs=slabs, **options)


@dataclass(frozen=True, kw_only=True)
class Row(Cell):
    """A cell with measures of its picture and of the sheets at the far end (docs/answers.md)."""

    judged: int
    covered: int
    nearest: float
    farthest: float
    surface_wrong: int
    outside: int
    depth_wrong: int
    lost: int
    displacement_rms: float | None
    displacement_p99: float | None
    displacement_max: float | None
    displaced: int
    predicted_rms: float | None
    predicted_p99: float | None
    misordered: float
    ordered_separation: float | None
    predicted_separation: float


Rows = Sequence[Row]


def part_of(row: Case, kind: type[Kind], **changed: Any) -> Kind:
    """Return the case or the cell of a row, with some fields changed."""
    return kind(**{field.name: getattr(row, field.name) for field in fields(kind)} | changed)


@dataclass(frozen=True)
class Grid:
    """Values of one family; each combination of these values with a near is a cell."""

    family: Family
    sides: tuple[Camera, ...]
    ratios: tuple[float, ...]
    buffers: tuple[DepthBuffer, ...]
    resolutions: tuple[int, ...] = (256,)
    drawings: tuple[Drawing, ...] = (AS_IN_THE_PAPER,)

    def blocks(self, nears: Sequence[float]) -> Iterator[tuple[Cell, ...]]:
        """Yield the cells of each picture; neighbors differ in the depth buffer, then in near."""
        for picture in product((self.family,), self.sides, self.ratios, self.resolutions):
            drawn = product(self.drawings, nears, self.buffers)
            yield tuple(
                Cell(*(*picture, *buffer, *drawing, near)) for drawing, near, buffer in drawn
            )


#: nears in descending order, and grids
Study = tuple[tuple[float, ...], tuple[Grid, ...]]

_DEPTHS = (1.5, 10.0, 100.0, 1000.0)
#: Depth buffers of all families but the first: four that need no depth from the fragment shader,
#: and one that does. Few suffice: equal |z| and near give equal depths in all families.
_BUFFERS: tuple[DepthBuffer, ...] = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.REVERSED),
    (DepthFormat.D32F, DepthMapping.REVERSED),
    (DepthFormat.D24, DepthMapping.LOGARITHMIC),
)

_FIRST = Grid(
    Family.ONE_SIDE, SIDES, _DEPTHS, tuple(product(DepthFormat, DepthMapping)), (128, 256, 512)
)
_SHEARED = tuple((pivot, fit, Offset.PLATE) for pivot in Pivot for fit in (None, Fit.SCREEN))
_OFFSETS = tuple((Pivot.APERTURE, None, offset) for offset in Offset)
_CROSSINGS = (1e1, 1e2, 1e3, 1e4, 1e5, 1e6)
_OTHERS = (
    Grid(Family.BOTH_SIDES, (Camera.BOTH,), _DEPTHS, _BUFFERS),
    Grid(Family.IN_MIDDLE, (Camera.C,), _DEPTHS, _BUFFERS),
    Grid(Family.OFF_MIDDLE, (Camera.C,), _DEPTHS, _BUFFERS),
    Grid(Family.RECENTERED, (Camera.C,), _DEPTHS, _BUFFERS, drawings=_SHEARED),
    Grid(Family.THROUGH, (Camera.BOTH,), _CROSSINGS, _BUFFERS, drawings=_OFFSETS),
    Grid(
        Family.RECENTERED_THROUGH,
        (Camera.BOTH,),
        _CROSSINGS,
        _BUFFERS,
        drawings=_SHEARED + _OFFSETS[1:],
    ),
)
_NEARS = tuple(float(near) for near in np.geomspace(1e-1, 1e-8, 15))

FULL: Study = (_NEARS, (_FIRST, *_OTHERS))
QUICK: Study = (
    _NEARS[::2],
    (
        replace(
            _FIRST, ratios=(1.5, 100.0), buffers=(*_BUFFERS[:2], _BUFFERS[3]), resolutions=(128,)
        ),
        *(replace(grid, ratios=grid.ratios[2:3], buffers=_BUFFERS[::3]) for grid in _OTHERS),
    ),
)


def seen_scene(cell: Cell) -> depth_family.SeenScene:
    """Return the scene and the aperture of a cell's picture."""
    ratio, resolution = cell.ratio, (cell.resolution, cell.resolution)
    match cell.family:
        case Family.ONE_SIDE:
            scene = depth_family.cars(ratio, cell.side, resolution)
            return depth_family.SeenScene(scene=scene, aperture=scene.plate.middle)
        case Family.BOTH_SIDES:
            return depth_family.cars_on_both_sides(ratio, resolution)
        case Family.RECENTERED:
            return depth_family.recentered_cars(ratio, resolution)
        case Family.THROUGH | Family.RECENTERED_THROUGH:
            recentered = cell.family is Family.RECENTERED_THROUGH
            return depth_family.car_through_plate(1 / ratio, resolution, recentered=recentered)
    in_middle = cell.family is Family.IN_MIDDLE
    return depth_family.cars_off_the_middle(ratio, resolution, in_middle=in_middle)


def measure(cells: Sequence[Cell]) -> Iterator[Row]:
    """Yield the rows of the cells of one picture; the picture's truth is traced once."""
    seen = seen_scene(cells[0])
    scene, aperture, reference = seen.scene, seen.aperture, Reference(seen.scene)
    truth = reference.trace(aperture)
    # |z| of visible surfaces as shares of the reach
    heights = np.abs(truth.height[truth.covered].astype(np.float64)) / REACH
    sheets = _misordered(cells)
    with Rasterizer(scene) as rasterizer:
        exact: DoubleFrustum | None = None
        for cell in cells:
            if with_exact_depth(cell.settings) != exact:
                # The control frame has exact depth.
                exact = with_exact_depth(cell.settings)
                control = rasterizer.render(aperture, exact, normals=False, color=False)
                control_wrong = surface_errors(truth, control, reference).wrong & judged_pixels(
                    truth
                )
                predicted = spread_of(TruePoints.from_image(truth), scene.frustum, exact)
            drawn = rasterizer.render(aperture, cell.settings, normals=False, color=False)
            judged = compare_images(truth, drawn, reference)
            wrong, spread = judged.maps.surface, judged.displacement_px
            assert wrong is not None and judged.surface is not None
            # A pixel that is right with exact depth is charged to the depth buffer.
            by_depth = wrong & ~control_wrong
            moved = lengths(judged.maps.displacement)[drawn.off_plate]
            own = _sheets_of(cell)
            # With several cameras the worst sheets count.
            misordered = [
                max(shares) for shares in zip(*(sheets[part] for part in own), strict=True)
            ]
            graded = zip(SEPARATIONS, misordered, strict=True)
            # Separations descend: the last ordered separation before the first failure counts.
            ordered = takewhile(lambda pair: pair[1] <= MAX_MISORDERED_FRACTION, graded)
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


def _sheets_of(cell: Cell) -> list[Cell]:
    """Return a cell for the sheets of each camera; sheets depend on neither shear nor fit."""
    plain = {
        "family": Family.ONE_SIDE,
        "ratio": 1.0,
        "resolution": 1,
        "pivot": Pivot.APERTURE,
        "fit": None,
    }
    sides = SIDES if cell.side is Camera.BOTH else (cell.side,)
    return [part_of(cell, Cell, **plain, side=side) for side in sides]


def _camera(sheets: Cell) -> tuple[Camera, float]:
    """Return the camera that draws the far end, and the near offset of its center."""
    return sheets.side, 0.0 if sheets.slabs or sheets.offset is Offset.NONE else sheets.near


#: sheets that this process has measured; cells of many pictures share them
_MISORDERED: dict[Cell, tuple[float, ...]] = {}


def _misordered(cells: Iterable[Cell]) -> dict[Cell, tuple[float, ...]]:
    """Return, by sheets, the shares of pixels with the wrong sheet at each of `SEPARATIONS`."""
    missing = {sheets for cell in cells for sheets in _sheets_of(cell)} - _MISORDERED.keys()
    for _, group in groupby(sorted(missing, key=_camera), key=_camera):
        shares: dict[Cell, list[float]] = {sheets: [] for sheets in group}
        for separation in SEPARATIONS:
            film = _film(next(iter(shares)), separation * REACH)
            with Rasterizer(film.scene) as rasterizer:
                for sheets in shares:
                    shares[sheets] += film.wrong_shares(rasterizer, sheets.settings)
        _MISORDERED.update({sheets: tuple(values) for sheets, values in shares.items()})
    return _MISORDERED


def _film(sheets: Cell, separation: float) -> SheetFilm:
    """Return a film that one pair of sheets covers, at the far end of a side.

    The hidden sheet is drawn first, so that equal depths show it.
    """
    scene = depth_family.empty_scene((SHEET_CELLS, SHEET_CELLS))
    cameras = model_cameras(scene.frustum, scene.plate.middle, sheets.settings)
    outermost = max(cameras, key=lambda camera: max(map(abs, camera.heights)))
    phases = np.random.default_rng(4).uniform(-SHEET_PHASE, SHEET_PHASE, SHEET_CELLS**2)
    heights = SHEET_HEIGHT * (1 + phases)
    pair = SheetPair(camera=outermost, heights=heights, separation=separation, loser_first=True)
    owner = np.zeros((SHEET_CELLS, SHEET_CELLS), dtype=np.int64)
    return SheetFilm.from_scene(scene, scene.plate.middle, [pair], owner, SHEET_CELL_PIXELS)


def predicted_separation(sheets: Cell) -> float:
    """Return the smallest separation ordered at the farthest surface, by the closed form."""
    near = (sheets.slabs[-1] if sheets.slabs else sheets.near) * REACH
    offset = _camera(sheets)[1] * REACH
    apart = smallest_separation(np.array(FARTHEST + offset), near, offset + REACH, *sheets.buffer)
    return float(apart) / REACH


def make_study(
    out: Path = DEFAULT_FOLDER,
    study: Study = FULL,
    engine: Engine = HERE,
    *,
    progress: bool = False,
) -> StudyFiles | None:
    """Measure where one pair of frusta is enough, and write document, figures and data.

    A block that is in the folder already, from the same libraries and device, is not measured
    again. Returns None if other parts of a job array are not measured yet.
    """
    check_folder(out, "when-to-split")
    sweep = Sweep.from_measure("splitting", out, Row, measure)
    nears, grids = study
    blocks = [block for grid in grids for block in grid.blocks(nears)]
    with open_workers(engine, len(blocks)) as workers:
        rows = sweep.rows(blocks, workers, engine.part, progress=progress)
        if rows is None:
            return None
        rows += _split(rows, sweep, workers, progress=progress)
    drawn = {name: svg(*figure) for name, figure in figures(rows).items()}
    return write_study(out, "when-to-split", rows, sweep.origin, document, drawn)


def _split(rows: Rows, sweep: Sweep, workers: Workers, *, progress: bool) -> list[Row]:
    """Measure, with one cut, two cuts and so on, the cases for which no near is enough."""
    measured: list[Row] = []
    # Only cases with the offset are split, because slabs leave no gap at the plate.
    unserved = {case for case, outcome in outcomes(rows).items() if not outcome.nears}
    failed = {case for case in unserved if case.offset is Offset.PLATE}
    first = {case: row for row in reversed(rows) if (case := part_of(row, Case)) in failed}
    cases = [*first.values()][::-1]
    for count in range(1, MAX_SLABS + 1):
        cells = [_cut(row, rows, count) for row in cases]
        blocks = [tuple(group) for _, group in groupby(cells, key=lambda cell: cell.picture)]
        # These cells depend on all rows: this process, which has all rows, measures them.
        tried = sweep.rows(blocks, workers, Part(), progress=progress and bool(blocks))
        assert tried is not None
        measured += tried
        cases = [row for row in tried if suitability(row) is not Suitability.ENOUGH]
    return measured


def _cut(row: Row, rows: Rows, count: int) -> Cell:
    """Return a cell with `count` cuts, in equal ratios from the first cut up to the reach.

    The first cut lies just under the nearest surface, so that the slab next to the plate is empty.
    If a surface runs through the plate, that slab is never empty: near, cuts and reach then form
    one geometric sequence from the largest near at which one pair is not bent, whatever the depth
    buffer.
    """
    if row.family in _CROSSING:
        alike = [
            r for r in rows if (r.picture, r.drawing, r.slabs) == (row.picture, row.drawing, ())
        ]
        near = max(straight_nears(alike), default=min(r.near for r in alike))
        cuts = np.geomspace(near, 1.0, count + 2)[1:-1]
    else:
        # The first slab is empty, so that its near offset displaces no surface.
        near = FIRST_CUT_PER_NEAREST * FARTHEST / REACH / row.ratio
        cuts = np.geomspace(near, 1.0, count + 1)[:-1]
    return part_of(row, Cell, near=near, slabs=tuple(map(float, cuts)))


class Suitability(StrEnum):
    """Suitability of a setting, with the reason if it is unsuitable."""

    ENOUGH = "enough"
    BENT = "bent"
    STARVED = "starved"
    BOTH = "both"


def suitability(row: Row, *, predicted: bool = False) -> Suitability:
    """Return the suitability of a cell by its measures, or by closed forms alone.

    A cell is bent if measured or predicted displacement exceeds `TOLERANCE_PX`. The prediction
    counts because points displaced out of the film are not drawn and not measured. Without an
    offset, points clipped by the near plane count as displaced. A cell is starved if more than
    `MAX_DEPTH_WRONG` of the pixels show a wrong surface because of depth, or if sheets
    `ASKED_SEPARATION` apart at the far end are not ordered.
    """
    bent = row.predicted_p99 is not None and row.predicted_p99 > TOLERANCE_PX
    # Surfaces nearer than near are clipped; `nearest` leaves out the nearest hundredth of points.
    bent = bent or (row.offset is Offset.NONE and row.nearest < row.near)
    if predicted:
        starved = row.predicted_separation > ASKED_SEPARATION
    else:
        # If no displacement is measured, depth has lost all surfaces.
        bent = bent or (row.displacement_p99 is not None and row.displacement_p99 > TOLERANCE_PX)
        starved = (
            row.depth_wrong / row.judged > MAX_DEPTH_WRONG
            or row.misordered > MAX_MISORDERED_FRACTION
        )
    if bent:
        return Suitability.BOTH if starved else Suitability.BENT
    return Suitability.STARVED if starved else Suitability.ENOUGH


class Outcome(NamedTuple):
    """Nears with which one pair of frusta is enough for a case, and the fewest cuts."""

    #: nears for which one pair of frusta is enough, largest first
    nears: tuple[float, ...]
    #: heights of the fewest cuts that are enough; None if no tried cuts are enough
    slabs: tuple[float, ...] | None


def outcomes(rows: Iterable[Row]) -> dict[Case, Outcome]:
    """Return the outcome of each case, in the order in which cases first appear."""
    grouped: dict[Case, list[Row]] = {}
    for row in rows:
        good = grouped.setdefault(part_of(row, Case), [])
        good += [row] if suitability(row) is Suitability.ENOUGH else []
    return {
        case: Outcome(
            nears=tuple(sorted((row.near for row in good if not row.slabs), reverse=True)),
            slabs=min((row.slabs for row in good if row.slabs), key=len, default=None),
        )
        for case, good in grouped.items()
    }


def straight_nears(rows: Iterable[Row]) -> set[float]:
    """Return the nears of rows at which no picture is bent with any depth buffer."""
    rows = list(rows)
    bent = {row.near for row in rows if suitability(row) in {Suitability.BENT, Suitability.BOTH}}
    return {row.near for row in rows} - bent


def record(files: StudyFiles) -> dict[str, Any]:
    """Return the study as `xfrustum study splitting --json` prints it."""
    rows = files.rows
    criteria = {
        "displacement_p99_px": TOLERANCE_PX,
        "depth_wrong": MAX_DEPTH_WRONG,
        "separation": ASKED_SEPARATION,
    }
    cases = [
        {**asdict(case), "one_pair": bool(outcome.nears), **outcome._asdict()}
        for case, outcome in outcomes(rows).items()
    ]
    return json_object(
        {
            **files.record,
            "sentence": sentence(rows),
            "criteria": criteria,
            "agreement": agreement(of_family(rows, Family.ONE_SIDE)),
            "helps": helps(rows),
            "cases": cases,
        }
    )


def document(rows: Rows, origin: Origin) -> str:
    """Return the study as Markdown."""
    columns, lines = advice(of_family(rows, Family.ONE_SIDE))
    values = {
        "sentence": sentence(rows),
        "tolerance_px": TOLERANCE_PX,
        "max_depth_wrong": f"{100 * MAX_DEPTH_WRONG:g} %",
        "separation": f"{ASKED_SEPARATION:g}",
        "helps": helps(rows),
        "columns": columns,
        "advice": lines,
        "figures": {name: title for name, (title, _) in figures(rows).items()},
        "devices": origin.devices,
    }
    return plain_text("when-to-split.md.j2", values)


def sentence(rows: Rows) -> str:
    """Return the result of the first family in one sentence."""
    family = rows[0].family
    first = of_family(rows, family)
    scenes = (
        f"content on {family} of the plate" if family is Family.ONE_SIDE else f"scenes {family}"
    )
    results, measured = outcomes(first), {row.near for row in first if not row.slabs}
    ranked = []
    for place, buffer in enumerate(dict.fromkeys(row.buffer for row in first)):
        own = [outcome for case, outcome in results.items() if case.buffer == buffer]
        always = unbroken(set.intersection(*(set(outcome.nears) for outcome in own)), measured)
        enough = sum(bool(outcome.nears) for outcome in own)
        # Sort by the number of suitable cases, then by the range of nears; among equal buffers take
        # the first that allows early depth tests.
        rank = (enough, len(always), buffer[1] not in BY_FRAGMENT, -place)
        ranked.append((rank, buffer, always, len(own)))
    (enough, *_), buffer, always, cases = max(ranked)
    good = sum(bool(outcome.nears) for outcome in results.values())
    text = f"With {scenes}, one pair of frusta is enough in {good} of {len(results)} cases; "
    text += f"with {buffer_name(buffer)} depth in {enough} of {cases}"
    if always:
        ends = f"{near_words(always[0])} to {near_words(always[-1])}"
        text += f", at any near from {ends} of the reach"
    return f"{text}."


def of_family(rows: Iterable[Row], family: Family) -> list[Row]:
    """Return the rows of one family."""
    return [row for row in rows if row.family is family]


def unbroken(nears: Iterable[float], measured: Iterable[float]) -> tuple[float, ...]:
    """Return the largest of some nears and all nears below it down to a gap, largest first."""
    chosen = set(nears)
    from_largest = dropwhile(lambda near: near not in chosen, sorted(measured, reverse=True))
    return tuple(takewhile(lambda near: near in chosen, from_largest))


def least_near(buffer: DepthBuffer) -> float | None:
    """Return the smallest near, a share of the reach, with which depth orders the far sheets.

    The sheets are `ASKED_SEPARATION` apart. By the closed form with a reach of one: float32 is
    relatively coarsest just above a power of two. None if even a trillionth of the reach suffices.
    """

    def excess(logarithm: float) -> float:
        near = math.exp(logarithm)
        far = near + 1.0
        return float(smallest_separation(np.array(far), near, far, *buffer)) - ASKED_SEPARATION

    low, high = math.log(_LEAST_NEAR), math.log(_LARGEST_NEAR)
    return None if excess(low) <= 0 else math.exp(brentq(excess, low, high, xtol=1e-3))


def agreement(rows: Rows) -> dict[str, float]:
    """Compare closed forms with all rows of one pair of frusta.

    Measures and closed forms agree for `same` of the `cells`. The others include `in_gaps` cells in
    a gap: a near that is not enough between two nears that are. `lowest` and `highest` are ratios
    of measured to predicted displacement. They cover rows with few pixels wrong by depth whose
    prediction is a tenth to ten times the tolerance.

    `same_by_rule` cases agree with a rule of thumb: displacement is largest in the film's corner,
    W / 2 sqrt(2) n / (|z| + n), and stays within the tolerance for n up to about
    sqrt(2) TOLERANCE_PX |z| / W; one pair is enough if this limit is at least `least_near`.
    """
    single, results = [row for row in rows if not row.slabs], outcomes(rows)
    measured = {row.near for row in single}
    gaps = {
        (near, case.buffer)
        for case, outcome in results.items()
        for near in measured - set(outcome.nears)
        if outcome.nears and outcome.nears[-1] < near < outcome.nears[0]
    }
    gap_nears, gap_buffers = {near for near, _ in gaps}, {buffer for _, buffer in gaps}
    # If every near orders the separation, the smallest near counts as zero.
    least = {
        buffer: least_near(buffer) or 0.0 for buffer in dict.fromkeys(row.buffer for row in rows)
    }
    by_rule = sum(
        bool(outcome.nears)
        == (least[case.buffer] * case.resolution * case.ratio <= math.sqrt(2) * TOLERANCE_PX)
        for case, outcome in results.items()
    )
    ratios = [
        row.displacement_p99 / row.predicted_p99
        for row in single
        if row.displacement_p99 is not None and row.predicted_p99 is not None
        if TOLERANCE_PX / 10 <= row.predicted_p99 <= 10 * TOLERANCE_PX
        if row.depth_wrong / row.judged <= MAX_DEPTH_WRONG
    ]
    others = [row for row in single if suitability(row) is not suitability(row, predicted=True)]
    return {
        "cells": len(single),
        "same": len(single) - len(others),
        "in_gaps": sum(row.near in gap_nears and row.buffer in gap_buffers for row in others),
        "cases": len(results),
        "same_by_rule": by_rule,
        "lowest": min(ratios, default=math.nan),
        "highest": max(ratios, default=math.nan),
    }


def helps(rows: Rows) -> list[dict[str, Any]]:
    """Count the cases that each remedy helps in each family, in the order of the rows.

    `cases` are drawn as in the paper; for `one_pair` of these cases one pair is enough. The other
    numbers count remaining cases that are served by another depth buffer, by a fit at the screen,
    by no offset (None if not drawn), and by slabs, with at most `most_slabs` cuts.
    """
    results, entries = outcomes(rows), []

    def served(ways: Iterable[Case]) -> int | None:
        drawn = [results[way] for way in ways if way in results]
        return sum(bool(way.nears) for way in drawn) if drawn else None

    for family in dict.fromkeys(row.family for row in rows):
        paper = [
            case for case in results if case.family is family and case.drawing == AS_IN_THE_PAPER
        ]
        failed = [case for case in paper if not results[case].nears]
        easy = {case.picture for case in paper if results[case].nears}
        cuts = [len(slabs) for case in failed if (slabs := results[case].slabs)]
        entries.append(
            {
                "family": family,
                "cases": len(paper),
                "one_pair": len(paper) - len(failed),
                "other_buffer": sum(case.picture in easy for case in failed),
                "fit": served(replace(case, fit=Fit.SCREEN) for case in failed),
                "no_offset": served(replace(case, offset=Offset.NONE) for case in failed),
                "slabs": len(cuts),
                "most_slabs": max(cuts, default=0),
            }
        )
    return entries


def advice(rows: Rows) -> tuple[list[list[str]], list[tuple[int, float, tuple[str, ...]]]]:
    """Return the table of advice: columns of depth buffers with equal advice, lines by scene.

    Advice serves both sides of the plate: nears that are enough on both sides, else the cuts of the
    side that needs more cuts.
    """
    results = outcomes(rows)
    kinds = sorted({(case.resolution, case.ratio) for case in results})
    measured = {row.near for row in rows if not row.slabs}

    def advised(kind: tuple[int, float], buffer: DepthBuffer) -> str:
        sides = [
            outcome
            for case, outcome in results.items()
            if (case.resolution, case.ratio, case.buffer) == (*kind, buffer)
        ]
        if common := set.intersection(*(set(outcome.nears) for outcome in sides)):
            nears = [near_words(near) for near in unbroken(common, measured)]
            return " to ".join(dict.fromkeys((nears[0], nears[-1])))
        cuts = [outcome.slabs for outcome in sides if not outcome.nears]
        if not cuts or None in cuts:
            return "**no**"
        return "**split** at " + ", ".join(
            f"{cut:.2g}" for cut in max((c for c in cuts if c), key=len)
        )

    columns: dict[tuple[str, ...], list[str]] = {}
    for buffer in dict.fromkeys(row.buffer for row in rows):
        columns.setdefault(tuple(advised(kind, buffer) for kind in kinds), []).append(
            buffer_name(buffer)
        )
    lines = [(*kind, tuple(cells[line] for cells in columns)) for line, kind in enumerate(kinds)]
    return list(columns.values()), lines


#: colors of the maps (Okabe and Ito's palette for color-blind readers) and their meanings
COLORS = {
    Suitability.ENOUGH: ("#009E73", "one pair is enough"),
    Suitability.BENT: ("#E69F00", "bent by the near plane"),
    Suitability.STARVED: ("#56B4E9", "starved of depth"),
    Suitability.BOTH: ("#5b5b5b", "both"),
}


def figures(rows: Rows) -> dict[str, tuple[str, list[Row]]]:
    """Return title and rows of each map, by name: a map for each side, and two further maps."""
    maps: dict[str, tuple[str, list[Row]]] = {}
    for row in rows:
        name, title = "families", "Other scenes"
        if row.family is Family.ONE_SIDE:
            name = title = row.side
        elif row.family is Family.RECENTERED_THROUGH:
            name, title = "recentered-through", "Recentered, through the plate"
        named = f"when-to-split-{name}", f"{title}: where one pair of frusta is enough"
        maps.setdefault(named[0], (named[1], []))[1].extend([] if row.slabs else [row])
    return maps


def svg(title: str, rows: Rows) -> str:
    """Return a map of `figures` as an SVG document."""

    def power(near: float) -> str:
        exponent = math.log10(near)
        written = str(round(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        return f"10{written}" if abs(exponent - round(exponent)) < 1e-6 else ""

    drawn = {
        "title": title,
        "panels": panels(rows),
        "names": [buffer_name(buffer) for buffer in dict.fromkeys(row.buffer for row in rows)],
        "nears": sorted({row.near for row in rows}, reverse=True),
        "legend": list(COLORS.values()),
    }
    return fragment("study-map.svg.j2", {"map": drawn}, {"power": power})


def panels(rows: Rows) -> list[list[dict[str, Any]]]:
    """Return rows of panels of a map: a line of colors for each buffer, largest near first."""
    all_panels: dict[tuple[object, ...], list[dict[str, Any]]] = {}
    pictures: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        pictures.setdefault((row.family, row.drawing, row.ratio, row.resolution), []).append(row)
    for (family, drawing, ratio, resolution), own in pictures.items():
        own.sort(key=lambda row: -row.near)
        lines = [
            tuple(COLORS[suitability(row)][0] for row in own if row.buffer == buffer)
            for buffer in dict.fromkeys(row.buffer for row in rows)
        ]
        options = zip(("pivot", "fit", "offset"), drawing, AS_IN_THE_PAPER, strict=True)
        words = [] if family is Family.ONE_SIDE else [family]
        words += [f"{name} {value}" for name, value, plain in options if value != plain]
        distance = f"distance {1 / ratio:g}" if family in _CROSSING else f"depth {ratio:g}"
        line = (family, drawing, ratio if family is Family.ONE_SIDE else None)
        own_title = {"row": ", ".join(words), "title": f"{distance}, {resolution} px"}
        all_panels.setdefault(line, []).append({**own_title, "lines": lines})
    return list(all_panels.values())


def buffer_name(buffer: DepthBuffer) -> str:
    """Return the usual name of format and mapping, such as `D24 standard`."""
    return f"{buffer[0].upper()} {buffer[1]}"


def near_words(near: float) -> str:
    """Return a share of the reach, in half decades, with one digit: `3e-4` for 3.16e-4."""
    return re.sub(r"e-0", "e-", f"{near:.0e}")
