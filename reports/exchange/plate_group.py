"""Plates in Zarr groups, as arrays of pixels.

This is the only place where the exchange touches the store of plates: it reads the arrays that
CONVENTIONS.md, "Plates", describes, and writes groups with the same arrays.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import ZstdCodec

from xfrustum.reports.plate.shards import read_places
from xfrustum.scenes.arrays import Bytes, Numbers
from xfrustum.scenes.disk.input_files import check_allowed
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.layouts import Pixels, PlateShape
from xfrustum.scenes.files.pictures import BYTE_LEVELS
from xfrustum.scenes.files.plate_files import PlateRows, Plates, empty_row, whole_plate

METADATA = "zarr.json"
"""Name of the file in the folder of a Zarr group of format 3."""

LAYOUT_ATTRIBUTE = "xfrustum:converted"
"""Attribute of groups that were converted, which says from what; groups that `plate` draws have another."""

COMPRESSION_LEVEL = 1
"""Level of Zstandard, as in plates that are drawn."""


_DAMAGE = (OSError, RuntimeError, ValueError, TypeError, LookupError, AttributeError, ArithmeticError)
"""Exceptions that Zarr and its codecs raise at metadata and chunks that were damaged."""


@contextmanager
def _reading(place: Path) -> Iterator[None]:
    """Turn what Zarr raises at a damaged group into an InputError of one line."""
    try:
        yield
    except _DAMAGE as error:
        told = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{place}: is no plate that can be read ({told:.200}); write it again") from error


def _check_regular(folder: Path) -> None:
    """Refuse a folder with pipes, devices or sockets in it: reading a pipe waits for ever."""
    try:
        for inside, _, names in os.walk(folder, onerror=_raised):
            for name in names:
                path = Path(inside) / name
                if not path.is_file():
                    raise InputError(f"{path}: is no regular file; take it out of the Zarr group")
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read ({error.strerror})") from error


def _raised(error: OSError) -> None:
    raise error


class PlateArray(StrEnum):
    """The arrays of a plate."""

    COLOR = "color"
    TRIANGLE = "triangle"


def is_group(place: Path) -> bool:
    """Return whether a folder is a Zarr group."""
    return (place / METADATA).is_file()


@dataclass(frozen=True, kw_only=True, eq=False)
class GroupRows:
    """The pixels of a plate in a Zarr group, read row by row.

    Attributes
    ----------
    place
        Folder of the group.
    stored, array
        Array of the group, and its name.
    shape, levels, dtype
        As in `PlateRows`.
    """

    place: Path
    stored: zarr.Array[Any]
    array: PlateArray
    shape: PlateShape
    levels: int | None
    dtype: np.dtype[Any]

    def row(self, number: int) -> Pixels:
        """Return the pixels of a row of hogels.

        Raises
        ------
        InputError
            The group cannot be read, or a number of a triangle is too large for pixels.
        """
        pixels = empty_row(self)
        for column in range(self.shape.hogels[0]):
            with _reading(self.place):
                hogel: Any = self.stored[number, column]
            pixels[column] = hogel if self.array is PlateArray.COLOR else packed(hogel)
        return pixels


def read_group(place: Path, array: PlateArray | None) -> tuple[Plates, PlateArray]:
    """Return all pixels of a plate in a Zarr group, and the array that they come from; see `open_group`."""
    rows = open_group(place, array)
    return whole_plate(rows), rows.array


def open_group(place: Path, array: PlateArray | None) -> GroupRows:
    """Return the pixels of a plate in a Zarr group, and the array that they come from, to be read by rows.

    Parameters
    ----------
    place
        Folder of the group.
    array
        Array to be read; None for colors where there are any, else for numbers of triangles. Numbers become
        pixels as in `--encoding triangle-id`.

    Raises
    ------
    InputError
        The folder is no plate, or its arrays are of another kind.
    """
    _check_regular(place)
    with _reading(place):
        group = zarr.open_group(place, mode="r")
        names = [name for name in PlateArray if name in group]
        chosen = array or (names[0] if names else PlateArray.COLOR)
        if chosen not in names:
            raise InputError(f"{place}: has no array {chosen}; is it a plate that `xfrustum plate` drew?")
        stored = group[chosen]
    dimensions = 5 if chosen is PlateArray.COLOR else 4
    if not isinstance(stored, zarr.Array) or stored.ndim != dimensions or stored.dtype.kind not in "uif":
        raise InputError(f"{place}: array {chosen} is not that of a plate")
    rows, columns, height, width = (int(count) for count in stored.shape[:4])
    shape = PlateShape(hogels=(columns, rows), resolution=(width, height))
    largest = max(math.prod(stored.shape[2:]), math.prod(stored.chunks), math.prod(stored.shards or ()))
    check_allowed(place, largest * stored.dtype.itemsize, f"one hogel or chunk of {chosen}")
    floating = stored.dtype.kind == "f"
    dtype = stored.dtype if chosen is PlateArray.COLOR else np.dtype(np.uint8)
    if dtype not in (np.uint8, np.float16, np.float32):
        raise InputError(f"{place}: array {chosen} has type {dtype}, and not uint8, float16 or float32")
    levels = None if floating else BYTE_LEVELS
    return GroupRows(place=place, stored=stored, array=chosen, shape=shape, levels=levels, dtype=dtype)


def missing_hogels(place: Path, array: PlateArray) -> int:
    """Return the number of hogels that were never written, which read as black or as no triangle.

    Shards at the right and lower edge reach beyond the plate; chunks there are no hogels. Groups by
    others, in which a hogel is not a chunk, do not tell, and 0 is returned.
    """
    with _reading(place):
        stored = zarr.open_group(place, mode="r")[array]
    assert isinstance(stored, zarr.Array)
    shape = stored.shape
    if stored.chunks != (1, 1, *shape[2:]):
        return 0
    high, wide = (stored.shards or stored.chunks)[:2]
    content_bytes = stored.dtype.itemsize * math.prod(shape[2:])
    there = 0
    for row, column in product(range(0, shape[0], high), range(0, shape[1], wide)):
        block = (row // high, column // wide, *(0 for _ in shape[2:]))
        path = place / array / stored.metadata.encode_chunk_key(block)
        # What is damaged was written, and whoever reads it is told so.
        file = read_places(path, high * wide, content_bytes)
        numbers = file.places.keys() | file.damaged
        there += sum(row + n // wide < shape[0] and column + n % wide < shape[1] for n in numbers)
    return shape[0] * shape[1] - there


def write_group(
    plate: PlateRows,
    place: Path,
    array: PlateArray,
    description: dict[str, object],
    done: Callable[[], object] = lambda: None,
) -> None:
    """Write a plate into a new Zarr group with one chunk for each hogel.

    Parameters
    ----------
    plate
        Pixels: 8 bits or floating point as colors; 8 bits as numbers of triangles.
    place
        Folder that does not exist.
    array
        Array to be written.
    description
        Attribute of the group that says where the plate comes from.
    done
        Function that is called after each hogel.
    """
    group = zarr.create_group(place, attributes={LAYOUT_ATTRIBUTE: description})
    shape = plate.shape.array if array is PlateArray.COLOR else plate.shape.array[:4]
    names = ("row", "column", "v", "u", "rgb")
    stored = group.create_array(
        array,
        shape=shape,
        chunks=(1, 1, *shape[2:]),
        dtype=plate.dtype if array is PlateArray.COLOR else np.dtype(np.int32),
        compressors=[ZstdCodec(level=COMPRESSION_LEVEL, checksum=True)],
        fill_value=-1 if array is PlateArray.TRIANGLE else 0,
        dimension_names=names[: len(shape)],
    ).with_config({"write_empty_chunks": True})
    for row in range(shape[0]):
        for column, hogel in enumerate(plate.row(row)):
            stored[row, column] = hogel if array is PlateArray.COLOR else unpacked(hogel)
            done()


def packed(triangle: Numbers) -> Bytes:
    """Return numbers (.., -1 for nothing) as pixels (.., 3): red * 65536 + green * 256 + blue is number + 1.

    Raises
    ------
    InputError
        A number takes more than 24 bits.
    """
    number = triangle.astype(np.int64) + 1
    if number.max(initial=0) >= 1 << 24:
        raise InputError("numbers of triangles above 16,777,214 do not fit into pictures of 8 bits")
    return np.stack((number >> 16, number >> 8 & 255, number & 255), axis=-1).astype(np.uint8)


def unpacked(pixels: Pixels) -> Numbers:
    """Return the numbers that pixels (.., 3) stand for: the inverse of `packed`."""
    red, green, blue = (pixels[..., channel].astype(np.int32) for channel in range(3))
    return (red << 16 | green << 8 | blue) - np.int32(1)
