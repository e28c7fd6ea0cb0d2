"""A plate on disk: its arrays and their labels, its blocks of hogels, and the Zarr group that holds them.

This is the only place that draws into the Zarr group of a plate; `exchange.convert` writes a
converted plate row by row. The shards of the group are blocks of hogels. Zarr writes every file
aside and renames it. The array `finished` says which hogels are there; its part of a block is
written after all others, so that whatever ends a process, a hogel that it calls finished is. What a
process that was killed may leave is a file `*.partial`, which the next command on the plate
removes, and beside it a part of the measures, which the next one that writes measures removes
(`scenes.disk`).

Concurrent writers of one shard would lose each other's hogels (zarr-python 3682). So a part of a
block is read, completed and written under an exclusive lock on the group's description. Whole
blocks are written under a shared lock, for every process has the same bytes of them.
"""

from __future__ import annotations

import fcntl
import io
import json
import math
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import zarr
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError
from zarr.abc.store import ByteRequest, Store
from zarr.codecs import ZstdCodec
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import LocalStore, MemoryStore

from xfrustum.compare.metrics.comparison import ComparisonNumbers
from xfrustum.interrupts import delayed
from xfrustum.reference.lines.lines import film_window
from xfrustum.reports.common.outputs import Staging, refused
from xfrustum.reports.common.records import named_columns, table_of
from xfrustum.reports.parts import differences_words
from xfrustum.scenes import NOTHING, Certainty, DoubleFrustum, Frustum, HogelCamera, InputError
from xfrustum.scenes.disk.durable import new_file
from xfrustum.scenes.disk.input_files import read_input
from xfrustum.scenes.model.plate_content import Channel, PlateContent, PlateHogel
from xfrustum.scenes.plate.plate import Aperture, ApertureBlocks, Plate

BLOCK_BYTES = 1 << 26
"""Largest size of a block's pixels by default, before they are compressed: what one process has in memory
while it fills a shard."""

MAX_BLOCK_SIDE = 16
"""Largest number of columns and of rows of a block by default: 256 hogels are lost at most when a process is
killed, and a plate of ten million hogels has 40,000 files for each of its arrays."""

PLATE_DIMENSIONS = ("row", "column")  # the first two of every array

_CERTAINTY = "how the pixel was decided: 0 proven, 1 exact, 2 tie, 3 not examined"
_IMAGES: Mapping[Channel, tuple[str, Any, tuple[str, ...], str]] = {
    Channel.COLOR: ("", 0, ("v", "u", "rgb"), "linear radiance"),
    Channel.TRIANGLE: (
        "<i4",
        NOTHING,
        ("v", "u"),
        "number of the visible triangle, -1 where there is none",
    ),
    Channel.HEIGHT: ("<f4", np.nan, ("v", "u"), "height of the visible surface above the plate"),
    Channel.NORMAL: ("<f4", np.nan, ("v", "u", "xyz"), "unit normal of the visible triangle"),
    Channel.CERTAINTY: ("u1", int(Certainty.UNEXAMINED), ("v", "u"), _CERTAINTY),
}
"""Type, value of what is missing, dimensions and meaning of each image; the type of color is asked for."""


SOURCE = "source"
"""Key that says where the scene came from, in the description of the scene: for people, it need not agree."""


PLACES = ("column", "row", "x", "y")
"""Columns of a table of measures that say which hogel a row is about; all others are measures."""


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


@dataclass(frozen=True, kw_only=True)
class ImageArray:
    """One array of a plate's store: an image of some shape for every hogel; `fill` where it was not drawn."""

    name: str
    dtype: np.dtype[Any]
    fill: Any
    shape: tuple[int, ...]
    dimensions: tuple[str, ...]
    attributes: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class Block:
    """A rectangle of hogels that lie in one shard of every array, and those of them that are asked for."""

    number: int  # row by row from the top left
    columns: range
    rows: range
    apertures: tuple[Aperture, ...]

    @property
    def selection(self) -> tuple[slice, slice]:
        """Its part of an array."""
        return slice(self.rows.start, self.rows.stop), slice(self.columns.start, self.columns.stop)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.rows), len(self.columns)

    def place_of(self, aperture: Aperture) -> tuple[int, int]:
        """Return row and column within the block."""
        return aperture.row - self.rows.start, aperture.column - self.columns.start


