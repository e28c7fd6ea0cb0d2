"""`xfrustum cost`: what accuracy costs in time, of every configuration, on one scene and machine."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

from xfrustum.compare import compare_images
from xfrustum.compare.beyond import displacement_p99
from xfrustum.compare.extent import require_seen
from xfrustum.compare.run import images_under_way, in_order
from xfrustum.compare.scouting.automatic import AutoApertures
from xfrustum.raster import Rasterizer
from xfrustum.reference import TRACERS, Reference
from xfrustum.reference.llvm import worker_count
from xfrustum.reports.common import provenance
from xfrustum.reports.common.formatting import digits, percent
from xfrustum.reports.common.json_ready import INLINED, json_object
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.timing import Stopwatch, Timing
from xfrustum.reports.cost.ways import Way, drawn, traced
from xfrustum.reports.scouting.automatic import ChoiceRecord, choices
from xfrustum.reports.trade_off.trade_off import FastestWithin, Option, answers
from xfrustum.reports.trade_off.trade_off_record import TradeOffRecord, trade_off_record
from xfrustum.scenes.arguments import real, whole
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.effects import ALL_EFFECTS, needed
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook.shown import Shown, Table
from xfrustum.scenes.plate.plate import Aperture
from xfrustum.tolerances import TOLERANCE_PX

REPEAT = 5
"""Measured pictures of each configuration unless told otherwise: the fewest by which times are told apart."""


@dataclass(frozen=True, kw_only=True)
class CostRecord:
    """The object that `cost --json` prints; see `CostReport`."""

    scene: provenance.SceneName
    aperture: tuple[int, int]
    apertures: tuple[ChoiceRecord, ...] | None
    trade_off: TradeOffRecord = field(metadata=INLINED)
    upload_s: dict[str, float]
    machine: dict[str, str]
    versions: dict[str, str]


@dataclass(frozen=True, kw_only=True, repr=False)
class CostReport(Shown):
    """Every option measured on a scene.

    Attributes
    ----------
    scene, aperture, tolerance_px
        Question that was asked; pictures of the aperture are timed.
    auto
        Apertures at all of which pictures are judged, the worst of which counts; None where it is the one.
    options
        Rasterizer, tracers and truth.
    upload_s
        By renderer: seconds of what is done once for a scene, buffers, programs and acceleration structures.
    machine, versions
        Names and values of the hardware and of the libraries.
    """

    scene: Scene
    aperture: Aperture
    auto: AutoApertures | None
    tolerance_px: float
    options: tuple[Option, ...]
    upload_s: dict[str, float]
    machine: dict[str, str]
    versions: dict[str, str]

    @property
    def answers(self) -> tuple[FastestWithin, ...]:
        """The cheapest options within the tolerance and within a fifth of it."""
        return answers(self.options, self.tolerance_px)

    def _said(self) -> str:
        column, row = self.aperture.index
        answered = " ".join(answer.sentence for answer in self.answers)
        return f"{len(self.options)} ways to draw aperture {column},{row} of {self.scene.name!r}. {answered}"

    def _tables(self) -> Sequence[Table]:
        ascending = sorted(self.options, key=lambda one: one.time_s.median)
        rows = [
            (
                one.label,
                digits(1e3 * one.time_s.median),
                digits(one.displacement_p99_px),
                percent(one.surface_fraction),
            )
            for one in ascending
        ]
        head = ("configuration", "time, ms", "displacement 99 %, px", "wrong surfaces")
        return (Table(head=head, rows=rows, numbers=True),)

    def summary(self) -> dict[str, Any]:
        """Return everything as one JSON object."""
        record = CostRecord(
            scene=provenance.SceneName.of(self.scene),
            aperture=self.aperture.index,
            apertures=choices(self.auto),
            trade_off=trade_off_record(self.options, self.tolerance_px),
            upload_s=self.upload_s,
            machine=self.machine,
            versions=self.versions,
        )
        return json_object(record)


def measure_cost(
    scene: Scene,
    aperture: Aperture | AutoApertures | None = None,
    tolerance_px: float = TOLERANCE_PX,
    *,
    repeat: int = REPEAT,
    progress: bool = False,
) -> CostReport:
    """Measure error and time of every configuration.

    Parameters
    ----------
    aperture
        Aperture whose picture is made; the middle one where None. Of the ones that `auto_apertures` chooses
        the first is timed; pictures are judged at each, and the worst counts.
    tolerance_px
        Tolerance of the 99th percentile of displacement; a fifth of it is answered for too.
    repeat
        Measured pictures of each configuration, after one that warms up. All configurations take turns,
        so that a slow minute slows all of them down.

    Raises
    ------
    InputError
        The tolerance or the number of repetitions is not positive, the aperture sees nothing of the objects,
        or there is no usable OpenGL.
    """
    if not 0 < real(tolerance_px) < math.inf or whole(repeat) < 1:
        raise InputError(f"cost: tolerance {tolerance_px} and repetitions {repeat} must be positive")
    auto = aperture if isinstance(aperture, AutoApertures) else None
    apertures = _all_of(scene.plate.middle if aperture is None else aperture)
    require_seen(scene, apertures)
    asked = Asked(repeat=repeat, tolerance_px=tolerance_px)
    watch = Stopwatch()
    with ExitStack() as stack:
        with watch.stage("raster"):
            drawers = {"auto": stack.enter_context(Rasterizer(scene))}
        if needed(scene) != ALL_EFFECTS:
            drawers["all"] = stack.enter_context(Rasterizer(scene, effects=ALL_EFFECTS))
        tracers = {name: Reference(scene, tracer=name) for name in TRACERS}
        for name, reference in tracers.items():
            with watch.stage(name):
                reference.tracer  # noqa: B018 - built when first asked for
        device = drawers["auto"].device
        ways = {one: [*drawn(scene, one, drawers), *traced(one, tracers)] for one in apertures}
        options = _race(ways, tracers["embree"], asked, progress)
    opengl = {f"OpenGL {name}": value for name, value in device.items()}
    libraries = {key: value for one in tracers.values() for key, value in one.versions.items()}
    return CostReport(
        scene=scene,
        aperture=apertures[0],
        auto=auto,
        tolerance_px=tolerance_px,
        options=tuple(options),
        upload_s=watch.seconds,
        machine={**provenance.machine(), **opengl},
        versions={**provenance.versions(), **libraries},
    )


def _all_of(aperture: Aperture | AutoApertures) -> tuple[Aperture, ...]:
    return aperture.apertures if isinstance(aperture, AutoApertures) else (aperture,)


def _race(
    ways: Mapping[Aperture, list[Way]], reference: Reference, asked: Asked, progress: bool
) -> list[Option]:
    """Make the picture of each way in turn; the first picture of each is judged, and not timed.

    Pictures of all apertures are judged, the worst one counts, and those of the first aperture are timed.
    """
    timed = [TimedWay(one) for one in next(iter(ways.values()))]
    errors = [(0.0, 0.0) for _ in timed]
    with progress_bar(len(timed) * (len(ways) + asked.repeat), "cost", "picture", shown=progress) as bar:
        for number, (p99, wrong) in _errors(ways, reference):
            errors[number] = max(errors[number][0], p99), max(errors[number][1], wrong)
            bar.update()
        for _ in range(asked.repeat):
            for way in timed:
                way()
                bar.update()
    return [one.option(*error) for one, error in zip(timed, errors, strict=True)]


def _errors(
    ways: Mapping[Aperture, list[Way]], reference: Reference
) -> Iterator[tuple[int, tuple[float, float]]]:
    """Yield the number of each way with its error at an aperture; one is judged while the next is made."""

    def pictures() -> Iterator[_Picture]:
        for aperture, those in ways.items():
            truth = reference.trace(aperture)
            for number, one in enumerate(those):
                yield _Picture(number=number, way=one, truth=truth, image=one.picture())

    def error(one: _Picture) -> tuple[int, tuple[float, float]]:
        return one.number, one.error(reference)

    most = images_under_way(math.prod(reference.scene.frustum.resolution))
    with ThreadPoolExecutor(worker_count(), thread_name_prefix="judging") as pool:
        yield from in_order((pool.submit(error, one) for one in pictures()), most)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Picture:
    """The picture that a way has made of an aperture, and the aperture's truth."""

    number: int
    way: Way
    truth: HogelImage
    image: HogelImage

    def error(self, reference: Reference) -> tuple[float, float]:
        """Return the 99th percentile of displacement, and the share of wrong surfaces."""
        judged = compare_images(self.truth, self.image, reference, radiance=False)
        assert judged.surface is not None, "the reference has the scene at hand"
        p99 = displacement_p99(judged) if self.way.renderer == "raster" else 0.0
        return p99, judged.surface.fraction


