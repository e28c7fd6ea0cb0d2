"""The main job: trace the truth once per aperture, rasterize every setting, compare each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from xfrustum.compare import compare_images
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
    watch = Stopwatch()
    with watch.stage("prepare"):
        reference = Reference(scene, tracer=tracer, effects=chosen(scene, effects))
        rasterizer = Rasterizer(scene, effects=chosen(scene, effects))
    bench = _Bench(scene, reference, rasterizer, _reduction(scene.frustum, len(apertures) * len(settings)))
    steps = len(apertures) * (1 + len(settings))
    with rasterizer, progress_bar(steps, "report", "image", shown=progress) as bar:
        for aperture in apertures:
            bar.set_postfix_str(f"aperture {aperture.column},{aperture.row}: truth", refresh=False)
            bench.trace(aperture, watch)
            bar.update()
            for setting in settings:
                bar.set_postfix_str(
                    f"aperture {aperture.column},{aperture.row}: {setting.depth_label}", refresh=False
                )
                bench.measure(aperture, setting, watch)
                bar.update()
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
    )


def _reduction(frustum: Frustum, count: int) -> int:
    width, height = frustum.resolution
    return max(1, math.ceil(math.sqrt(width * height * count / PAGE_PIXELS)))


class _Bench:
    """The two renderers of a scene, the truth of the aperture at hand, and all that was measured."""

    _truth: HogelImage
    _predictor: Predictor

    def __init__(self, scene: Scene, reference: Reference, rasterizer: Rasterizer, reduction: int) -> None:
        self._frustum = scene.frustum
        self._shaded = is_shaded(scene)
        self._reference = reference
        self._rasterizer = rasterizer
        self.reduction = reduction
        self.rows: list[Measurement] = []
        self.pictures: list[SettingPictures] = []
        self.truths: list[bytes] = []

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

    def measure(self, aperture: Aperture, settings: DoubleFrustum, watch: Stopwatch) -> None:
        lap = Stopwatch()
        with lap.stage("raster"):
            drawn = self._rasterizer.render(aperture, settings, normals=False, color=True)
        with lap.stage("compare"):
            # Colors that a scene says nothing of say nothing of the raster, and take their time.
            comparison = compare_images(
                self._truth, drawn, self._reference, radiance=self._shaded, perceptual=self._shaded
            )
        with lap.stage("predict"):
            predicted = self._predictor.predict(settings)
        with lap.stage("pictures"):
            self.pictures.append(
                images.setting_pictures(drawn, comparison.maps, self._frustum.longest_reach, self.reduction)
            )
        watch.add(lap.seconds)
        self.rows.append(
            Measurement(
                aperture=aperture,
                settings=settings,
                comparison=comparison.summary(),
                certainty=comparison.certainty,
                predicted=predicted,
                times_s={**self._trace_s, **lap.seconds},
            )
        )
