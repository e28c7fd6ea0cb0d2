"""Tables of records: columns and types follow from the dataclass of the rows, whatever the rows hold."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from tests.support.rows import GPU_S, NO_PREDICTION, TIMES, comparison_numbers, measured_row
from xfrustum.compare.metrics.comparison import ComparisonNumbers
from xfrustum.compare.metrics.error_maps import Spread
from xfrustum.reports.common.records import named_columns, table_of
from xfrustum.reports.error_report.best import TableRow
from xfrustum.scenes import DoubleFrustum


class Kind(StrEnum):
    ROUND = "round"


@dataclass(frozen=True, kw_only=True)
class Size:
    width: int
    height: float | None


@dataclass(frozen=True, kw_only=True)
class Thing:
    name: str
    kind: Kind
    heavy: bool
    size: Size | None
    weights: tuple[float, ...]
    inner: Size = field(metadata=named_columns("{}"))
    times: Mapping[str, float] = field(metadata=named_columns("time_{}_s"))
    label: Kind | float | None = None


def thing(size: Size | None, times: Mapping[str, float]) -> Thing:
    inner = Size(width=3, height=None)
    return Thing(name="a", kind=Kind.ROUND, heavy=True, size=size, weights=(), inner=inner, times=times)


def row(comparison: ComparisonNumbers, predicted: Spread | None) -> TableRow:
    """Return a made-up row of measurements.parquet."""
    measured = measured_row(DoubleFrustum(near=0.1), comparison)
    measured = replace(measured, predicted=replace(NO_PREDICTION, displacement_px=predicted))
    made_by = {"scene_name": "scene", "version_scikit-image": "1", "device_OpenGL vendor": "somebody"}
    return measured.table_row(10.0, made_by)


BARE = row(comparison_numbers(100, 50, 0.1, None), None)
FULL = row(comparison_numbers(100, 50, 0.1, 0.5, 0.2), Spread(rms=1.0, p50=1.0, p95=1.0, p99=1.0, max=1.0))


def test_every_field_has_its_column_and_its_type() -> None:
    table = table_of(Thing, [thing(Size(width=1, height=2.0), {"a": 0.5})])
    assert [(one.name, one.type) for one in table.schema] == [
        ("name", pa.string()),
        ("kind", pa.string()),
        ("heavy", pa.bool_()),
        ("size_width", pa.int64()),
        ("size_height", pa.float64()),
        ("weights", pa.list_(pa.float64())),
        ("width", pa.int64()),
        ("height", pa.float64()),
        ("time_a_s", pa.float64()),
        ("label", pa.string()),
    ]


def test_what_a_row_lacks_is_null_of_the_right_type_and_not_a_number_too() -> None:
    rows = [thing(Size(width=1, height=float("inf")), {"a": 1.0}), thing(None, {"b": float("nan")})]
    table = table_of(Thing, rows)
    first, second = table.to_pylist()
    assert (first["time_a_s"], first["time_b_s"], first["size_height"]) == (1.0, None, None)
    assert (second["time_a_s"], second["time_b_s"], second["size_width"]) == (None, None, None)
    bare = table_of(Thing, rows[1:]).schema
    assert all(table.schema.field(name).type == bare.field(name).type for name in bare.names)


def test_a_report_has_the_same_columns_whatever_was_measured(tmp_path: Path) -> None:
    """Files of shaded and unshaded scenes, of empty and full pictures, can be read as one table."""
    read = []
    for number, made in enumerate((BARE, FULL)):
        pq.write_table(table_of(TableRow, [made]), tmp_path / f"{number}.parquet")
        read.append(pq.read_table(tmp_path / f"{number}.parquet"))
    assert read[0].schema == read[1].schema
    assert not any(pa.types.is_null(one.type) for one in read[0].schema)
    bare, full = (table.to_pylist()[0] for table in read)
    for group in ("displacement_px", "predicted_displacement_px", "radiance"):
        assert bare[f"{group}_rms"] is None is not full[f"{group}_rms"]
    assert full["radiance_channels_rms"] == [0.1, 0.1, 0.1]
    assert full["version_scikit_image"] == "1" and full["device_opengl_vendor"] == "somebody"
    assert full["time_raster_s"] == TIMES.raster and full["time_raster_gpu_s"] == GPU_S
