"""Drawing and judging of many hogels: the loop behind reports, surveys, plans and plates.

The caller's thread owns the OpenGL context: it traces truths and draws frames. Other threads, one
per processor, judge. A task is submitted when all its images exist, so that no task waits for
another. Results are yielded in order; the number of images in memory is bounded.

The settings of a task differ only in their depth buffers. They share the traced links of the chain
(T1 to T4), the frame with linear depth (R0), and the predictions.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from itertools import chain, islice, pairwise
from types import MappingProxyType
from typing import Self, TypeVar

from xfrustum.compare.attribution import Budget, Cause, ChainStart, charged
from xfrustum.compare.comparison import Comparison, ComparisonNumbers, compare_images
from xfrustum.compare.prediction.predict import (
    Prediction,
    Predictor,
    traced_models,
    with_exact_depth,
)
from xfrustum.raster import Drawn, Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.llvm import worker_count
from xfrustum.scenes.arguments import InputError, one_of
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.images import HogelImage
from xfrustum.scenes.model.scene import Scene, is_shaded
from xfrustum.scenes.plate import Aperture, DoubleFrustum, PlateTile
from xfrustum.scenes.representation import ShortRepr

Result = TypeVar("Result")

NO_TRUTHS: Mapping[Aperture, HogelImage] = MappingProxyType({})

IMAGES_PER_THREAD = 4
"""Images in memory for each judging thread, enough for threads not to wait for images."""

MAX_CONCURRENT_PIXELS = 1 << 23
"""Largest number of pixels of all images in memory, unless two images have more.

