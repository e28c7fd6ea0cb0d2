"""The pixels of a plate, read from files in any layout."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from xfrustum.scenes.disk.durable import Aside, scratch_folder
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.layouts.detection import FileSet
from xfrustum.scenes.files.layouts.layout import Index, Naming, Part, Pixels, PlateShape, as_plate, row_of
from xfrustum.scenes.files.layouts.picture_files import BYTE_LEVELS, Picture, read_picture
from xfrustum.scenes.files.layouts.tiles import Quilt
from xfrustum.scenes.files.layouts.video import read_video

MAX_BYTES_IN_MEMORY = 1 << 28
"""Bytes of a plate's pixels that are held in memory; larger plates are held in a scratch file."""


class PlateRows(Protocol):
    """A plate whose pixels are had one row of hogels after the other."""

    @property
    def shape(self) -> PlateShape:
        """Shape of the plate."""

    @property
    def levels(self) -> int | None:
        """Largest level of integers; None of floating-point numbers."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the pixels."""

    def row(self, number: int) -> Pixels:
        """Return the pixels (columns, H, W, 3) of a row of hogels.

        Raises
        ------
        InputError
            They cannot be read.
        """


def empty_row(rows: PlateRows) -> Pixels:
    """Return zeros (columns, H, W, 3) for a row of hogels; above `MAX_BYTES_IN_MEMORY` in a scratch file."""
    alone = PlateShape(hogels=(rows.shape.hogels[0], 1), resolution=rows.shape.resolution)
    return Plates.empty(alone, rows.dtype, rows.levels).row(0)


def whole_plate(rows: PlateRows) -> Plates:
    """Return all pixels of a plate."""
    if isinstance(rows, Plates):
        return rows
    plate = Plates.empty(rows.shape, rows.dtype, rows.levels)
    for number in range(rows.shape.hogels[1]):
        plate.pixels[number] = rows.row(number)
    return plate


@dataclass(frozen=True, kw_only=True)
class WithLevels:
    """A plate whose pixels have another largest level; see `with_levels`.

    Attributes
    ----------
    plate
        The plate.
    levels
        Largest level of the pixels that are returned.
    """

    plate: PlateRows
    levels: int | None

    @property
    def shape(self) -> PlateShape:
        """Shape of the plate."""
        return self.plate.shape

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the pixels."""
        none = np.empty(0, self.plate.dtype)
        return with_levels(none, self.plate.levels, self.levels).dtype

    def row(self, number: int) -> Pixels:
        """Return the pixels of a row of hogels."""
        return with_levels(self.plate.row(number), self.plate.levels, self.levels)


@dataclass(kw_only=True, eq=False)
class Plates:
    """A plate's pixels in a file that is removed, or in memory.

    Attributes
    ----------
    pixels
        (rows, columns, H, W, 3).
    levels
        Largest level of integers; None of floating-point numbers.
    lossy
        Whether the format of some file changes pixels.
    """

    pixels: Pixels
    levels: int | None
    lossy: bool = False
    _scratch: Aside | None = field(default=None, repr=False)

    @classmethod
    def empty(cls, shape: PlateShape, dtype: np.dtype[np.generic], levels: int | None) -> Plates:
        """Return a plate of zeros."""
        size = int(np.prod(shape.array)) * dtype.itemsize
        if size <= MAX_BYTES_IN_MEMORY:
            return cls(pixels=np.zeros(shape.array, dtype), levels=levels)
        scratch = Aside(scratch_folder())
        try:
            # An empty file without a name of its own: its pages go when nobody maps it any more.
            pixels = np.memmap(scratch.path, dtype, "w+", shape=shape.array)
        except OSError as error:
            scratch.remove()
            raise InputError(
                f"{scratch_folder()}: cannot hold the plate's pixels, {size:,} bytes ({error.strerror}); "
                "set TMPDIR to another folder"
            ) from error
        return cls(pixels=pixels, levels=levels, _scratch=scratch)

    @property
    def shape(self) -> PlateShape:
        """Shape of the plate."""
        rows, columns, height, width, _ = self.pixels.shape
        return PlateShape(hogels=(columns, rows), resolution=(width, height))

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the pixels."""
        dtype: np.dtype[Any] = self.pixels.dtype
        return dtype

    def row(self, number: int) -> Pixels:
        """Return the pixels (columns, H, W, 3) of a row of hogels."""
        hogels: Pixels = self.pixels[number]
        return hogels


