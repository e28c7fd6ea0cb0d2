"""The main job: trace the truth once per aperture, rasterize every setting, compare each."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.common import provenance
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.timing import Stopwatch
from xfrustum.reports.error_report.sweep_bench import REPEAT_BUDGET_S, SweepBench
from xfrustum.reports.measurements.measurement import Measurement, Sweep
from xfrustum.scenes.model.effects import chosen
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Aperture
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

DepthBuffer = tuple[DepthFormat, DepthMapping]

DEFAULT_DEPTHS: tuple[DepthBuffer, ...] = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.REVERSED),
    (DepthFormat.D32F, DepthMapping.STANDARD),
    (DepthFormat.D32F, DepthMapping.REVERSED),
)
"""Cheapest first: of windows of the same nears, the first is recommended."""

DEFAULT_NEAR_COUNT = 25
_LARGEST_NEAR, _SMALLEST_NEAR = 1e-1, 1e-8

PAGE_PIXELS = 120_000_000
"""Pixels of all settings together that are shown in full. All pictures of a setting take between a
tenth and a fifth of a byte per pixel, so that the page stays under 30 MB; larger sweeps are shown reduced."""


def default_nears(frustum: Frustum) -> tuple[float, ...]:
    """Return 25 offsets in scene units, logarithmic, from 1e-1 down to 1e-8 of the longest reach."""
    fractions = np.geomspace(_LARGEST_NEAR, _SMALLEST_NEAR, DEFAULT_NEAR_COUNT)
    return tuple(float(fraction) * frustum.longest_reach for fraction in fractions)


def settings_grid(nears: Iterable[float], depths: Iterable[DepthBuffer]) -> tuple[DoubleFrustum, ...]:
    """Return every near with every depth buffer: all nears of the first buffer first."""
    return tuple(
        DoubleFrustum(near=near, depth=depth, mapping=mapping) for depth, mapping in depths for near in nears
    )


def sweep(
    scene: Scene,
    apertures: Sequence[Aperture],
    settings: Sequence[DoubleFrustum],
    *,
    tracer: str = "embree",
    effects: str = "auto",
    progress: bool = False,
) -> Sweep:
    """Measure every setting at every aperture.

    Only numbers and encoded pictures are kept, so memory does not grow with the float images.

    Parameters
    ----------
    apertures, settings
        At least one each.
    tracer
        Which reference traces the truth.
    effects
        What is simulated, as `--effects` takes it.
    progress
        Show a progress bar on standard error.

    Raises
    ------
    InputError
        No usable OpenGL context, or an unknown tracer.
    """
    watch, begun = Stopwatch(), time.perf_counter()
    with watch.stage("prepare"):
        reference = Reference(scene, tracer=tracer, effects=chosen(scene, effects))
        rasterizer = Rasterizer(scene, effects=chosen(scene, effects))
    bench = SweepBench(
        scene, reference, rasterizer, _reduction(scene.frustum, len(apertures) * len(settings))
    )
    with rasterizer:
        _run(bench, apertures, settings, watch, progress)
        with watch.stage("repeat"):
            # No longer than the measurement itself.
            budget_s = min(REPEAT_BUDGET_S, time.perf_counter() - begun)
            frames = bench.repeat(_within_tolerance(bench.rows), apertures[0], budget_s)
    opengl = {f"OpenGL {name}": value for name, value in rasterizer.device.items()}
    wall_s = time.perf_counter() - begun
    return Sweep(
        scene=scene,
        apertures=tuple(apertures),
        rows=tuple(bench.rows),
        pictures=tuple(bench.pictures),
        truths=tuple(bench.truths),
        reduction=bench.reduction,
        versions={**provenance.versions(), **reference.versions},
        devices={**provenance.machine(), **opengl},
        times_s=watch.seconds | {"other": wall_s - sum(watch.seconds.values())},
        parts_s={"raster": {"gpu": bench.gpu_s}},
        wall_s=wall_s,
        frames_s=frames,
    )


def _within_tolerance(rows: Sequence[Measurement]) -> list[DoubleFrustum]:
    """Return the settings that keep the usual tolerance at every aperture, in the order of the rows."""
    keeps = {row.settings: True for row in rows}
    for row in rows:
        moved, wrong = row.displacement_p99_px, row.surface_fraction
        keeps[row.settings] &= moved <= TOLERANCE_PX and wrong <= MAX_WRONG
    return [settings for settings, kept in keeps.items() if kept]


def _run(
    bench: SweepBench,
    apertures: Sequence[Aperture],
    settings: Sequence[DoubleFrustum],
    watch: Stopwatch,
    progress: bool,
) -> None:
    """Trace every aperture, and draw and judge every setting there."""
    with watch.stage("warm up"):
        bench.warm_up(apertures[0], settings)
    steps = len(apertures) * (1 + len(settings))
    with progress_bar(steps, "report", "image", shown=progress) as bar:
        for aperture in apertures:
            bar.set_postfix_str(f"aperture {aperture.column},{aperture.row}: truth", refresh=False)
            bench.trace(aperture, watch)
            bar.update()
            for some in _batches(settings, bench.at_once):
                bar.set_postfix_str(
                    f"aperture {aperture.column},{aperture.row}: {some[0].depth_label}", refresh=False
                )
                bench.measure(aperture, some, watch)
                bar.update(len(some))


def _batches(settings: Sequence[DoubleFrustum], size: int) -> Iterator[Sequence[DoubleFrustum]]:
    """Yield parts of about that size: a remainder by itself would leave processors idle."""
    count = max(1, round(len(settings) / size))
    for part in np.array_split(np.arange(len(settings)), count):
        yield [settings[i] for i in part]


def _reduction(frustum: Frustum, count: int) -> int:
    width, height = frustum.resolution
    return max(1, math.ceil(math.sqrt(width * height * count / PAGE_PIXELS)))
