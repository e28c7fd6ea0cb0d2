"""The two threads beside those that judge: one that draws all hogels, and one that traces them in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import nullcontext
from typing import TypeVar

from xfrustum.compare.judging.stopwatch import Machine, Stopwatch
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.certify.processors import kernels_on_all_threads
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture

Result = TypeVar("Result")


class DrawingThread:
    """A rasterizer in a thread of its own: an OpenGL context is made and used in one thread only.

    Parameters
    ----------
    scene
        Scene that is uploaded.
    effects
        Effects that are simulated; None for those that the scene calls for.

    Raises
    ------
    InputError
        There is no usable OpenGL, or the scene is too large for it.
    """

    def __init__(self, scene: Scene, effects: frozenset[Effect] | None = None) -> None:
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="drawing")
        self._released = False
        try:
            self._rasterizer = self._thread.submit(Rasterizer, scene, effects).result()
        except BaseException:
            self._thread.shutdown(cancel_futures=True)
            raise

    @property
    def device(self) -> dict[str, str]:
        """Names of the device that draws."""
        return self._rasterizer.device

    def submit(self, task: Callable[[Rasterizer], Result]) -> Future[Result]:
        """Have the thread do something with the rasterizer, after all that it was asked before."""
        return self._thread.submit(task, self._rasterizer)

    def release(self) -> None:
        """Free the rasterizer, and end the thread; again, it does nothing."""
        if not self._released:
            self._released = True
            try:
                self._thread.submit(self._rasterizer.release).result()
            finally:
                self._thread.shutdown()


class TracingThread:
    """A reference that traces apertures one after the other, in the order in which they are submitted.

    They are one stream of the reference, so that triangles are sorted once for all of them. After an error
    nothing more is traced: the others end with the same error.

    Parameters
    ----------
    reference
        Reference that traces.
    thread
        Executor with one thread.
    machine
        Machine whose time is shared.
    colored
        Whether the truths have color.
    """

    def __init__(
        self, reference: Reference, thread: ThreadPoolExecutor, machine: Machine, *, colored: bool
    ) -> None:
        self._thread, self._machine = thread, machine
        self._asked: deque[Aperture] = deque()
        self._failed: BaseException | None = None
        self._images = reference.stream(self._taken(), colored=colored)

    def submit(self, aperture: Aperture, watch: Stopwatch) -> Future[HogelImage]:
        """Have an aperture traced; the stopwatch is given the time."""
        return self._thread.submit(self._traced, aperture, watch)

    def _traced(self, aperture: Aperture, watch: Stopwatch) -> HogelImage:
        if self._failed is not None:
            raise self._failed
        # A truth that is traced by itself may take all processors.
        threads = kernels_on_all_threads() if self._machine.apart else nullcontext()
        with self._machine.undisturbed(), threads, self._machine.timed(watch, "trace"):
            self._asked.append(aperture)
            try:
                return next(self._images)
            except BaseException as error:
                # The stream has ended: asked once more, it would only say that.
                self._failed = error
                raise

    def _taken(self) -> Iterator[Aperture]:
        """Yield each aperture when it is traced; the stream takes one at a time."""
        while True:
            yield self._asked.popleft()
