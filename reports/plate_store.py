"""A plate on disk: a Zarr group with one chunk for each hogel, which is there whole or not at all.

Zarr writes a chunk aside and renames it, and nothing else is written after the group has been made:
a chunk that exists is a hogel that is finished, whatever happened to the process that wrote it.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import ZstdCodec

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.plate import Aperture
from xfrustum.scenes.plate_content import PlateContent, PlateHogel
from xfrustum.scenes.scene import Scene

ATTRIBUTE = "xfrustum"
"""Of the group: everything that decides its pixels."""

COLOR, TRIANGLE = "color", "triangle"
"""Arrays of the group. A hogel is finished with its color, which is written last."""

COMPRESSION_LEVEL = 1
"""Of Zstandard: the same bytes for the same pixels, at a small part of the time that drawing takes."""

Description = Mapping[str, Any]
"""What JSON can hold."""


class PlateStore:
    """The hogels of one scene, drawn with one choice of settings.

    Parameters
    ----------
    out
        The group's folder.
    group
        The group in it.
    """

    def __init__(self, out: Path, group: zarr.Group) -> None:
        self.out = out
        # In the order in which they are written. A hogel that shows nothing is written too: Zarr would
        # leave out a chunk of fill values, and it would count as missing.
        self._arrays = {
            name: _array_of(group, name).with_config({"write_empty_chunks": True})
            for name in (TRIANGLE, COLOR)
            if name in group
        }

    def finished(self, aperture: Aperture) -> bool:
        """Return whether the hogel of an aperture has been written."""
        return self._chunk(COLOR, aperture).exists()

    def write(self, hogel: PlateHogel) -> None:
        """Write a hogel; afterwards it is finished.

        Raises
        ------
        InputError
            The disk is full or cannot be written.
        """
        column, row = hogel.aperture.index
        images: dict[str, Any] = {COLOR: hogel.color, TRIANGLE: hogel.triangle}
        with _mendable(self.out):
            for name, array in self._arrays.items():
                # What a killed process left in the middle of writing.
                for partial in self._chunk(name, hogel.aperture).parent.glob("*.partial"):
                    partial.unlink()
                array[row, column] = images[name]

    def _chunk(self, name: str, aperture: Aperture) -> Path:
        array = self._arrays[name]
        place = (aperture.row, aperture.column, *(0 for _ in array.shape[2:]))
        return self.out / name / str(array.metadata.encode_chunk_key(place))


def open_store(out: Path, scene: Scene, content: PlateContent, description: Description) -> PlateStore:
    """Open the plate of a scene, or make it.

    Parameters
    ----------
    out
        A folder that this made before, or that does not exist.
    scene
        Its plate and resolution give the shapes.
    content
        Which arrays there are.
    description
        Everything that decides the pixels.

    Raises
    ------
    InputError
        What exists there is something else, or was drawn from another scene or with other
        settings; or nothing can be written there.
    """
    with _mendable(out):
        if not out.exists():
            _make(out, scene, content, description)
        return PlateStore(out, _opened(out, description))


def _make(out: Path, scene: Scene, content: PlateContent, description: Description) -> None:
    """Make an empty group aside and rename it."""
    aside = out.with_name(f".{out.name}.new")
    shutil.rmtree(aside, ignore_errors=True)
    group = zarr.create_group(aside, attributes={ATTRIBUTE: dict(description)})
    width, height = scene.frustum.resolution
    shape = (*scene.plate.hogels[::-1], height, width)
    names = ("row", "column", "y", "x")
    _array(group, COLOR, (*shape, 3), content.color.dtype, (*names, "rgb"))
    if content.ids:
        _array(group, TRIANGLE, shape, np.dtype(np.int32), names)
    aside.rename(out)


def _array(
    group: zarr.Group, name: str, shape: tuple[int, ...], dtype: np.dtype[Any], dimensions: tuple[str, ...]
) -> None:
    group.create_array(
        name,
        shape=shape,
        chunks=(1, 1, *shape[2:]),
        dtype=dtype,
        compressors=[ZstdCodec(level=COMPRESSION_LEVEL)],
        fill_value=-1 if name == TRIANGLE else 0,
        dimension_names=dimensions,
    )


def _array_of(group: zarr.Group, name: str) -> zarr.Array[Any]:
    array = group[name]
    assert isinstance(array, zarr.Array)
    return array


def _opened(out: Path, description: Description) -> zarr.Group:
    try:
        if not out.is_dir():
            raise NotADirectoryError(out)
        group = zarr.open_group(out, mode="r+")
        found = group.attrs[ATTRIBUTE]
    # Zarr's own errors are ValueErrors, and some of them OSErrors too.
    except (KeyError, ValueError, NotADirectoryError) as error:
        raise InputError(f"--out {out}: exists and is no plate of xfrustum; choose another place") from error
    wanted = json.loads(json.dumps(description))
    if found != wanted:
        where = ", ".join(_differences(found, wanted))
        raise InputError(
            f"--out {out}: was drawn with another {where}; give what it was drawn with, or another place"
        )
    return group


def _differences(found: Any, wanted: Any, where: str = "") -> Iterator[str]:
    """Yield the names of what differs, at most one level deep."""
    if not (isinstance(found, dict) and isinstance(wanted, dict)) or "." in where:
        yield where or "description"
        return
    for key in dict.fromkeys((*wanted, *found)):
        if found.get(key) != wanted.get(key):
            yield from _differences(found.get(key), wanted.get(key), f"{where}.{key}" if where else key)


@contextmanager
def _mendable(out: Path) -> Iterator[None]:
    """Turn what the file system refuses into an InputError."""
    try:
        yield
    except OSError as error:
        raise InputError(
            f"--out {out}: cannot write there ({error.strerror}); free some space or choose another place"
        ) from error
