"""Many hogels drawn and judged: the one loop behind reports, surveys, plans and plates.

Frames are drawn in the one thread that owns the OpenGL context, truths are traced in another, and
as many threads as there are processors judge. Results come in order, and a bounded number of frames
is ahead of the caller. Depth buffers of one pair of cameras share the traced links of the chain (T1
to T4), the frame with linear depth (R0), and the predictions.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from itertools import chain, groupby, islice, pairwise
from types import MappingProxyType
from typing import Generic, Self, TypeVar

from xfrustum.compare.attribution.budget import Budget, Cause, ChainStart, charged
from xfrustum.compare.metrics.comparison import Comparison, ComparisonNumbers, compare_images
from xfrustum.compare.metrics.error_maps import PixelErrors, pixel_errors
from xfrustum.compare.prediction.chain import traced_models, with_exact_depth
from xfrustum.compare.prediction.predict import LinkedPrediction, Prediction, Predictor
from xfrustum.raster import Drawn, Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.llvm import worker_count
from xfrustum.scenes.arguments import one_of
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene, is_shaded
from xfrustum.scenes.notebook import Figure, NotebookRepr
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

Result = TypeVar("Result")
Timed = tuple[Result, float]  #: something that was made, and the wall seconds that it took

NO_TRUTHS: Mapping[Aperture, HogelImage] = MappingProxyType({})

IMAGES_PER_THREAD = 4
"""Images that are made, or being judged, for each thread that judges: enough that none waits for an image."""

MAX_CONCURRENT_PIXELS = 1 << 23
"""Largest number of pixels of all images under way, unless two have more. An image takes about 240 bytes a
pixel with its truth and its error maps, so that this is 2 GB."""


def images_under_way(pixels: int) -> int:
    """Return how many images of so many pixels are made and not yet handed to the caller at a time."""
    return max(2, min(IMAGES_PER_THREAD * worker_count(), MAX_CONCURRENT_PIXELS // pixels))


def in_order(tasks: Iterable[Future[Result]], most: int) -> Iterator[Result]:
    """Yield results in order, so many begun ahead; after an error or close the others are cancelled."""
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
    """What is wanted of each frame beside its geometry."""

    color: bool = False  #: whether frames have color
    colored_truths: bool = True
    radiance: bool = False  #: whether colors are compared; see `compare_images`
    perceptual: bool = False
    causes: bool = False  #: whether errors are predicted and wrong pixels charged to causes


@dataclass(frozen=True, kw_only=True)
class StageTimes:
    """Wall seconds of the stages of one frame; stages of other frames run at the same time."""

    #: the hogel's certified truth, the same for all its frames; 0 where it was there already
    trace: float
    raster: float
    compare: float
    predict: float = 0.0
    causes: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedFrame:
    """A frame with all that was found of it."""

    aperture: Aperture
    truth: HogelImage
    settings: DoubleFrustum
    image: HogelImage
    comparison: Comparison
    prediction: Prediction | None  #: None, like the budget, where causes were not wanted
    budget: Budget | None
    times: StageTimes
    gpu_s: float  #: part of `times.raster` in which the device drew, by its own clock


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class JudgedDrawing(NotebookRepr):
    """One drawing of a hogel, judged by the truth."""

    settings: DoubleFrustum
    comparison: ComparisonNumbers  #: a `Comparison`, which has maps, where images were asked for
    image: HogelImage | None
    causes: (
        tuple[Cause, ...] | None
    )  #: what each link does; None, like the next two, unless asked for
    unexplained: int | None  #: wrong pixels charged to rounding whose cause is not known
    predicted: Prediction | None  #: the error by closed forms
    times: StageTimes

    @classmethod
    def from_frame(cls, frame: JudgedFrame, *, images: bool) -> JudgedDrawing:
        """Return what a stream yields of a frame."""
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

    def _said(self) -> str:
        near, depth = self.settings.near, self.settings.depth_label
        return f"near {near:.3g} scene units, {depth}: {self.comparison.said()}"

    def table(self) -> str:
        """Return the numbers as aligned lines."""
        return self.comparison.table()

    def _figures(self) -> Sequence[Figure]:
        return self.comparison._figures() if isinstance(self.comparison, Comparison) else ()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class JudgedHogel(NotebookRepr):
    """One hogel with its drawings, judged, in the order of the settings."""

    aperture: Aperture
    truth: HogelImage | None  #: None unless images were asked for
    drawings: tuple[JudgedDrawing, ...]

    def _said(self) -> str:
        drawn = "; ".join(one._said() for one in self.drawings)
        return f"aperture {self.aperture.column},{self.aperture.row}; {drawn}"

    def _figures(self) -> Sequence[Figure]:
        return () if self.truth is None else self.truth._figures()


_Finished = tuple[Aperture, HogelImage | None, JudgedDrawing]


class Evaluator:
    """A reference and a rasterizer of one scene: what the one draws is judged by what the other traces.

    A context manager: leaving it frees the rasterizer. The tracer does not matter where there is a
    reference; effects are those that the scene calls for where they are None; `model` is that of
    the device, None for what is known of it. Raises InputError where there is no such tracer, or no
    usable OpenGL.
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
        # An OpenGL context is made, used and freed in one thread only.
        self._drawing = ThreadPoolExecutor(1, thread_name_prefix="drawing")
        self._released = False
        try:
            self._rasterizer = self._drawing.submit(Rasterizer, scene, effects, model).result()
        except BaseException:
            self._drawing.shutdown(cancel_futures=True)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.release()

    def release(self) -> None:
        """Free the rasterizer, and end its thread; again, it does nothing."""
        if not self._released:
            self._released = True
            try:
                self._drawing.submit(self._rasterizer.release).result()
            finally:
                self._drawing.shutdown()

    @property
    def model(self) -> DeviceModel:
        """The model of the device that draws, by which pixels are explained."""
        return self._rasterizer.model

    @property
    def device(self) -> dict[str, str]:
        """Names of the device that draws."""
        return self._rasterizer.device

    def submit(self, task: Callable[[Rasterizer], Result]) -> Future[Result]:
        """Have the drawing thread do something with the rasterizer, after all that it was asked before."""
        return self._drawing.submit(task, self._rasterizer)

    def stream(
        self,
        apertures: Iterable[Aperture],
        settings: Sequence[DoubleFrustum],
        images: bool = False,
        radiance: bool | None = None,
        causes: bool = False,
    ) -> Iterator[JudgedHogel]:
        """Yield many hogels, judged, in the order of their apertures.

        Apertures are taken in the caller's thread, some ahead of what has been yielded. Memory does
        not grow with their number. An exception of any thread comes to the caller, and closing the
        iterator early ends the work. InputError where there are no settings, or they make no sense
        for the scene's frustum.

        `images` keeps truths, drawings in color and error maps. `radiance` compares colors; None
        does so for scenes that say how they look. `causes` predicts errors, and charges wrong
        pixels to causes.
        """
        colors = is_shaded(self.scene) if radiance is None else radiance
        wanted = FrameRequest(color=images or colors, radiance=colors, causes=causes)

        def finish(frame: JudgedFrame) -> _Finished:
            return (
                frame.aperture,
                frame.truth if images else None,
                JudgedDrawing.from_frame(frame, images=images),
            )

        def hogels(frames: Generator[_Finished, None, None]) -> Iterator[JudgedHogel]:
            # The frames of a hogel follow one another; equal settings are drawn once.
            with closing(frames):
                while found := list(islice(frames, len(set(settings)))):
                    drawn = {drawing.settings: drawing for _, _, drawing in found}
                    drawings = tuple(drawn[one] for one in settings)
                    yield JudgedHogel(aperture=found[0][0], truth=found[0][1], drawings=drawings)

        return hogels(self.frames(apertures, settings, wanted, finish))

    def frames(
        self,
        apertures: Iterable[Aperture],
        settings: Sequence[DoubleFrustum],
        wanted: FrameRequest,
        finish: Callable[[JudgedFrame], Result],
        truths: Mapping[Aperture, HogelImage] = NO_TRUTHS,
    ) -> Generator[Result, None, None]:
        """Yield what is made of each judged frame, hogel by hogel, those of the same cameras together.

        `finish` is called with each frame in the thread that has judged it: what it returns is
        yielded, and the frame is not kept. Equal settings are drawn once; truths that are there
        already are not traced again.
        """
        if not settings:
            raise InputError("nothing to judge: give at least one setting")
        for one in settings:
            one_of(one, DoubleFrustum, "settings")
            one.check_against(self.scene.frustum)
        # In groups of the same cameras; those of one near follow one another.
        nears = list(dict.fromkeys(setting.near for setting in settings))
        cameras: dict[DoubleFrustum, list[DoubleFrustum]] = {}
        for setting in sorted(dict.fromkeys(settings), key=lambda one: nears.index(one.near)):
            cameras.setdefault(with_exact_depth(setting), []).append(setting)
        return _Loop(self, wanted, finish).run(apertures, list(cameras.values()), truths)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cameras:
    """Settings of one hogel that differ in their depth buffers alone, under way."""

    aperture: Aperture
    truth: Future[Timed[HogelImage]]  #: with the seconds of tracing
    predicted: (
        Future[Timed[list[LinkedPrediction]]] | None
    )  #: for all of the settings; None without causes
    settings: list[DoubleFrustum]
    first: Future[Timed[Drawn]]  #: the frame with the first of the settings, and the seconds
    #: With causes the chain up to R0, with all that budgets of these frames share; else errors of
    #: the first frame, beside which the others are judged.
    shared: Future[ChainStart] | Future[PixelErrors] | None


