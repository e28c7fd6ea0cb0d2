"""What a scene calls for, as text and as JSON."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from xfrustum.reports.common.formatting import digits, percent
from xfrustum.reports.common.json_ready import json_object
from xfrustum.reports.common.provenance import SceneName
from xfrustum.reports.effects.cost_record import PROCEDURE, RENDERERS, Cost
from xfrustum.reports.effects.depths import EXAMPLE_SUB_APERTURES, DepthRow, Depths
from xfrustum.reports.effects.plan import EffectsPlan, Row
from xfrustum.scenes.appearance.sampling import Transport
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.plate.double_frustum import Camera

Number = TypeVar("Number")


@dataclass(frozen=True, kw_only=True)
class ByRenderer(Generic[Number]):
    """One number for each renderer; None where it was not measured or means nothing."""

    raster: Number | None
    reference: Number | None


@dataclass(frozen=True, kw_only=True)
class EffectRecord:
    """One effect: whether it is used, why, for which objects, and what it costs."""

    name: str
    used: bool
    reason: str
    objects: tuple[int, ...]
    out_of_sight: tuple[int, ...]
    cost_s: ByRenderer[float]
    spread_s: ByRenderer[float]
    interval_s: ByRenderer[tuple[float, float]]
    resolved: ByRenderer[bool]


@dataclass(frozen=True, kw_only=True)
class ObjectRecord:
    """One object: its name, its heights, and the effects that it calls for; none if it is out of sight."""

    number: int
    name: str
    heights: tuple[float, float]
    in_sight: bool
    effects: tuple[str, ...]


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
    objects: tuple[ObjectRecord, ...]
    depths: Depths
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
        objects=tuple(_objects(plan)),
        depths=plan.depths,
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
        objects=row.objects,
        out_of_sight=row.out_of_sight,
        cost_s=_by_renderer(row.costs, lambda cost: cost.seconds),
        spread_s=_by_renderer(row.costs, lambda cost: cost.spread),
        interval_s=_by_renderer(row.costs, lambda cost: cost.interval),
        resolved=_by_renderer(row.costs, lambda cost: cost.resolved),
    )


def _objects(plan: EffectsPlan) -> Iterator[ObjectRecord]:
    """Yield each object with the local effects that it calls for."""
    cameras = (Effect.C, Effect.C_STAR)
    for number, part in enumerate(plan.scene.objects):
        z = part.vertices[:, 2]
        rows = [row for row in plan.rows if number in row.objects]
        yield ObjectRecord(
            number=number,
            name=part.name,
            heights=(float(z.min()), float(z.max())),
            in_sight=any(row.name in cameras for row in rows),
            effects=tuple(row.name for row in rows if row.used and row.name not in cameras),
        )


def _by_renderer(costs: dict[str, Cost], number: Callable[[Cost], Number]) -> ByRenderer[Number]:
    raster, reference = (number(costs[name]) if name in costs else None for name in RENDERERS)
    return ByRenderer(raster=raster, reference=reference)


def table(plan: EffectsPlan) -> str:
    """Return the plan as text: the effects, then what is drawn, sampled and traced."""
    measured = RENDERERS if plan.repeat else ()
    lines = [("effect", "", *measured, "because")]
    lines += [
        (
            row.name,
            "used" if row.used else "left out",
            *(_time(row.costs.get(r)) for r in measured),
            _because(row),
        )
        for row in plan.rows
    ]
    parts = (_columns(lines), [""], _by_object(plan), [""], _by_depth(plan), [""], _sentences(plan))
    return "\n".join(line for part in parts for line in part)


def _because(row: Row) -> str:
    """Return the reason of a row, and where the text says what an effect that is left out would change."""
    left_out = row.name == "band-limiting" and not row.used
    return f"{row.reason}; what it would change is said below" if left_out else row.reason


def _columns(lines: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield lines of cells, each column as wide as its longest cell."""
    widths = [max(len(line[column]) for line in lines) for column in range(len(lines[0]))]
    for line in lines:
        yield "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()


