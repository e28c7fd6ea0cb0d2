"""The one engine that draws and judges many hogels: drawing, tracing and judging overlap.

Frames are drawn in one thread and truths are traced in another, both in order and not far ahead; as many
threads as there are processors judge them. Results come in order. Everything found is what judging each
hogel alone finds, bit for bit: threads decide when a number is computed, not how.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, Generic, TypeVar

from xfrustum.compare.attribution.budget import Budget, ChainStart, charged
from xfrustum.compare.judging.charging import Charging, chain_start
from xfrustum.compare.judging.frames import Frame, Frames, draw_turn, exact_frame, warm_up
from xfrustum.compare.judging.groups import Batched, ComparedGroups
from xfrustum.compare.judging.in_order import images_under_way, in_order, workers
from xfrustum.compare.judging.parts import Part, parts_of
from xfrustum.compare.judging.stopwatch import Machine, StageTimes, Stopwatch
from xfrustum.compare.judging.threads import DrawingThread, TracingThread
from xfrustum.compare.metrics.comparison import Comparison, compare_each, compare_images
from xfrustum.compare.metrics.error_maps import JudgedImage
from xfrustum.compare.prediction.predict import Prediction, Predictor
from xfrustum.reference import Reference
from xfrustum.reference.certify.processors import kernels_on_one_thread
from xfrustum.reference.devices.threads import worker_count
from xfrustum.scenes.arguments import one_of
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

Found = TypeVar("Found")

NO_TRUTHS: Mapping[Aperture, HogelImage] = MappingProxyType({})
"""The truths that are there before anything is traced, where there are none."""

MAX_BATCH_PIXELS = 1 << 20
"""Largest number of pixels of the frames of the same cameras that are drawn one after the other."""

MAX_UNDISTURBED_PIXELS = 1 << 24
"""Largest number of pixels of the frames that are drawn in one undisturbed turn, 0.5 GB; all threads wait
for it."""

TASKS_PER_THREAD = 3
"""Number of frames under way for each thread, beside those that are drawn together: frames with exact
depth are drawn before the threads come to them."""


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """What is wanted of each drawing.

    Attributes
    ----------
    color
        Whether frames are drawn in color; where not, no colors are compared.
    colored_truths
        Whether truths have color where frames have; where not, no colors are compared either.
    radiance, perceptual
        Whether colors are compared, and how different the pictures look; see `compare_images`.
    causes
        Whether errors are predicted and wrong pixels charged to causes.
    apart
        Whether truths and frames are made while nothing else runs, so that their times are those that each
        takes by itself. Everything takes longer then. Before the first frame is timed, programs are compiled
        and targets allocated.
    """

    color: bool = False
    colored_truths: bool = True
    radiance: bool = False
    perceptual: bool = False
    causes: bool = False
    apart: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class TracedHogel:
    """A hogel whose truth is traced.

    Attributes
    ----------
    number
        Number of the hogel in the stream.
    aperture, truth
        Its aperture and its certified image.
    trace_s
        Seconds of tracing.
    """

    number: int
    aperture: Aperture
    truth: HogelImage
    trace_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedFrame:
    """A frame with all that was found of it.

    Attributes
    ----------
    hogel
        Hogel that it shows.
    settings, image
        Settings that it was drawn with, and the image.
    comparison
        How it differs from the truth.
    prediction, budget
        Errors by closed forms, and wrong pixels charged to causes; None where that was not wanted.
    lap
        Seconds of the frame's stages: `raster`, `compare`, `predict` and `causes`.
    gpu_s
        Part of `raster` in which the device drew, by its own clock.
    """

    hogel: TracedHogel
    settings: DoubleFrustum
    image: HogelImage
    comparison: Comparison
    prediction: Prediction | None
    budget: Budget | None
    lap: Stopwatch
    gpu_s: float

    @property
    def times(self) -> StageTimes:
        """Seconds of the truth and of the frame's stages."""
        return StageTimes.of(self.hogel.trace_s, self.lap)


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged(Generic[Found]):
    """What was made of one frame, with its hogel and its settings.

    Attributes
    ----------
    hogel, settings
        Hogel that the frame shows, and settings that it was drawn with.
    found
        What `finish` has returned.
    """

    hogel: TracedHogel
    settings: DoubleFrustum
    found: Found


