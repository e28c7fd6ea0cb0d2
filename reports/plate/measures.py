"""How each hogel of a plate differs from its truth: rows of a table, and the arrays made of its columns.

A block's rows are a Parquet file of their own, a part of a table that is a folder. Times are left out: the
same plate has the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from xfrustum.compare.metrics.comparison import ComparisonNumbers
from xfrustum.compare.run import Judge, JudgedFrame, Wanted
from xfrustum.raster.plate.one_by_one import plate_hogel
from xfrustum.raster.rasterizer import Rasterizer, normals_of
from xfrustum.reports.common.records import columns_of, named_columns, table_of
from xfrustum.reports.plate.layout import Block
from xfrustum.reports.plate.sources import HogelSource, check_drawable, visible_effects
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.hogel_image import Certainty
from xfrustum.scenes.model.plate_content import Channel, PlateContent, PlateHogel
from xfrustum.scenes.model.scene import Scene, is_shaded
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

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


class JudgedSource(HogelSource):
    """Hogels that are judged as they are drawn, each by one drawing, with the images of `Drawn`, bit for bit.

    Raises
    ------
    InputError
        As from `Drawn`; or see `Judge`.
    """

    judged = True

    def __init__(self, scene: Scene, settings: DoubleFrustum, content: PlateContent) -> None:
        check_drawable(content)
        settings.check_against(scene.frustum)
        self.scene, self.content = scene, content
        self.settings, self._settings = settings, settings
        self._judge = Judge(scene, effects=content.effects)
        try:
            effects = self._judge.submit(lambda rasterizer: self._examined(rasterizer, settings)).result()
        except BaseException:
            self._judge.release()
            raise
        self.simulated = visible_effects(effects, scene, settings)
        self.renderer = self._judge.device["renderer"]

    def _examined(self, rasterizer: Rasterizer, settings: DoubleFrustum) -> frozenset[Effect]:
        """Return the effects of the drawings; InputError where the device cannot make them."""
        rasterizer.check_sampling(self.scene.sampling)
        return rasterizer.effects_for(settings)

    def hogels(self, apertures: Iterable[Aperture]) -> Iterator[PlateHogel]:
        """Draw and judge hogels, and yield them in the order of their apertures."""
        colors = is_shaded(self.scene)
        # Pixels are stored with color; whether it is compared is another question.
        wanted = Wanted(color=True, colored_truths=colors, radiance=colors)
        with closing(self._judge.frames(apertures, [self._settings], wanted, self._judged)) as frames:
            yield from frames

    def _judged(self, frame: JudgedFrame) -> JudgedPlateHogel:
        """Return what is stored of a frame, in the thread that has judged it."""
        here, image = frame.aperture, frame.image
        if Channel.NORMAL in self.content.channels:
            image = replace(image, normal=normals_of(self.scene, image.triangle))
        measured = MeasuredHogel(
            column=here.column, row=here.row, x=here.x, y=here.y, comparison=frame.comparison.numbers
        )
        return JudgedPlateHogel(**{**vars(plate_hogel(image, self.content)), "measured": measured})

    def release(self) -> None:
        """Free the judge."""
        self._judge.release()


def measures_of(scene: Scene) -> dict[str, str]:
    """Return the names of the measures of a scene's hogels, and the unit of each.

    Errors of color are measures only where the scene says how it looks.
    """
    empty = ComparisonNumbers(
        pixels=0,
        judged=0,
        covered=0,
        at_plate=0,
        surface=None,
        triangle=None,
        displacement_px=None,
        height=None,
        radiance=None,
        certainty={kind.name.lower(): 0 for kind in Certainty},
    )
    row = MeasuredHogel(column=0, row=0, x=0.0, y=0.0, comparison=empty)
    found = {}
    for column in columns_of(MeasuredHogel, [row]):
        numeric = pa.types.is_integer(column.type) or pa.types.is_floating(column.type)
        kept = is_shaded(scene) or not column.name.startswith("radiance")
        if column.name not in PLACES and numeric and kept:
            found[column.name] = _unit(column.name, scene.units)
    return found


def _unit(name: str, length: str) -> str:
    if name.startswith("displacement_px"):
        return "px"
    return length if name.startswith("height") else "1"


class Table:
    """The measures of a plate's hogels as a folder of Parquet files, one for each block."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

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
        if found is None:
            return set()
        return set(zip(found["column"].to_pylist(), found["row"].to_pylist(), strict=True))

    def write(self, block: Block, table: pa.Table) -> None:
        """Write the rows of a block; the file is there whole or not at all."""
        self.folder.mkdir(exist_ok=True)
        aside = self.path(block).with_suffix(".partial")
        pq.write_table(table, aside)
        aside.replace(self.path(block))


def merged(before: pa.Table | None, hogels: Iterable[MeasuredHogel]) -> pa.Table:
    """Return rows of a block with those of some hogels added, or put in the place of older ones."""
    added = table_of(MeasuredHogel, list(hogels))
    rows: dict[tuple[int, int], dict[str, Any]] = {}
    for table in (before, added):
        if table is not None and table.schema == added.schema:
            rows |= {(row["row"], row["column"]): row for row in table.to_pylist()}
    # From plain values, so that equal rows make equal bytes, whatever tables they come from.
    return pa.Table.from_pylist([rows[place] for place in sorted(rows)], schema=added.schema)


def maps_of(table: pa.Table, block: Block, names: Iterable[str]) -> Mapping[str, Floats]:
    """Return each measure of a block over (row, column), NaN where there is none."""
    columns = np.array(table["column"].to_pylist(), dtype=np.int64) - block.columns.start
    rows = np.array(table["row"].to_pylist(), dtype=np.int64) - block.rows.start
    maps: dict[str, Floats] = {}
    for name in names:
        values: list[Any] = table[name].to_pylist() if name in table.column_names else [None] * len(rows)
        maps[name] = np.full(block.shape, np.nan)
        maps[name][rows, columns] = [np.nan if value is None else value for value in values]
    return maps
