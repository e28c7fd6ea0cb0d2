"""What a scene calls for, as text and as JSON."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from xfrustum.reports.common.formatting import digits
from xfrustum.reports.common.json_ready import json_object
from xfrustum.reports.common.provenance import SceneName
from xfrustum.reports.effects.costs import PROCEDURE, RENDERERS, Cost
from xfrustum.reports.effects.plan import EffectsPlan, Row
from xfrustum.scenes.appearance.sampling import Transport
from xfrustum.scenes.plate.double_frustum import Camera

Number = TypeVar("Number")


@dataclass(frozen=True, kw_only=True)
class ByRenderer(Generic[Number]):
    """One number for each renderer; None where it was not measured or means nothing."""

    raster: Number | None
    reference: Number | None


@dataclass(frozen=True, kw_only=True)
class EffectRecord:
    """One effect: whether it is used, why, and what it costs."""

    name: str
    used: bool
    reason: str
    cost_s: ByRenderer[float]
    spread_s: ByRenderer[float]
    interval_s: ByRenderer[tuple[float, float]]
    resolved: ByRenderer[bool]


@dataclass(frozen=True, kw_only=True)
class SlabRecord:
    """One slab: its camera, its heights, and the number of its triangles."""

    camera: Camera
    heights: tuple[float, float]
    triangles: int


@dataclass(frozen=True, kw_only=True)
class PassRecord:
    """One pass of the rasterizer; `draws` says what it draws."""

    camera: Camera
    heights: tuple[float, float]
    draws: str


@dataclass(frozen=True, kw_only=True)
class SamplesRecord:
    """Points per pixel, coverage samples, and points of the aperture."""

    pixel: int
    multisample: int
    aperture: int


@dataclass(frozen=True, kw_only=True)
class EffectsRecord:
    """The object that `explain --json` prints; see `EffectsPlan`."""

    scene: SceneName
    aperture: tuple[int, int]
    effects: tuple[EffectRecord, ...]
    cameras: tuple[Camera, ...]
    slabs: tuple[SlabRecord, ...]
    passes: tuple[PassRecord, ...]
    samples: SamplesRecord
    transport: Transport
    tracer: str
    image_s: ByRenderer[float]
    left_out_s: ByRenderer[float]
    left_out_interval_s: ByRenderer[tuple[float, float]]
    repeat: int
    procedure: str


def summary(plan: EffectsPlan) -> dict[str, Any]:
    """Return the plan as one JSON object."""
    sampling = plan.scene.sampling
    record = EffectsRecord(
        scene=SceneName.of(plan.scene),
        aperture=plan.aperture.index,
        effects=tuple(_effect(row) for row in plan.rows),
        cameras=tuple(dict.fromkeys(slab.camera for slab in plan.drawn)),
        slabs=tuple(
            SlabRecord(camera=slab.camera, heights=slab.heights, triangles=slab.triangles)
            for slab in plan.slabs
        ),
        passes=tuple(
            PassRecord(camera=camera, heights=heights, draws=kind) for camera, heights, kind in plan.passes
        ),
        samples=SamplesRecord(
            pixel=sampling.supersample**2, multisample=sampling.multisample, aperture=sampling.aperture
        ),
        transport=plan.scene.transport,
        tracer=plan.tracer,
        image_s=_by_renderer(plan.left_out, lambda cost: cost.without),
        left_out_s=_by_renderer(plan.left_out, lambda cost: cost.seconds),
        left_out_interval_s=_by_renderer(plan.left_out, lambda cost: cost.interval),
        repeat=plan.repeat,
        procedure=PROCEDURE,
    )
    return json_object(record)


def _effect(row: Row) -> EffectRecord:
    return EffectRecord(
        name=row.name,
        used=row.used,
        reason=row.reason,
        cost_s=_by_renderer(row.costs, lambda cost: cost.seconds),
        spread_s=_by_renderer(row.costs, lambda cost: cost.spread),
        interval_s=_by_renderer(row.costs, lambda cost: cost.interval),
        resolved=_by_renderer(row.costs, lambda cost: cost.resolved),
    )


def _by_renderer(costs: dict[str, Cost], number: Callable[[Cost], Number]) -> ByRenderer[Number]:
    raster, reference = (number(costs[name]) if name in costs else None for name in RENDERERS)
    return ByRenderer(raster=raster, reference=reference)


def table(plan: EffectsPlan) -> str:
    """Return the plan as text: the effects, then what is drawn, sampled and traced."""
    lines = [("effect", "", *(f"{name}" for name in RENDERERS), "because")]
    lines += [
        (
            row.name,
            "used" if row.used else "left out",
            *(_time(row.costs.get(r)) for r in RENDERERS),
            row.reason,
        )
        for row in plan.rows
    ]
    widths = [max(len(line[column]) for line in lines) for column in range(len(lines[0]))]
    rows = ("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in lines)
    return "\n".join((*(row.rstrip() for row in rows), "", *_sentences(plan)))


def _sentences(plan: EffectsPlan) -> Iterator[str]:
    units, sampling, transport = plan.scene.units, plan.scene.sampling, plan.scene.transport
    for slab in plan.slabs:
        low, high = (digits(height) for height in slab.heights)
        side = "behind" if slab.camera is Camera.C else "before"
        content = {0: "empty, skipped", 1: "1 triangle"}.get(slab.triangles, f"{slab.triangles:,} triangles")
        yield f"slab {low} to {high} {units} {side} the plate, camera {slab.camera}: {content}"
    kinds = [kind for *_, kind in plan.passes]
    yield f"passes: {kinds.count('surfaces')} of surfaces, {kinds.count('reflections')} of reflections"
    yield (
        f"samples: {sampling.supersample**2} a pixel, {sampling.multisample} of coverage, "
        f"{sampling.aperture} over the aperture"
    )
    asked = [name for name in ("shadows", "interreflection") if getattr(transport, name)]
    yield f"light transport: {' and '.join(asked) or 'none'}; tracer: {plan.tracer}"
    if plan.left_out:
        parts = (
            f"{name} {_duration(cost.without)}, all effects besides {_time(cost)}"
            for name, cost in plan.left_out.items()
        )
        yield f"one image: {'; '.join(parts)}"
        yield f"measured here: {plan.repeat} times {PROCEDURE}"
        yield "not told: the interval of the differences, in brackets, holds zero, or repetitions are too few"


def _time(cost: Cost | None) -> str:
    """Write a cost, or the interval of its repetitions where it cannot be told from nothing."""
    if cost is None:
        return "-"
    if not cost.resolved:
        low, high = cost.interval
        return f"not told ({_duration(low)} to {_duration(high)})"
    return _duration(cost.seconds)


def _duration(seconds: float) -> str:
    return f"{digits(seconds)} s" if abs(seconds) >= 1 else f"{digits(1e3 * seconds)} ms"
