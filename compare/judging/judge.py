"""Many hogels drawn with several settings each, and judged by their certified truth."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np

from xfrustum.compare.attribution.budget import Budget, Cause, ChainStart, charged
from xfrustum.compare.metrics.comparison import ComparisonNumbers, compare_images
from xfrustum.compare.metrics.error_maps import ErrorMaps
from xfrustum.compare.prediction.chain import traced_models, with_exact_depth
from xfrustum.compare.prediction.predict import Predictor
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes.arguments import one_of
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.look import is_shaded
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture


@dataclass(frozen=True, kw_only=True)
class StageTimes:
    """Wall seconds of the stages of one drawing; no stage is a part of another.

    Attributes
    ----------
    trace
        The hogel's certified truth, the same for all its drawings.
    raster
        A frame with read-back.
    compare, predict
        Judging and predicting the frame.
    causes
        Charging its wrong pixels to causes: its share of what the frames of the same cameras have in common.
        This stage and `predict` take no time where causes were not asked for.
    """

    trace: float
    raster: float
    compare: float
    predict: float
    causes: float


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedDrawing:
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
    times
        Wall seconds by stage.
    """

    settings: DoubleFrustum
    comparison: ComparisonNumbers
    image: HogelImage | None
    causes: tuple[Cause, ...] | None
    unexplained: int | None
    times: StageTimes


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedHogel:
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


class Judge:
    """A reference and a rasterizer of one scene, which judge what the one draws by what the other traces.

    A context manager: leaving it frees the rasterizer.

    Parameters
    ----------
    scene
        Scene that is traced and drawn.
    tracer
        Name of the tracer that gives the truth a second opinion.

    Raises
    ------
    InputError
        There is no such tracer, or no usable OpenGL.
    """

    def __init__(self, scene: Scene, tracer: str = "embree") -> None:
        one_of(scene, Scene, "scene")
        self.scene = scene
        self.reference = Reference(scene, tracer)
        self._rasterizer = Rasterizer(scene)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def release(self) -> None:
        """Free the rasterizer."""
        self._rasterizer.release()

    def stream(
        self,
        apertures: Iterable[Aperture],
        settings: Sequence[DoubleFrustum],
        images: bool = False,
        radiance: bool | None = None,
        causes: bool = False,
    ) -> Iterator[JudgedHogel]:
        """Yield many hogels, judged, in the order of their apertures.

        Parameters
        ----------
        apertures
            Apertures of the hogels.
        settings
            Settings that each hogel is drawn with.
        images
            Whether truths, drawings and error maps are kept.
        radiance
            Whether colors are compared; None for scenes that say how they look.
        causes
            Whether wrong pixels are charged to causes.

        Raises
        ------
        InputError
            The settings make no sense for the scene's frustum.
        """
        for one in settings:
            one_of(one, DoubleFrustum, "settings")
            one.check_against(self.scene.frustum)
        colors = is_shaded(self.scene) if radiance is None else radiance
        asked = _Asked(images=images, radiance=colors, causes=causes)
        return self._judged(apertures, tuple(settings), asked)

    def _judged(
        self, apertures: Iterable[Aperture], settings: tuple[DoubleFrustum, ...], asked: _Asked
    ) -> Iterator[JudgedHogel]:
        begun = time.perf_counter()
        for truth in self.reference.stream(apertures):
            trace_s = time.perf_counter() - begun
            charging = _Charging(self.reference, self._rasterizer, truth) if asked.causes else None
            yield JudgedHogel(
                aperture=truth.camera.aperture,
                truth=truth if asked.images else None,
                drawings=tuple(self._drawing(truth, one, asked, charging, trace_s) for one in settings),
            )
            begun = time.perf_counter()

    def _drawing(
        self,
        truth: HogelImage,
        settings: DoubleFrustum,
        asked: _Asked,
        charging: _Charging | None,
        trace_s: float,
    ) -> JudgedDrawing:
        clock = [time.perf_counter()]
        color = asked.images or asked.radiance
        drawn = self._rasterizer.render(truth.camera.aperture, settings, normals=False, color=color)
        clock.append(time.perf_counter())
        comparison = compare_images(truth, drawn, self.reference, radiance=asked.radiance)
        clock.append(time.perf_counter())
        budget = charging.budget(drawn, comparison.maps) if charging else None
        clock.append(time.perf_counter())
        raster, compare, causes = np.diff(clock).tolist()
        return JudgedDrawing(
            settings=settings,
            comparison=comparison if asked.images else comparison.numbers,
            image=drawn if asked.images else None,
            causes=None if budget is None else budget.causes,
            unexplained=None if budget is None else int(budget.explanation.unexplained.sum()),
            times=StageTimes(trace=trace_s, raster=raster, compare=compare, predict=0.0, causes=causes),
        )


@dataclass(frozen=True, kw_only=True)
class _Asked:
    """What a stream is asked for; see `Judge.stream`."""

    images: bool
    radiance: bool
    causes: bool


class _Charging:
    """What charging the wrong pixels of one hogel's drawings to causes needs, found once for all of them."""

    def __init__(self, reference: Reference, rasterizer: Rasterizer, truth: HogelImage) -> None:
        self._reference, self._rasterizer, self._truth = reference, rasterizer, truth
        self._bits = int(rasterizer.device["subpixel_bits"])
        gaps = reference.gaps(truth.camera.aperture)
        self._predictor = Predictor(truth, gaps, reference.scene.frustum, self._bits)
        self._models: dict[DoubleFrustum, HogelImage] = {}
        self._starts: dict[DoubleFrustum, ChainStart] = {}

    def budget(self, drawn: HogelImage, maps: ErrorMaps) -> Budget:
        """Charge the wrong pixels of one drawing."""
        settings = drawn.camera.settings
        assert settings is not None, "the rasterizer says with which settings it drew"
        start = self._start(with_exact_depth(settings))
        budget = charged(start, drawn, self._predictor.links(settings), maps)
        budget.causes  # noqa: B018 - found when first asked for
        return budget

    def _start(self, exact: DoubleFrustum) -> ChainStart:
        if exact not in self._starts:
            aperture = self._truth.camera.aperture
            models = traced_models(self._reference, aperture, exact, self._models, shaded=False)
            drawn = self._rasterizer.render(aperture, exact, normals=False, color=False)
            self._starts[exact] = ChainStart(
                reference=self._reference, images=(self._truth, *models, drawn), subpixel_bits=self._bits
            )
        return self._starts[exact]
