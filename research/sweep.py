"""Measure a study's cells in blocks, store each finished block, and write study rows as Parquet.

A cell is one measurement of a study; a block has the cells that share the costliest images.
The rows of a block are one Parquet file. The name of the file depends on cells and origin. A
stopped study continues with the blocks whose files are missing.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, TypeVar

import pyarrow.parquet as pq
from pydantic import TypeAdapter

from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.blocks import Job, Part, Workers
from xfrustum.reports.common import outputs
from xfrustum.reports.common.outputs import Staging, check_writable_folder, write_files
from xfrustum.reports.common.records import named_columns, table_of
from xfrustum.research.depth_family import CAR_RATIO, cars
from xfrustum.scenes import Camera, InputError

Row = TypeVar("Row")
BLOCKS, IMAGES = "blocks", "images"  # folders of measured blocks and of figures
VERSION_COLUMN, DEVICE_COLUMN = "version_{}", "device_{}"


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Origin of a study's numbers: versions of the libraries and the device, by name."""

    versions: Mapping[str, str] = field(metadata=named_columns(VERSION_COLUMN))
    devices: Mapping[str, str] = field(metadata=named_columns(DEVICE_COLUMN))

    @property
    def decisive(self) -> str:
        """All inputs of the results other than the cells, as text: libraries and OpenGL device."""
        opengl = {name: text for name, text in self.devices.items() if name.startswith("OpenGL")}
        return json.dumps([dict(self.versions), opengl], sort_keys=True)


@cache
def measured_by() -> Origin:
    """Return the versions and the device of this process; InputError without OpenGL."""
    scene = cars(CAR_RATIO, Camera.C, (1, 1))
    with Rasterizer(scene) as rasterizer:
        opengl = {f"OpenGL {name}": value for name, value in rasterizer.device.items()}
    versions = {**outputs.versions(), **Reference(scene).versions}
    return Origin(versions=versions, devices={**outputs.machine(), **opengl})


def write_rows(kind: type[Row], rows: Sequence[Row], origin: Origin, path: Path) -> None:
    """Write rows of one dataclass, with versions and device as constant columns."""
    # Constant columns cost little in Parquet, and keep rows self-contained.
    table, common = table_of(kind, rows), table_of(Origin, [origin] * len(rows))
    for column in common.schema:
        table = table.append_column(column, common[column.name])
    pq.write_table(table, path.absolute(), compression="zstd")


def read_rows(kind: type[Row], path: Path) -> tuple[tuple[Row, ...], Origin]:
    """Return the rows of a file of `write_rows`, and their origin."""
    table = pq.read_table(path.absolute()).to_pylist()
    names = {field.name for field in fields(kind)}  # type: ignore[arg-type]  # a dataclass
    reader = TypeAdapter(kind)
    rows = tuple(reader.validate_python({name: row[name] for name in names}) for row in table)

    def named(pattern: str) -> dict[str, str]:
        prefix = pattern.format("")
        columns = table[0].items()
        return {name.removeprefix(prefix): str(v) for name, v in columns if name.startswith(prefix)}

    return rows, Origin(versions=named(VERSION_COLUMN), devices=named(DEVICE_COLUMN))


