"""How each hogel of a plate differs from its truth: rows of a table, and the arrays made of its columns.

A block's rows are a Parquet file of their own, a part of a table that is a folder. Times are left out: the
same plate has the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from xfrustum.compare.metrics.comparison import ComparisonNumbers
from xfrustum.reports.common.records import columns_of, named_columns, table_of
from xfrustum.reports.plate.layout import Block
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.hogel_image import Certainty
from xfrustum.scenes.model.plate_content import PlateHogel
from xfrustum.scenes.model.scene import Scene, is_shaded

PLACES = ("column", "row", "x", "y")
"""Columns that say which hogel a row is about; all others are measures."""


@dataclass(frozen=True, kw_only=True)
class MeasuredHogel:
    """One hogel, its place on the plate, its aperture's in scene units, and what `compare --json` tells."""

    column: int
    row: int
    x: float
    y: float
    comparison: ComparisonNumbers = field(metadata=named_columns("{}"))


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedPlateHogel(PlateHogel):
    """A hogel's images with its measures."""

    measured: MeasuredHogel


def measures_of(scene: Scene) -> dict[str, str]:
    """Return the names of the measures of a scene's hogels, and the unit of each.

    Errors of color are measures only where the scene says how it looks.
    """
    nothing = dict.fromkeys(("surface", "triangle", "displacement_px", "height", "radiance"))
    counts = dict.fromkeys(("pixels", "judged", "covered", "at_plate"), 0)
    certainty = {kind.name.lower(): 0 for kind in Certainty}
    empty = ComparisonNumbers(**counts, **nothing, certainty=certainty)  # type: ignore[arg-type]
    found = {}
    for column in columns_of(MeasuredHogel, [MeasuredHogel(column=0, row=0, x=0.0, y=0.0, comparison=empty)]):
        name, numeric = column.name, pa.types.is_integer(column.type) or pa.types.is_floating(column.type)
        if name not in PLACES and numeric and (is_shaded(scene) or not name.startswith("radiance")):
            length = scene.units if name.startswith("height") else "1"
            found[name] = "px" if name.startswith("displacement_px") else length
    return found


@dataclass(frozen=True)
class Table:
    """The measures of a plate's hogels as a folder of Parquet files, one for each block."""

    folder: Path

    def path(self, block: Block) -> Path:
        """Return the file of a block."""
        return self.folder / f"block-{block.number:08}.parquet"

    def rows(self, block: Block) -> pa.Table | None:
        """Return the rows of a block, by row and column; None where its file is missing or damaged."""
        try:
            found = pq.read_table(self.path(block).absolute())
        except (OSError, pa.ArrowException, ValueError):
            return None
        return found if set(PLACES) <= set(found.column_names) else None

    def measured(self, block: Block) -> set[tuple[int, int]]:
        """Return column and row of each hogel of a block that has been judged."""
        found = self.rows(block)
        return (
            set() if found is None else set(zip(*found.select(PLACES[:2]).to_pydict().values(), strict=True))
        )

    def add(self, block: Block, hogels: Iterable[MeasuredHogel]) -> pa.Table:
        """Write and return the rows of a block with those of some hogels, in the place of older ones.

        The file is there whole or not at all.
        """
        added, before = table_of(MeasuredHogel, list(hogels)), self.rows(block)
        rows: dict[tuple[int, int], dict[str, Any]] = {}
        for table in (before, added):
            if table is not None and table.schema == added.schema:
                rows |= {(row["row"], row["column"]): row for row in table.to_pylist()}
        # From plain values, so that equal rows make equal bytes, whatever tables they come from.
        merged = pa.Table.from_pylist([rows[place] for place in sorted(rows)], schema=added.schema)
        self.folder.mkdir(exist_ok=True)
        aside = self.path(block).with_suffix(".partial")
        pq.write_table(merged, aside)
        aside.replace(self.path(block))
        return merged


def maps_of(table: pa.Table, block: Block, names: Iterable[str]) -> Mapping[str, Floats]:
    """Return each measure of a block over (row, column), NaN where there is none."""
    columns = np.array(table["column"].to_pylist(), dtype=np.int64) - block.columns.start
    rows = np.array(table["row"].to_pylist(), dtype=np.int64) - block.rows.start
    maps: dict[str, Floats] = {}
    for name in names:
        maps[name] = np.full(block.shape, np.nan)
        if name in table.column_names:
            maps[name][rows, columns] = table[name].cast(pa.float64()).fill_null(np.nan).to_numpy()
    return maps
