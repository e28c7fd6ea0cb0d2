"""The main job: trace the truth once per aperture, rasterize every setting, compare each."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from xfrustum.compare.judging.judge import Judge
from xfrustum.reference.plain import CERTIFIED_DECISION, Decision, open_reference
from xfrustum.reports.common import provenance
from xfrustum.reports.common.geometry import CameraGeometry
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.timing import Stopwatch, Timing
from xfrustum.reports.error_report.measuring import (
    REPEAT_BUDGET_S,
    MeasuredSetting,
    SettingMeasurer,
    TracedAperture,
)
from xfrustum.reports.inspection.drawn import inspected_drawings
from xfrustum.reports.inspection.hogels import MAX_HOGELS, InspectedHogel
from xfrustum.reports.measurements.best import best_setting, keeping_tolerance
from xfrustum.reports.measurements.measurement import (
    Measurement,
    RasterParts,
    SettingPictures,
    StageParts,
    Sweep,
    TracersAlonePictured,
)
from xfrustum.scenes.model.effects import Effect, chosen
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Aperture

DepthBuffer = tuple[DepthFormat, DepthMapping]

DEFAULT_DEPTHS: tuple[DepthBuffer, ...] = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.REVERSED),
    (DepthFormat.D32F, DepthMapping.STANDARD),
    (DepthFormat.D32F, DepthMapping.REVERSED),
)
"""Depth buffers of a report, the cheapest first: where windows are equally good, the first is recommended."""

DEFAULT_NEAR_COUNT = 25
_LARGEST_NEAR_PER_REACH, _SMALLEST_NEAR_PER_REACH = 1e-1, 1e-8

PAGE_PIXELS = 120_000_000
"""Pixels of all settings together up to which pictures are shown in full; those of larger sweeps are reduced.
All pictures of a setting take between a tenth and a fifth of a byte per pixel, so that the page stays under
30 MB."""


def default_nears(frustum: Frustum) -> tuple[float, ...]:
    """Return 25 offsets in scene units, logarithmic, from 1e-1 down to 1e-8 of the longest reach."""
    fractions = np.geomspace(_LARGEST_NEAR_PER_REACH, _SMALLEST_NEAR_PER_REACH, DEFAULT_NEAR_COUNT)
    return tuple(float(fraction) * frustum.longest_reach for fraction in fractions)


def settings_grid(
    nears: Iterable[float],
    depths: Iterable[DepthBuffer],
    geometries: Iterable[CameraGeometry] = (CameraGeometry(),),
) -> tuple[DoubleFrustum, ...]:
    """Return every near with every depth buffer and camera geometry: all nears of the first buffer first.

    The buffers of the first geometry come before those of the second.
    """
    nears, depths = tuple(nears), tuple(depths)
    return tuple(
        geometry.with_depth(near, depth, mapping)
        for geometry in geometries
        for depth, mapping in depths
        for near in nears
    )


def sweep(  # noqa: PLR0913 - as `make_report`
    scene: Scene,
    apertures: Sequence[Aperture],
    settings: Sequence[DoubleFrustum],
    *,
    decision: Decision = CERTIFIED_DECISION,
    effects: str = "auto",
    causes: bool = True,
    progress: bool = False,
) -> Sweep:
    """Measure every setting at every aperture.

    Only numbers and encoded pictures are kept, so memory does not grow with the float images.

    Parameters
    ----------
    apertures, settings
        At least one aperture and one setting.
    decision
        What decides the truths.
    effects
        Effects that are simulated, as `--effects` takes them.
    causes
        Whether wrong pixels are charged to causes, and errors predicted; else nothing of both is made.
    progress
        Show a progress bar on standard error.

    Raises
    ------
    InputError
        No usable OpenGL context, or an unknown tracer.
    """
    watch, begun, cpu_begun = Stopwatch(), time.perf_counter(), time.process_time()
    with _opened(scene, decision, effects, watch) as judge:
        reduction = _reduction(scene.frustum, len(apertures) * len(settings))
        measurer = SettingMeasurer(judge, reduction, causes=causes)
        measured = _run(measurer, apertures, settings, watch, progress)
        with watch.stage("repeat"):
            frames = _repeated(measurer, measured.rows, time.perf_counter() - begun)
        inspected, inspection_cpu_s = _inspected(judge, measured.rows, watch, causes=causes)
    wall_s = time.perf_counter() - begun
    return Sweep(
        scene=scene,
        apertures=tuple(apertures),
        rows=tuple(measured.rows),
        pictures=tuple(measured.pictures),
        truths=tuple(measured.truths),
        alone=tuple(measured.alone),
        decided_by=judge.reference.decided_by,
        reduction=reduction,
        versions={**provenance.versions(), **judge.reference.versions},
        devices=_devices(judge),
        times_s=watch.seconds | {"other": wall_s - sum(watch.seconds.values())},
        parts_s=measured.parts_s,
        wall_s=wall_s,
        frames_s=frames,
        cpu_s=_cpu_seconds(measurer, inspection_cpu_s, time.process_time() - cpu_begun),
        charged=causes,
        inspected=inspected,
    )


def _inspected(
    judge: Judge, rows: Sequence[Measurement], watch: Stopwatch, *, causes: bool
) -> tuple[tuple[InspectedHogel, ...], float]:
    """Return the hogels where the best setting is worst, drawn anew with it, and the CPU seconds of that."""
    best = best_setting(rows).settings
    drawn = sorted((row for row in rows if row.settings == best), key=lambda row: -row.surface_fraction)
    begun = time.process_time()
    with watch.stage("inspection"):
        apertures = [row.aperture for row in drawn[:MAX_HOGELS]]
        found = tuple(inspected_drawings(judge, apertures, best, causes=causes))
    return found, time.process_time() - begun


def _opened(scene: Scene, decision: Decision, effects: str, watch: Stopwatch) -> Judge:
    with watch.stage("prepare"):
        simulated = _simulated(scene, effects)
        return Judge(scene, reference=open_reference(scene, decision, simulated), effects=simulated)


def _devices(judge: Judge) -> dict[str, str]:
    opengl = {f"OpenGL {name}": value for name, value in judge.drawing.device.items()}
    return {**provenance.machine(), **opengl}


def _cpu_seconds(measurer: SettingMeasurer, inspection_s: float, everything_s: float) -> dict[str, float]:
    """Return the CPU seconds of all stages whose share of the process is known, and of everything."""
    wanted: tuple[str, ...] = ("raster", "trace", "pictures", "alone", "repeat")
    known = {name: seconds for name, seconds in measurer.cpu_seconds.items() if name in wanted}
    return {**known, "inspection": inspection_s, "all": everything_s}


def _simulated(scene: Scene, effects: str) -> frozenset[Effect] | None:
    """Return the effects that are named; None for `auto`.

    Renderers decide themselves what that is: with a tiny near, pictures show surfaces beyond the reach.
    """
    return None if effects == "auto" else chosen(scene, effects)


@dataclass(frozen=True, kw_only=True)
class _Measured:
    """Rows and pictures of all settings at all apertures, pictures of the truths, and the tracers alone."""

    rows: list[Measurement]
    pictures: list[SettingPictures]
    truths: list[bytes]
    alone: list[TracersAlonePictured]

    @property
    def parts_s(self) -> StageParts:
        """Seconds of the parts of stages, of all rows together."""
        return StageParts(raster=RasterParts(gpu=sum(row.parts_s.raster.gpu for row in self.rows)))


def _repeated(
    measurer: SettingMeasurer, rows: Sequence[Measurement], measured_s: float
) -> dict[DoubleFrustum, Timing]:
    """Time what keeps the tolerance again, at the first aperture, for no longer than it was measured."""
    kept = keeping_tolerance(rows)
    first = [row for row in rows if row.aperture == rows[0].aperture and row.settings in kept]
    return measurer.repeat(first, min(REPEAT_BUDGET_S, measured_s))


def _run(
    measurer: SettingMeasurer,
    apertures: Sequence[Aperture],
    settings: Sequence[DoubleFrustum],
    watch: Stopwatch,
    progress: bool,
) -> _Measured:
    """Trace every aperture, and draw and judge every setting at each of them."""
    measured = _Measured(rows=[], pictures=[], truths=[], alone=[])
    steps = len(apertures) * (1 + len(settings))
    with progress_bar(steps, "report", "image", shown=progress) as bar:
        found: dict[tuple[Aperture, DoubleFrustum], MeasuredSetting] = {}
        for aperture, one in measurer.measure(apertures, settings):
            at = f"aperture {aperture.column},{aperture.row}"
            if isinstance(one, TracedAperture):
                measured.truths.append(one.picture)
                measured.alone.extend([one.alone] if one.alone else [])
                bar.set_postfix_str(f"{at}: truth", refresh=False)
            else:
                found[aperture, one.row.settings] = one
                bar.set_postfix_str(f"{at}: near {one.row.settings.near:.3g}", refresh=False)
            bar.update()
    watch.add(measurer.seconds)
    in_order = [found[aperture, setting] for aperture in apertures for setting in settings]
    measured.rows.extend(one.row for one in in_order)
    measured.pictures.extend(one.pictures for one in in_order)
    return measured


def _reduction(frustum: Frustum, count: int) -> int:
    width, height = frustum.resolution
    return max(1, math.ceil(math.sqrt(width * height * count / PAGE_PIXELS)))
