"""The content of report.json, and measurements.parquet."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from xfrustum.compare.attribution.budget import CauseNumbers
from xfrustum.compare.metrics.paired import CONFIDENCE
from xfrustum.compare.prediction.chain import links_of
from xfrustum.compare.prediction.predict import Prediction
from xfrustum.reference.plain import CERTIFIED
from xfrustum.reports.common.formatting import unexamined_truth
from xfrustum.reports.common.raster_command import plan_command, raster_command
from xfrustum.reports.common.records import table_of
from xfrustum.reports.error_report.report_records import (
    AloneRecord,
    BestRecord,
    PredictedSurface,
    RecommendationRecord,
    ReportRecord,
    ReportRow,
    RowNumbers,
    SceneRecord,
    TableRow,
)
from xfrustum.reports.error_report.shading import ShadingReport
from xfrustum.reports.measurements.best import (
    Recommendation,
    best_per_depth,
    best_per_geometry,
    best_setting,
    sentence,
)
from xfrustum.reports.measurements.measurement import Measurement, Sweep
from xfrustum.reports.scouting.automatic import ScoutRecord
from xfrustum.scenes.model.scene import Scene


def report_record(sweep: Sweep, shading: ShadingReport | None = None) -> ReportRecord:
    """Return the content of report.json."""
    reach = sweep.scene.frustum.longest_reach
    return ReportRecord(
        scene=_scene_record(sweep.scene),
        apertures=sweep.apertures,
        best=RecommendationRecord(
            sentence=headline(sweep),
            best=_best_record(best_setting(sweep.rows), reach),
            command=recommended_command(sweep),
            plan_command=plan_command(sweep.scene),
            confidence=CONFIDENCE,
        ),
        best_per_depth=tuple(_best_record(best, reach) for best in best_per_depth(sweep.rows)),
        best_per_geometry=tuple(_best_record(best, reach) for best in best_per_geometry(sweep.rows)),
        rows=tuple(
            ReportRow(aperture=row.aperture.index, numbers=_row_numbers(row, reach), causes=row.causes)
            for row in sweep.rows
        ),
        tracers_alone=tuple(
            AloneRecord(aperture=aperture.index, numbers=alone.numbers)
            # Where a tracer alone made the truths, there is nothing to compare it with.
            for aperture, alone in zip(sweep.apertures, sweep.alone, strict=False)
        ),
        decided_by=sweep.decided_by,
        versions=sweep.versions,
        devices=sweep.devices,
        times_s=sweep.times_s,
        cost=sweep.cost,
        shading=shading.record if shading else None,
        scout=ScoutRecord.of(sweep.auto) if sweep.auto else None,
        left_out=sweep.left_out,
    )


def measurement_table(sweep: Sweep) -> pa.Table:
    """Return one row per aperture and setting, whose columns follow from `TableRow`."""
    scene, reach = sweep.scene, sweep.scene.frustum.longest_reach
    rows = [
        TableRow(
            aperture=row.aperture,
            numbers=_row_numbers(row, reach),
            causes=_charged(row),
            scene_name=scene.name,
            scene_source=scene.source,
            scene_hash=scene.content_hash,
            units=scene.units,
            decided_by=sweep.decided_by,
            versions=sweep.versions,
            devices=sweep.devices,
        )
        for row in sweep.rows
    ]
    return table_of(TableRow, rows)


def write_parquet(sweep: Sweep, path: Path) -> None:
    """Write one row per aperture and setting; see `measurement_table`."""
    pq.write_table(measurement_table(sweep), path)


def recommended_command(sweep: Sweep) -> str:
    """Return the command that draws as a sweep recommends, at the aperture at which that is worst."""
    best = best_setting(sweep.rows)
    return raster_command(sweep.scene, best.aperture, best.settings)


def headline(sweep: Sweep) -> str:
    """Return the recommendation of a sweep in words; it says so where a tracer alone made the truths."""
    frustum = sweep.scene.frustum
    said = sentence(sweep.rows, sweep.scene.units, frustum.longest_reach, recentered=frustum.recentered)
    if sweep.decided_by == CERTIFIED:
        return said
    return f"{said.removesuffix('.')} ({unexamined_truth(sweep.decided_by)})."


def _charged(row: Measurement) -> dict[str, CauseNumbers | None]:
    """Return the numbers of each cause; None for each where causes were left out, whose columns stay."""
    if not row.causes:
        return dict.fromkeys(links_of(row.settings))
    return {cause.name: cause.numbers for cause in row.causes}


def _row_numbers(row: Measurement, reach: float) -> RowNumbers:
    predicted = row.predicted
    return RowNumbers(
        settings=row.settings,
        near_per_reach=row.settings.near / reach,
        comparison=row.comparison,
        unexplained=row.unexplained,
        shear=row.shear,
        predicted_displacement_px=predicted.displacement_px if predicted else None,
        predicted_surface=_predicted_surface(predicted) if predicted else None,
        smallest_separation=predicted.separation if predicted else None,
        measured_over_predicted=row.measured_over_predicted,
        times_s=row.times_s,
        parts_s=row.parts_s,
    )


def _predicted_surface(predicted: Prediction) -> PredictedSurface:
    return PredictedSurface(
        fraction=predicted.surface_fraction,
        silhouettes=predicted.silhouettes,
        snapped=predicted.snapped,
        depth=predicted.depth,
        outside=predicted.outside,
        culled=predicted.culled,
    )


def _best_record(best: Recommendation, reach: float) -> BestRecord:
    return BestRecord(
        settings=best.settings,
        near_per_reach=best.settings.near / reach,
        surface_fraction=best.surface_fraction,
        displacement_p99_px=best.displacement_p99_px,
        radiance_fraction=best.radiance_fraction,
        window=best.window,
        aperture=best.aperture.index,
    )


def _scene_record(scene: Scene) -> SceneRecord:
    return SceneRecord(
        name=scene.name,
        source=scene.source,
        hash=scene.content_hash,
        units=scene.units,
        objects=len(scene.objects),
        triangles=len(scene.faces),
        plate=scene.plate,
        frustum=scene.frustum,
    )
