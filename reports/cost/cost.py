"""`xfrustum cost`: what accuracy costs in time, of every configuration, on one scene and machine."""

import math
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from xfrustum.compare.beyond import displacement_p99
from xfrustum.compare.extent import require_seen
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.compare.run import images_under_way, in_order
from xfrustum.compare.scout import AutoApertures
from xfrustum.raster import Drawn, Rasterizer
from xfrustum.reference import TRACERS, Reference
from xfrustum.reference.llvm import worker_count
from xfrustum.reports.common import provenance
from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.timing import Timing
from xfrustum.reports.cost.trade_off import FastestWithin, Option, answers, pareto
from xfrustum.reports.scout import choices
from xfrustum.scenes.arguments import real, whole
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect, needed
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook import Shown, Table, digits, percent
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum, Offset
from xfrustum.scenes.plate.plate import Aperture
from xfrustum.tolerances import TOLERANCE_PX

REPEAT = 5
"""Measured pictures of each configuration unless told otherwise: the fewest by which times are told apart."""

NEARS_PER_REACH = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 1e-4, 1e-5, 1e-6)
DEPTHS = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D32F, DepthMapping.STANDARD),
    (DepthFormat.D32F, DepthMapping.REVERSED),
    (DepthFormat.D24, DepthMapping.LOGARITHMIC),
    (DepthFormat.D24, DepthMapping.LINEAR),
)
CUTS_PER_REACH = ((0.1,), (0.03, 0.2), (0.01, 0.05, 0.25))
"""Heights of one, two and three cuts in about geometric progression, as planners place them; see
docs/method.md, "Splitting"."""
NEARS_PER_CUT = (1e-1, 1e-2)
NEARS_WITHOUT_OFFSET_PER_REACH = (1e-2, 1e-3, 1e-4, 1e-5)
"""Near planes of cameras that stay in the aperture, over the shorter reach: they displace nothing, and
leave a gap of near on both sides of the plate. Their depth buffer is D32F reversed, which needs no
large near."""
USUAL_NEAR_PER_REACH = 1e-3
"""Near plane at which samples and effects are measured: their cost does not depend on it."""


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

        def times(one: Timing | None) -> dict[str, Any] | None:
            """Return the median, the ends, and the interval of the median, of repeated seconds."""
            if one is None:
                return None
            ends = {"median": one.median, "low": one.lowest, "high": one.highest}
            return {**ends, "interval": one.interval, "repetitions": one.repetitions}

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
                        "time_s": times(one.time_s),
                        "gpu_s": times(one.gpu_s),
                        "read_back_s": times(one.read_s),
                        "pareto": best,
                    }
                    for one, best in zip(self.options, pareto(self.options), strict=True)
                ],
                "answers": [
                    {
                        "tolerance_px": one.tolerance_px,
                        # The option with the least error of the fastest ones, if any keeps the tolerance.
                        "configuration": one.option.label if one.option else None,
                        "time_s": times(one.option.time_s) if one.option else None,
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


def measure_cost(
    scene: Scene,
    aperture: Aperture | AutoApertures | None = None,
    tolerance_px: float = TOLERANCE_PX,
    *,
    repeat: int = REPEAT,
    progress: bool = False,
) -> CostReport:
    """Measure error and time of every configuration.

    The picture is that of one aperture, the middle one where None. Of the ones that `auto_apertures` chooses
    the first is timed; pictures are judged at each, and the worst counts. A fifth of the tolerance of the
    99th percentile of displacement is answered for too. Of each configuration `repeat` pictures are timed,
    after one that warms up. All take turns, so that a slow minute slows all of them down.

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
        ways = {one: [*_drawn(scene, one, drawers), *_traced(one, tracers)] for one in apertures}
        # All are judged by their first picture, which is not timed; those of the first aperture are timed.
        timed = ways[apertures[0]]
        errors = [(0.0, 0.0) for _ in timed]
        with progress_bar(len(timed) * (len(ways) + repeat), "cost", "picture", shown=progress) as bar:
            for number, (p99, wrong) in _errors(ways, tracers["embree"]):
                errors[number] = max(errors[number][0], p99), max(errors[number][1], wrong)
                bar.update()
            seconds: list[dict[str, list[float]]] = [defaultdict(list) for _ in timed]
            for _ in range(repeat):
                for way, taken in zip(timed, seconds, strict=True):
                    begun = time.perf_counter()
                    made = way.make()
                    taken["time_s"].append(time.perf_counter() - begun)
                    if isinstance(made, Drawn):
                        taken["gpu_s"].append(made.times["draw"].gpu_s)
                        taken["read_s"].append(made.times["read"].wall_s)
                    bar.update()
    options = [
        Option(
            renderer=way.renderer,
            label=way.label,
            family=way.family,
            configuration={"family": way.family, **way.configuration},
            displacement_p99_px=p99,
            surface_fraction=wrong,
            **{name: Timing.of(values) for name, values in taken.items()},
        )
        for way, (p99, wrong), taken in zip(timed, errors, seconds, strict=True)
    ]
    libraries = {key: value for one in tracers.values() for key, value in one.versions.items()}
    return CostReport(
        scene=scene,
        aperture=apertures[0],
        auto=chosen if isinstance(chosen, AutoApertures) else None,
        tolerance_px=tolerance_px,
        options=tuple(options),
        upload_s=upload_s,
        machine={**provenance.machine(), **{f"OpenGL {name}": value for name, value in device.items()}},
        versions={**provenance.versions(), **libraries},
    )


cost = measure_cost
"""The name of `measure_cost` in the public API, beside the other commands."""


_Error = tuple[int, tuple[float, float]]
"""Number of a way, its 99th percentile of displacement, pixels, and its share of wrong surfaces."""


@dataclass(frozen=True, kw_only=True)
class _Way:
    """One way to make a picture; see `Option`."""

    renderer: str
    label: str
    family: str
    make: Callable[[], HogelImage | Drawn]
    configuration: Mapping[str, Any] = field(default_factory=dict)


def _errors(ways: Mapping[Aperture, list[_Way]], reference: Reference) -> Iterator[_Error]:
    """Yield the number of each way with its error at an aperture; one is judged while the next is made."""

    def error(number: int, way: _Way, truth: HogelImage, image: HogelImage) -> _Error:
        judged = compare_images(truth, image, reference, radiance=False)
        assert judged.surface is not None, "the reference has the scene at hand"
        p99 = displacement_p99(judged) if way.renderer == "raster" else 0.0
        return number, (p99, judged.surface.fraction)

    def tasks(pool: ThreadPoolExecutor) -> Iterator[Future[_Error]]:
        for aperture, those in ways.items():
            truth = reference.trace(aperture)
            for number, way in enumerate(those):
                made = way.make()
                image = made.image if isinstance(made, Drawn) else made
                yield pool.submit(error, number, way, truth, image)

    most = images_under_way(math.prod(reference.scene.frustum.resolution))
    with ThreadPoolExecutor(worker_count(), thread_name_prefix="judging") as pool:
        yield from in_order(tasks(pool), most)


def _drawn(scene: Scene, aperture: Aperture, drawers: dict[str, Rasterizer]) -> Iterator[_Way]:
    """Yield nears with depth buffers and mappings, slabs, cameras without an offset, samples, effects."""
    reach, units = scene.frustum.longest_reach, scene.units

    def way(
        settings: DoubleFrustum, family: str | None = None, samples: int = 1, effects: str = "auto"
    ) -> _Way:
        drawer = drawers[effects]
        label = (
            f"raster, near {digits(settings.near)} {units} ({digits(settings.near / reach)} of the reach) "
            f"with {settings.depth_label} depth"
        )
        if settings.slabs:
            label += f" and cuts at {', '.join(digits(cut) for cut in settings.slabs)}"
        if settings.offset is Offset.NONE:
            label += " and no offset, which leaves a gap at the plate"
        if samples > 1:
            label += f", {samples} aperture samples"
        if effects == "all":
            label += ", all effects"
        names = ("near", "depth", "mapping", "slabs", "offset")
        sampling = replace(scene.sampling, aperture=samples)
        return _Way(
            renderer="raster",
            label=label,
            family=family or settings.depth_label,
            configuration={
                **{name: getattr(settings, name) for name in names},
                "aperture_samples": samples,
                "effects": sorted(drawer.effects_for(settings), key=list(Effect).index),
            },
            make=partial(drawer.draw, aperture, settings, normals=False, sampling=sampling),
        )

    for depth, mapping in DEPTHS:
        for share in NEARS_PER_REACH:
            yield way(DoubleFrustum(near=share * reach, depth=depth, mapping=mapping))
    for cuts in CUTS_PER_REACH:
        for share in NEARS_PER_CUT:
            slabs = tuple(cut * reach for cut in cuts)
            yield way(DoubleFrustum(near=share * slabs[0], slabs=slabs), f"{len(cuts) + 1} slabs")
    usual = DoubleFrustum(near=USUAL_NEAR_PER_REACH * reach)
    stays = replace(usual, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED, offset=Offset.NONE)
    for share in NEARS_WITHOUT_OFFSET_PER_REACH:
        yield way(replace(stays, near=share * min(scene.frustum.reach)), "no offset")
    samples = scene.sampling.aperture
    for count in sorted({2, samples} if samples > 1 else ()):
        yield way(usual, "aperture samples", count)
    if "all" in drawers:
        yield way(usual, "all effects", effects="all")


def _traced(aperture: Aperture, tracers: Mapping[str, Reference]) -> Iterator[_Way]:
    """Yield each tracer alone, and the certified truth."""
    for name, reference in tracers.items():
        label = f"{name} alone, float32, nothing proven"
        yield _Way(renderer=name, label=label, family=name, make=partial(reference.propose, aperture))
    yield _Way(
        renderer="certified",
        label="the certified truth",
        family="certified truth",
        configuration={"certified": True},
        make=partial(tracers["embree"].trace, aperture),
    )