def _by_object(plan: EffectsPlan) -> Iterator[str]:
    """Yield which object calls for which effects, and where it lies."""
    for one in _objects(plan):
        low, high = (digits(height) for height in one.heights)
        called = ", ".join(one.effects) or "no effect"
        if not one.in_sight:
            called = "out of sight: beyond the reach or beside the frustum"
        yield f"object {one.number}, {one.name}, heights {low} to {high} {plan.scene.units}: {called}"


def _by_depth(plan: EffectsPlan) -> Iterator[str]:
    """Yield the content of the frustum by depth, and what bounds its errors."""
    found, units = plan.depths, plan.scene.units
    aperture = f"{plan.aperture.column},{plan.aperture.row}"
    listed = ", ".join(map(digits, found.cuts))
    cuts = f"cut at {listed} {units}" if found.cuts else "without cuts"
    yield (
        f"depth of what lies in the frustum of aperture {aperture}, "
        f"hidden surfaces included; near {digits(found.near)} {units}, {cuts}, {plan.settings.depth_label}:"
    )
    lines: list[tuple[str, ...]] = [
        (f"|z| ({units})", "surface", "near offset", "shear", "separation", "blur", "sub-apertures")
    ]
    lines += [_depth_cells(row, units) for row in found.rows]
    yield from _columns(lines)
    beyond = "; neither moves what lies beyond the first cut" if found.cuts else ""
    yield (
        "near offset: displacement of the nearest content in the film's corner; shear: more by pivot "
        f"camera{beyond}"
    )
    yield "separation: what the depth buffer orders at the farthest content; blur: by the area of the hogel"
    if found.largest_near is None:
        answer = f"no near keeps content that touches the plate within {digits(found.tolerance_px)} px"
    else:
        answer = (
            f"a near of {digits(found.largest_near)} {units} keeps everything within "
            f"{digits(found.tolerance_px)} px"
        )
    yield (
        f"for aperture {aperture} alone, hidden surfaces included: {answer}; "
        "for the plate ask `xfrustum plan`"
    )
    yield _band_limiting(found, plan.scene.sampling.aperture)


def _blur(least: float | None, largest: float | None) -> str:
    if least is None:
        return "without end"
    return f"{digits(least)} px or more" if largest is None else f"{digits(least)} to {digits(largest)} px"


def _depth_cells(row: DepthRow, units: str) -> tuple[str, ...]:
    least, largest = row.blur_px
    return (
        f"{digits(row.nearest)} to {digits(row.farthest)} {row.side}",
        percent(row.share),
        f"{digits(row.near_px)} px",
        f"{digits(row.shear_px)} px",
        f"{digits(row.separation)} {units}",
        _blur(least, largest),
        "over 65,536" if row.sub_apertures is None else f"{row.sub_apertures:,}",
    )


def _band_limiting(found: Depths, used: int) -> str:
    """Say how far off edges may be without band limiting, and with how many sub-apertures how much less.

    Parameters
    ----------
    found
        Content by depth, with the bounds.
    used
        Number of sub-apertures that are asked for.
    """
    if found.sub_apertures == 1:
        return "band limiting: not needed; the area of the hogel changes no pixel by a level of 8 bits"
    without, *others = found.band_errors
    now = "not used" if used == 1 else f"{used:,} sub-apertures are used"
    most = max(EXAMPLE_SUB_APERTURES) + 1 if found.sub_apertures is None else found.sub_apertures
    parts = [
        f"{one.sub_apertures:,} sub-apertures: up to {digits(one.levels)} levels"
        for one in others
        if one.sub_apertures < most
    ]
    enough = "more than 65,536" if found.sub_apertures is None else f"{found.sub_apertures:,}"
    return (
        f"band limiting: {now}; without it edges may be off by up to {digits(without.levels)} levels of "
        f"8 bits (at the worst pixel of an edge of contrast {digits(found.contrast)}); "
        f"{''.join(f'{part}; ' for part in parts)}"
        f"{enough} keep it under one level (--aperture-samples auto)"
    )


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