@dataclass(frozen=True, kw_only=True)
class Layout:
    """The arrays of a store and their division into blocks."""

    plate: Plate
    frustum: Frustum
    units: str
    content: PlateContent
    side: tuple[int, int]  # columns and rows of a block
    measures: tuple[tuple[str, str], ...] = ()  # name and unit of each, where hogels are judged

    @cached_property
    def arrays(self) -> tuple[ImageArray, ...]:
        """The arrays in the order in which a block's are written."""
        arrays, units = [], {Channel.HEIGHT: self.units, Channel.COLOR: "1", Channel.NORMAL: "1"}
        for channel in self.content.channels:
            kind, fill, dimensions, meaning = _IMAGES[channel]
            dtype = self.content.color.dtype if channel is Channel.COLOR else np.dtype(kind)
            if dtype == np.uint8 and channel is Channel.COLOR:
                meaning = f"{meaning} from 0 to 1 times 255, rounded"
            array = ImageArray(
                name=channel,
                dtype=dtype,
                fill=fill,
                shape=(*self.frustum.resolution[::-1], *(3 for _ in dimensions[2:])),
                dimensions=(*PLATE_DIMENSIONS, *dimensions),
                attributes={"long_name": meaning}
                | ({"units": units[channel]} if channel in units else {}),
            )
            arrays.append(array)
        return tuple(arrays)

    @property
    def hogel_bytes(self) -> int:
        """Size of all images of a hogel before they are compressed."""
        return sum(map(self.array_bytes, self.arrays))

    def array_bytes(self, array: ImageArray) -> int:
        """Return the size of one image of a hogel before it is compressed."""
        return math.prod(array.shape) * array.dtype.itemsize

    def coordinates(self) -> Iterator[tuple[str, str, NDArray[Any], str, Mapping[str, str]]]:
        """Yield name, dimension, values, meaning and unit of every coordinate."""
        columns, rows = self.plate.hogels
        width, height = self.frustum.resolution
        x = np.array([self.plate.aperture(column, 0).x for column in range(columns)])
        y = np.array([self.plate.aperture(0, row).y for row in range(rows)])
        u, v = (2 * np.arange(width) + 1) / width - 1, 1 - (2 * np.arange(height) + 1) / height
        length, film = {"units": self.units}, {"units": "1"}
        yield "column", "column", np.arange(columns), "column of the hogel, from the left", {}
        yield "row", "row", np.arange(rows), "row of the hogel, from the top", {}
        yield "x", "column", x, "x of the aperture", length
        yield "y", "row", y, "y of the aperture", length
        yield "u", "u", u, "film coordinate of the pixel's center, to the right", film
        yield "v", "v", v, "film coordinate of the pixel's center, upward", film

    def blocks(self, apertures: Iterable[Aperture]) -> Iterator[Block]:
        """Yield the blocks of the hogels asked for as first named; rectangles are listed block by block."""
        (width, height), hogels = self.side, self.plate.hogels
        across = -(-hogels[0] // width)
        named: dict[int, list[Aperture]] = {}
        if isinstance(apertures, ApertureBlocks):
            for columns, rows in apertures.blocks:
                for row in range(rows.start // height, -(-rows.stop // height)):
                    first, last = (
                        row * across + end // width for end in (columns.start, columns.stop - 1)
                    )
                    named |= {number: [] for number in range(first, last + 1)}
        else:
            for one in dict.fromkeys(apertures):
                named.setdefault(one.row // height * across + one.column // width, []).append(one)
        for number, some in named.items():
            row, column = divmod(number, across)
            columns = range(column * width, min((column + 1) * width, hogels[0]))
            rows = range(row * height, min((row + 1) * height, hogels[1]))
            inside = some or [
                one
                for j in rows
                for i in columns
                if (one := self.plate.aperture(i, j)) in apertures
            ]
            yield Block(number=number, columns=columns, rows=rows, apertures=tuple(inside))


def default_side(plate: Plate, frustum: Frustum, content: PlateContent) -> tuple[int, int]:
    """Return the columns and rows of the largest block, a power of two, that `BLOCK_BYTES` hold."""
    whole = Layout(plate=plate, frustum=frustum, units="", content=content, side=(1, 1))
    side = MAX_BLOCK_SIDE
    while side > 1 and side * side * whole.hogel_bytes > BLOCK_BYTES:
        side //= 2
    return min(side, plate.hogels[0]), min(side, plate.hogels[1])


def side_of(found: object, plate: Plate) -> tuple[int, int] | None:
    """Return the columns and rows of a block as a store's description has them; None where it has none."""
    side = found.get("block") if isinstance(found, dict) else None
    if not (
        isinstance(side, Sequence) and len(side) == 2 and all(type(count) is int for count in side)
    ):
        return None
    columns, rows = side
    inside = 1 <= columns <= plate.hogels[0] and 1 <= rows <= plate.hogels[1]
    return (columns, rows) if inside else None


ATTRIBUTE = "xfrustum"  # of the group, holds everything that decides its pixels
# key of a description that decides no pixel; a store keeps its own unless one is asked for
LAYOUT = "layout"
COLOR, TRIANGLE = Channel.COLOR.value, Channel.TRIANGLE.value  # arrays that most readers ask for
FINISHED = "finished"  # array over (row, column) that is 1 where a hogel is there
METADATA = "zarr.json"  # what Zarr calls the description of a group or an array, in its folder

COMPRESSOR = ZstdCodec(level=1, checksum=True)
"""Compressor of everything: level 1 takes a small part of the time that drawing takes; the checksum tells a
reader whether a chunk is what was written."""

DAMAGE = (
    OSError,
    RuntimeError,
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    ArithmeticError,
)
"""What Zarr raises of files that are not what was written: codecs, JSON and checksums have errors of their
own."""


class _RegularFiles(LocalStore):
    """A folder of which regular files alone are read: a FIFO would keep its reader waiting."""

    async def get(
        self,
        key: str,
        prototype: BufferPrototype | None = None,
        byte_range: ByteRequest | None = None,
    ) -> Buffer | None:
        path = self.root / key
        if path.exists() and not path.is_file():
            raise OSError(f"{path} is no regular file")
        return await super().get(key, prototype, byte_range)


def open_group(place: Path, mode: str = "r") -> zarr.Group:
    """Open the Zarr group in a folder; InputError where there is none, or its description is damaged."""
    try:
        return _opened(place, mode)
    except DAMAGE as error:
        raise InputError(
            f"{place}: is no plate that can be read ({told(error)}); draw one with `xfrustum plate`"
        ) from error


def _opened(place: Path, mode: str, *, consolidated: bool | None = None) -> zarr.Group:
    files = _RegularFiles(place.resolve(), read_only=mode == "r")
    return zarr.open_group(files, mode=mode, use_consolidated=consolidated)  # type: ignore[arg-type]


def told(error: Exception) -> str:
    """Return what Zarr says of damage, in one short line."""
    return f"{' '.join(str(error).split()) or type(error).__name__:.200}"


@dataclass(frozen=True)
class Table:
    """The measures of a plate's hogels, a Parquet file for each block; the same plate has the same bytes."""

    folder: Path

    def path(self, block: Block) -> Path:
        """Return the file of a block."""
        return self.folder / f"block-{block.number:08}.parquet"

    def rows(self, block: Block) -> list[dict[str, Any]]:
        """Return the rows of a block, by row and column; none where its file is missing or damaged."""
        try:
            found = pq.read_table(io.BytesIO(read_input(self.path(block), "table")))
        except (InputError, OSError, pa.ArrowException, ValueError):
            return []
        return list(found.to_pylist()) if set(PLACES) <= set(found.column_names) else []

    def add(self, block: Block, hogels: Iterable[MeasuredHogel]) -> list[dict[str, Any]]:
        """Write and return the rows of a block with those of some hogels, in the place of older ones."""
        added = table_of(MeasuredHogel, list(hogels))
        before = [row for row in self.rows(block) if row.keys() == set(added.column_names)]
        rows = {(row["row"], row["column"]): row for row in (*before, *added.to_pylist())}
        merged = [rows[place] for place in sorted(rows)]
        self.folder.mkdir(exist_ok=True)
        with new_file(self.path(block)) as aside:
            # From plain values, so that equal rows make equal bytes, whatever tables they come
            # from.
            pq.write_table(pa.Table.from_pylist(merged, schema=added.schema), aside)
        return merged


def require_described(place: Path, layout: Layout) -> None:
    """Raise InputError unless the arrays of a plate, and their labels, are those of its layout.

    Shapes, types, fill values, dimensions and units are compared, and the values of coordinates:
    every file that is gone reads as zeros. The copies of the descriptions in the group's own file
    are compared, too.
    """
    expected = _make(MemoryStore(), layout, {})
    for consolidated in (True, False):
        try:
            group = _opened(place, "r", consolidated=consolidated)
            _require_alike(group, expected, layout)
        except _Differs as differs:
            raise InputError(
                f"{place}: {differs}; draw the plate again, at another place, or bring its files back"
            ) from differs
        except DAMAGE as error:
            if consolidated and "onsolidated" in str(error):  # which readers of Zarr need not have
                continue
            raise InputError(
                f"{place}: is damaged ({told(error)}); draw the plate at another place"
            ) from error


class _Differs(Exception):
    """An array that is not as the scene says, in words."""


def _require_alike(group: zarr.Group, expected: zarr.Group, layout: Layout) -> None:
    values = {name: found for name, _, found, _, _ in layout.coordinates()}
    if group.attrs.get("units") != layout.units:
        raise _Differs(f"its units are {group.attrs.get('units')}, and the scene's {layout.units}")
    for name in expected.array_keys():
        if name == FINISHED and name not in group:  # plates of version 0.2
            continue
        if name not in group:
            raise _Differs(f"has no array {name}")
        found, wanted = (_declared(one[name]) for one in (group, expected))
        for key in wanted:
            if found[key] != wanted[key]:
                raise _Differs(f"{key} of {name} is {found[key]}, and should be {wanted[key]}")
        if name in values:
            stored = np.asarray(group[name][:])  # type: ignore[index]
            if wrong := int(np.count_nonzero(stored != values[name])):
                place = int(np.flatnonzero(stored != values[name])[0])
                raise _Differs(
                    f"{wrong:,} of {stored.size:,} values of {name} are not the scene's: "
                    f"{name}[{place}] is {stored[place]:.6g}, and should be {values[name][place]:.6g}"
                )


def _declared(array: Any) -> dict[str, str]:
    """Return what the description of an array declares of its values."""
    said = array.metadata.to_dict()
    keys = ("shape", "data_type", "fill_value", "dimension_names")
    facts = {key.replace("_", " "): json.dumps(said.get(key), default=str) for key in keys}
    return facts | {"units": json.dumps(said.get("attributes", {}).get("units"))}


def has_shard(place: Path, array: Any, column: int, row: int) -> bool:
    """Return whether the file that holds a hogel of a plate's array exists."""
    return shard_file(place, array, column, row).is_file()


def shard_file(place: Path, array: Any, column: int, row: int) -> Path:
    """Return the file that holds a hogel of a plate's array."""
    side = (array.shards or array.chunks)[:2]
    number = (row // side[0], column // side[1], *(0 for _ in array.shape[2:]))
    return place / str(array.basename) / str(array.metadata.encode_chunk_key(number))


class PlateStore:
    """The hogels of one scene, drawn with one choice of settings, for those who write it."""

    def __init__(self, out: Path, layout: Layout) -> None:
        # The blocks are those of the store, whatever a new one would have.
        side = side_of((said_by(out) or {}).get(LAYOUT), layout.plate)
        self.out, self.layout = out, layout if side is None else replace(layout, side=side)
        self._place = out.resolve()
        require_described(out, self.layout)
        group, expected = open_group(out, "r+"), _make(MemoryStore(), self.layout, {})

        def array(name: str) -> zarr.Array[Any]:
            try:
                found: Any = group[name]
                # Nothing that it declares is believed: a shape of 10^12 hogels, for instance.
                said, wanted = (
                    json.dumps(one.metadata.to_dict(), sort_keys=True, default=str)
                    for one in (found, expected[name])
                )
                if said != wanted:
                    raise ValueError(name)
            except DAMAGE as error:
                raise InputError(
                    f"--out {out}: the description of {name} is damaged; draw the plate at another place"
                ) from error
            # What is black is written like any other hogel.
            return found.with_config({"write_empty_chunks": True})  # type: ignore[no-any-return]

        self._finished = array(FINISHED)
        self._arrays = {one.name: array(one.name) for one in self.layout.arrays}
        self._maps = {name: array(name) for name, _ in layout.measures}
        # Beside the group, for nothing but Zarr's own files belongs into it.
        self.table = Table(self._place.with_suffix(".parquet"))

    def missing(self, block: Block, *, check: bool = False) -> tuple[tuple[Aperture, ...], int]:
        """Return a block's unfinished hogels, and how many are damaged, which only `check` finds."""
        flags, files = (
            self._flags(block),
            all(self._shard(array, block).is_file() for array in self._arrays),
        )
        measured = (
            {(row["column"], row["row"]) for row in self.table.rows(block)} if self._maps else None
        )
        missing, damaged = [], 0
        for aperture in block.apertures:
            there = bool(flags[block.place_of(aperture)]) and files
            there = there and (measured is None or aperture.index in measured)
            if there and check:
                try:
                    for array in (*self._arrays.values(), *self._maps.values()):
                        array[aperture.row, aperture.column]
                except DAMAGE:
                    damaged, there = damaged + 1, False
            if not there:
                missing.append(aperture)
        return tuple(missing), damaged

    def write(self, block: Block, hogels: Mapping[Aperture, PlateHogel]) -> None:
        """Add hogels to a block; afterwards they are finished. InputError where the disk is full."""
        rows, columns = block.shape
        told = f"--out {self.out}: cannot write there"
        with refused(told), (self._place / METADATA).open("r+b") as lock:
            fcntl.flock(lock, fcntl.LOCK_SH if len(hogels) == rows * columns else fcntl.LOCK_EX)
            flags = self._flags(block)
            for aperture in hogels:
                flags[block.place_of(aperture)] = 0
            kept = [tuple(place) for place in np.argwhere(flags)]
            for array in self.layout.arrays:
                stored = self._arrays[array.name]
                values = np.full((*block.shape, *array.shape), array.fill, array.dtype)
                for row, column in kept:
                    try:
                        values[row, column] = stored[block.rows[row], block.columns[column]]
                    except DAMAGE:
                        flags[row, column] = 0  # it is drawn again by whoever asks for it
                for aperture, hogel in hogels.items():
                    values[block.place_of(aperture)] = hogel.image(Channel(array.name))
                try:
                    stored[block.selection] = values
                except ValueError:
                    # Zarr reads the index of a shard that is there, and this one is damaged.
                    self._shard(array.name, block).unlink()
                    stored[block.selection] = values
            if self._maps:
                judged = [
                    one.measured for one in hogels.values() if isinstance(one, JudgedPlateHogel)
                ]
                measured = self.table.add(block, judged)
                for name, stored in self._maps.items():
                    values = np.full(block.shape, np.nan)
                    for one in measured:
                        if one[name] is not None:
                            place = (
                                one["row"] - block.rows.start,
                                one["column"] - block.columns.start,
                            )
                            values[place] = one[name]
                    stored[block.selection] = values
            for aperture in hogels:
                flags[block.place_of(aperture)] = 1
            self._finished[block.selection] = flags

    def remove_partial(self) -> None:
        """Remove what processes that were killed have left, unless somebody is writing just now."""
        with (self._place / METADATA).open("r+b") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                return
            for path in self._place.rglob("*.partial"):
                path.unlink(missing_ok=True)

    def _flags(self, block: Block) -> NDArray[np.uint8]:
        """Return which hogels of a block are finished, (rows, columns); none where that is damaged."""
        try:
            return np.array(self._finished[block.selection], np.uint8)
        except DAMAGE:
            return np.zeros(block.shape, np.uint8)

    def _shard(self, name: str, block: Block) -> Path:
        return shard_file(self._place, self._arrays[name], block.columns.start, block.rows.start)


def open_store(
    out: Path, layout: Layout, description: Mapping[str, Any], *, free: bool = True
) -> PlateStore:
    """Open the plate of a scene, or make it; several processes may do so at once.

    Where blocks are `free`, a store keeps its own. InputError where it was drawn from another scene
    or with other settings, is something else, or is damaged.
    """
    wanted: dict[str, Any] = json.loads(json.dumps({**description, LAYOUT: {"block": layout.side}}))
    table = out.resolve().with_suffix(".parquet")
    if layout.measures and table.exists() and not table.is_dir():
        raise InputError(
            f"--out {out}: its measures belong into {table}, which is no folder; move that away"
        )
    if not out.exists():
        try:
            # Zarr writes from a thread of its own, which would go on making files after an
            # interrupt.
            with Staging(out) as staging, delayed():
                _make(LocalStore(staging.folder), layout, wanted)
                # No folder that holds something is replaced by this: another process may have been
                # faster.
                staging.folder.rename(out.resolve())
        except InputError:
            if not (out / METADATA).is_file():
                raise
    found = said_by(out)
    if found is None:
        raise InputError(f"--out {out}: exists and is no plate of xfrustum; choose another place")
    # The place of the scene stays as it was, so that folders can be moved and bytes do not change.
    scene = found.get("scene")
    if isinstance(scene, dict) and SOURCE in scene:
        wanted = {**wanted, "scene": {**wanted["scene"], SOURCE: scene[SOURCE]}}
    if free and side_of(found.get(LAYOUT), layout.plate) is not None:
        wanted = {**wanted, LAYOUT: found[LAYOUT]}
    if found != wanted:
        raise InputError(
            f"--out {out}: was drawn with {differences_words(found, wanted)}; "
            "give what it was drawn with, or another place"
        )
    store = PlateStore(out, layout)
    store.remove_partial()
    return store


def said_by(out: Path) -> dict[str, Any] | None:
    """Return what a store says of its plate; None where it is none of ours."""
    try:
        found = open_group(out).attrs.get(ATTRIBUTE)
    except InputError:
        return None
    return found if isinstance(found, dict) else None


def _make(store: Store, layout: Layout, description: Mapping[str, Any]) -> zarr.Group:
    """Make an empty group: a chunk for each hogel, and a shard for each block of several."""
    columns, rows = layout.side
    # The unit of lengths stands here too, for xarray prints the attributes of groups alone.
    attributes = {"coordinates": "x y", "units": layout.units, ATTRIBUTE: dict(description)}
    group = zarr.create_group(store, attributes=attributes)
    for array in layout.arrays:
        group.create_array(
            array.name,
            shape=(*layout.plate.hogels[::-1], *array.shape),
            chunks=(1, 1, *array.shape),
            shards=None if rows == columns == 1 else (rows, columns, *array.shape),
            dtype=array.dtype,
            compressors=[COMPRESSOR],
            fill_value=array.fill,
            dimension_names=array.dimensions,
            attributes=dict(array.attributes),
        )
    maps = [(name, "<f8", np.nan, name.replace("_", " "), unit) for name, unit in layout.measures]
    for name, dtype, fill, meaning, unit in (
        *maps,
        (FINISHED, "u1", 0, "1 where the hogel is there", "1"),
    ):
        group.create_array(
            name,
            shape=layout.plate.hogels[::-1],
            chunks=(rows, columns),
            dtype=dtype,
            compressors=[COMPRESSOR],
            fill_value=fill,
            dimension_names=PLATE_DIMENSIONS,
            attributes={"long_name": meaning, "units": unit},
        )
    for name, dimension, values, meaning, units in layout.coordinates():
        group.create_array(
            name,
            data=values,
            chunks=values.shape,
            compressors=None,
            dimension_names=[dimension],
            attributes={"long_name": meaning, **units},
        )
    with warnings.catch_warnings():
        # Consolidated metadata are no part of Zarr's format 3 yet; readers that know them are
        # faster.
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(store)
    return group


def camera_of(store: Any, column: int, row: int) -> HogelCamera:
    """Return the crossed frustum of a hogel of a plate, in full double precision.

    The line of film coordinates u, v is (x, y, 0) + s (kx + u tx, ky + v ty, -1), with the aperture
    x, y, the shear k and the half-extent t. It has the settings that the plate was drawn with. The
    store is a folder, or the plate as `zarr.open_group` or `xarray.open_zarr` opens it.

    InputError where there is no plate, or no such hogel on it.
    """
    in_folder = isinstance(store, str | Path)
    said = said_by(Path(store)) if in_folder else store.attrs.get(ATTRIBUTE)
    name = store if in_folder else "the store"
    if not isinstance(said, Mapping):
        raise InputError(
            f"{name}: is no plate of xfrustum; give one that `xfrustum plate` has made"
        )
    try:
        plate = TypeAdapter(Plate).validate_python(said["plate"])
        frustum = TypeAdapter(Frustum).validate_python(said["frustum"])
        settings = TypeAdapter(DoubleFrustum | None).validate_python(said.get("settings"))
        scene, renderer = said["scene"], said["renderer"]
        source, scene_hash, device = str(scene[SOURCE]), str(scene["hash"]), str(renderer["device"])
    except (KeyError, TypeError, ValidationError, InputError) as error:
        raise InputError(
            f"{name}: the description of the plate is damaged; draw it again"
        ) from error
    aperture = plate.aperture(column, row)
    shear, half_extent = film_window(frustum, aperture)
    return HogelCamera(
        aperture=aperture,
        resolution=frustum.resolution,
        shear=shear,
        half_extent=half_extent,
        reach=frustum.reach,
        scene=source,
        scene_hash=scene_hash,
        renderer=device,
        settings=settings,
    )