@dataclass(frozen=True, kw_only=True, eq=False)
class _Hogel:
    """A hogel that is being traced."""

    number: int
    aperture: Aperture
    truth: Future[HogelImage]
    lap: Stopwatch

    @property
    def traced(self) -> TracedHogel:
        """The hogel, as soon as it is traced."""
        truth = self.truth.result()
        trace_s = self.lap.seconds["trace"]
        return TracedHogel(number=self.number, aperture=self.aperture, truth=truth, trace_s=trace_s)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Charged:
    """The tasks that must end before a hogel's frames of the same cameras are charged to causes."""

    predictor: Future[Predictor]
    start: Future[ChainStart]
    prepared: tuple[Future[None], ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Task:
    """One frame that is to be judged, with what judging it waits for.

    Attributes
    ----------
    hogel, frames, place
        Hogel that the frame shows, the frames that are drawn together, and its place among these.
    beside
        Frame of the same cameras that is judged first; None where there is no other, or causes are wanted.
    compared
        Its comparison, where this has begun: that of the only frame of its cameras, beside which the one with
        exact depth is judged.
    charged
        Tasks that must end before it is charged to causes; None where causes are not wanted.
    """

    hogel: _Hogel
    frames: Future[Frames]
    place: int
    beside: Future[JudgedImage] | None
    compared: Batched[Comparison] | None
    charged: _Charged | None


class Engine(Generic[Found]):
    """Draws and judges many hogels.

    Parameters
    ----------
    reference, drawing
        The two renderers of a scene.
    wanted
        What is wanted of each drawing.
    finish
        Function that is called with each frame in the thread that has judged it. What it returns is kept, and
        the frame is not.

    Attributes
    ----------
    machine
        Machine whose time all tasks share.
    watch
        Seconds, by stage, of what the drawings of a hogel have in common beside its truth.
    """

    def __init__(
        self,
        reference: Reference,
        drawing: DrawingThread,
        wanted: Wanted,
        finish: Callable[[JudgedFrame], Found],
    ) -> None:
        self.machine = Machine(apart=wanted.apart)
        self.watch = Stopwatch()
        self._reference, self._drawing, self._wanted, self._finish = reference, drawing, wanted, finish
        self._pixels = math.prod(reference.scene.frustum.resolution)
        self._batch_size = max(1, min(2 * worker_count(), MAX_BATCH_PIXELS // self._pixels))

    def frames(
        self,
        apertures: Iterable[Aperture],
        settings: Sequence[DoubleFrustum],
        truths: Mapping[Aperture, HogelImage] = NO_TRUTHS,
    ) -> Generator[Judged[Found], None, None]:
        """Yield what is found of each drawing, hogel by hogel, those of the same cameras together.

        Parameters
        ----------
        apertures
            Apertures, taken in the thread of the caller, some hogels ahead of what it has been given.
        settings
            Settings that each is drawn with, at least one.
        truths
            True images that are there already, and are not traced again.
        """
        parts = parts_of(settings, self._batch_size)
        turns, most = self._turns(parts), images_under_way(self._pixels)
        if len(settings) > 1 and self._batch_size > 1:
            # Threads go on with some frames while the next ones are drawn.
            longest = max(len(part.settings) for part in parts)
            most = max(most, longest + TASKS_PER_THREAD * worker_count())
        one_thread = kernels_on_one_thread(self._pixels)
        with one_thread, workers("judging") as pool, workers("tracing", 1) as thread:
            # The time of a whole truth is measured with its color.
            colored = (self._wanted.color and self._wanted.colored_truths) or self._wanted.apart
            tracing = TracingThread(self._reference, thread, self.machine, colored=colored)
            drawn: deque[Future[Any]] = deque()
            tasks = (
                task
                for hogel in _traced(tracing, apertures, truths)
                for task in self._tasks(hogel, turns, pool, drawn)
            )
            try:
                yield from in_order(pool, self._judged, tasks, most)
            finally:
                for one in drawn:
                    one.cancel()

    def _turns(self, parts: Sequence[Part]) -> list[list[Part]]:
        """Return the parts of each turn: one, or several where all threads wait until a turn has ended."""
        frames = [len(part.settings) + (part.first and self._wanted.causes) for part in parts]
        count = -(-sum(frames) // max(1, MAX_UNDISTURBED_PIXELS // self._pixels))
        # Turns are about equally long: after a short one threads would be idle.
        most = -(-sum(frames) // max(1, count))
        turns: list[list[Part]] = []
        drawn = 0
        for part, more in zip(parts, frames, strict=True):
            if not (turns and self._wanted.apart and drawn + more <= most):
                turns.append([])
                drawn = 0
            turns[-1].append(part)
            drawn += more
        return turns

    def _tasks(
        self,
        hogel: _Hogel,
        turns: Sequence[Sequence[Part]],
        pool: Executor,
        drawn: deque[Future[Any]],
    ) -> Iterator[_Task]:
        """Have the frames of a hogel drawn, turn by turn, and yield the task of each."""
        charging = self._charging(hogel) if self._wanted.causes else None
        predictor = charging and pool.submit(charging.predictor, turns[0][0].settings[0])
        if self._wanted.apart and hogel.number == 0:
            self._make_ready(hogel, [one for parts in turns for part in parts for one in part.settings])
        stage = self.machine, self.watch
        draw = partial(draw_turn, self.machine, hogel.aperture, color=self._wanted.color)
        beside: Future[JudgedImage] | None = None
        compared: Batched[Comparison] | None = None
        charged: _Charged | None = None
        for parts in turns:
            waiting: deque[Future[Frames]] = deque(Future() for _ in parts)
            drawn.append(self._drawing.submit(partial(draw, parts=parts, drawn=tuple(waiting))))
            drawn.extend(waiting)
            compare = partial(self._compared_each, hogel)
            # No name here stands for all frames of the turn: each is freed when it is judged.
            alone = ComparedGroups(
                compare, pool, {k: waiting[k] for k, part in enumerate(parts) if part.only}
            )
            for number, part in enumerate(parts):
                while drawn and drawn[0].done():
                    drawn.popleft()
                frames = waiting.popleft()
                if part.first:
                    beside, compared, charged = None, alone.of(number), None
                if part.first and charging and predictor:
                    exact = self._drawing.submit(partial(exact_frame, stage, hogel.aperture, frames))
                    drawn.append(exact)
                    start = pool.submit(chain_start, charging, exact, frames, compared)
                    # Threads that would wait for the chain compare meanwhile.
                    alone.begin_behind(number)
                    prepared = charging.prepare(pool, start)
                    charged = _Charged(predictor=predictor, start=start, prepared=prepared)
                elif part.first and not part.only:
                    beside = pool.submit(self._first, hogel, frames)
                alone.begin_behind(number)
                for place in range(len(part.settings)):
                    yield _Task(
                        hogel=hogel,
                        frames=frames,
                        place=place,
                        beside=beside,
                        compared=compared,
                        charged=charged,
                    )

    def _make_ready(self, hogel: _Hogel, settings: Sequence[DoubleFrustum]) -> None:
        """Draw once, and make the reference ready to judge frames, before the first frame is timed.

        Threads that judge the first frames would otherwise wait for the one that makes the reference ready.
        The predictor, which is made meanwhile, needs kernels at first: so OpenGL is warmed up before.
        """
        truth, stage = hogel.truth.result(), (self.machine, self.watch)
        warm = partial(warm_up, stage, hogel.aperture, settings, color=self._wanted.color)
        self._drawing.submit(warm).result()
        with self.machine.stage(self.watch, "prepare"):
            self._reference.make_ready(truth, len(settings))

    def _compared_each(self, hogel: _Hogel, waiting: Sequence[Future[Frames]]) -> list[Comparison]:
        """Compare the only frames of their cameras with the truth, each in an equal share of the time."""
        truth, frames = hogel.truth.result(), [one.result()[0] for one in waiting]
        lap = Stopwatch()
        with self.machine.stage(lap, "compare"):
            compared = compare_each(
                truth,
                [frame.image for frame in frames],
                self._reference,
                radiance=self._wanted.radiance,
                perceptual=self._wanted.perceptual,
            )
        for frame in frames:
            frame.lap.record("compare", lap.seconds["compare"] / len(frames))
        return compared

    def _charging(self, hogel: _Hogel) -> Charging:
        bits = int(self._drawing.device["subpixel_bits"])
        return Charging(self._reference, hogel.truth, bits, self.machine, self.watch)

    def _first(self, hogel: _Hogel, frames: Future[Frames]) -> JudgedImage:
        """Judge the first of several frames of the same cameras, beside which the others are judged."""
        truth, frame = hogel.truth.result(), frames.result()[0]
        with self.machine.stage(frame.lap, "compare"):
            return JudgedImage.of(truth, frame.image, self._reference)

    def _compared(self, hogel: _Hogel, frame: Frame, beside: JudgedImage | None) -> Comparison:
        """Compare a frame with the truth."""
        truth = hogel.truth.result()
        with self.machine.stage(frame.lap, "compare"):
            return compare_images(
                truth,
                frame.image,
                self._reference,
                radiance=self._wanted.radiance,
                perceptual=self._wanted.perceptual,
                judged=beside,
            )

    def _judged(self, task: _Task) -> Judged[Found]:
        """Predict the errors of a frame, compare it with the truth, and charge what is wrong to causes."""
        hogel, frame = task.hogel.traced, task.frames.result()[task.place]
        settings = frame.settings
        stage = partial(self.machine.stage, frame.lap)
        beside = task.beside.result() if task.beside else None
        prediction = budget = None
        if task.charged:
            predictor = task.charged.predictor.result()
            with stage("predict"):
                prediction = predictor.predict(settings)
            with stage("causes"):
                links = predictor.links(settings)
            _, exact_wrong = task.charged.prepared
            exact_wrong.result()
            start = task.charged.start.result()
            beside = None if task.compared else start.exact
        comparison = task.compared.result() if task.compared else self._compared(task.hogel, frame, beside)
        if task.charged:
            for found in task.charged.prepared:
                found.result()
            with stage("causes"), kernels_on_one_thread(self._pixels):
                budget = charged(start, frame.image, links, comparison.errors)
                budget.causes  # noqa: B018 - found when first asked for, and it belongs to this stage
        judged = JudgedFrame(
            hogel=hogel,
            settings=settings,
            image=frame.image,
            comparison=comparison,
            prediction=prediction,
            budget=budget,
            lap=frame.lap,
            gpu_s=frame.gpu_s,
        )
        return Judged(hogel=hogel, settings=settings, found=self._finish(judged))


def _traced(
    tracing: TracingThread, apertures: Iterable[Aperture], truths: Mapping[Aperture, HogelImage]
) -> Iterator[_Hogel]:
    for number, aperture in enumerate(apertures):
        one_of(aperture, Aperture, "aperture")
        lap = Stopwatch()
        if aperture in truths:
            truth: Future[HogelImage] = Future()
            truth.set_result(truths[aperture])
            lap.record("trace", 0.0)
        else:
            truth = tracing.submit(aperture, lap)
        yield _Hogel(number=number, aperture=aperture, truth=truth, lap=lap)
