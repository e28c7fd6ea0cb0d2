"""Truth, frames, comparisons and predictions of a sweep, and the time that each takes."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare import Comparison, ErrorMaps, compare_images
from xfrustum.compare.predict import Prediction, Predictor
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports import images
from xfrustum.reports.measurement import Measurement, SettingPictures
from xfrustum.reports.shading import is_shaded
from xfrustum.reports.timing import Stopwatch
from xfrustum.scenes.double_frustum import DoubleFrustum
from xfrustum.scenes.hogel_image import HogelImage
from xfrustum.scenes.plate import Aperture
from xfrustum.scenes.scene import Scene

PROCESSORS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
"""That this process may run on."""

AT_ONCE_PIXELS = 1 << 20
"""Pixels of all images that are judged side by side, some 200 bytes each; a larger image is judged alone."""


class SweepBench:
    """The two renderers of a scene, the truth of the aperture at hand, and all that was measured.

    Parameters
    ----------
    scene
        What is shown.
    reference, rasterizer
        Of the scene.
    reduction
        Image pixels per picture pixel, along each side.

    Attributes
    ----------
    at_once
        About how many settings are judged side by side.
    rows, pictures, truths
        What was measured so far; see `Sweep`.
    """

    _truth: HogelImage
    _gaps: NDArray[np.float64]
    _predictor: Future[Predictor] | None

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
        """Trace the aperture that is measured next, and how far behind its surfaces others lie."""
        lap = Stopwatch()
        with lap.stage("trace"):
            self._truth = self._reference.trace(aperture)
        self._trace_s = dict(lap.seconds)
        with lap.stage("pictures"):
            self.truths.append(images.picture(self._truth, self.reduction))
        with lap.stage("predict"):
            self._gaps = self._reference.gaps(aperture)
        self._predictor = None
        watch.add(lap.seconds)

    def measure(self, aperture: Aperture, settings: Sequence[DoubleFrustum], watch: Stopwatch) -> None:
        """Draw some settings one after the other, alone on the machine, then judge them side by side."""
        drawn = [self._draw(aperture, setting) for setting in settings]
        with ThreadPoolExecutor(PROCESSORS) as pool:
            if self._predictor is None:
                # What an aperture's predictions share is found once, while images are compared.
                self._predictor = pool.submit(self._first_prediction, settings[0], watch)
            compared = [pool.submit(self._compare, image, lap) for image, lap in drawn]
            predicted = [pool.submit(self._predict, image, lap) for image, lap in drawn]
            comparisons = [each.result() for each in compared]
            predictions = [each.result() for each in predicted]
            # By themselves: they belong to the page, whose price is not that of the measurement.
            with watch.stage("pictures"):
                maps = (comparison.maps for comparison in comparisons)
                self.pictures.extend(pool.map(self._encoded, (image for image, _ in drawn), maps))
        for (image, lap), comparison, predicts in zip(drawn, comparisons, predictions, strict=True):
            watch.add(lap.seconds)
            row = Measurement(
                aperture=aperture,
                settings=_settings(image),
                comparison=comparison.summary(),
                certainty=comparison.certainty,
                predicted=predicts,
                times_s={**self._trace_s, **lap.seconds},
            )
            self.rows.append(row)

    def _draw(self, aperture: Aperture, settings: DoubleFrustum) -> tuple[HogelImage, Stopwatch]:
        lap = Stopwatch()
        with lap.stage("raster"):
            drawn = self._rasterizer.render(aperture, settings, normals=False, color=True)
        # Part of the frame: what is left is orders and read-back.
        lap.record("gpu", self._rasterizer.times["draw"].gpu_s)
        return drawn, lap

    def _compare(self, drawn: HogelImage, lap: Stopwatch) -> Comparison:
        with lap.stage("compare"):
            # Colors that a scene says nothing of say nothing of the raster, and take their time.
            return compare_images(
                self._truth, drawn, self._reference, radiance=self._shaded, perceptual=self._shaded
            )

    def _first_prediction(self, settings: DoubleFrustum, watch: Stopwatch) -> Predictor:
        with watch.stage("predict"):
            bits = int(self._rasterizer.device["subpixel_bits"])
            predictor = Predictor(self._truth, self._gaps, self._frustum, bits)
            predictor.predict(settings)
        return predictor

    def _predict(self, drawn: HogelImage, lap: Stopwatch) -> Prediction:
        assert self._predictor is not None, "the first batch of an aperture makes it"
        predictor = self._predictor.result()
        with lap.stage("predict"):
            return predictor.predict(_settings(drawn))

    def _encoded(self, drawn: HogelImage, maps: ErrorMaps) -> SettingPictures:
        return images.setting_pictures(drawn, maps, self._frustum.longest_reach, self.reduction)


def _settings(drawn: HogelImage) -> DoubleFrustum:
    settings = drawn.camera.settings
    assert settings is not None, "the rasterizer says with which settings it drew"
    return settings
