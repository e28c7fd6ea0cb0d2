"""A plate on disk: a Zarr group with one chunk for each hogel, which is there whole or not at all.

A chunk is written aside and renamed when it is on the disk, and nothing else is written after the group
has been made: a chunk that is whole is a hogel that is finished, whatever happened to the process that
wrote it. What is not whole was damaged from outside, and counts as missing.
"""

from __future__ import annotations

import asyncio
import json
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.abc.store import Store
from zarr.codecs import ZstdCodec
from zarr.core.buffer import Buffer, default_buffer_prototype
from zarr.storage import LocalStore, MemoryStore

from xfrustum.reports.cluster.claims import Claims
from xfrustum.reports.plate.chunks import is_whole
from xfrustum.scenes.disk.durable import Aside, clear, remove_abandoned, sync_folder, write_file
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.plate_content import PlateContent, PlateHogel
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture

ATTRIBUTE = "xfrustum"
"""Attribute of the group that holds everything that decides its pixels."""

SOURCE = "source"
"""Key that says where the scene came from, in the description of the scene: for people, it need not agree."""

COLOR, TRIANGLE = "color", "triangle"
"""Arrays of the group. A hogel is finished with its color, which is written last."""

METADATA = "zarr.json"
"""What Zarr calls the description of a group or an array, in its folder."""

METADATA_BYTES = 1 << 20
"""Largest description that is read; those of plates take some thousand bytes."""

COMPRESSION_LEVEL = 1
"""Level of Zstandard: the same bytes for the same pixels, in a small part of the time that drawing takes."""

Description = Mapping[str, Any]
"""A JSON object as it is read from a file: it may say anything."""


class PlateStore:
    """The hogels of one scene, drawn with one choice of settings.

    Parameters
    ----------
    out
        The group's folder.
    arrays
        Arrays of the group by name, in the order in which a hogel's are written.
    mended
        Names of arrays whose description was damaged and has been written again.
    """

    def __init__(
        self, out: Path, arrays: Mapping[str, zarr.Array[Any]], mended: tuple[str, ...] = ()
    ) -> None:
        self.out = out
        self.mended = mended
        # A hogel that shows nothing is written too: Zarr would leave out a chunk of fill values, and it
        # would count as missing.
        self._arrays = {
            name: array.with_config({"write_empty_chunks": True}) for name, array in arrays.items()
        }

    def finished(self, aperture: Aperture) -> bool:
        """Return whether a hogel has been written and, as far as its layout says, is whole."""
        return all(self._is_whole(name, aperture) for name in self._arrays)

    def damaged(self, aperture: Aperture) -> bool:
        """Return whether there is something of a hogel that is not whole."""
        return any(
            _exists(self._chunk(name, aperture)) and not self._is_whole(name, aperture)
            for name in self._arrays
        )

    def readable(self, aperture: Aperture) -> bool:
        """Return whether all of a finished hogel can be decompressed and is what was written."""
        try:
            for array in self._arrays.values():
                array[aperture.row, aperture.column]
        except (RuntimeError, ValueError, OSError):
            return False
        return True

    def write(self, hogel: PlateHogel) -> None:
        """Write a hogel; afterwards it is finished, and on the disk.

        Raises
        ------
        InputError
            The disk is full or cannot be written.
        """
        column, row = hogel.aperture.index
        with _mendable(self.out):
            for name, array in self._arrays.items():
                _clear_way(self.out, self._chunk(name, hogel.aperture))
                image = hogel.color if name == COLOR else hogel.triangle
                assert image is not None
                array[row, column] = image

    def claims(self) -> Claims:
        """Return what tells processes that draw this plate at once who draws which hogel.

        Raises
        ------
        InputError
            The group cannot be read.
        """
        with _mendable(self.out):
            return Claims(self.out / METADATA)

    def _is_whole(self, name: str, aperture: Aperture) -> bool:
        array = self._arrays[name]
        return is_whole(self._chunk(name, aperture), prod(array.chunks) * array.dtype.itemsize)

    def _chunk(self, name: str, aperture: Aperture) -> Path:
        array = self._arrays[name]
        place = (aperture.row, aperture.column, *(0 for _ in array.shape[2:]))
        return self.out / name / str(array.metadata.encode_chunk_key(place))