@dataclass(frozen=True, kw_only=True)
class Sweep(Job):
    """Blocks of one study: tuples of cells (dataclasses), each measured as one `row`."""

    unit: ClassVar[str] = "cell"

    study: str
    folder: Path
    row: type[Any]
    measure: Callable[[Sequence[Any]], Iterable[Any]]
    origin: Origin

    @classmethod
    def from_measure(
        cls, study: str, out: Path, row: type[Any], measure: Callable[..., Iterable[Any]]
    ) -> Sweep:
        """Return the job of a study, with its folder of blocks and the origin of this process."""
        folder = out.absolute() / BLOCKS
        return cls(study=study, folder=folder, row=row, measure=measure, origin=measured_by())

    @property
    def name(self) -> str:
        """Name of the job."""
        return f"study-{self.study}"

    def file(self, cells: Sequence[Any]) -> Path:
        """Return the file of a block."""
        key = [self.study, self.origin.decisive, *map(asdict, cells)]
        # The name depends on cells and origin, so that other libraries cause a new measurement.
        digest = hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()
        return self.folder / f"{digest[:32]}.parquet"

    def finished(self, cells: Sequence[Any]) -> bool:
        """Return whether a block is measured."""
        return self.file(cells).exists()

    def size(self, cells: Sequence[Any]) -> int:
        """Return the number of cells of a block."""
        return len(cells)

    def words(self, cells: Sequence[Any]) -> str:
        """Return the name of a block by its first cell."""
        return f"the block of {asdict(cells[0])}"

    @contextmanager
    def open(self) -> Iterator[Sweep]:
        """Yield this job as the session; InputError if this process has another origin."""
        here = measured_by()
        if here.decisive != self.origin.decisive:
            raise InputError(
                "a worker has other libraries or another device than the start of the study "
                f"({here.devices.get('OpenGL renderer')}); give all workers the same"
            )
        yield self

    def make(self, cells: Sequence[Any]) -> None:
        """Measure a block; its file is complete or absent."""
        rows, file = list(self.measure(cells)), self.file(cells)
        with Staging(self.folder, (file.name,)) as staging:
            write_rows(self.row, rows, self.origin, staging.folder / file.name)
            staging.commit()

    def rows(
        self, blocks: Sequence[Sequence[Any]], workers: Workers, part: Part, *, progress: bool
    ) -> list[Any] | None:
        """Measure missing blocks of a part; return all rows, or None while blocks are missing."""
        own = list(part.of(blocks))
        workers.run(self, own, sum(map(len, own)), progress=progress)
        # Other parts of a job array may still be at work.
        if not all(map(self.finished, blocks)):
            return None
        return [row for cells in blocks for row in read_rows(self.row, self.file(cells))[0]]


@dataclass(frozen=True, kw_only=True)
class StudyFiles:
    """Files of a study: Markdown, Parquet and SVG; all rows, and their origin."""

    document: Path
    data: Path
    figures: tuple[Path, ...]
    rows: tuple[Any, ...]
    origin: Origin

    @property
    def record(self) -> dict[str, Any]:
        """Files and their origin, for the JSON of every study."""
        return {
            "files": {"document": self.document, "data": self.data, "figures": self.figures},
            "cells": len(self.rows),
            "versions": self.origin.versions,
            "devices": self.origin.devices,
        }


def check_folder(out: Path, name: str) -> None:
    """Raise InputError unless the study can be written, before anything is measured."""
    check_writable_folder(out, (f"{name}.md", f"{name}.parquet"))
    for folder in (IMAGES, BLOCKS):
        check_writable_folder(out / folder)


def write_study(
    out: Path,
    name: str,
    rows: Sequence[Any],
    origin: Origin,
    document: Callable[[Sequence[Any], Origin], str],
    figures: Mapping[str, str] = MappingProxyType({}),
) -> StudyFiles:
    """Write figures, data and document; the document last, after the files that it refers to."""
    pictures: tuple[Path, ...] = ()
    if figures:
        pictures = write_files(
            out / IMAGES, {f"{figure}.svg": drawn for figure, drawn in figures.items()}
        )
    text, data, kind = f"{name}.md", f"{name}.parquet", type(rows[0])
    with Staging(out, (text, data)) as staging:
        write_rows(kind, rows, origin, staging.folder / data)
        # Read the rows back, so that the file by itself gives the same document again.
        filed, origin = read_rows(kind, staging.folder / data)
        staging.write(text, document(filed, origin))
        staging.commit()
    return StudyFiles(
        document=out / text, data=out / data, figures=pictures, rows=filed, origin=origin
    )
