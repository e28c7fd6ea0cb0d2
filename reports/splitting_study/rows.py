"""The study's measurements as rows, and as Parquet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path

import pyarrow.parquet as pq
from pydantic import TypeAdapter

from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.reports.common.records import named_columns, table_of
from xfrustum.reports.splitting_study.grid import Cell, Setting
from xfrustum.reports.splitting_study.measure import SEPARATIONS, CellResult, SheetResult

ASKED_SEPARATION = 1e-3
"""Distance of two surfaces at the far end that a depth buffer must order, as a share of the reach."""


@dataclass(frozen=True, kw_only=True)
class StudyRow(Setting, CellResult):
    """A cell, its picture judged, and the sheets at the far end of its side.

    Attributes
    ----------
    misordered
        Share of pixels that do not show the right one of two sheets `ASKED_SEPARATION` apart.
    ordered_separation
        The smallest separation measured that is ordered, with all larger ones; None where none is.
    predicted_separation
        The smallest that is, by the closed form.
    """

    misordered: float
    ordered_separation: float | None
    predicted_separation: float

    @property
    def depth_fraction(self) -> float:
        """Share of the judged pixels whose wrong surface is charged to depth."""
        return self.depth_wrong / self.judged


def joined(cell: Cell, picture: CellResult, sheets: Sequence[SheetResult]) -> StudyRow:
    """Return a cell with what was measured for it; of the sheets of several cameras the worst count."""
    ordered = None
    misordered = [max(shares) for shares in zip(*(one.misordered for one in sheets), strict=True)]
    for separation, share in zip(SEPARATIONS, misordered, strict=True):
        if share > MAX_MISORDERED_FRACTION:
            break
        ordered = separation
    return StudyRow(
        **vars(cell),
        **vars(picture),
        misordered=misordered[SEPARATIONS.index(ASKED_SEPARATION)],
        ordered_separation=ordered,
        predicted_separation=max(one.predicted_separation for one in sheets),
    )


@dataclass(frozen=True, kw_only=True)
class Origin:
    """What a study's numbers came from: versions of the libraries and the device, by name."""

    versions: Mapping[str, str]
    devices: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class FiledRow(StudyRow):
    """A row as it is filed, with what measured it; the columns of the table are its fields.

    Attributes
    ----------
    versions, devices
        Versions of the libraries and the device, by name.
    """

    versions: Mapping[str, str] = field(metadata=named_columns("version_{}"))
    devices: Mapping[str, str] = field(metadata=named_columns("device_{}"))


def write_parquet(rows: Sequence[StudyRow], origin: Origin, path: Path) -> None:
    """Write one row per cell; versions and device are columns of their own, the same in every row."""
    filed = [FiledRow(**vars(row), versions=origin.versions, devices=origin.devices) for row in rows]
    pq.write_table(table_of(FiledRow, filed), path, compression="zstd")


def read_parquet(path: Path) -> tuple[tuple[StudyRow, ...], Origin]:
    """Return the rows of a file of `write_parquet`, and where they came from."""
    found = pq.read_table(path).to_pylist()
    names = {one.name for one in fields(StudyRow)}
    reader = TypeAdapter(StudyRow)
    rows = tuple(reader.validate_python({name: row[name] for name in names}) for row in found)
    common = {name: str(value) for name, value in found[0].items() if name not in names}
    return rows, Origin(
        versions={n.removeprefix("version_"): v for n, v in common.items() if n.startswith("version_")},
        devices={n.removeprefix("device_"): v for n, v in common.items() if n.startswith("device_")},
    )
