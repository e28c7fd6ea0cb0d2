"""How the study of splitting measures a cell: truth against raster, and pairs of sheets at the far end."""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType

import numpy as np

from xfrustum.compare import compare_images
from xfrustum.compare.attribution.wrong_by_depth import DepthControl
from xfrustum.compare.metrics.displacement import Spread, lengths
from xfrustum.compare.planning.sheets import SheetFilm, SheetPair
from xfrustum.compare.prediction import predict
from xfrustum.compare.prediction.depth import smallest_separation
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.lines.lines import model_cameras
from xfrustum.reports.splitting_study.grid import Cell, Family, Picture, SheetCell
from xfrustum.scenes.geometry.refine import refine
from xfrustum.scenes.library.depth_family import (
    FARTHEST,
    REACH,
    SeenScene,
    car_through_plate,
    cars,
    cars_off_the_middle,
    cars_on_both_sides,
    empty_scene,
    recentered_cars,
)
from xfrustum.scenes.plate.double_frustum import DoubleFrustum, Offset
from xfrustum.tolerances import TOLERANCE_PX

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


@dataclass(frozen=True, kw_only=True)
class CellResult:
    """One picture judged; lengths are shares of the reach, displacement in pixels.

    Attributes
    ----------
    judged, covered
        Pixels whose truth is no tie; those where the truth shows a surface.
    nearest, farthest
        Percentile `NEAREST_PERCENTILE` and maximum of |z| over what the truth shows.
    surface_wrong
        Judged pixels that show the wrong surface, whatever the cause.
    outside
        Those of `surface_wrong` whose point belongs outside the true film.
    depth_wrong
        Those of `surface_wrong` that are right with exact depth, at the same near and slabs.
    lost
        Those of `depth_wrong` that show nothing where exact depth shows a surface.
    displacement_rms, displacement_p99, displacement_max
        Measured displacement; None where nothing is shown.
    displaced
        Pixels of the drawn picture that show a surface displaced by more than `TOLERANCE_PX`.
    predicted_rms, predicted_p99
        Displacement by the closed form, from the truth alone.
    seconds
        Wall time of drawing and judging.
    """

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
    seconds: float


@dataclass(frozen=True, kw_only=True)
class SheetResult:
    """Sheets of every separation, by one depth buffer.

    Attributes
    ----------
    misordered
        Share of pixels that do not show the right sheet, for each of `SEPARATIONS`.
    predicted_separation
        Smallest separation ordered at the farthest surface by the closed form, share of the reach.
    seconds
        Wall time of drawing.
    """

    misordered: tuple[float, ...]
    predicted_separation: float
    seconds: float


def seen_scene(picture: Picture) -> SeenScene:
    """Return the scene of a picture, and the aperture that it is seen from."""
    resolution = (picture.resolution, picture.resolution)
    match picture.family:
        case Family.ONE_SIDE:
            scene = cars(picture.ratio, picture.side, resolution)
            seen = SeenScene(scene=scene, aperture=scene.plate.middle)
        case Family.BOTH_SIDES:
            seen = cars_on_both_sides(picture.ratio, resolution)
        case Family.OFF_MIDDLE | Family.IN_MIDDLE:
            in_middle = picture.family is Family.IN_MIDDLE
            seen = cars_off_the_middle(picture.ratio, resolution, in_middle=in_middle)
        case Family.RECENTERED:
            seen = recentered_cars(picture.ratio, resolution)
        case Family.THROUGH:
            seen = car_through_plate(1 / picture.ratio, resolution)
    return SeenScene(scene=refine(seen.scene, picture.refined), aperture=seen.aperture)


