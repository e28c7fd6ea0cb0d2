"""`xfrustum cost`: what accuracy costs in time, of every configuration, on one scene and machine."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from xfrustum.compare.beyond import displacement_p99
from xfrustum.compare.extent import require_seen
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.compare.run import images_under_way, in_order
from xfrustum.compare.scout import AutoApertures
from xfrustum.raster import Rasterizer
from xfrustum.reference import TRACERS, Reference
from xfrustum.reference.llvm import worker_count
from xfrustum.reports.common import provenance
from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.timing import Timing
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

Error = tuple[float, float]
"""99th percentile of displacement, pixels, and share of wrong surfaces."""


@dataclass(frozen=True, kw_only=True, repr=False)
class CostReport(Shown):
    """Every option measured on a scene."""

    scene: Scene
    aperture: Aperture
    #: Apertures at all of which pictures are judged, the worst of which counts; None where it is the one.
    auto: AutoApertures | None
    tolerance_px: float
    options: tuple[Option, ...]
    #: By renderer: seconds of what is done once for a scene, buffers, programs and acceleration structures.
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
        rows = [
            (
                one.label,
                digits(1e3 * one.time_s.median),
                digits(one.displacement_p99_px),
                percent(one.surface_fraction),
            )
            for one in sorted(self.options, key=lambda one: one.time_s.median)
        ]
        head = ("configuration", "time, ms", "displacement 99 %, px", "wrong surfaces")
        return (Table(head=head, rows=rows, numbers=True),)

    def summary(self) -> dict[str, Any]:
        """Return everything as one JSON object."""
        content: dict[str, Any] = json_ready(
            {
                "scene": {"name": self.scene.name, "hash": self.scene.content_hash},
                "aperture": self.aperture.index,
                "apertures": choices(self.auto),
                "rows": [
                    {
                        "renderer": one.renderer,
                        "label": one.label,
                        **one.configuration,
                        "error": {
                            "displacement_p99_px": one.displacement_p99_px,
                            "surface_fraction": one.surface_fraction,
                        },
                        "time_s": _times(one.time_s),
                        "gpu_s": _times(one.gpu_s),
                        "read_back_s": _times(one.read_s),
                        "pareto": best,
                    }
                    for one, best in zip(self.options, pareto(self.options), strict=True)
                ],
                "answers": [
                    {
                        "tolerance_px": one.tolerance_px,
                        # The option with the least error of the fastest ones, if any keeps the tolerance.
                        "configuration": one.option.label if one.option else None,
                        "time_s": _times(one.option.time_s) if one.option else None,
                        "ranked": one.ranked,
                        "fastest": [tied.label for tied in one.fastest],
                        "sentence": one.sentence,
                    }
                    for one in self.answers
                ],
                "upload_s": self.upload_s,
                "machine": self.machine,
                "versions": self.versions,
            }
        )
        return content


def _times(times: Timing | None) -> dict[str, Any] | None:
    """Return the median, the ends, and the interval of the median, of repeated seconds."""
    if times is None:
        return None
    ends = {"median": times.median, "low": times.lowest, "high": times.highest}
    return {**ends, "interval": times.interval, "repetitions": times.repetitions}


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
    chosen = scene.plate.middle if aperture is None else aperture
    apertures = chosen.apertures if isinstance(chosen, AutoApertures) else (chosen,)
    require_seen(scene, apertures)
    upload_s: dict[str, float] = {}
    with ExitStack() as stack:
        begun = time.perf_counter()
        drawers = {"auto": stack.enter_context(Rasterizer(scene))}
        upload_s["raster"] = time.perf_counter() - begun
        if needed(scene) != ALL_EFFECTS:
            drawers["all"] = stack.enter_context(Rasterizer(scene, effects=ALL_EFFECTS))
        tracers = {name: Reference(scene, tracer=name) for name in TRACERS}
        for name, reference in tracers.items():
            begun = time.perf_counter()
            reference.tracer  # noqa: B018 - built when first asked for
            upload_s[name] = time.perf_counter() - begun
        device = drawers["auto"].device
        ways = {one: [*drawn(scene, one, drawers), *traced(one, tracers)] for one in apertures}
        # All are judged by their first picture, which is not timed; those of the first aperture are timed.
        timed = ways[apertures[0]]
        errors = [(0.0, 0.0) for _ in timed]
        with progress_bar(len(timed) * (len(ways) + repeat), "cost", "picture", shown=progress) as bar:
            for number, (p99, wrong) in _errors(ways, tracers["embree"]):
                errors[number] = max(errors[number][0], p99), max(errors[number][1], wrong)
                bar.update()
            for _ in range(repeat):
                for way in timed:
                    way.take_time()
                    bar.update()
    libraries = {key: value for one in tracers.values() for key, value in one.versions.items()}
    return CostReport(
        scene=scene,
        aperture=apertures[0],
        auto=chosen if isinstance(chosen, AutoApertures) else None,
        tolerance_px=tolerance_px,
        options=tuple(way.option(*error) for way, error in zip(timed, errors, strict=True)),
        upload_s=upload_s,
        machine={**provenance.machine(), **{f"OpenGL {name}": value for name, value in device.items()}},
        versions={**provenance.versions(), **libraries},
    )


cost = measure_cost
"""The name of `measure_cost` in the public API, beside the other commands."""


def _errors(ways: Mapping[Aperture, list[Way]], reference: Reference) -> Iterator[tuple[int, Error]]:
    """Yield the number of each way with its error at an aperture; one is judged while the next is made."""

    def error(number: int, way: Way, truth: HogelImage, image: HogelImage) -> tuple[int, Error]:
        judged = compare_images(truth, image, reference, radiance=False)
        assert judged.surface is not None, "the reference has the scene at hand"
        p99 = displacement_p99(judged) if way.renderer == "raster" else 0.0
        return number, (p99, judged.surface.fraction)

    def tasks(pool: ThreadPoolExecutor) -> Iterator[Future[tuple[int, Error]]]:
        for aperture, those in ways.items():
            truth = reference.trace(aperture)
            for number, way in enumerate(those):
                yield pool.submit(error, number, way, truth, way.picture())

    most = images_under_way(math.prod(reference.scene.frustum.resolution))
    with ThreadPoolExecutor(worker_count(), thread_name_prefix="judging") as pool:
        yield from in_order(tasks(pool), most)
