"""A plate on disk: a Zarr group whose shards are blocks of hogels, each file there whole or not at all.

A file is written aside and renamed when it is on the disk, and nothing else is written after the group has
been made: a hogel that a whole file's index names is finished, whatever happened to the process that wrote
it. What is not whole was damaged from outside, and counts as missing. A block is always written as a whole,
by the process that has claimed it: concurrent writes into one shard lose data.
"""

from __future__ import annotations

import asyncio
import json
import stat
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numcodecs.zstd import Zstd
from numpy.typing import NDArray
from zarr.abc.store import Store
from zarr.codecs import ZstdCodec
from zarr.core.buffer import default_buffer_prototype
from zarr.storage import LocalStore, MemoryStore

from xfrustum.reports.cluster.claims import Claims
from xfrustum.reports.parts import differences_words
from xfrustum.reports.plate.chunks import is_whole
from xfrustum.reports.plate.layout import PLATE_DIMENSIONS, Block, BlockPart, Layout, PlateArray, side_of
from xfrustum.reports.plate.measures import (
    JudgedPlateHogel,
    MeasuredHogel,
    Table,
    maps_of,
    merged,
    parquet_of,
)
from xfrustum.reports.plate.shards import BlockFile, assembled, read_places
from xfrustum.scenes.disk.durable import Aside, clear, remove_abandoned, sync_folder, write_file
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.plate_content import Channel, PlateHogel
from xfrustum.scenes.plate.plate import Aperture, Plate

ATTRIBUTE = "xfrustum"
"""Attribute of the group that holds everything that decides its pixels."""

SOURCE = "source"
"""Key that says where the scene came from, in the description of the scene: for people, it need not agree."""

LAYOUT = "layout"
"""Key of the layout in a description: it decides no pixel; a store keeps its own unless one is asked for."""

COLOR, TRIANGLE = Channel.COLOR.value, Channel.TRIANGLE.value
"""Names of the arrays that most readers ask for."""

METADATA = "zarr.json"
"""What Zarr calls the description of a group or an array, in its folder."""

METADATA_BYTES = 1 << 22
"""Largest description that is read; those of plates take some ten thousand bytes."""

COMPRESSION_LEVEL = 1
"""Level of Zstandard: the same bytes for the same pixels, in a small part of the time that drawing takes."""

_COMPRESSOR = Zstd(level=COMPRESSION_LEVEL, checksum=True)
"""Compressor of all pixels. Its checksum tells a reader whether a chunk is what was written."""

MEASURE_TYPE = np.dtype("<f8")
"""Type of all measures: counts are whole numbers in it, and what there is none of is NaN."""

Description = Mapping[str, Any]
"""A JSON object as it is read from a file: it may say anything."""


@dataclass(frozen=True, kw_only=True)
class Encoded:
    """A hogel as it is stored.

    Attributes
    ----------
    images
        Compressed images by the names of their arrays.
    measured
        How it differs from its truth; None where it was not judged.
    """

    images: Mapping[str, bytes]
    measured: MeasuredHogel | None


@dataclass(frozen=True, kw_only=True)
class BlockState:
    """What a store has of some hogels of a block.

    Attributes
    ----------
    missing
        Hogels that are not finished.
    damaged
        Those of them of which something is there that is not whole.
    """

    missing: tuple[Aperture, ...]
    damaged: frozenset[Aperture]


