"""What a report says in words, report.json, and measurements.parquet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from xfrustum.compare import Spread
from xfrustum.compare.attribution.budget import CauseNumbers, ShearNumbers
from xfrustum.compare.metrics.comparison import ComparisonNumbers
from xfrustum.compare.metrics.paired import CONFIDENCE
from xfrustum.compare.prediction.chain import links_of
from xfrustum.compare.prediction.predict import Separations
from xfrustum.compare.run import StageTimes
from xfrustum.reference.plain import CERTIFIED
from xfrustum.reports.common.json_ready import INLINED, json_object, json_ready
from xfrustum.reports.common.raster_command import plan_command, raster_command, unexamined_truth
from xfrustum.reports.common.records import named_columns, table_of
from xfrustum.reports.error_report.best import (
    Recommendation,
    best_per_depth,
    best_per_geometry,
    sentence,
)
from xfrustum.reports.error_report.light import LightReport
from xfrustum.reports.error_report.measurement import Measurement, Ratios, StageParts
from xfrustum.reports.error_report.sweep import LEFT_OUT, Sweep
from xfrustum.reports.scout import ScoutRecord
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture


@dataclass(frozen=True, kw_only=True)
class PredictedSurface:
    """The predicted share of wrong surfaces, and its parts; see `Prediction`."""

    fraction: float
    silhouettes: float
    snapped: float
    depth: float
    outside: float
    culled: float = 0.0


@dataclass(frozen=True, kw_only=True)
class RowNumbers:
    """Settings and numbers of one row: what a row of report.json and one of measurements.parquet share."""

    settings: DoubleFrustum = field(metadata=named_columns("{}"))
    near_per_reach: float
    comparison: ComparisonNumbers = field(metadata=named_columns("{}"))
    unexplained: int | None
    shear: ShearNumbers | None
    predicted_displacement_px: Spread | None
    predicted_surface: PredictedSurface | None
    smallest_separation: Separations | None
    measured_over_predicted: Ratios
    times_s: StageTimes = field(metadata=named_columns("time_{}_s"))
    parts_s: StageParts = field(metadata=named_columns("time_{}_s"))

    @classmethod
    def of(cls, row: Measurement, reach: float) -> RowNumbers:
        """Return the numbers of a row."""
        predicted, surface = row.predicted, None
        if predicted is not None:
            names = ("silhouettes", "snapped", "depth", "outside", "culled")
            parts = {name: getattr(predicted, name) for name in names}
            surface = PredictedSurface(fraction=predicted.surface_fraction, **parts)
        return cls(
            settings=row.settings,
            near_per_reach=row.settings.near / reach,
            comparison=row.comparison,
            unexplained=row.unexplained,
            shear=row.shear,
            predicted_displacement_px=predicted.displacement_px if predicted else None,
            predicted_surface=surface,
            smallest_separation=predicted.separation if predicted else None,
            measured_over_predicted=row.measured_over_predicted,
            times_s=row.times_s,
            parts_s=row.parts_s,
        )


@dataclass(frozen=True, kw_only=True)
class TableRow:
    """One row of measurements.parquet, which names the scene and everything that made the numbers."""

    aperture: Aperture
    numbers: RowNumbers = field(metadata=INLINED)
    causes: Mapping[str, CauseNumbers | None] = field(metadata=named_columns("cause_{}"))
    scene_name: str
    scene_source: str
    scene_hash: str
    units: str
    decided_by: str
    versions: Mapping[str, str] = field(metadata=named_columns("version_{}"))
    devices: Mapping[str, str] = field(metadata=named_columns("device_{}"))

    @classmethod
    def of(cls, row: Measurement, sweep: Sweep) -> TableRow:
        """Return a row of a sweep; where causes were left out, their columns stay."""
        scene = sweep.scene
        causes: dict[str, CauseNumbers | None] = dict.fromkeys(links_of(row.settings))
        return cls(
            aperture=row.aperture,
            numbers=RowNumbers.of(row, scene.frustum.longest_reach),
            causes=causes | {cause.name: cause.numbers for cause in row.causes},
            scene_name=scene.name,
            scene_source=scene.source,
            scene_hash=scene.content_hash,
            units=scene.units,
            decided_by=sweep.decided_by,
            versions=sweep.versions,
            devices=sweep.devices,
        )


def write_parquet(sweep: Sweep, path: Path) -> None:
    """Write one row per aperture and setting, whose columns follow from `TableRow`."""
    pq.write_table(table_of(TableRow, [TableRow.of(row, sweep) for row in sweep.rows]), path.absolute())


def report_content(sweep: Sweep, light: LightReport | None = None) -> dict[str, Any]:
    """Return the object in report.json."""
    scene, reach = sweep.scene, sweep.scene.frustum.longest_reach
    content: dict[str, Any] = json_ready(
        {
            "scene": {
                "name": scene.name,
                "source": scene.source,
                "hash": scene.content_hash,
                "units": scene.units,
                "objects": len(scene.objects),
                "triangles": len(scene.faces),
                "plate": scene.plate,
                "frustum": scene.frustum,
            },
            "apertures": sweep.apertures,
            "best": {
                "sentence": headline(sweep),
                **_best(sweep.best, reach),
                "command": recommended_command(sweep),
                "plan_command": plan_command(scene),
                "confidence": CONFIDENCE,
            },
            "best_per_depth": [_best(best, reach) for best in best_per_depth(sweep.rows)],
            "best_per_geometry": [_best(best, reach) for best in best_per_geometry(sweep.rows)],
            "rows": [
                {
                    "aperture": row.aperture.index,
                    **json_object(RowNumbers.of(row, reach)),
                    "causes": row.causes,
                }
                for row in sweep.rows
            ],
            # Where a tracer alone made the truths, there is nothing to compare it with.
            "tracers_alone": [
                {"aperture": aperture.index, **json_object(alone.numbers)}
                for aperture, alone in zip(sweep.apertures, sweep.alone, strict=False)
            ],
            "decided_by": sweep.decided_by,
            "versions": sweep.versions,
            "devices": sweep.devices,
            "times_s": sweep.times_s,
            "cost": {
                "wall_s": sweep.wall_s,
                "frames_s": sweep.times_s["raster"],
                "truths_s": sweep.times_s["trace"],
                "pictures_s": sweep.times_s["pictures"],
            },
            "shading": light and light.record,
            "scout": ScoutRecord.of(sweep.auto) if sweep.auto else None,
            "left_out": () if sweep.charged else LEFT_OUT,
        }
    )
    return content


def recommended_command(sweep: Sweep) -> str:
    """Return the command that draws as a sweep recommends, at the aperture at which that is worst."""
    return raster_command(sweep.scene, sweep.best.aperture, sweep.best.settings)


def headline(sweep: Sweep) -> str:
    """Return the recommendation of a sweep in words; it says so where a tracer alone made the truths."""
    frustum = sweep.scene.frustum
    said = sentence(sweep.rows, sweep.scene.units, frustum.longest_reach, recentered=frustum.recentered)
    if sweep.decided_by == CERTIFIED:
        return said
    return f"{said.removesuffix('.')} ({unexamined_truth(sweep.decided_by)})."


def _best(best: Recommendation, reach: float) -> dict[str, Any]:
    """Return a recommendation as report.json has it; the aperture is the one with most wrong surfaces."""
    return {
        **json_object(best.settings),
        "near_per_reach": best.settings.near / reach,
        "surface_fraction": best.surface_fraction,
        "displacement_p99_px": best.displacement_p99_px,
        "radiance_fraction": best.radiance_fraction,
        "window": best.window,
        "aperture": best.aperture.index,
    }
