"""What a scene calls for, as text and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from xfrustum.reports.common.formatting import digits
from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.effects.costs import PROCEDURE, RENDERERS, Cost
from xfrustum.reports.effects.plan import EffectsPlan
from xfrustum.scenes.plate.double_frustum import Camera


def summary(plan: EffectsPlan) -> dict[str, Any]:
    """Return the plan as one JSON object."""
    sampling, transport = plan.scene.sampling, plan.scene.transport
    ready: dict[str, Any] = json_ready(
        {
            "scene": {"name": plan.scene.name, "hash": plan.scene.content_hash},
            "aperture": plan.aperture.index,
            "effects": [
                {
                    "name": row.name,
                    "used": row.used,
                    "reason": row.reason,
                    "cost_s": _by_renderer(row.costs, "seconds"),
                    "spread_s": _by_renderer(row.costs, "spread"),
                    "interval_s": _by_renderer(row.costs, "interval"),
                    "resolved": _by_renderer(row.costs, "resolved"),
                }
                for row in plan.rows
            ],
            "cameras": list(dict.fromkeys(slab.camera for slab in plan.drawn)),
            "slabs": [
                {"camera": slab.camera, "heights": slab.heights, "triangles": slab.triangles}
                for slab in plan.slabs
            ],
            "passes": [
                {"camera": camera, "heights": heights, "draws": kind} for camera, heights, kind in plan.passes
            ],
            "samples": {
                "pixel": sampling.supersample**2,
                "multisample": sampling.multisample,
                "aperture": sampling.aperture,
            },
            "transport": transport,
            "tracer": plan.tracer,
            "image_s": _by_renderer(plan.left_out, "without"),
            "left_out_s": _by_renderer(plan.left_out, "seconds"),
            "left_out_interval_s": _by_renderer(plan.left_out, "interval"),
            "repeat": plan.repeat,
            "procedure": PROCEDURE,
        }
    )
    return ready


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


def _by_renderer(costs: dict[str, Cost], what: str) -> dict[str, Any]:
    return {name: getattr(costs[name], what) if name in costs else None for name in RENDERERS}


def _time(cost: Cost | None) -> str:
    """Write a cost; of one that cannot be told from nothing, the interval of its repetitions."""
    if cost is None:
        return "-"
    if not cost.resolved:
        low, high = cost.interval
        return f"not told ({_duration(low)} to {_duration(high)})"
    return _duration(cost.seconds)


def _duration(seconds: float) -> str:
    return f"{digits(seconds)} s" if abs(seconds) >= 1 else f"{digits(1e3 * seconds)} ms"