class _Loop(Generic[Result]):
    """One run of `Evaluator.frames`: a thread that draws, one that traces, and those that judge."""

    # A task of the judging threads waits for drawing, for tracing, or for judging tasks submitted
    # before it: so they never all wait.

    def __init__(
        self, judge: Evaluator, wanted: FrameRequest, finish: Callable[[JudgedFrame], Result]
    ) -> None:
        self._judge, self._wanted, self._finish = judge, wanted, finish
        self._reference = judge.reference
        self._device = judge.model
        self._tracing = ThreadPoolExecutor(1, thread_name_prefix="tracing")
        self._judging = ThreadPoolExecutor(worker_count(), thread_name_prefix="judging")

    def run(
        self,
        apertures: Iterable[Aperture],
        groups: list[list[DoubleFrustum]],
        truths: Mapping[Aperture, HogelImage],
    ) -> Generator[Result, None, None]:
        """Yield what is made of each frame; see `Evaluator.frames`."""
        most = images_under_way(math.prod(self._judge.scene.frustum.resolution))
        # Some cameras are begun ahead: threads that would wait for the one work on the other.
        begun = pairwise(chain(self._begun(apertures, groups, truths), [None]))
        try:
            tasks = (
                self._submitted(some, one) for some, _ in begun if some for one in some.settings
            )
            yield from in_order(tasks, most)
        finally:
            # Nobody wants what has not begun, and what waits for that ends.
            for pool in (self._tracing, self._judging):
                pool.shutdown(cancel_futures=True)

    def _begun(
        self,
        apertures: Iterable[Aperture],
        groups: list[list[DoubleFrustum]],
        truths: Mapping[Aperture, HogelImage],
    ) -> Iterator[_Cameras]:
        """Begin with hogel after hogel: with first frames, and with what the frames of some cameras share."""
        color, colored = self._wanted.color, self._wanted.color and self._wanted.colored_truths

        def trace(aperture: Aperture) -> Timed[HogelImage]:
            if aperture in truths:
                return truths[aperture], 0.0
            return _timed(partial(self._reference.trace, aperture, colored=colored))

        def predicting(truth: Future[Timed[HogelImage]]) -> Predictor:
            return Predictor(truth.result()[0], self._reference, self._device)

        def predict(
            predictor: Future[Predictor], settings: list[DoubleFrustum]
        ) -> Timed[list[LinkedPrediction]]:
            return _timed(partial(predictor.result().predict_each, settings))

        for aperture in apertures:
            one_of(aperture, Aperture, "aperture")
            truth = self._tracing.submit(trace, aperture)
            predictor = self._judging.submit(predicting, truth) if self._wanted.causes else None
            # Geometries of one near share some traced models.
            for _, of_near in groupby(groups, key=lambda group: group[0].near):
                traced: dict[DoubleFrustum, HogelImage] = {}
                for settings in of_near:
                    first = self._draw(aperture, settings[0], color=color)
                    shared: Future[ChainStart] | Future[PixelErrors] | None = None
                    predicted = None
                    if predictor:
                        predicted = self._judging.submit(predict, predictor, settings)
                        exact = with_exact_depth(settings[0])
                        last = (
                            first
                            if exact == settings[0]
                            else self._draw(aperture, exact, color=False)
                        )
                        chain_of = partial(
                            traced_models, self._reference, aperture, exact, traced, shaded=False
                        )
                        models = self._tracing.submit(chain_of)
                        shared = self._judging.submit(self._start, truth, models, last)
                    elif len(settings) > 1:
                        shared = self._judging.submit(self._beside, truth, first)
                    yield _Cameras(
                        aperture=aperture,
                        truth=truth,
                        predicted=predicted,
                        settings=settings,
                        first=first,
                        shared=shared,
                    )

    def _draw(
        self, aperture: Aperture, setting: DoubleFrustum, *, color: bool
    ) -> Future[Timed[Drawn]]:
        """Have a frame drawn; the result has the seconds that this took, too."""
        return self._judge.submit(
            lambda rasterizer: _timed(
                partial(rasterizer.draw, aperture, setting, normals=False, color=color)
            )
        )

    def _beside(self, truth: Future[Timed[HogelImage]], first: Future[Timed[Drawn]]) -> PixelErrors:
        errors = pixel_errors(truth.result()[0], first.result()[0].image, self._reference)
        errors.find_maps()
        return errors

    def _start(
        self,
        truth: Future[Timed[HogelImage]],
        models: Future[tuple[HogelImage, ...]],
        last: Future[Timed[Drawn]],
    ) -> ChainStart:
        """Return the chain up to R0, and find in this thread all that budgets share."""
        images = (truth.result()[0], *models.result(), last.result()[0].image)
        start = ChainStart(reference=self._reference, images=images, device=self._device)
        start.find_shared()
        return start

    def _submitted(self, cameras: _Cameras, setting: DoubleFrustum) -> Future[Result]:
        drawn = cameras.first
        if setting != cameras.settings[0]:
            drawn = self._draw(cameras.aperture, setting, color=self._wanted.color)
        return self._judging.submit(self._judged, cameras, setting, drawn)

    def _judged(
        self, cameras: _Cameras, setting: DoubleFrustum, drawing: Future[Timed[Drawn]]
    ) -> Result:
        """Compare a frame with the truth, predict its errors, charge its wrong pixels, and finish it."""
        (truth, trace_s), (drawn, raster_s) = cameras.truth.result(), drawing.result()
        shared = cameras.shared.result() if cameras.shared else None
        begun = time.perf_counter()
        comparison = compare_images(
            truth,
            drawn.image,
            self._reference,
            radiance=self._wanted.radiance,
            perceptual=self._wanted.perceptual,
            cached_errors=shared.exact if isinstance(shared, ChainStart) else shared,
        )
        compared = done = time.perf_counter()
        prediction, budget, predict_s = None, None, 0.0
        if cameras.predicted and isinstance(shared, ChainStart):
            predicted, predict_s = cameras.predicted.result()
            prediction, links = predicted[cameras.settings.index(setting)]
            budget = charged(shared, comparison.errors, (prediction, links))
            budget.causes  # noqa: B018 - found when first asked for, and it belongs to this time
            done = time.perf_counter()
        frame = JudgedFrame(
            aperture=cameras.aperture,
            truth=truth,
            settings=setting,
            image=drawn.image,
            comparison=comparison,
            prediction=prediction,
            budget=budget,
            times=StageTimes(
                trace=trace_s,
                raster=raster_s,
                compare=compared - begun,
                predict=predict_s / len(cameras.settings),
                causes=done - compared,
            ),
            gpu_s=drawn.times["draw"].gpu_s,
        )
        return self._finish(frame)


def _timed(make: Callable[[], Result]) -> Timed[Result]:
    begun = time.perf_counter()
    return make(), time.perf_counter() - begun
