"""How settings are measured at an aperture: truth, frames, comparisons, predictions, and their times."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare import Comparison, ErrorMaps, compare_images
from xfrustum.compare.attribution.budget import Budget, ChainStart, charged
from xfrustum.compare.metrics.displacement import displacement
from xfrustum.compare.metrics.error_maps import JudgedImage
from xfrustum.compare.metrics.paired import PixelSet
from xfrustum.compare.metrics.radiance import STEP
from xfrustum.compare.prediction.chain import traced_models, with_exact_depth
from xfrustum.compare.prediction.predict import Prediction, Predictor
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.alone import TracersAlone
from xfrustum.reference.plain import CERTIFIED
from xfrustum.reports.common.timing import FEWEST_REPETITIONS, SharedStopwatch, Stopwatch, Timing
from xfrustum.reports.common.turns import open_races, take_turn, take_turns_until_settled
from xfrustum.reports.error_report import images
from xfrustum.reports.error_report.causes import CAUSE_COLORS
from xfrustum.reports.measurements.measurement import (
    Measurement,
    RasterParts,
    SettingPictures,
    StageParts,
    StageTimes,
    TracersAlonePictured,
)
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.look import is_shaded
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

PROCESSORS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
"""Number of processors that this process may run on."""

MAX_CONCURRENT_PIXELS = 1 << 20
"""Pixels of all images that are judged side by side; each needs about 200 bytes. A larger image is judged
alone."""

REPEAT_BUDGET_S = 20.0
"""Largest number of wall seconds for drawing frames again to time them: a fifth of the time of a default
report, of 125 settings, at 512 x 512 with a software renderer."""


@dataclass(frozen=True, kw_only=True)
class TracedAperture:
    """An aperture with its truth, and what all settings there have in common.

    Attributes
    ----------
    aperture
        Aperture that was traced.
    truth
        Its certified image.
    gaps
        (H, W) how far behind its surfaces others lie; see `Reference.gaps`.
    trace_s
        Wall seconds of tracing the truth.
    picture
        The truth as an encoded picture.
    alone
        How many pixels each ray tracer alone would have got wrong, with pictures; None where the truth is
        not certified.
    """

    aperture: Aperture
    truth: HogelImage
    gaps: Floats
    trace_s: float
    picture: bytes
    alone: TracersAlonePictured | None

    @cached_property
    def moved(self) -> Floats:
        """(H, W, 2) displacement of the truth itself, which is rounding."""
        return displacement(self.truth, self.truth.camera)


@dataclass(frozen=True, kw_only=True)
class MeasuredSetting:
    """One setting at one aperture: its row and its pictures."""

    row: Measurement
    pictures: SettingPictures


@dataclass(frozen=True, kw_only=True)
class _Drawn:
    """A frame, the stopwatch of its row, and the device's own time."""

    image: HogelImage
    lap: Stopwatch
    gpu_s: float


@dataclass(frozen=True, kw_only=True)
class _Judged:
    """The row of a frame, its error maps, and the links that its wrong surfaces are charged to."""

    row: Measurement
    maps: ErrorMaps
    charge: NDArray[np.int8]


