"""How the study of splitting measures a cell: truth against raster, and pairs of sheets at the far end."""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import dataclass, replace
from types import TracebackType

import numpy as np

from xfrustum.compare import compare_images
from xfrustum.compare.metrics.displacement import Spread
from xfrustum.compare.prediction import predict
from xfrustum.compare.prediction.depth import smallest_separation
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.splitting_study.grid import CONTROL, Cell, SheetCell
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.geometry.refine import refine
from xfrustum.scenes.library.depth_family import FARTHEST, REACH, SHOWN_SHEET, cars, sheet_pair
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum

SEPARATIONS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
"""Of the sheets, as shares of the reach."""

SHEET_PIXELS = 64

NEAREST_PERCENTILE = 1
"""Of the visible |z|: what is nearer is a hundredth of the picture, which the 99th percentile leaves out."""


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
    depth_wrong
        Of them those that the control, at the same near and slabs, shows rightly.
    lost
        Of them those that show nothing where the control shows a surface.
    displacement_rms, displacement_p99
        None where nothing is shown.
    predicted_rms, predicted_p99
        The same by the closed form, from the truth alone.
    seconds
        Wall time of drawing and judging.
    """

    judged: int
    covered: int
    nearest: float
    farthest: float
    surface_wrong: int
    depth_wrong: int
    lost: int
    displacement_rms: float | None
    displacement_p99: float | None
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Control:
    """What all depth buffers share at one near and one set of slabs.

    Attributes
    ----------
    settings
        Of the control.
    right, shown
        (H, W) where the control shows the right surface, or none rightly; where it shows one.
    predicted
        Displacement by the closed form.
    """

    settings: DoubleFrustum
    right: Mask
    shown: Mask
    predicted: Spread | None


class PictureBench:
    """The truth of one scene of cars, and a rasterizer that is judged by it.

    A context manager; memory is that of one scene and a few images.

    Parameters
    ----------
    side, ratio, resolution, refined
        As in `Cell`.
    """

    def __init__(self, side: Camera, ratio: float, resolution: int, refined: int) -> None:
        self._scene = refine(cars(ratio, side, (resolution, resolution)), refined)
        self._reference = Reference(self._scene)
        self._aperture = self._scene.plate.middle
        self._truth = self._reference.trace(self._aperture)
        heights = np.abs(self._truth.height[self._truth.covered].astype(np.float64)) / REACH
        self._nearest = float(np.percentile(heights, NEAREST_PERCENTILE))
        self._farthest = float(heights.max())
        self._rasterizer = Rasterizer(self._scene)
        self._last_control: Control | None = None

    def __enter__(self) -> PictureBench:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._rasterizer.release()

    def measure(self, cell: Cell) -> CellResult:
        """Draw a cell of this scene and judge it; cells of one near and one set of slabs share a control."""
        control = self._control(cell.settings)
        start = time.perf_counter()
        drawn = self._draw(cell.settings)
        judged = compare_images(self._truth, drawn, self._reference)
        wrong = judged.maps.surface
        assert wrong is not None
        seconds = time.perf_counter() - start
        charged = wrong & control.right
        return CellResult(
            judged=judged.judged,
            covered=judged.covered,
            nearest=self._nearest,
            farthest=self._farthest,
            surface_wrong=int(wrong.sum()),
            depth_wrong=int(charged.sum()),
            lost=int((charged & control.shown & ~drawn.covered).sum()),
            displacement_rms=judged.displacement_px.rms if judged.displacement_px else None,
            displacement_p99=judged.displacement_px.p99 if judged.displacement_px else None,
            predicted_rms=control.predicted.rms if control.predicted else None,
            predicted_p99=control.predicted.p99 if control.predicted else None,
            seconds=seconds,
        )

    def _draw(self, settings: DoubleFrustum) -> HogelImage:
        return self._rasterizer.render(self._aperture, settings, normals=False, color=False)

    def _control(self, settings: DoubleFrustum) -> Control:
        """Return the control of some settings; the last one is kept."""
        wanted = replace(settings, depth=CONTROL[0], mapping=CONTROL[1])
        if self._last_control is None or self._last_control.settings != wanted:
            drawn = self._draw(wanted)
            wrong = compare_images(self._truth, drawn, self._reference).maps.surface
            assert wrong is not None
            self._last_control = Control(
                settings=wanted,
                right=~wrong,
                shown=drawn.covered,
                predicted=predict.displacement(self._truth, self._scene.frustum, wanted),
            )
        return self._last_control


class SheetBench:
    """Pairs of sheets of every separation, as the cameras of one offset see them.

    A context manager.

    Parameters
    ----------
    offset
        How far the cameras that draw the far end stand back, as a share of the reach.
    """

    def __init__(self, offset: float) -> None:
        with ExitStack() as stack:
            self._rasterizers = [
                stack.enter_context(Rasterizer(sheet_pair(offset * REACH, separation * REACH, SHEET_PIXELS)))
                for separation in SEPARATIONS
            ]
            self._stack = stack.pop_all()

    def __enter__(self) -> SheetBench:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def measure(self, cell: SheetCell) -> SheetResult:
        """Draw the sheets of every separation with one depth buffer and one camera."""
        start = time.perf_counter()
        return SheetResult(
            misordered=tuple(self._misordered(r, cell) for r in self._rasterizers),
            predicted_separation=predicted_separation(cell),
            seconds=time.perf_counter() - start,
        )

    @staticmethod
    def _misordered(rasterizer: Rasterizer, cell: SheetCell) -> float:
        drawn = rasterizer.render(rasterizer.scene.plate.middle, cell.settings, normals=False, color=False)
        return float((drawn.object != SHOWN_SHEET[cell.side]).mean())


def predicted_separation(cell: SheetCell) -> float:
    """Return the smallest separation ordered at the farthest surface, by the closed form."""
    if cell.slabs:
        near, offset = cell.slabs[-1] * REACH, 0.0
    else:
        near = offset = cell.near * REACH
    ordered = smallest_separation(np.array(FARTHEST + offset), near, offset + REACH, cell.depth, cell.mapping)
    return float(ordered) / REACH
