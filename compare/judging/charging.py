"""The predictor and the chains by which wrong pixels of one hogel's drawings are charged to causes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager
from threading import Lock

from xfrustum.compare.attribution.budget import ChainStart
from xfrustum.compare.attribution.steps import shifts
from xfrustum.compare.judging.frames import Frames
from xfrustum.compare.judging.groups import Batched
from xfrustum.compare.judging.stopwatch import Machine, Stopwatch
from xfrustum.compare.metrics.comparison import Comparison
from xfrustum.compare.metrics.error_maps import JudgedImage
from xfrustum.compare.prediction.chain import traced_models, with_exact_depth
from xfrustum.compare.prediction.predict import Predictor
from xfrustum.reference import Reference
from xfrustum.reference.certify.processors import kernels_on_one_thread
from xfrustum.reference.film_shifts import Vectors
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import DoubleFrustum

PREPARED_STAGES = (
    {"step_sizes": "causes", "rounding": "causes"},
    {"exact_wrong": "exact", "surface_charge": "causes"},
)
"""Stages of the properties of a `ChainStart` that are found side by side before the first frame is charged.
Those of the second group may have to wait for a frame that is compared. Comparing the frame with exact depth
has a stage of its own: where there are several depth buffers, it is compared first, and their frames beside
it in little time."""


class Charging:
    """The predictor of one hogel, and the chains of its pairs of cameras up to the frame with exact depth.

    Its tasks run in the threads that judge; each waits only for tasks that were begun before it.

    Parameters
    ----------
    reference
        Reference that traces the models.
    truth
        The hogel's true image.
    subpixel_bits
        Subpixel bits of the device that draws.
    machine, watch
        Machine whose time is shared, and stopwatch of what the hogel's drawings have in common.
    """

    def __init__(
        self,
        reference: Reference,
        truth: Future[HogelImage],
        subpixel_bits: int,
        machine: Machine,
        watch: Stopwatch,
    ) -> None:
        self._reference, self._truth, self._bits = reference, truth, subpixel_bits
        self._machine, self._watch = machine, watch
        self._tracing, self._moving = Lock(), Lock()
        self._models: dict[DoubleFrustum, HogelImage] = {}
        self._shifts: Vectors | None = None

    def predictor(self, settings: DoubleFrustum) -> Predictor:
        """Return the predictor of the hogel, with what all of its predictions share computed."""
        truth = self._truth.result()
        with self._machine.stage(self._watch, "predict"), self._kernels(truth):
            gaps = self._reference.gaps(truth.camera.aperture)
            predictor = Predictor(truth, gaps, self._reference.scene.frustum, self._bits)
            predictor.predict(settings)
        return predictor

    def start(
        self,
        settings: DoubleFrustum,
        exact: Future[HogelImage],
        beside: Callable[[], JudgedImage] | None,
    ) -> ChainStart:
        """Return the chain of some cameras up to their frame with exact depth.

        Parameters
        ----------
        settings
            Settings with these cameras.
        exact
            The frame, which may be drawn while the models are traced.
        beside
            Function that returns a frame of these cameras that is compared, beside which the exact one is;
            where there are several of the same cameras these are compared beside the exact one, and it is
            None.
        """
        truth = self._truth.result()
        with self._machine.stage(self._watch, "causes"), self._kernels(truth):
            models = self._traced(truth, settings)
            moved = self._truth_shifts(truth)
        return ChainStart(
            reference=self._reference,
            images=(truth, *models, exact.result()),
            subpixel_bits=self._bits,
            truth_shifts=moved,
            beside=beside,
        )

    def prepare(self, pool: Executor, start: Future[ChainStart]) -> tuple[Future[None], ...]:
        """Have the properties in `PREPARED_STAGES` found side by side."""
        return tuple(pool.submit(self._find, start, parts) for parts in PREPARED_STAGES)

    def _find(self, start: Future[ChainStart], parts: Mapping[str, str]) -> None:
        ready = start.result()
        if ready.beside is not None and "exact_wrong" in parts:
            # Nothing may be waited for within a stage.
            ready.beside()
        for part, stage in parts.items():
            with self._machine.stage(self._watch, stage), self._kernels(ready.truth):
                getattr(ready, part)

    @staticmethod
    def _kernels(truth: HogelImage) -> AbstractContextManager[None]:
        """Have kernels run on one thread: other threads judge, too."""
        return kernels_on_one_thread(truth.triangle.size)

    def _traced(self, truth: HogelImage, settings: DoubleFrustum) -> tuple[HogelImage, ...]:
        exact = with_exact_depth(settings)
        with self._tracing:
            if any(known.near != exact.near for known in self._models):
                # Camera geometries share the models of a near; those of others are not needed again.
                self._models.clear()
            return traced_models(self._reference, truth.camera.aperture, exact, self._models, shaded=False)

    def _truth_shifts(self, truth: HogelImage) -> Vectors:
        """Return the displacement of the truth itself, which is rounding."""
        with self._moving:
            if self._shifts is None:
                self._shifts = shifts(truth, truth.camera)
            return self._shifts


def chain_start(
    charging: Charging,
    exact: Future[HogelImage],
    frames: Future[Frames],
    compared: Batched[Comparison] | None,
) -> ChainStart:
    """Return the chain of some cameras as soon as their frames are drawn; see `Charging`.

    Parameters
    ----------
    charging
        Charging of the hogel.
    exact
        The frame with exact depth.
    frames, compared
        Frames of these cameras, and the comparison of the first, if it is the only one.
    """
    first = frames.result()[0]
    beside = None if compared is None else _Beside(first.image, compared)
    return charging.start(first.settings, exact, beside)


class _Beside:
    """The image beside which R0 is judged: made once, so that what is found of it is found once."""

    def __init__(self, image: HogelImage, compared: Batched[Comparison]) -> None:
        self._image, self._compared = image, compared
        self._lock = Lock()
        self._made: JudgedImage | None = None

    def __call__(self) -> JudgedImage:
        errors = self._compared.result().errors
        with self._lock:
            if self._made is None:
                self._made = JudgedImage(image=self._image, errors=errors)
            return self._made