class SettingMeasurer:
    """The two renderers of a scene, which measure settings at its apertures.

    Parameters
    ----------
    scene
        Scene that is shown.
    reference, rasterizer
        The two renderers of this scene.
    reduction
        Image pixels per picture pixel, along each side.

    Attributes
    ----------
    batch_size
        About how many settings are judged side by side.
    """

    def __init__(self, scene: Scene, reference: Reference, rasterizer: Rasterizer, reduction: int) -> None:
        self._frustum = scene.frustum
        self._height_range = images.height_range(scene, scene.frustum.longest_reach)
        self._shaded = is_shaded(scene)
        self._reference = reference
        self._rasterizer = rasterizer
        self._scene = scene
        self._reduction = reduction
        images_at_once = MAX_CONCURRENT_PIXELS // math.prod(scene.frustum.resolution)
        self.batch_size = max(1, min(2 * PROCESSORS, images_at_once))

    def warm_up(self, aperture: Aperture, settings: Sequence[DoubleFrustum]) -> None:
        """Draw once what compiles a program or allocates a target, which belongs to the time of no row."""
        for setting in {(s.depth, s.mapping): s for s in settings}.values():
            self._render(aperture, setting)

    def trace(self, aperture: Aperture, watch: Stopwatch) -> TracedAperture:
        """Trace an aperture, and how far behind its surfaces others lie."""
        lap = Stopwatch()
        with lap.stage("trace"):
            truth = self._reference.trace(aperture)
        with lap.stage("pictures"):
            picture = images.picture(truth, self._reduction)
        with lap.stage("predict"):
            gaps = self._reference.gaps(aperture)
        with lap.stage("alone"):
            alone = self._alone(truth)
        watch.add(lap.seconds)
        return TracedAperture(
            aperture=aperture,
            truth=truth,
            gaps=gaps,
            trace_s=lap.seconds["trace"],
            picture=picture,
            alone=alone,
        )

    @cached_property
    def _tracers(self) -> TracersAlone:
        return TracersAlone(self._scene)

    def _alone(self, truth: HogelImage) -> TracersAlonePictured | None:
        if self._reference.decided_by != CERTIFIED:
            return None
        found = self._tracers.find(truth)
        return TracersAlonePictured(
            numbers=found.numbers, pictures=images.alone_pictures(truth, found.wrong, self._reduction)
        )

    def measure(
        self, traced: TracedAperture, batches: Iterable[Sequence[DoubleFrustum]], watch: Stopwatch
    ) -> Iterator[list[MeasuredSetting]]:
        """Measure batches of settings at an aperture, and yield the rows and pictures of each batch.

        The settings of a batch are drawn one after the other, alone on the machine, and then judged side by
        side.
        """
        predictor: Future[Predictor] | None = None
        start: ChainStart | None = None
        models: dict[DoubleFrustum, HogelImage] = {}
        for settings in batches:
            drawn = [self._draw(traced.aperture, setting) for setting in settings]
            shared = SharedStopwatch()
            shared_parts: tuple[tuple[str, ...], ...] = ()
            if start is None or not _same_cameras(start, settings[0]):
                # Traced once for all depth buffers of these cameras.
                with watch.stage("causes"):
                    if any(known.near != settings[0].near for known in models):
                        # Camera geometries share the models of a near; those of others are not needed again.
                        models.clear()
                    start = self._chain_start(traced, drawn, models)
                # These are found side by side, and while the errors of the first frames are predicted.
                shared_parts = (("exact", "steps", "surface_charge"), ("rounding",))
            with ThreadPoolExecutor(PROCESSORS) as pool:
                if predictor is None:
                    # The common part of an aperture's predictions is found once, while images are compared.
                    predictor = pool.submit(self._predictor, traced, settings[0], watch, shared)
                for parts in shared_parts:
                    pool.submit(_prepare, start, parts, watch, shared)
                tasks = [pool.submit(self._judged, traced, start, predictor, each, shared) for each in drawn]
                judged = [each.result() for each in tasks]
                # Timed separately: encoding pictures is not measurement.
                with watch.stage("pictures"):
                    pictures = list(pool.map(self._encoded, drawn, judged))
            for each in drawn:
                watch.add(each.lap.seconds)
            yield [
                MeasuredSetting(row=each.row, pictures=own)
                for each, own in zip(judged, pictures, strict=True)
            ]

    def repeat(self, rows: Sequence[Measurement], budget_s: float) -> dict[DoubleFrustum, Timing]:
        """Draw the settings of some rows in turns until the fastest are told apart; return the times of each.

        Nothing is repeated where not all settings could be drawn often enough in the time.

        Parameters
        ----------
        rows
            Rows of one aperture.
        budget_s
            Largest number of seconds.
        """
        settings = [row.settings for row in rows]
        expected = sum(row.times_s.raster for row in rows)
        if len(settings) < 2 or FEWEST_REPETITIONS * expected > budget_s:
            return {}
        aperture = rows[0].aperture
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
            drawn = self._rasterizer.draw(aperture, settings, normals=False, color=True)
        return _Drawn(image=drawn.image, lap=lap, gpu_s=drawn.times["draw"].gpu_s)

    def _compare(
        self, truth: HogelImage, drawn: _Drawn, exact: JudgedImage, shared: SharedStopwatch
    ) -> Comparison:
        with shared.stage(drawn.lap, "compare"):
            # Where a scene says nothing of light, colors say nothing of the rasterizer, and take time.
            return compare_images(
                truth,
                drawn.image,
                self._reference,
                radiance=self._shaded,
                perceptual=self._shaded,
                judged=exact,
            )

    def _judged(
        self,
        traced: TracedAperture,
        start: ChainStart,
        predictor: Future[Predictor],
        drawn: _Drawn,
        shared: SharedStopwatch,
    ) -> _Judged:
        """Compare a frame with the truth, predict its errors, and charge what is wrong to causes."""
        prediction = _predict(predictor, drawn, shared)
        with shared.stage(drawn.lap, "causes"):
            links = predictor.result().links(_settings(drawn.image))
        exact = start.exact
        comparison = self._compare(traced.truth, drawn, exact, shared)
        with shared.stage(drawn.lap, "causes"):
            budget = charged(start, drawn.image, links, comparison.maps)
            budget.causes  # noqa: B018 - found when first asked for, and it belongs to this stage
        row = _row(traced, drawn, comparison, prediction, budget)
        return _Judged(row=row, maps=comparison.maps, charge=_charges(budget))

    def _predictor(
        self, traced: TracedAperture, settings: DoubleFrustum, watch: Stopwatch, shared: SharedStopwatch
    ) -> Predictor:
        """Return the predictor of an aperture, with what all of its predictions share computed."""
        with shared.stage(watch, "predict"):
            bits = int(self._rasterizer.device["subpixel_bits"])
            predictor = Predictor(traced.truth, traced.gaps, self._frustum, bits)
            predictor.predict(settings)
        return predictor

    def _chain_start(
        self, traced: TracedAperture, drawn: Sequence[_Drawn], known: dict[DoubleFrustum, HogelImage]
    ) -> ChainStart:
        """Return the chain of the first frame's cameras up to the frame with exact depth."""
        exact = with_exact_depth(_settings(drawn[0].image))
        frames = [each.image for each in drawn if _settings(each.image) == exact]
        if not frames:
            frames = [self._rasterizer.render(traced.aperture, exact, normals=False, color=False)]
        models = traced_models(self._reference, traced.aperture, exact, known, shaded=False)
        bits = int(self._rasterizer.device["subpixel_bits"])
        images = (traced.truth, *models, frames[0])
        return ChainStart(
            reference=self._reference, images=images, subpixel_bits=bits, truth_moved=traced.moved
        )

    def _encoded(self, drawn: _Drawn, judged: _Judged) -> SettingPictures:
        scale = self._frustum.longest_reach, self._height_range
        return images.setting_pictures(drawn.image, judged.maps, judged.charge, scale, self._reduction)


