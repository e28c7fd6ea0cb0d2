"""Truth, frames, comparisons and predictions of a sweep, and the time that each takes."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

from xfrustum.compare import Comparison, ErrorMaps, compare_images
from xfrustum.compare.metrics.paired import PixelSet
from xfrustum.compare.metrics.radiance import STEP
from xfrustum.compare.prediction.predict import Prediction, Predictor
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.common.timing import FEWEST_REPETITIONS, SharedStopwatch, Stopwatch, Timing
from xfrustum.reports.common.turns import open_races, take_turn, take_turns_until_settled
from xfrustum.reports.error_report import images
from xfrustum.reports.error_report.shading import is_shaded
from xfrustum.reports.measurements.measurement import Measurement, SettingPictures
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

PROCESSORS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
"""That this process may run on."""

AT_ONCE_PIXELS = 1 << 20
"""Pixels of all images that are judged side by side, some 200 bytes each; a larger image is judged alone."""


REPEAT_BUDGET_S = 20.0
"""Most wall seconds that frames drawn again for their time may take: a fifth of what a default report of 125
settings takes at 512 x 512 with a software renderer."""


@dataclass(frozen=True, kw_only=True)
class _Drawn:
    """A frame, the stopwatch of its row, and the device's own time."""

    image: HogelImage
    lap: Stopwatch
    gpu_s: float


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
    gpu_s
        The device's own time in all frames so far.
    """

    _truth: HogelImage
    _gaps: Floats
    _predictor: Future[Predictor] | None

    def __init__(self, scene: Scene, reference: Reference, rasterizer: Rasterizer, reduction: int) -> None:
        self._frustum = scene.frustum
        self._height_range = images.height_range(scene, scene.frustum.longest_reach)
        self._shaded = is_shaded(scene)
        self._reference = reference
        self._rasterizer = rasterizer
        self.at_once = max(1, min(2 * PROCESSORS, AT_ONCE_PIXELS // math.prod(scene.frustum.resolution)))
        self.reduction = reduction
        self.rows: list[Measurement] = []
        self.pictures: list[SettingPictures] = []
        self.truths: list[bytes] = []
        self.gpu_s = 0.0

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
        shared = SharedStopwatch()
        with ThreadPoolExecutor(PROCESSORS) as pool:
            if self._predictor is None:
                # What an aperture's predictions share is found once, while images are compared.
                self._predictor = pool.submit(self._first_prediction, settings[0], watch, shared)
            compared = [pool.submit(self._compare, each, shared) for each in drawn]
            predicted = [pool.submit(self._predict, each, shared) for each in drawn]
            comparisons = [each.result() for each in compared]
            predictions = [each.result() for each in predicted]
            # By themselves: they belong to the page, whose price is not that of the measurement.
            with watch.stage("pictures"):
                maps = (comparison.maps for comparison in comparisons)
                self.pictures.extend(pool.map(self._encoded, (each.image for each in drawn), maps))
        for each, comparison, predicts in zip(drawn, comparisons, predictions, strict=True):
            watch.add(each.lap.seconds)
            self.gpu_s += each.gpu_s
            row = Measurement(
                aperture=aperture,
                settings=_settings(each.image),
                comparison=comparison.summary(),
                certainty=comparison.certainty,
                predicted=predicts,
                times_s={**self._trace_s, **each.lap.seconds},
                parts_s={"raster": {"gpu": each.gpu_s}},
                wrong=_wrong_pixels(comparison.maps),
            )
            self.rows.append(row)

    def repeat(
        self, settings: Sequence[DoubleFrustum], aperture: Aperture, budget_s: float
    ) -> dict[DoubleFrustum, Timing]:
        """Draw some settings in turns until the fastest are told apart; return the times of each.

        Nothing is repeated where not all of them could be drawn often enough in the time.
        """
        rows = {row.settings: row for row in self.rows if row.aperture == aperture}
        expected = sum(rows[setting].times_s["raster"] for setting in settings)
        if len(settings) < 2 or FEWEST_REPETITIONS * expected > budget_s:
            return {}
        runs = [partial(self._render, aperture, setting) for setting in settings]
        seconds: list[list[float]] = [[] for _ in settings]
        for _ in range(FEWEST_REPETITIONS):
            take_turn(runs, seconds)
        left = budget_s - sum(map(sum, seconds))
        take_turns_until_settled(runs, seconds, _unsettled, left)
        return {setting: Timing.of(taken) for setting, taken in zip(settings, seconds, strict=True)}

    def _render(self, aperture: Aperture, settings: DoubleFrustum) -> HogelImage:
        return self._rasterizer.render(aperture, settings, normals=False, color=True)

    def _draw(self, aperture: Aperture, settings: DoubleFrustum) -> _Drawn:
        lap = Stopwatch()
        with lap.stage("raster"):
            image = self._render(aperture, settings)
        return _Drawn(image=image, lap=lap, gpu_s=self._rasterizer.times["draw"].gpu_s)

    def _compare(self, drawn: _Drawn, shared: SharedStopwatch) -> Comparison:
        with shared.stage(drawn.lap, "compare"):
            # Colors that a scene says nothing of say nothing of the raster, and take their time.
            return compare_images(
                self._truth, drawn.image, self._reference, radiance=self._shaded, perceptual=self._shaded
            )

    def _first_prediction(
        self, settings: DoubleFrustum, watch: Stopwatch, shared: SharedStopwatch
    ) -> Predictor:
        with shared.stage(watch, "predict"):
            bits = int(self._rasterizer.device["subpixel_bits"])
            predictor = Predictor(self._truth, self._gaps, self._frustum, bits)
            predictor.predict(settings)
        return predictor

    def _predict(self, drawn: _Drawn, shared: SharedStopwatch) -> Prediction:
        assert self._predictor is not None, "the first batch of an aperture makes it"
        predictor = self._predictor.result()
        with shared.stage(drawn.lap, "predict"):
            return predictor.predict(_settings(drawn.image))

    def _encoded(self, drawn: HogelImage, maps: ErrorMaps) -> SettingPictures:
        return images.setting_pictures(
            drawn, maps, self._frustum.longest_reach, self._height_range, self.reduction
        )


def _settings(drawn: HogelImage) -> DoubleFrustum:
    settings = drawn.camera.settings
    assert settings is not None, "the rasterizer says with which settings it drew"
    return settings


def _wrong_pixels(maps: ErrorMaps) -> dict[str, PixelSet]:
    found = {}
    if maps.surface is not None:
        found["surface"] = PixelSet.of(maps.surface)
    if maps.radiance is not None:
        with np.errstate(invalid="ignore"):
            found["radiance"] = PixelSet.of(np.abs(maps.radiance).max(axis=-1) > STEP)
    return found


def _unsettled(spreads: Sequence[Timing]) -> list[bool]:
    """Return who takes a further turn."""
    fastest = min(spreads, key=lambda one: one.median)
    return open_races([one for one in spreads if not fastest.told_below(one)], spreads)
