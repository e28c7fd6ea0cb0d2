"""Measurements as rows: Parquet for tools, JSON for everything else."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from xfrustum.compare.metrics.paired import CONFIDENCE
from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.common.raster_command import raster_command
from xfrustum.reports.measurements.best import Verdict, best_per_depth, best_setting, sentence
from xfrustum.reports.measurements.measurement import Measurement, Sweep
from xfrustum.reports.trade_off import trade_off
from xfrustum.scenes.model.scene import Scene

# What `compare --json` may set to null as a whole still fills its columns.
_SPREAD = ("rms", "p50", "p95", "p99", "max")
_GROUPS = {
    "surface": ("wrong", "fraction"),
    "triangle": ("wrong", "fraction"),
    "displacement_px": _SPREAD,
    "height": ("rms", "max"),
}


def report_object(sweep: Sweep) -> dict[str, Any]:
    """Return the content of report.json: one object without NaN or infinity."""
    reach = sweep.scene.frustum.longest_reach
    options = trade_off.options_of(sweep)
    report = {
        "scene": _scene_object(sweep.scene),
        "apertures": sweep.apertures,
        "best": {
            "sentence": sentence(sweep.rows, sweep.scene.units, reach),
            **_verdict_object(best_setting(sweep.rows), reach),
            "command": recommended_command(sweep),
            "confidence": CONFIDENCE,
        },
        "best_per_depth": [_verdict_object(verdict, reach) for verdict in best_per_depth(sweep.rows)],
        "rows": [_row_object(row, reach) for row in sweep.rows],
        "versions": sweep.versions,
        "devices": sweep.devices,
        "times_s": sweep.times_s,
        "parts_s": sweep.parts_s,
        "cost": sweep.cost,
        "trade_off": trade_off.summary(options, recommended=trade_off.recommended_of(sweep, options)),
    }
    ready: dict[str, Any] = json_ready(report)
    return ready


def flat_rows(sweep: Sweep) -> list[dict[str, Any]]:
    """Return one flat mapping per aperture and setting, all with the same keys."""
    common: dict[str, Any] = {
        "scene_name": sweep.scene.name,
        "scene_source": sweep.scene.source,
        "scene_hash": sweep.scene.content_hash,
        "units": sweep.scene.units,
    }
    common |= {f"version_{_column(name)}": value for name, value in sweep.versions.items()}
    common |= {f"device_{_column(name)}": value for name, value in sweep.devices.items()}
    reach = sweep.scene.frustum.longest_reach
    rows = [_flat_row(row, reach) | common for row in sweep.rows]
    columns = dict.fromkeys(key for row in rows for key in row)
    return [{key: row.get(key) for key in columns} for row in rows]


def write_parquet(sweep: Sweep, path: Path) -> None:
    """Write one row per aperture and setting; see `flat_rows` for the columns."""
    pq.write_table(pa.Table.from_pylist(flat_rows(sweep)), path)


def _flat_row(row: Measurement, reach: float) -> dict[str, Any]:
    flat: dict[str, Any] = {
        "aperture_column": row.aperture.column,
        "aperture_row": row.aperture.row,
        "aperture_x": row.aperture.x,
        "aperture_y": row.aperture.y,
        **asdict(row.settings),
        "near_per_reach": row.settings.near / reach,
    }
    for key, value in row.comparison.items():
        flat |= _flatten(key, value, _GROUPS.get(key, ()))
    for key, value in _predicted_object(row).items():
        flat |= _flatten(key, json_ready(value), _GROUPS.get(key.removeprefix("predicted_"), ()))
    flat |= {f"time_{_column(name)}_s": seconds for name, seconds in row.times_s.items()}
    flat |= {
        f"time_{_column(stage)}_{_column(part)}_s": seconds
        for stage, parts in row.parts_s.items()
        for part, seconds in parts.items()
    }
    ready: dict[str, Any] = json_ready(flat)
    return ready


def _flatten(key: str, value: Any, group: Sequence[str]) -> dict[str, Any]:
    if isinstance(value, Mapping):
        # What is nested in a group fills columns of its own.
        parts = [_flatten(f"{key}_{name}", item, ()) for name, item in value.items()]
        return {name: item for part in parts for name, item in part.items()}
    if group:
        return {f"{key}_{name}": None for name in group}
    return {key: value}


def _row_object(row: Measurement, reach: float) -> dict[str, Any]:
    return {
        "aperture": row.aperture.index,
        "settings": row.settings,
        "near_per_reach": row.settings.near / reach,
        "comparison": row.comparison,
        **_predicted_object(row),
        "times_s": row.times_s,
        "parts_s": row.parts_s,
    }


def _predicted_object(row: Measurement) -> dict[str, Any]:
    predicted = row.predicted
    return {
        "predicted_displacement_px": predicted.displacement_px,
        "predicted_surface": {
            "fraction": predicted.surface_fraction,
            "silhouettes": predicted.silhouettes,
            "snapped": predicted.snapped,
            "depth": predicted.depth,
        },
        "smallest_separation": predicted.separation,
        "measured_over_predicted": row.measured_over_predicted,
    }


def _verdict_object(verdict: Verdict, reach: float) -> dict[str, Any]:
    return {
        **asdict(verdict.settings),
        "near_per_reach": verdict.settings.near / reach,
        "surface_fraction": verdict.surface_fraction,
        "displacement_p99_px": verdict.displacement_p99_px,
        "radiance_fraction": verdict.radiance_fraction,
        "window": verdict.window,
    }


def recommended_command(sweep: Sweep) -> str:
    """Return the command that draws as a sweep recommends."""
    return raster_command(sweep.scene, sweep.scene.plate.middle, best_setting(sweep.rows).settings)


def _scene_object(scene: Scene) -> dict[str, Any]:
    return {
        "name": scene.name,
        "source": scene.source,
        "hash": scene.content_hash,
        "units": scene.units,
        "objects": len(scene.objects),
        "triangles": len(scene.faces),
        "plate": scene.plate,
        "frustum": scene.frustum,
    }


def _column(name: str) -> str:
    return re.sub(r"\W+", "_", name.lower())