def _prepare(start: ChainStart, parts: Sequence[str], watch: Stopwatch, shared: SharedStopwatch) -> None:
    """Find some of the properties of a chain's start, one after the other, which keeps them."""
    with shared.stage(watch, "causes"):
        for part in parts:
            getattr(start, part)


def _predict(predictor: Future[Predictor], drawn: _Drawn, shared: SharedStopwatch) -> Prediction:
    ready = predictor.result()
    with shared.stage(drawn.lap, "predict"):
        return ready.predict(_settings(drawn.image))


def _same_cameras(start: ChainStart, settings: DoubleFrustum) -> bool:
    return with_exact_depth(settings) == start.images[-1].camera.settings


def _row(
    traced: TracedAperture, drawn: _Drawn, comparison: Comparison, prediction: Prediction, budget: Budget
) -> Measurement:
    return Measurement(
        aperture=traced.aperture,
        settings=_settings(drawn.image),
        comparison=comparison.numbers,
        causes=budget.causes,
        unexplained=int(budget.explanation.unexplained.sum()),
        shear=budget.start.shear,
        predicted=prediction,
        times_s=StageTimes(trace=traced.trace_s, **drawn.lap.seconds),
        parts_s=StageParts(raster=RasterParts(gpu=drawn.gpu_s)),
        wrong=_wrong_pixels(comparison.maps),
    )


def _charges(budget: Budget) -> NDArray[np.int8]:
    """Return the place in `CAUSE_COLORS` of each wrong surface's link, (H, W), or the place after all."""
    places = np.array([list(CAUSE_COLORS).index(name) for name in budget.links], dtype=np.int8)
    wrong = budget.surface_charge >= 0
    charge = budget.surface_charge.copy()
    charge[wrong] = places[charge[wrong]]
    charge[budget.explanation.unexplained & wrong] = len(CAUSE_COLORS)
    return charge


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
    """Return which settings take a further turn."""
    fastest = min(spreads, key=lambda one: one.median)
    return open_races([one for one in spreads if not fastest.told_below(one)], spreads)