class PictureWorkbench:
    """The truth of one picture, and a rasterizer that is judged by it.

    A context manager; memory is that of one scene and a few images.
    """

    def __init__(self, picture: Picture) -> None:
        seen = seen_scene(picture)
        self._scene, self._aperture = seen.scene, seen.aperture
        self._reference = Reference(self._scene)
        self._truth = self._reference.trace(self._aperture)
        heights = np.abs(self._truth.height[self._truth.covered].astype(np.float64)) / REACH
        self._nearest = float(np.percentile(heights, NEAREST_PERCENTILE))
        self._farthest = float(heights.max())
        self._rasterizer = Rasterizer(self._scene)
        self._last_control: tuple[DepthControl, Spread | None] | None = None

    def __enter__(self) -> PictureWorkbench:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._rasterizer.release()

    def measure(self, cell: Cell) -> CellResult:
        """Draw a cell of this scene and judge it; cells of one near and one set of slabs share a control."""
        control, predicted = self._control(cell.settings)
        start = time.perf_counter()
        drawn = self._rasterizer.render(self._aperture, cell.settings, normals=False, color=False)
        judged = compare_images(self._truth, drawn, self._reference)
        wrong = judged.maps.surface
        assert wrong is not None and judged.surface is not None
        moved = lengths(judged.maps.displacement)[drawn.off_plate]
        seconds = time.perf_counter() - start
        return CellResult(
            judged=judged.judged,
            covered=judged.covered,
            nearest=self._nearest,
            farthest=self._farthest,
            surface_wrong=int(wrong.sum()),
            outside=judged.surface.outside,
            depth_wrong=int(control.charged(wrong).sum()),
            lost=int(control.lost(wrong, drawn).sum()),
            displacement_rms=judged.displacement_px.rms if judged.displacement_px else None,
            displacement_p99=judged.displacement_px.p99 if judged.displacement_px else None,
            displacement_max=judged.displacement_px.max if judged.displacement_px else None,
            displaced=int((moved > TOLERANCE_PX).sum()),
            predicted_rms=predicted.rms if predicted else None,
            predicted_p99=predicted.p99 if predicted else None,
            seconds=seconds,
        )

    def _control(self, settings: DoubleFrustum) -> tuple[DepthControl, Spread | None]:
        """Return the control of some settings and the predicted displacement; the last ones are kept."""
        if self._last_control is None or not self._last_control[0].serves(settings):
            control = DepthControl.of(self._rasterizer, self._truth, self._reference, settings)
            predicted = predict.displacement(self._truth, self._scene.frustum, control.settings)
            self._last_control = control, predicted
        return self._last_control


class SheetWorkbench:
    """Pairs of sheets of every separation, as one camera with one offset sees them.

    A context manager.

    Parameters
    ----------
    cell
        Any cell of that camera and that offset; its depth buffer means nothing.
    """

    def __init__(self, cell: SheetCell) -> None:
        films = [_sheets(cell, separation * REACH) for separation in SEPARATIONS]
        with ExitStack() as stack:
            self._films = [(film, stack.enter_context(Rasterizer(film.scene))) for film in films]
            self._stack = stack.pop_all()

    def __enter__(self) -> SheetWorkbench:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def measure(self, cell: SheetCell) -> SheetResult:
        """Draw the sheets of every separation with one depth buffer."""
        start = time.perf_counter()
        shares = [film.wrong_shares(rasterizer, cell.settings) for film, rasterizer in self._films]
        return SheetResult(
            misordered=tuple(share for (share,) in shares),
            predicted_separation=predicted_separation(cell),
            seconds=time.perf_counter() - start,
        )


def _sheets(cell: SheetCell, separation: float) -> SheetFilm:
    """Return one pair of sheets at the far end of a cell's side, which covers the film.

    The sheet that must not show comes first, so that equal depths show it.
    """
    scene = empty_scene((SHEET_CELLS, SHEET_CELLS))
    cameras = model_cameras(scene.frustum, scene.plate.middle, cell.settings)
    outermost = max(cameras, key=lambda camera: max(map(abs, camera.heights)))
    phases = np.random.default_rng(4).uniform(-SHEET_PHASE, SHEET_PHASE, SHEET_CELLS**2)
    pair = SheetPair(
        camera=outermost, heights=SHEET_HEIGHT * (1 + phases), separation=separation, loser_first=True
    )
    owner = np.zeros((SHEET_CELLS, SHEET_CELLS), dtype=np.int64)
    return SheetFilm.of(scene, scene.plate.middle, [pair], owner, SHEET_CELL_PIXELS)


def predicted_separation(cell: SheetCell) -> float:
    """Return the smallest separation ordered at the farthest surface, by the closed form."""
    if cell.slabs:
        near, offset = cell.slabs[-1] * REACH, 0.0
    else:
        near = cell.near * REACH
        offset = near if cell.offset is Offset.PLATE else 0.0
    ordered = smallest_separation(np.array(FARTHEST + offset), near, offset + REACH, cell.depth, cell.mapping)
    return float(ordered) / REACH
