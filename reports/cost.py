"""`xfrustum cost`: what accuracy costs in time, of every configuration, on one scene and machine."""

from __future__ import annotations

import math
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from xfrustum.compare import compare_images
from xfrustum.raster import Rasterizer
from xfrustum.reference import TRACERS, Reference
from xfrustum.reports import provenance
from xfrustum.reports.cost_ways import Contestant, drawn, traced
from xfrustum.reports.progress import progress_bar
from xfrustum.reports.tables import json_ready
from xfrustum.reports.timing import Spread, Stopwatch
from xfrustum.reports.trade_off import Answer, Option, answers, summary
from xfrustum.scenes.arguments import real, whole
from xfrustum.scenes.effects import ALL_EFFECTS, needed
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.plate import Aperture
from xfrustum.scenes.scene import Scene

REPEAT = 5


@dataclass(frozen=True, kw_only=True)
class CostReport:
    """Every option measured on a scene.

    Attributes
    ----------
    scene, aperture, tolerance_px
        What was asked.
    options
        Raster, tracers and truth.
    upload_s
        By renderer: what is done once for a scene, buffers, programs and acceleration structures.
    machine, versions
        Names and values, for whoever repeats it.
    """

    scene: Scene
    aperture: Aperture
    tolerance_px: float
    options: tuple[Option, ...]
    upload_s: dict[str, float]
    machine: dict[str, str]
    versions: dict[str, str]

    @property
    def answers(self) -> tuple[Answer, ...]:
        """The cheapest options within the tolerance and within a fifth of it."""
        return answers(self.options, self.tolerance_px)

    def summary(self) -> dict[str, Any]:
        """Return everything as one JSON object."""
        ready: dict[str, Any] = json_ready(
            {
                "scene": {"name": self.scene.name, "hash": self.scene.content_hash},
                "aperture": self.aperture.index,
                **summary(self.options, self.tolerance_px),
                "upload_s": self.upload_s,
                "machine": self.machine,
                "versions": self.versions,
            }
        )
        return ready


def measure_cost(
    scene: Scene,
    aperture: Aperture | None = None,
    tolerance_px: float = 0.5,
    *,
    repeat: int = REPEAT,
    progress: bool = False,
) -> CostReport:
    """Measure error and time of every configuration.

    Parameters
    ----------
    aperture
        The middle one where None.
    tolerance_px
        Of the 99th percentile of displacement; a fifth of it is answered for too.
    repeat
        Measured pictures of each configuration, after one that warms up. All configurations take turns,
        so that a slow minute is everybody's.

    Raises
    ------
    InputError
        The tolerance or the number of repetitions is not positive, or there is no usable OpenGL.
    """
    if not 0 < real(tolerance_px) < math.inf or whole(repeat) < 1:
        raise InputError(f"cost: tolerance {tolerance_px} and repetitions {repeat} must be positive")
    aperture = scene.plate.middle if aperture is None else aperture
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
        contestants = [
            *drawn(scene, aperture, drawers),
            *traced(aperture, tracers),
        ]
        options = _race(contestants, tracers["embree"], aperture, repeat, progress)
    opengl = {f"OpenGL {name}": value for name, value in device.items()}
    libraries = {key: value for one in tracers.values() for key, value in one.versions.items()}
    return CostReport(
        scene=scene,
        aperture=aperture,
        tolerance_px=tolerance_px,
        options=tuple(options),
        upload_s=watch.seconds,
        machine={**provenance.machine(), **opengl},
        versions={**provenance.versions(), **libraries},
    )


def _race(
    contestants: list[Contestant], reference: Reference, aperture: Aperture, repeat: int, progress: bool
) -> list[Option]:
    """Let each make its picture in turn; the first is judged, and not timed."""
    truth = reference.trace(aperture)
    errors: list[tuple[float, float]] = []
    taken: list[dict[str, list[float]]] = [{"time_s": [], "gpu_s": [], "read_s": []} for _ in contestants]
    with progress_bar(len(contestants) * (1 + repeat), "cost", "picture", shown=progress) as bar:
        for one in contestants:
            judged = compare_images(truth, one.picture(), reference, radiance=False)
            moved, wrong = judged.displacement_px, judged.surface_wrong or 0
            errors.append((moved.p99 if moved else 0.0, wrong / max(judged.judged, 1)))
            bar.update()
        for _ in range(repeat):
            for one, times in zip(contestants, taken, strict=True):
                watch = Stopwatch()
                with watch.stage("picture"):
                    one.picture()
                times["time_s"].append(watch.seconds["picture"])
                if one.rasterizer is not None:
                    stages = one.rasterizer.times
                    times["gpu_s"].append(stages["draw"].gpu_s)
                    times["read_s"].append(stages["read"].wall_s)
                bar.update()
    return [
        Option(
            renderer=one.renderer,
            label=one.label,
            configuration=one.configuration,
            displacement_p99_px=p99 if one.renderer == "raster" else 0.0,
            surface_fraction=wrong,
            **{name: Spread.of(values) for name, values in times.items() if values},
        )
        for one, (p99, wrong), times in zip(contestants, errors, taken, strict=True)
    ]
