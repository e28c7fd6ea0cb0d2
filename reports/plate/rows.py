"""Plates in Zarr groups (CONVENTIONS.md, "Plates") as rows of pixels, for conversion from and to files."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from xfrustum.reports.plate.store import COMPRESSOR, DAMAGE, FINISHED, METADATA, open_group, told
from xfrustum.scenes.arrays import Bytes, Numbers
from xfrustum.scenes.disk.input_files import check_allowed
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.layouts import Pixels, PlateShape
from xfrustum.scenes.files.pictures import BYTE_LEVELS
from xfrustum.scenes.files.plate_files import PlateRows, empty_row

LAYOUT_ATTRIBUTE = "xfrustum:converted"  # of converted groups, says from what; drawn ones have another


class PlateArray(StrEnum):
    """The arrays of a plate."""

    COLOR = "color"
    TRIANGLE = "triangle"


def is_group(place: Path) -> bool:
    """Return whether a folder is a Zarr group."""
    return (place / METADATA).is_file()


@dataclass(kw_only=True, eq=False)
class GroupRows(PlateRows):
    """The pixels of a plate in a Zarr group; numbers of triangles as in `--encoding triangle-id`."""

    place: Path
    stored: zarr.Array[Any]
    array: PlateArray


def open_plate(place: Path, array: PlateArray | None) -> GroupRows:
    """Return a plate's pixels, by default its colors or else its numbers; InputError where it is none."""
    group = open_group(place)
    try:
        names = [name for name in PlateArray if name in group]
        chosen = array or (names[0] if names else PlateArray.COLOR)
        if chosen not in names:
            raise InputError(f"{place}: has no array {chosen}; is it a plate that `xfrustum plate` drew?")
        stored = group[chosen]
    except DAMAGE as error:
        raise InputError(f"{place}: is no plate that can be read ({told(error)})") from error
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

    def row(number: int) -> Pixels:
        pixels = empty_row(found)
        for column in range(columns):
            try:
                hogel: Any = stored[number, column]
            except DAMAGE as error:
                damage = f"hogel {column},{number} is damaged ({told(error)})"
                raise InputError(f"{place}: {damage}; `plate --check` draws it again") from error
            pixels[column] = hogel if chosen is PlateArray.COLOR else packed(hogel)
        return pixels

    found = GroupRows(
        place=place,
        stored=stored,
        array=chosen,
        shape=shape,
        levels=None if floating else BYTE_LEVELS,
        dtype=dtype,
        row=row,
    )
    return found


def missing_hogels(rows: GroupRows) -> int:
    """Return the number of hogels that were never drawn; 0 where others' groups do not say it."""
    place, stored = rows.place, rows.stored
    try:
        finished = open_group(place).get(FINISHED)
        if isinstance(finished, zarr.Array) and finished.shape == stored.shape[:2]:
            return int(np.count_nonzero(np.asarray(finished[:]) == 0))
        if stored.shards is None and stored.chunks == (1, 1, *stored.shape[2:]):
            return int(stored.shape[0] * stored.shape[1] - stored.nchunks_initialized)
        return 0
    except DAMAGE as error:
        raise InputError(f"{place}: array {FINISHED} is damaged; draw the plate again") from error


def write_group(
    plate: PlateRows,
    place: Path,
    array: PlateArray,
    description: dict[str, object],
    done: Callable[[], object] = lambda: None,
) -> None:
    """Write a plate into a new Zarr group with a chunk for each hogel; after each `done` is called."""
    group = zarr.create_group(place, attributes={LAYOUT_ATTRIBUTE: description})
    shape = plate.shape.array if array is PlateArray.COLOR else plate.shape.array[:4]
    names = ("row", "column", "v", "u", "rgb")
    stored = group.create_array(
        array,
        shape=shape,
        chunks=(1, 1, *shape[2:]),
        dtype=plate.dtype if array is PlateArray.COLOR else np.dtype(np.int32),
        compressors=[COMPRESSOR],
        fill_value=-1 if array is PlateArray.TRIANGLE else 0,
        dimension_names=names[: len(shape)],
    ).with_config({"write_empty_chunks": True})
    for row in range(shape[0]):
        for column, hogel in enumerate(plate.row(row)):
            stored[row, column] = hogel if array is PlateArray.COLOR else unpacked(hogel)
            done()


def packed(triangle: Numbers) -> Bytes:
    """Return numbers (.., -1 for nothing) as pixels (.., 3): number + 1 is 65536 red + 256 green + blue."""
    number = triangle.astype(np.int64) + 1
    if number.max(initial=0) >= 1 << 24:
        raise InputError("numbers of triangles above 16,777,214 do not fit into pictures of 8 bits")
    return np.stack((number >> 16, number >> 8 & 255, number & 255), axis=-1).astype(np.uint8)


def unpacked(pixels: Pixels) -> Numbers:
    """Return the numbers that pixels (.., 3) stand for: the inverse of `packed`."""
    red, green, blue = (pixels[..., channel].astype(np.int32) for channel in range(3))
    return (red << 16 | green << 8 | blue) - np.int32(1)