An image with its truth and error maps takes about 240 bytes per pixel, 2 GB in all."""


def images_under_way(pixels: int) -> int:
    """Return the largest number of images, of `pixels` each, in memory and not yet yielded."""
    return max(2, min(IMAGES_PER_THREAD * worker_count(), MAX_CONCURRENT_PIXELS // pixels))


def in_order(tasks: Iterable[Future[Result]], most: int) -> Generator[Result, None, None]:
    """Yield results in order, at most `most` tasks ahead; closing cancels the remaining tasks."""
    waiting: deque[Future[Result]] = deque()
    try:
        for task in tasks:
            waiting.append(task)
            while waiting and (len(waiting) >= most or waiting[0].done()):
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        for task in waiting:
            task.cancel()


@dataclass(frozen=True, kw_only=True)
class FrameRequest:
    """Requested measurements of frames in addition to their geometry."""

    color: bool = False  #: color of frames
    colored_truths: bool = True  #: color of truths, if frames have color
    radiance: bool = False  #: comparison of colors; see `compare_images`
    perceptual: bool = False  #: FLIP and SSIM
    causes: bool = False  #: predicted errors, and wrong pixels charged to causes


@dataclass(frozen=True, kw_only=True)
class StageTimes:
    """Wall seconds of the stages of one frame; stages of other frames run at the same time."""

    #: certified truth of the hogel, equal for all its frames; 0 if the truth was given
    trace: float
    raster: float
    compare: float
    predict: float = 0.0
    causes: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedFrame:
    """A frame and its measures."""

    aperture: Aperture
    truth: HogelImage
    settings: DoubleFrustum
    image: HogelImage
    comparison: Comparison
    prediction: Prediction | None  #: prediction and budget: None if causes are not requested
    budget: Budget | None
    times: StageTimes
    gpu_s: float  #: part of `times.raster` in which the device drew, by its own clock


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class JudgedDrawing(ShortRepr):
    """One drawing of a hogel, compared with the truth."""

    settings: DoubleFrustum
    comparison: ComparisonNumbers  #: a `Comparison` with maps if images are kept
    image: HogelImage | None
    causes: (
        tuple[Cause, ...] | None
    )  #: effect of each link; this and the next two fields are None if causes are not requested
    unexplained: int | None  #: number of wrong pixels that rounding should explain, and does not
    predicted: Prediction | None  #: predicted error in closed form
    times: StageTimes

    @classmethod
    def from_frame(cls, frame: JudgedFrame, *, images: bool) -> JudgedDrawing:
        """Return the drawing of a frame, with or without its images."""
        budget = frame.budget
        return cls(
            settings=frame.settings,
            comparison=frame.comparison if images else frame.comparison.numbers,
            image=frame.image if images else None,
            causes=None if budget is None else budget.causes,
            unexplained=None if budget is None else budget.explanation.counts()["unexplained"],
            predicted=frame.prediction,
            times=frame.times,
        )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class JudgedHogel(ShortRepr):
    """One hogel with its judged drawings in the order of the settings."""

    aperture: Aperture
    truth: HogelImage | None  #: None unless images are kept
    drawings: tuple[JudgedDrawing, ...]


class Evaluator:
    """Reference and rasterizer of one scene: drawn hogels are judged by traced truths.

    An evaluator is a context manager for one thread; leaving the context frees the rasterizer.
    `tracer` has no effect if a reference is given. `effects` None: the effects that the scene
    needs. `model` None: the known model of the OpenGL device. Raises InputError for an unknown
    tracer, or without usable OpenGL.
    """

    def __init__(
        self,
        scene: Scene,
        tracer: str = "embree",
        *,
        reference: Reference | None = None,
        effects: frozenset[Effect] | None = None,
        model: DeviceModel | None = None,
    ) -> None:
        one_of(scene, Scene, "scene")
        self.scene = scene
        self.reference = Reference(scene, tracer, effects) if reference is None else reference
        self.rasterizer = Rasterizer(scene, effects, model)
        self._by_hogels, self._released = self.reference, False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.release()

    def release(self) -> None:
        """Free the rasterizer; further calls have no effect."""
        if not self._released:
            self._released = True
            self.rasterizer.release()

    def decide(self, tile: PlateTile) -> None:
        """Compute the truths of all hogels of a tile by directions, before judging the hogels."""
        # Free the memory of the previous tile first.
        self.reference = self._by_hogels
        self.reference = self._by_hogels.with_tile(tile, gaps=True)

    @property
    def model(self) -> DeviceModel:
        """Rounding model of the drawing device; it explains pixels."""
        return self.rasterizer.model

    @property
    def device(self) -> dict[str, str]:
        """Names of the drawing device."""
        return self.rasterizer.device

    def stream(
        self,
        apertures: Iterable[Aperture],
        settings: Sequence[DoubleFrustum],
        images: bool = False,
        radiance: bool | None = None,
        causes: bool = False,
    ) -> Iterator[JudgedHogel]:
        """Yield judged hogels in the order of their apertures.

        Some apertures are read ahead; memory does not grow with their number. Closing the iterator
        ends the work. Raises InputError without settings, or if settings do not fit the frustum.

        `images` keeps truths, drawings in color and error maps. `radiance` compares colors;
        None: only in scenes with materials or lights. `causes` predicts errors, and charges wrong
        pixels to causes.
        """
        colors = is_shaded(self.scene) if radiance is None else radiance
        request = FrameRequest(color=images or colors, radiance=colors, causes=causes)
        return self._hogels(self.frames(apertures, settings, request), settings, images=images)

    def _hogels(
        self,
        frames: Generator[JudgedFrame, None, None],
        settings: Sequence[DoubleFrustum],
        *,
        images: bool,
    ) -> Iterator[JudgedHogel]:
        # The frames of a hogel follow one another; equal settings are drawn once.
        with closing(frames):
            while of_hogel := list(islice(frames, len(set(settings)))):
                drawings = {
                    frame.settings: JudgedDrawing.from_frame(frame, images=images)
                    for frame in of_hogel
                }
                yield JudgedHogel(
                    aperture=of_hogel[0].aperture,
                    truth=of_hogel[0].truth if images else None,
                    drawings=tuple(drawings[setting] for setting in settings),
                )

    def frames(
        self,
        apertures: Iterable[Aperture],
        settings: Sequence[DoubleFrustum],
        request: FrameRequest,
        truths: Mapping[Aperture, HogelImage] = NO_TRUTHS,
    ) -> Generator[JudgedFrame, None, None]:
        """Yield judged frames hogel by hogel; frames of equal cameras follow each other.

        Equal settings are drawn once; given truths are not traced again.
        """
        if not settings:
            raise InputError("nothing to judge: give at least one setting")
        for setting in settings:
            one_of(setting, DoubleFrustum, "settings")
            setting.check_against(self.scene.frustum)
        # Group by near, then by cameras, in the order of their first occurrence.
        nears: dict[float, dict[DoubleFrustum, list[DoubleFrustum]]] = {}
        for setting in dict.fromkeys(settings):
            cameras = nears.setdefault(setting.near, {})
            cameras.setdefault(with_exact_depth(setting), []).append(setting)
        groups = [list(cameras.values()) for cameras in nears.values()]
        return self._judged(self._truths(apertures, request, truths), groups, request)

    def _judged(
        self, truths: Iterator[_Truth], groups: CameraGroups, request: FrameRequest
    ) -> Generator[JudgedFrame, None, None]:
        """Trace and draw in this thread, judge in other threads, and yield frames in order."""
        pixels = math.prod(self.scene.frustum.resolution)
        # A task has all frames of its cameras. Drawing and judging overlap only with at least two
        # tasks.
        largest = max(len(settings) for of_near in groups for settings in of_near)
        most = max(2, images_under_way(pixels) // largest)

        def tasks() -> Iterator[Future[list[JudgedFrame]]]:
            # Trace the next truth early: its predictor is computed while frames are drawn.
            begun = (
                (truth, pool.submit(Predictor, truth.image, self.reference, self.model))
                if request.causes
                else (truth, None)
                for truth in truths
            )
            for (truth, predictor), _ in pairwise(chain(begun, [(None, None)])):
                assert truth is not None, "only the last has no successor"
                for frames, start in self._drawn(truth, groups, request):
                    images = FrameImages(
                        truth=truth,
                        frames=frames,
                        start=start,
                        predictor=predictor.result() if predictor else None,
                    )
                    yield pool.submit(judge_frames, self.reference, self.model, request, images)

        # Threads scale, because NumPy and the tracers release the interpreter lock in large loops;
        # processes would have to copy images.
        pool = ThreadPoolExecutor(worker_count(), thread_name_prefix="judging")
        try:
            with closing(in_order(tasks(), most)) as judged:
                for frames in judged:
                    yield from frames
        finally:
            # After an early end or an error, results of remaining tasks are not needed.
            pool.shutdown(cancel_futures=True)

    def _truths(
        self,
        apertures: Iterable[Aperture],
        request: FrameRequest,
        truths: Mapping[Aperture, HogelImage],
    ) -> Iterator[_Truth]:
        colored = request.color and request.colored_truths
        for aperture in apertures:
            one_of(aperture, Aperture, "aperture")
            begun, image, trace_s = time.perf_counter(), truths.get(aperture), 0.0
            if image is None:
                image = self.reference.trace(aperture, colored=colored)
                trace_s = time.perf_counter() - begun
            yield _Truth(aperture=aperture, image=image, trace_s=trace_s)

    def _drawn(
        self, truth: _Truth, groups: CameraGroups, request: FrameRequest
    ) -> Iterator[tuple[Frames, tuple[HogelImage, ...]]]:
        """Yield the frames of a hogel by cameras, with images T0 to R0 if causes are requested."""
        for of_near in groups:
            # Cameras with the same near share some traced models.
            traced: dict[DoubleFrustum, HogelImage] = {}
            for settings in of_near:
                frames = {
                    setting: self._draw(truth.aperture, setting, color=request.color)
                    for setting in settings
                }
                start: tuple[HogelImage, ...] = ()
                if request.causes:
                    exact = with_exact_depth(settings[0])
                    # The requested frames may include the frame with exact depth.
                    last, _ = frames.get(exact) or self._draw(truth.aperture, exact, color=False)
                    models = traced_models(
                        self.reference, truth.aperture, exact, traced, shaded=False
                    )
                    start = (truth.image, *models, last.image)
                yield frames, start

    def _draw(
        self, aperture: Aperture, setting: DoubleFrustum, *, color: bool
    ) -> tuple[Drawn, float]:
        """Draw a frame; return the frame and the wall seconds."""
        begun = time.perf_counter()
        drawn = self.rasterizer.draw(aperture, setting, normals=False, color=color)
        return drawn, time.perf_counter() - begun


#: settings grouped by near, then by cameras
CameraGroups = Sequence[Sequence[Sequence[DoubleFrustum]]]

#: frames with their drawing times, wall seconds
Frames = Mapping[DoubleFrustum, tuple[Drawn, float]]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Truth:
    """Truth of a hogel before drawing."""

    aperture: Aperture
    image: HogelImage
    trace_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameImages:
    """Images of one hogel whose settings differ only in their depth buffers."""

    truth: _Truth
    frames: Frames
    start: tuple[HogelImage, ...]  #: images T0 to R0; empty if causes are not requested
    predictor: Predictor | None  #: closed forms of the hogel; None if causes are not requested


def judge_frames(
    reference: Reference, device: DeviceModel, request: FrameRequest, images: FrameImages
) -> list[JudgedFrame]:
    """Compare frames of equal cameras with the truth; with causes, predict and charge errors."""
    begun, settings, truth = time.perf_counter(), list(images.frames), images.truth
    start, cached, predictions = None, None, []
    shared_s, predict_s = 0.0, 0.0
    if images.predictor is not None:
        start = ChainStart.from_images(reference, images.start, device)
        cached, shared_s = start.exact, time.perf_counter() - begun
        predictions = images.predictor.predict_each(settings)
        predict_s = time.perf_counter() - begun - shared_s
    judged = []
    for place, (setting, (drawn, raster_s)) in enumerate(images.frames.items()):
        begun = time.perf_counter()
        comparison = compare_images(
            truth.image,
            drawn.image,
            reference,
            radiance=request.radiance,
            perceptual=request.perceptual,
            cached_errors=cached,
        )
        # Without causes there is no R0: use the first frame. Other frames differ from it at few
        # pixels.
        cached = cached or comparison.errors
        compared = time.perf_counter()
        prediction, budget, causes_s = None, None, 0.0
        if start is not None:
            prediction = predictions[place][0]
            budget = charged(start, comparison.errors, predictions[place])
            # Divide the time of shared work equally among the frames.
            causes_s = time.perf_counter() - compared + shared_s / len(settings)
        times = StageTimes(
            trace=truth.trace_s,
            raster=raster_s,
            compare=compared - begun,
            predict=predict_s / len(settings),
            causes=causes_s,
        )
        frame = JudgedFrame(
            aperture=truth.aperture,
            truth=truth.image,
            settings=setting,
            image=drawn.image,
            comparison=comparison,
            prediction=prediction,
            budget=budget,
            times=times,
            gpu_s=drawn.gpu_s,
        )
        judged.append(frame)
    return judged
