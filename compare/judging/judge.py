"""Many hogels drawn with several settings each, and judged by their certified truth."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from types import TracebackType
from typing import Self, TypeVar

from xfrustum.compare.attribution.budget import Cause
from xfrustum.compare.judging.engine import Engine, JudgedFrame, Wanted
from xfrustum.compare.judging.stopwatch import StageTimes
from xfrustum.compare.judging.threads import DrawingThread
from xfrustum.compare.metrics.comparison import Comparison, ComparisonNumbers
from xfrustum.compare.metrics.comparison_facts import figures, said_of_numbers, table_of_numbers
from xfrustum.compare.prediction.predict import Prediction
from xfrustum.reference import Reference
from xfrustum.scenes.arguments import one_of
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.look import is_shaded
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook.shown import Figure, Shown, Table
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

Found = TypeVar("Found")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class JudgedDrawing(Shown):
    """One drawing of a hogel, judged by the truth.

    Attributes
    ----------
    settings
        Settings that it was drawn with.
    comparison
        How it differs from the truth; a `Comparison`, which has maps, where images were asked for.
    image
        The drawing; None unless images were asked for.
    causes
        What each link of the chain does, as the rows of `report --json` have it; None unless that was asked.
    unexplained
        Number of wrong pixels charged to rounding whose cause is not known; None likewise.
    predicted
        The error by closed forms; None likewise.
    times
        Wall seconds by stage.
    """

    settings: DoubleFrustum
    comparison: ComparisonNumbers
    image: HogelImage | None
    causes: tuple[Cause, ...] | None
    unexplained: int | None
    predicted: Prediction | None
    times: StageTimes

    def _said(self) -> str:
        return (
            f"near {self.settings.near:.3g} scene units, {self.settings.depth_label}: "
            f"{said_of_numbers(self.comparison)}"
        )

    def _tables(self) -> Sequence[Table]:
        return (table_of_numbers(self.comparison),)

    def _figures(self) -> Sequence[Figure]:
        return tuple(figures(self.comparison)) if isinstance(self.comparison, Comparison) else ()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class JudgedHogel(Shown):
    """One hogel with its drawings, judged.

    Attributes
    ----------
    aperture
        Aperture of the hogel.
    truth
        Its certified image; None unless images were asked for.
    drawings
        One for each of the settings, in their order.
    """

    aperture: Aperture
    truth: HogelImage | None
    drawings: tuple[JudgedDrawing, ...]

    def _said(self) -> str:
        drawn = "; ".join(one._said() for one in self.drawings)
        return f"aperture {self.aperture.column},{self.aperture.row}; {drawn}"

    def _figures(self) -> Sequence[Figure]:
        return () if self.truth is None else self.truth._figures()


class Judge:
    """A reference and a rasterizer of one scene: what the one draws is judged by what the other traces.

    A context manager: leaving it frees the rasterizer.

    Parameters
    ----------
    scene
        Scene that is traced and drawn.
    tracer
        Name of the tracer that gives the truth a second opinion.
    reference
        Reference of the scene, where there is one already; `tracer` then does not matter.
    effects
        Effects that are simulated; None for those that the scene calls for.

    Attributes
    ----------
    scene, reference
        The scene, and what traces it.
    drawing
        The thread that draws it.

    Raises
    ------
    InputError
        There is no such tracer, or no usable OpenGL.
    """

    def __init__(
        self,
        scene: Scene,
        tracer: str = "embree",
        *,
        reference: Reference | None = None,
        effects: frozenset[Effect] | None = None,
    ) -> None:
        one_of(scene, Scene, "scene")
        self.scene = scene
        self.reference = Reference(scene, tracer, effects) if reference is None else reference
        self.drawing = DrawingThread(scene, effects)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def release(self) -> None:
        """Free the rasterizer, and end its thread."""
        self.drawing.release()

    def stream(
        self,
        apertures: Iterable[Aperture],
        settings: Sequence[DoubleFrustum],
        images: bool = False,
        radiance: bool | None = None,
        causes: bool = False,
    ) -> Iterator[JudgedHogel]:
        """Yield many hogels, judged, in the order of their apertures.

        While the caller looks at one hogel, others are drawn in a thread of their own, traced in another, and
        judged in as many as there are processors. Memory does not grow with the number of apertures.
        Everything found is what judging each hogel alone finds, bit for bit. An exception of any thread comes
        to the caller, and closing the iterator early ends the work.

        Parameters
        ----------
        apertures
            Apertures of the hogels, taken in the caller's thread, some ahead of what has been yielded.
        settings
            Settings that each hogel is drawn with.
        images
            Whether truths, drawings in color and error maps are kept.
        radiance
            Whether colors are compared; None for scenes that say how they look.
        causes
            Whether errors are predicted and wrong pixels charged to causes.

        Raises
        ------
        InputError
            There are no settings, or they make no sense for the scene's frustum.
        """
        if not settings:
            raise InputError("nothing to judge: give at least one setting")
        for one in settings:
            one_of(one, DoubleFrustum, "settings")
            one.check_against(self.scene.frustum)
        colors = is_shaded(self.scene) if radiance is None else radiance
        wanted = Wanted(color=images or colors, radiance=colors, causes=causes)

        def finish(frame: JudgedFrame) -> JudgedDrawing:
            return _drawing(frame, images)

        return self._stream(self.engine(wanted, finish), apertures, tuple(settings), images)

    def engine(self, wanted: Wanted, finish: Callable[[JudgedFrame], Found]) -> Engine[Found]:
        """Return what a stream is made of: an engine that keeps what `finish` returns of each frame."""
        return Engine(self.reference, self.drawing, wanted, finish)

    def _stream(
        self,
        engine: Engine[JudgedDrawing],
        apertures: Iterable[Aperture],
        settings: tuple[DoubleFrustum, ...],
        images: bool,
    ) -> Iterator[JudgedHogel]:
        different = len(set(settings))
        with closing(engine.frames(apertures, settings)) as frames:
            while found := list(islice(frames, different)):
                hogel = found[0].hogel
                drawings = {one.settings: one.found for one in found}
                yield JudgedHogel(
                    aperture=hogel.aperture,
                    truth=hogel.truth if images else None,
                    drawings=tuple(drawings[one] for one in settings),
                )


def _drawing(frame: JudgedFrame, images: bool) -> JudgedDrawing:
    """Return what a stream yields of a frame."""
    budget = frame.budget
    return JudgedDrawing(
        settings=frame.settings,
        comparison=frame.comparison if images else frame.comparison.numbers,
        image=frame.image if images else None,
        causes=None if budget is None else budget.causes,
        unexplained=None if budget is None else budget.explanation.counts()["unexplained"],
        predicted=frame.prediction,
        times=frame.times,
    )