@dataclass(frozen=True, kw_only=True)
class Asked:
    """The number of turns that all ways take, and the tolerance that is asked for."""

    repeat: int
    tolerance_px: float


class TimedWay:
    """A way to make a picture and the seconds of its pictures; calling it makes one picture."""

    def __init__(self, way: Way) -> None:
        self._way = way
        self.time_s: list[float] = []
        self._gpu_s: list[float] = []
        self._read_s: list[float] = []

    def __call__(self) -> None:
        """Make a picture, and note what it and its stages took."""
        begun = time.perf_counter()
        if self._way.draw is None:
            self._way.picture()
        else:
            stages = self._way.draw().times
            self._gpu_s.append(stages["draw"].gpu_s)
            self._read_s.append(stages["read"].wall_s)
        self.time_s.append(time.perf_counter() - begun)

    def option(self, displacement_p99_px: float, surface_fraction: float) -> Option:
        """Return the way with its error and the times of its pictures."""
        return Option(
            renderer=self._way.renderer,
            label=self._way.label,
            family=self._way.family,
            configuration=self._way.configuration,
            displacement_p99_px=displacement_p99_px,
            surface_fraction=surface_fraction,
            time_s=Timing.of(self.time_s),
            gpu_s=Timing.of(self._gpu_s) if self._gpu_s else None,
            read_s=Timing.of(self._read_s) if self._read_s else None,
        )
