"""`xfrustum cost`: what accuracy costs in time, of every configuration, on one scene and machine."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from xfrustum.compare import compare_images
from xfrustum.compare.beyond import displacement_p99
from xfrustum.compare.extent import require_seen
from xfrustum.compare.run import images_under_way, in_order
from xfrustum.compare.scout import AutoApertures
from xfrustum.raster import Rasterizer
from xfrustum.reference import TRACERS, Reference
from xfrustum.reference.llvm import worker_count
from xfrustum.reports.common import provenance
from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.timing import Stopwatch, Timing
from xfrustum.reports.cost.trade_off import FastestWithin, Option, answers, pareto
from xfrustum.reports.cost.ways import Way, drawn, traced
from xfrustum.reports.scout import choices
from xfrustum.scenes.arguments import real, whole
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.effects import ALL_EFFECTS, needed
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook import Shown, Table, digits, percent
from xfrustum.scenes.plate.plate import Aperture
from xfrustum.tolerances import TOLERANCE_PX

REPEAT = 5
"""Measured pictures of each configuration unless told otherwise: the fewest by which times are told apart."""


@dataclass(frozen=True, kw_only=True, repr=False)
class CostReport(Shown):
    """Every option measured on a scene.

    Attributes
    ----------
    auto
        Apertures at all of which pictures are judged, the worst of which counts; None where it is the one.
    upload_s
        By renderer: seconds of what is done once for a scene, buffers, programs and acceleration structures.
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
        front = pareto(self.options)
        content: dict[str, Any] = json_ready(
            {
                "scene": provenance.SceneName.of(self.scene),
                "aperture": self.aperture.index,
                "apertures": choices(self.auto),
                "rows": [_row(one, best) for one, best in zip(self.options, front, strict=True)],
                "answers": [_answer(one) for one in self.answers],
                "upload_s": self.upload_s,
                "machine": self.machine,
                "versions": self.versions,
            }
        )
        return content


def _row(option: Option, best: bool) -> dict[str, Any]:
    return {
        "renderer": option.renderer,
        "label": option.label,
        **option.configuration,
        "error": {
            "displacement_p99_px": option.displacement_p99_px,
            "surface_fraction": option.surface_fraction,
        },
        "time_s": _times(option.time_s),
        "gpu_s": _times(option.gpu_s),
        "read_back_s": _times(option.read_s),
        "pareto": best,
    }


def _answer(answer: FastestWithin) -> dict[str, Any]:
    """Return what a tolerance costs: the option with the least error of the fastest ones, if any keeps it."""
    option, ranking = answer.option, answer.ranking
    return {
        "tolerance_px": answer.tolerance_px,
        "configuration": option.label if option else None,
        "time_s": _times(option.time_s) if option else None,
        "ranked": ranking is not None and ranking.ranked,
        "fastest": [one.label for one in ranking.fastest] if ranking else [],
        "sentence": answer.sentence,
    }


def _times(times: Timing | None) -> dict[str, Any] | None:
    """Return the median, the ends, and the interval of the median, of repeated seconds."""
    if times is None:
        return None
    return {
        "median": times.median,
        "low": times.lowest,
        "high": times.highest,
        "interval": times.interval,
        "repetitions": times.repetitions,
    }


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
        options = tuple(_race(ways, tracers["embree"], repeat, progress=progress))
    opengl = {f"OpenGL {name}": value for name, value in device.items()}
    libraries = {key: value for one in tracers.values() for key, value in one.versions.items()}
    return CostReport(
        scene=scene,
        aperture=apertures[0],
        auto=auto,
        tolerance_px=tolerance_px,
        options=options,
        upload_s=watch.seconds,
        machine={**provenance.machine(), **opengl},
        versions={**provenance.versions(), **libraries},
    )


def _all_of(aperture: Aperture | AutoApertures) -> tuple[Aperture, ...]:
    return aperture.apertures if isinstance(aperture, AutoApertures) else (aperture,)


def _race(
    ways: Mapping[Aperture, list[Way]], reference: Reference, repeat: int, *, progress: bool
) -> Iterator[Option]:
    """Make the picture of each way in turn; the first picture of each is judged, and not timed.

    Pictures of all apertures are judged, the worst one counts, and those of the first aperture are timed.
    """
    timed = next(iter(ways.values()))
    errors = [(0.0, 0.0) for _ in timed]
    with progress_bar(len(timed) * (len(ways) + repeat), "cost", "picture", shown=progress) as bar:
        for number, (p99, wrong) in _errors(ways, reference):
            errors[number] = max(errors[number][0], p99), max(errors[number][1], wrong)
            bar.update()
        for _ in range(repeat):
            for way in timed:
                way.take_time()
                bar.update()
    for way, error in zip(timed, errors, strict=True):
        yield way.option(*error)


def _errors(
    ways: Mapping[Aperture, list[Way]], reference: Reference
) -> Iterator[tuple[int, tuple[float, float]]]:
    """Yield the number of each way with its error at an aperture; one is judged while the next is made."""

    def error(number: int, way: Way, truth: HogelImage, image: HogelImage) -> tuple[int, tuple[float, float]]:
        judged = compare_images(truth, image, reference, radiance=False)
        assert judged.surface is not None, "the reference has the scene at hand"
        p99 = displacement_p99(judged) if way.renderer == "raster" else 0.0
        return number, (p99, judged.surface.fraction)

    def tasks(pool: ThreadPoolExecutor) -> Iterator[Future[tuple[int, tuple[float, float]]]]:
        for aperture, those in ways.items():
            truth = reference.trace(aperture)
            for number, way in enumerate(those):
                yield pool.submit(error, number, way, truth, way.picture())

    most = images_under_way(math.prod(reference.scene.frustum.resolution))
    with ThreadPoolExecutor(worker_count(), thread_name_prefix="judging") as pool:
        yield from in_order(tasks(pool), most)