class PlateStore:
    """The hogels of one scene, drawn with one choice of settings.

    Parameters
    ----------
    out
        The group's folder.
    layout
        Arrays of the group and their blocks.
    mended
        Names of arrays whose description was damaged and has been written again.
    """

    def __init__(self, out: Path, layout: Layout, mended: tuple[str, ...] = ()) -> None:
        self.out, self.layout, self.mended = out, layout, mended
        self._arrays = {array.name: array for array in layout.arrays}
        self._place = out.resolve()
        # Beside the group, for nothing but Zarr's own files belongs into it.
        self.table = Table(self._place.with_suffix(".parquet"))

    def state(self, part: BlockPart, *, check: bool = False) -> BlockState:
        """Return which hogels of a block are missing, as far as the layout of files tells.

        With `check` every hogel that seems finished is decompressed too: what is not what was written is
        missing, and damaged.
        """
        files = [self._file(array, part.block) for array in self._arrays.values()]
        measured = self._measured(part.block)
        missing, damaged = [], set()
        for aperture in part.apertures:
            number = part.block.place_of(aperture)
            unmeasured = measured is not None and aperture.index not in measured
            if unmeasured or any(number not in file.places for file in files):
                missing.append(aperture)
                if any(number in file.damaged for file in files):
                    damaged.add(aperture)
            elif check and not self._readable(aperture):
                missing.append(aperture)
                damaged.add(aperture)
        return BlockState(missing=tuple(missing), damaged=frozenset(damaged))

    def encoded(self, hogel: PlateHogel) -> Encoded:
        """Return the compressed images of a hogel."""
        return Encoded(
            images={
                name: _compressed(np.ascontiguousarray(hogel.image(Channel(name)), dtype=array.dtype))
                for name, array in self._arrays.items()
            },
            measured=hogel.measured if isinstance(hogel, JudgedPlateHogel) else None,
        )

    def write(self, block: Block, hogels: Mapping[Aperture, Encoded]) -> None:
        """Add hogels to a block; afterwards they are finished, and on the disk.

        Each array's file is written anew, with what is whole of the file before. Nobody else may write the
        block meanwhile: the caller has claimed it.

        Raises
        ------
        InputError
            The disk is full or cannot be written.
        """
        count = self.layout.hogels_in_block
        with _mendable(self.out):
            for name, array in self._arrays.items():
                path = self._path(array, block)
                _clear_way(self._place, path)
                kept = self._file(array, block).chunks() if count > 1 else {}
                drawn = {block.place_of(aperture): one.images[name] for aperture, one in hogels.items()}
                path.parent.mkdir(parents=True, exist_ok=True)
                write_file(path, assembled({**kept, **drawn}, count), host=self._place)
            if self.layout.measures:
                self._write_measures(block, [one.measured for one in hogels.values() if one.measured])

    def _write_measures(self, block: Block, hogels: Sequence[MeasuredHogel]) -> None:
        """Write the arrays of measures of a block and, as the last of its files, their table."""
        table = merged(self.table.rows(block), hogels)
        maps = maps_of(table, block, [name for name, _ in self.layout.measures])
        for name, values in maps.items():
            path = self._measure_path(name, block)
            _clear_way(self._place, path)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_file(path, _compressed(values), host=self._place)
        self.table.folder.mkdir(exist_ok=True)
        remove_abandoned(self.table.folder)
        write_file(self.table.path(block), parquet_of(table))

    def _measured(self, block: Block) -> set[tuple[int, int]] | None:
        """Return the hogels of a block whose measures are there and whole; None where there are none."""
        if not self.layout.measures:
            return None
        size = self.layout.hogels_in_block * MEASURE_TYPE.itemsize
        if not all(is_whole(self._measure_path(name, block), size) for name, _ in self.layout.measures):
            return set()
        return self.table.measured(block)

    def _measure_path(self, name: str, block: Block) -> Path:
        return self._place / name / "c" / Path(*map(str, block.place))

    def claims(self) -> Claims:
        """Return what tells processes that draw this plate at once who draws which block.

        Raises
        ------
        InputError
            The group cannot be read.
        """
        with _mendable(self.out):
            return Claims(self.out / METADATA)

    def _readable(self, aperture: Aperture) -> bool:
        """Return whether all of a finished hogel can be decompressed and is what was written."""
        group = zarr.open_group(LocalStore(self._place, read_only=True), mode="r")
        try:
            for name in self._arrays:
                array = group[name]
                assert isinstance(array, zarr.Array)
                array[aperture.row, aperture.column]
        except (RuntimeError, ValueError, OSError):
            return False
        return True

    def _file(self, array: PlateArray, block: Block) -> BlockFile:
        return read_places(self._path(array, block), self.layout.hogels_in_block, array.chunk_bytes)

    def _path(self, array: PlateArray, block: Block) -> Path:
        place = (*block.place, *(0 for _ in array.shape))
        return self._place / array.name / "c" / Path(*map(str, place))