def open_store(out: Path, scene: Scene, content: PlateContent, description: Description) -> PlateStore:
    """Open the plate of a scene, or make it; several processes may do so at once.

    What the arrays are follows from the scene. Where their descriptions say something else they were
    damaged, and are written again: nothing that they declare is believed.

    Parameters
    ----------
    out
        A folder that this made before, or that does not exist.
    scene
        Scene that gives plate and resolution, and so the shapes.
    content
        Content that says which arrays there are.
    description
        Everything that decides the pixels.

    Raises
    ------
    InputError
        What exists there is something else, or was drawn from another scene or with other
        settings; or nothing can be written there.
    """
    with _mendable(out):
        place = out.resolve()
        remove_abandoned(place.parent)
        if not _exists(place):
            _make(place, _documents(scene, content, description))
        made_with = _made_with(out, place, json.loads(json.dumps(description)))
        documents = _documents(scene, content, made_with)
        remove_abandoned(place)
        mended = tuple(_mended(place, documents))
        group = zarr.open_group(_DurableStore(place), mode="r+")
        names = [name for name in (TRIANGLE, COLOR) if f"{name}/{METADATA}" in documents]
        return PlateStore(out, {name: _array_of(group, name) for name in names}, mended)


class _DurableStore(LocalStore):
    """A folder of chunks, each on the disk before it has its name; made aside in the folder itself."""

    async def set(self, key: str, value: Buffer) -> None:
        await asyncio.to_thread(self.set_sync, key, value)

    def set_sync(self, key: str, value: Buffer) -> None:
        path = self.root / key
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, value.to_bytes(), host=self.root)


def _documents(scene: Scene, content: PlateContent, description: Description) -> dict[str, bytes]:
    """Return the descriptions of group and arrays that Zarr writes for a scene, by their place."""
    store = MemoryStore()
    group = zarr.create_group(store, attributes={ATTRIBUTE: dict(description)})
    width, height = scene.frustum.resolution
    shape = (*scene.plate.hogels[::-1], height, width)
    names = ("row", "column", "y", "x")
    _array(group, COLOR, (*shape, 3), content.color.dtype, (*names, "rgb"))
    if content.ids:
        _array(group, TRIANGLE, shape, np.dtype(np.int32), names)
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


def _array(
    group: zarr.Group, name: str, shape: tuple[int, ...], dtype: np.dtype[Any], dimensions: tuple[str, ...]
) -> None:
    group.create_array(
        name,
        shape=shape,
        chunks=(1, 1, *shape[2:]),
        dtype=dtype,
        # With a checksum, so that reading a chunk tells whether it is what was written.
        compressors=[ZstdCodec(level=COMPRESSION_LEVEL, checksum=True)],
        fill_value=-1 if name == TRIANGLE else 0,
        dimension_names=dimensions,
    )


def _array_of(group: zarr.Group, name: str) -> zarr.Array[Any]:
    array = group[name]
    assert isinstance(array, zarr.Array)
    return array


def _made_with(out: Path, place: Path, wanted: Description) -> Description:
    """Return the description that a folder was made with; InputError where it is of something else."""
    document = _read_document(place / METADATA)
    attributes = document.get("attributes") if isinstance(document, dict) else None
    found = attributes.get(ATTRIBUTE) if isinstance(attributes, dict) else None
    if found is None:
        raise InputError(f"--out {out}: exists and is no plate of xfrustum; choose another place")
    wanted = _from_where(wanted, found)
    if found != wanted:
        where = ", ".join(_differences(found, wanted))
        raise InputError(
            f"--out {out}: was drawn with another {where}; give what it was drawn with, or another place"
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


def _mended(place: Path, documents: Mapping[str, bytes]) -> Iterator[str]:
    """Write descriptions again that say something else than they must; yield whose they are."""
    for key, content in documents.items():
        if _read_document(place / key) != json.loads(content):
            _clear_way(place, place / key)
            (place / key).parent.mkdir(exist_ok=True)
            write_file(place / key, content, host=place)
            yield key.removesuffix(METADATA).rstrip("/") or "group"


def _read_document(path: Path) -> Any:
    """Return what a description says; None where it is none."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            return None
        with path.open("rb") as file:
            return json.loads(file.read(METADATA_BYTES + 1)[:METADATA_BYTES])
    except (OSError, ValueError, RecursionError):
        return None


def _differences(found: Any, wanted: Any, where: str = "") -> Iterator[str]:
    """Yield the names of what differs, at most one level deep."""
    if not (isinstance(found, dict) and isinstance(wanted, dict)) or "." in where:
        yield where or "description"
        return
    for key in dict.fromkeys((*wanted, *found)):
        if found.get(key) != wanted.get(key):
            yield from _differences(found.get(key), wanted.get(key), f"{where}.{key}" if where else key)


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