@dataclass(kw_only=True, eq=False)
class LaidOutFiles:
    """Files in a layout, read hogel by hogel, or as a whole where each file holds many hogels.

    Attributes
    ----------
    files
        The files, their layout and the shape of the plate.
    """

    files: FileSet

    @cached_property
    def _parts(self) -> dict[Index, Part]:
        tiles = next(iter(self.files.files)) if isinstance(self.files.layout, Quilt) else None
        naming = Naming(tiles=(tiles[0], tiles[1]) if tiles else None)
        return {part.index: part for part in self.files.layout.parts(self.files.shape, naming)}

    @cached_property
    def _part_of_aperture(self) -> dict[tuple[int, int], Part]:
        return {part.aperture: part for part in self._parts.values() if part.aperture is not None}

    def part(self, column: int, row: int) -> Part | None:
        """Return the file that holds one hogel and no other; None where there is no such file."""
        return self._part_of_aperture.get((column, row))

    def hogel(self, column: int, row: int) -> Picture:
        """Return the picture of a hogel, upright as the layout says.

        Raises
        ------
        InputError
            A file that it needs is missing, damaged or of another size.
        """
        part = self.part(column, row)
        if part is None:
            whole = self.plate
            return Picture(pixels=whole.pixels[row, column], levels=whole.levels, lossy=whole.lossy)
        picture = self.read(part)
        upright = np.empty(self.files.shape.array[2:], picture.pixels.dtype)
        # All hogels share this memory, so that the view of any hogel of the plate leads there.
        shared = np.lib.stride_tricks.as_strided(upright, self.files.shape.array, (0, 0, *upright.strides))
        part.select(shared)[...] = picture.pixels
        return Picture(pixels=upright, levels=picture.levels, lossy=picture.lossy)

    def rows(self) -> PlateRows:
        """Return the plate, in the memory of one row of hogels where each file has pixels of one row alone.

        Raises
        ------
        InputError
            As from `plate`, be it here or where rows are read.
        """
        parts: dict[int, list[Part]] = {}
        for part in self._parts.values():
            row = row_of(part, self.files.shape)
            if row is None:
                return self.plate
            parts.setdefault(row, []).append(part)
        return _FilesByRow(self, parts)

    @cached_property
    def plate(self) -> Plates:
        """The whole plate.

        Raises
        ------
        InputError
            A file is missing, damaged or of another size than the others.
        """
        plate: Plates | None = None
        for part in self._parts.values():
            picture = self.read(part)
            if plate is None:
                plate = Plates.empty(self.files.shape, picture.pixels.dtype, picture.levels)
            self.require_same_type(part, picture, plate)
            view = part.select(plate.pixels)
            view[...] = picture.pixels.reshape(view.shape)
            plate.lossy |= picture.lossy
        assert plate is not None
        return plate

    def require_same_type(self, part: Part, picture: Picture, plate: PlateRows) -> None:
        """Raise InputError where a file has other types of pixels than its plate."""
        if (picture.pixels.dtype, picture.levels) != (plate.dtype, plate.levels):
            raise InputError(f"{self.files.files[part.index]}: has another type of pixels than the others")

    def read(self, part: Part) -> Picture:
        """Return what a file holds.

        Raises
        ------
        InputError
            It is missing, damaged or of another size.
        """
        path = self.files.files.get(part.index)
        if path is None:
            raise InputError(f"{self.files.place}: has no file such as {part.name}")
        picture = read_picture(path) if part.frames is None else read_video(path)
        width, height = part.size
        found = picture.pixels.shape[-2], picture.pixels.shape[-3]
        if part.frames not in (None, len(picture.pixels)):
            raise InputError(f"{path}: has {len(picture.pixels)} frames, and the plate {part.frames} columns")
        if isinstance(self.files.layout, Quilt) and found[0] >= width and found[1] >= height:
            # Tiles are rounded down to whole pixels; what is left over lies at the right and at the top.
            cropped = picture.pixels[found[1] - height :, :width]
            return Picture(pixels=cropped, levels=picture.levels, lossy=picture.lossy)
        if found != (width, height):
            raise InputError(f"{path}: is {found[0]} x {found[1]}, and should be {width} x {height}")
        return picture


class _FilesByRow:
    """A plate in files of which each has pixels of one row of hogels alone.

    Parameters
    ----------
    files
        The files.
    parts
        Files of each row of hogels.
    """

    def __init__(self, files: LaidOutFiles, parts: Mapping[int, Sequence[Part]]) -> None:
        self._files, self._parts = files, parts
        self.shape = files.files.shape
        first = files.read(parts[0][0])
        self.dtype, self.levels = first.pixels.dtype, first.levels

    def row(self, number: int) -> Pixels:
        """Return the pixels of a row of hogels, read from its files."""
        hogels = empty_row(self)
        plate = as_plate(hogels, self.shape)
        for part in self._parts[number]:
            picture = self._files.read(part)
            self._files.require_same_type(part, picture, self)
            view = part.select(plate)
            view[...] = picture.pixels.reshape(view.shape)
        return hogels


def with_levels(pixels: Pixels, before: int | None, after: int | None) -> Pixels:
    """Return samples with another largest level, rounded; floating-point numbers have none.

    Levels that are read with more of them than they had before turn back into the same bits.
    """
    if before == after:
        return pixels
    if after is None:
        assert before is not None
        return (pixels / np.float64(before)).astype(np.float32)
    shares = np.clip(np.nan_to_num(pixels.astype(np.float64)), 0, 1) if before is None else pixels / before
    return np.rint(shares * after).astype(np.uint8 if after <= BYTE_LEVELS else np.uint16)