def open_store(out: Path, layout: Layout, description: Description, *, free: bool = True) -> PlateStore:
    """Open the plate of a scene, or make it; several processes may do so at once.

    What the arrays are follows from the scene. Where their descriptions say something else they were
    damaged, and are written again: nothing that they declare is believed.

    Parameters
    ----------
    out
        A folder that this made before, or that does not exist.
    layout
        Arrays, and blocks of a new store.
    description
        Everything that decides the pixels.
    free
        Whether the blocks of a store that exists may be others.

    Raises
    ------
    InputError
        What exists there is something else, or was drawn from another scene or with other
        settings; or nothing can be written there.
    """
    wanted = json.loads(json.dumps({**description, LAYOUT: {"block": layout.side}}))
    with _mendable(out):
        place = out.resolve()
        table = place.with_suffix(".parquet")
        if layout.measures and _exists(table) and not table.is_dir():
            raise InputError(
                f"--out {out}: its measures belong into {table}, which is no folder; move that away"
            )
        remove_abandoned(place.parent)
        if not _exists(place):
            _make(place, _documents(layout, wanted))
        made_with = _made_with(out, place, wanted, free=free)
        layout = _layout_of(layout, made_with)
        documents = _documents(layout, made_with)
        remove_abandoned(place)
        mended = tuple(dict.fromkeys(_mended(place, documents)))
        return PlateStore(out, layout, mended)


def _layout_of(layout: Layout, made_with: Description) -> Layout:
    """Return the layout of a store that was made with a description that agrees with what is wanted."""
    if LAYOUT not in made_with:
        return replace(layout, side=(1, 1), labelled=False)
    side = side_of(made_with[LAYOUT], layout.plate)
    assert side is not None, "a layout that is none does not agree"
    return replace(layout, side=side)


def _documents(layout: Layout, description: Description) -> dict[str, bytes]:
    """Return the descriptions of group and arrays that Zarr writes for a layout, by their place."""
    store = MemoryStore()
    # The unit of lengths stands here too, for xarray prints the attributes of groups alone.
    labels = {"coordinates": "x y", "units": layout.units} if layout.labelled else {}
    group = zarr.create_group(store, attributes={**labels, ATTRIBUTE: dict(description)})
    for array in layout.arrays:
        _create(group, array, layout)
    for name, unit in layout.measures:
        group.create_array(
            name,
            shape=layout.plate.hogels[::-1],
            chunks=layout.side[::-1],
            dtype=MEASURE_TYPE,
            compressors=[ZstdCodec(level=COMPRESSION_LEVEL, checksum=True)],
            fill_value=np.nan,
            dimension_names=PLATE_DIMENSIONS,
            attributes={"long_name": name.replace("_", " "), "units": unit},
        )
    if layout.labelled:
        for name, dimension, values, attributes in layout.coordinates():
            group.create_array(
                name,
                data=values,
                chunks=values.shape,
                compressors=None,
                dimension_names=[dimension],
                attributes=dict(attributes),
            )
        with warnings.catch_warnings():
            # The page of Zarr's format does not name these yet; readers that do not know them go on without.
            warnings.simplefilter("ignore", UserWarning)
            zarr.consolidate_metadata(store)
    return asyncio.run(_everything(store))


async def _everything(store: Store) -> dict[str, bytes]:
    found = {}
    async for key in store.list():
        value = await store.get(key, default_buffer_prototype())
        assert value is not None
        found[key] = value.to_bytes()
    return found


def _make(place: Path, documents: Mapping[str, bytes]) -> None:
    """Make an empty group aside and give it its name, unless another process has been faster."""
    with Aside(place.parent, folder=True) as aside:
        group = aside.path / "group"
        for key, content in documents.items():
            (group / key).parent.mkdir(parents=True, exist_ok=True)
            write_file(group / key, content)
        sync_folder(group)
        try:
            # No folder that holds something is replaced by this.
            group.rename(place)
        except OSError:
            if not _exists(place):
                raise
        sync_folder(place.parent)


def _create(group: zarr.Group, array: PlateArray, layout: Layout) -> None:
    """Describe an array: a chunk for each hogel, and a shard for each block of several."""
    columns, rows = layout.side
    group.create_array(
        array.name,
        shape=(*layout.plate.hogels[::-1], *array.shape),
        chunks=(1, 1, *array.shape),
        shards=None if layout.hogels_in_block == 1 else (rows, columns, *array.shape),
        dtype=array.dtype,
        compressors=[ZstdCodec(level=COMPRESSION_LEVEL, checksum=True)],
        fill_value=array.fill,
        dimension_names=array.dimensions,
        attributes=dict(array.attributes),
    )


