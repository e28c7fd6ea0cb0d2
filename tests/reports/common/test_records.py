"""Tables of records: columns and types follow from the dataclass, whatever the rows hold."""

import math
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from tests.support.rows import GPU_S, NO_PREDICTION, TIMES, comparison_numbers, measured_row
from xfrustum.compare.metrics.comparison import ComparisonNumbers
from xfrustum.compare.metrics.error_maps import Spread
from xfrustum.reports.common.records import table_of
from xfrustum.reports.error_report.best import TableRow
from xfrustum.scenes import DoubleFrustum


def row(comparison: ComparisonNumbers, predicted: Spread | None) -> TableRow:
    """Return a made-up row of measurements.parquet."""
    measured = measured_row(DoubleFrustum(near=0.1), comparison)
    measured = replace(measured, predicted=replace(NO_PREDICTION, displacement_px=predicted))
    made_by = {
        "scene_name": "scene",
        "version_scikit-image": "1",
        "device_OpenGL vendor": "somebody",
    }
    return measured.table_row(10.0, made_by)


SPREAD = Spread(rms=1.0, p50=math.inf, p95=math.nan, p99=1.0, max=1.0)
BARE = row(comparison_numbers(100, 50, 0.1, None), None)
FULL = row(comparison_numbers(100, 50, 0.1, 0.5, 0.2), SPREAD)


def test_a_report_has_the_same_columns_and_types_whatever_was_measured(tmp_path: Path) -> None:
    """Files of shaded and unshaded scenes, of empty and full pictures, can be read as one table."""
    read = []
    for number, made in enumerate((BARE, FULL)):
        pq.write_table(table_of(TableRow, [made]), tmp_path / f"{number}.parquet")
        read.append(pq.read_table(tmp_path / f"{number}.parquet"))
    assert read[0].schema == read[1].schema == table_of(TableRow, [BARE, FULL]).schema
    assert not any(pa.types.is_null(column.type) for column in read[0].schema)
    types = {
        "near": pa.float64(),
        "depth": pa.string(),
        "slabs": pa.list_(pa.float64()),
        "fit": pa.string(),
    }
    types |= {"surface_wrong": pa.int64(), "time_raster_s": pa.float64()}
    assert {name: read[0].schema.field(name).type for name in types} == types
    bare, full = (table.to_pylist()[0] for table in read)
    for group in ("displacement_px", "predicted_displacement_px", "radiance"):
        assert bare[f"{group}_rms"] is None is not full[f"{group}_rms"]
    # A value that is no number is null too.
    assert full["predicted_displacement_px_p50"] is None is full["predicted_displacement_px_p95"]
    assert full["radiance_channels_rms"] == [0.1, 0.1, 0.1]
    assert full["version_scikit_image"] == "1" and full["device_opengl_vendor"] == "somebody"
    assert full["time_raster_s"] == TIMES.raster and full["time_raster_gpu_s"] == GPU_S
