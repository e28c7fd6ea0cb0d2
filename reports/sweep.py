"""The main job: trace the truth once per aperture, rasterize every setting, compare each."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from xfrustum.compare import ErrorMaps, compare_images
from xfrustum.compare.predict import Predictor
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports import images, provenance
from xfrustum.reports.measurement import Measurement, SettingPictures, Sweep
from xfrustum.reports.progress import progress_bar
from xfrustum.reports.shading import is_shaded
from xfrustum.reports.timing import Stopwatch
from xfrustum.scenes.double_frustum import DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.effects import chosen
from xfrustum.scenes.frustum import Frustum
from xfrustum.scenes.hogel_image import HogelImage
from xfrustum.scenes.plate import Aperture
from xfrustum.scenes.scene import Scene

DepthBuffer = tuple[DepthFormat, DepthMapping]

DEFAULT_DEPTHS: tuple[DepthBuffer, ...] = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.REVERSED),
    (DepthFormat.D32F, DepthMapping.STANDARD),
    (DepthFormat.D32F, DepthMapping.REVERSED),
)
"""Cheapest first: of equally good settings at one near, the verdict names the first."""

DEFAULT_NEAR_COUNT = 25
_LARGEST_NEAR, _SMALLEST_NEAR = 1e-1, 1e-8

PAGE_PIXELS = 120_000_000
"""Pixels of all settings together that are shown in full. All pictures of a setting take between a
tenth and a fifth of a byte per pixel, so that the page stays under 30 MB; larger sweeps are shown reduced."""


PROCESSORS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
"""That this process may run on."""

AT_ONCE_PIXELS = 1 << 20
"""Pixels of all images that are judged side by side, some 200 bytes each; a larger image is judged alone."""


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
    bench = _Bench(scene, reference, rasterizer, _reduction(scene.frustum, len(apertures) * len(settings)))
    with rasterizer:
        _run(bench, apertures, settings, watch, progress)
    opengl = {f"OpenGL {name}": value for name, value in rasterizer.device.items()}
    return Sweep(
        scene=scene,
        apertures=tuple(apertures),
        rows=tuple(bench.rows),
        pictures=tuple(bench.pictures),
        truths=tuple(bench.truths),
        reduction=bench.reduction,
        versions={**provenance.versions(), **reference.versions},
        devices={**provenance.machine(), **opengl},
        times_s=watch.seconds,
        wall_s=time.perf_counter() - begun,
    )


def _run(
    bench: _Bench,
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
            for start in range(0, len(settings), bench.at_once):
                some = settings[start : start + bench.at_once]
                bar.set_postfix_str(
                    f"aperture {aperture.column},{aperture.row}: {some[0].depth_label}", refresh=False
                )
                bench.measure(aperture, some, watch)
                bar.update(len(some))


def _reduction(frustum: Frustum, count: int) -> int:
    width, height = frustum.resolution
    return max(1, math.ceil(math.sqrt(width * height * count / PAGE_PIXELS)))


class _Bench:
    """The two renderers of a scene, the truth of the aperture at hand, and all that was measured.

    Attributes
    ----------
    at_once
        How many settings are judged side by side.
    """

    _truth: HogelImage
    _predictor: Predictor

    def __init__(self, scene: Scene, reference: Reference, rasterizer: Rasterizer, reduction: int) -> None:
        self._frustum = scene.frustum
        self._shaded = is_shaded(scene)
        self._reference = reference
        self._rasterizer = rasterizer
        self.at_once = max(1, min(2 * PROCESSORS, AT_ONCE_PIXELS // math.prod(scene.frustum.resolution)))
        self.reduction = reduction
        self.rows: list[Measurement] = []
        self.pictures: list[SettingPictures] = []
        self.truths: list[bytes] = []

    def warm_up(self, aperture: Aperture, settings: Sequence[DoubleFrustum]) -> None:
        """Draw once what compiles a program or allocates a target: no row's time is to have that in it."""
        for setting in {(s.depth, s.mapping): s for s in settings}.values():
            self._rasterizer.render(aperture, setting, normals=False, color=True)

    def trace(self, aperture: Aperture, watch: Stopwatch) -> None:
        lap = Stopwatch()
        with lap.stage("trace"):
            self._truth = self._reference.trace(aperture)
        self._trace_s = dict(lap.seconds)
        with lap.stage("pictures"):
            self.truths.append(images.picture(self._truth, self.reduction))
        with lap.stage("predict"):
            gaps = self._reference.gaps(aperture)
            bits = int(self._rasterizer.device["subpixel_bits"])
            self._predictor = Predictor(self._truth, gaps, self._frustum, bits)
        watch.add(lap.seconds)

    def measure(self, aperture: Aperture, settings: Sequence[DoubleFrustum], watch: Stopwatch) -> None:
        """Draw some settings one after the other, alone on the machine, then judge them side by side."""
        drawn = [self._draw(aperture, setting) for setting in settings]
        with ThreadPoolExecutor(PROCESSORS) as pool:
            judged = list(pool.map(self._judge, drawn))
            # By themselves: they belong to the page, whose price is not that of the measurement.
            with watch.stage("pictures"):
                pictures = pool.map(
                    self._encoded, (image for image, _ in drawn), (maps for _, maps in judged)
                )
                self.pictures.extend(pictures)
        for row, _ in judged:
            self.rows.append(row)
            watch.add({stage: row.times_s[stage] for stage in row.times_s.keys() - self._trace_s.keys()})

    def _draw(self, aperture: Aperture, settings: DoubleFrustum) -> tuple[HogelImage, Stopwatch]:
        lap = Stopwatch()
        with lap.stage("raster"):
            drawn = self._rasterizer.render(aperture, settings, normals=False, color=True)
        # Part of the frame: what is left is orders and read-back.
        lap.record("gpu", self._rasterizer.times["draw"].gpu_s)
        return drawn, lap

    def _judge(self, measured: tuple[HogelImage, Stopwatch]) -> tuple[Measurement, ErrorMaps]:
        drawn, lap = measured
        settings = drawn.camera.settings
        assert settings is not None, "the rasterizer says with which settings it drew"
        with lap.stage("compare"):
            # Colors that a scene says nothing of say nothing of the raster, and take their time.
            comparison = compare_images(
                self._truth, drawn, self._reference, radiance=self._shaded, perceptual=self._shaded
            )
        with lap.stage("predict"):
            predicted = self._predictor.predict(settings)
        row = Measurement(
            aperture=drawn.camera.aperture,
            settings=settings,
            comparison=comparison.summary(),
            certainty=comparison.certainty,
            predicted=predicted,
            times_s={**self._trace_s, **lap.seconds},
        )
        return row, comparison.maps

    def _encoded(self, drawn: HogelImage, maps: ErrorMaps) -> SettingPictures:
        return images.setting_pictures(drawn, maps, self._frustum.longest_reach, self.reduction)