def _made_with(out: Path, place: Path, wanted: Description, *, free: bool) -> Description:
    """Return the description that a folder was made with; InputError where it is of something else."""
    document = _read_document(place / METADATA)
    attributes = document.get("attributes") if isinstance(document, dict) else None
    found = attributes.get(ATTRIBUTE) if isinstance(attributes, dict) else None
    if found is None:
        raise InputError(f"--out {out}: exists and is no plate of xfrustum; choose another place")
    wanted = _from_where(wanted, found)
    if free or (wanted[LAYOUT] == {"block": [1, 1]} and LAYOUT not in found):
        wanted = _laid_out_as(wanted, found)
    if found != wanted:
        raise InputError(
            f"--out {out}: was drawn with {differences_words(found, wanted)}; "
            "give what it was drawn with, or another place"
        )
    return wanted


def _from_where(wanted: Description, found: Any) -> Description:
    """Return a description with the scene's place taken from another one, for it decides no pixel.

    The place stays as it was when the plate was made, so that folders can be moved and the bytes are those
    of a run that was not disturbed.
    """
    scene = found.get("scene") if isinstance(found, dict) else None
    source = scene.get(SOURCE) if isinstance(scene, dict) else None
    if not isinstance(source, str) or "scene" not in wanted:
        return wanted
    return {**wanted, "scene": {**wanted["scene"], SOURCE: source}}


def _laid_out_as(wanted: Description, found: Any) -> Description:
    """Return a description with the layout of a store, where that is one that a plate can have."""
    if not isinstance(found, dict):
        return wanted
    if LAYOUT not in found:
        return {key: value for key, value in wanted.items() if key != LAYOUT}
    hogels = wanted["plate"]["hogels"]
    plate = Plate(size=(1.0, 1.0), hogels=(hogels[0], hogels[1]))
    return wanted if side_of(found[LAYOUT], plate) is None else {**wanted, LAYOUT: found[LAYOUT]}


def _mended(place: Path, documents: Mapping[str, bytes]) -> Iterator[str]:
    """Write descriptions again that say something else than they must; yield the names of their arrays."""
    for key, content in documents.items():
        if not _says(place / key, content):
            _clear_way(place, place / key)
            (place / key).parent.mkdir(parents=True, exist_ok=True)
            write_file(place / key, content, host=place)
            yield "group" if key == METADATA else key.partition("/")[0]


def _compressed(image: NDArray[Any]) -> bytes:
    return bytes(_COMPRESSOR.encode(image))


def _says(path: Path, content: bytes) -> bool:
    """Return whether a file says the same: descriptions in any form of JSON, coordinates byte by byte."""
    if path.name == METADATA:
        return bool(_read_document(path) == json.loads(content))
    try:
        return path.is_file() and not path.is_symlink() and path.read_bytes() == content
    except OSError:
        return False


def _read_document(path: Path) -> Any:
    """Return what a description says; None where it is none."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            return None
        with path.open("rb") as file:
            return json.loads(file.read(METADATA_BYTES + 1)[:METADATA_BYTES])
    except (OSError, ValueError, RecursionError):
        return None


def _clear_way(group: Path, path: Path) -> None:
    """Remove what keeps a file of a group from being replaced: what is no file, and files for folders."""
    for place in reversed(path.relative_to(group).parents[:-1]):
        if _exists(group / place) and not (group / place).is_dir():
            clear(group / place)
    if path.is_symlink() or not path.is_file():
        clear(path)


def _exists(path: Path) -> bool:
    """Return whether anything has this name, a link that leads nowhere included."""
    return path.exists() or path.is_symlink()


@contextmanager
def _mendable(out: Path) -> Iterator[None]:
    """Turn what the file system refuses into an InputError."""
    try:
        yield
    except OSError as error:
        raise InputError(
            f"--out {out}: cannot write there ({error.strerror or error}); "
            "free some space or choose another place"
        ) from error
