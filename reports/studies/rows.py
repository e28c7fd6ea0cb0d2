"""Rows of a study as Parquet, each with what measured it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import TypeVar

import pyarrow.parquet as pq
from pydantic import TypeAdapter

from xfrustum.reports.common.records import table_of
from xfrustum.reports.studies.origin import DEVICE_COLUMN, VERSION_COLUMN, Origin

Row = TypeVar("Row")


def write_rows(kind: type[Row], rows: Sequence[Row], origin: Origin, path: Path) -> None:
    """Write rows of one dataclass; versions and device are columns of their own, the same in every row.

    Parameters
    ----------
    kind
        Dataclass of the rows.
    rows
        Instances of it.
    origin
        What measured them.
    path
        File to be written.
    """
    table, common = table_of(kind, rows), table_of(Origin, [origin] * len(rows))
    for column in common.schema:
        table = table.append_column(column, common[column.name])
    pq.write_table(table, path, compression="zstd")


def read_rows(kind: type[Row], path: Path) -> tuple[tuple[Row, ...], Origin]:
    """Return the rows of a file of `write_rows`, and where they came from."""
    found = pq.read_table(path).to_pylist()
    names = {one.name for one in fields(kind)}  # type: ignore[arg-type]  # a dataclass; no type says so
    reader = TypeAdapter(kind)
    rows = tuple(reader.validate_python({name: row[name] for name in names}) for row in found)
    common = {name: str(value) for name, value in found[0].items() if name not in names}
    return rows, Origin(versions=_named(common, VERSION_COLUMN), devices=_named(common, DEVICE_COLUMN))


def _named(columns: dict[str, str], pattern: str) -> dict[str, str]:
    """Return the values of the columns of one pattern by what stands in its place."""
    prefix = pattern.format("")
    return {name.removeprefix(prefix): value for name, value in columns.items() if name.startswith(prefix)}
