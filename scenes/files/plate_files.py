"""Plates as files of any layout: recognition by names, reading row by row, and writing."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.disk import read_small
from xfrustum.scenes.files.layouts import (
    LAYOUTS,
    PICTURE_SUFFIXES,
    Index,
    Layout,
    Pixels,
    PlateShape,
    Target,
)
from xfrustum.scenes.files.pictures import (
    Picture,
    picture_size,
    picture_text,
    read_picture,
    write_picture,
)

#: name of the file that describes a plate, written by the Blender script
PLATE_FILE = "plate.json"
#: largest size of `PLATE_FILE`, bytes: enough for a hundred thousand objects with colors
MAX_FACTS_BYTES = 1 << 24
#: size of a plate's pixels, bytes, above which they are in a scratch file
MAX_BYTES_IN_MEMORY = 1 << 28


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateRows:
    """Pixels of a plate, by rows of hogels."""

    shape: PlateShape
    dtype: np.dtype[Any]
    #: function of a row's number that returns its pixels (columns, H, W, 3), or raises InputError
    row: Callable[[int], Pixels]
    #: True if pixels are certainly linear radiance
    linear: bool = False
    #: (rows, columns, H, W, 3), if the whole plate is in memory
    pixels: Pixels | None = None
    #: name of a lossy file format, such as "JPEG"
    lossy: str = ""

    @classmethod
    def from_pixels(cls, pixels: Pixels, lossy: str = "", *, linear: bool = False) -> PlateRows:
        """Return a plate that holds all its pixels (rows, columns, H, W, 3)."""
        rows, columns, height, width, _ = pixels.shape
        return cls(
            shape=PlateShape(hogels=(columns, rows), resolution=(width, height)),
            dtype=pixels.dtype,
            row=pixels.__getitem__,
            linear=linear,
            pixels=pixels,
            lossy=lossy,
        )

    @property
    def floating(self) -> bool:
        """True if pixels are floating-point numbers instead of levels from 0 to 255."""
        return self.dtype.kind == "f"

    def whole(self) -> Pixels:
        """Return all pixels (rows, columns, H, W, 3)."""
        if self.pixels is not None:
            return self.pixels
        pixels = empty_pixels(self.shape, self.dtype)
        for number, row in enumerate(pixels):
            row[...] = self.row(number)
        return pixels


def empty_pixels(shape: PlateShape, dtype: np.dtype[Any]) -> Pixels:
    """Return zeros (rows, columns, H, W, 3), above `MAX_BYTES_IN_MEMORY` in a scratch file."""
    size = math.prod(shape.array) * dtype.itemsize
    if size <= MAX_BYTES_IN_MEMORY:
        return np.zeros(shape.array, dtype)
    try:
        # The mapping remains valid after the file is closed; the file has no name and needs no
        # cleanup.
        with tempfile.TemporaryFile() as file:
            return np.memmap(file, dtype, "w+", shape=shape.array)
    except (OSError, ValueError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or "too large for a file"
        raise InputError(
            f"{tempfile.gettempdir()}: cannot hold the plate's pixels, {size:,} bytes ({reason}); "
            "set TMPDIR to another folder"
        ) from error


def empty_row(shape: PlateShape, dtype: np.dtype[Any]) -> Pixels:
    """Return zeros (columns, H, W, 3) for a row of hogels; see `empty_pixels`."""
    row = PlateShape(hogels=(shape.hogels[0], 1), resolution=shape.resolution)
    pixels: Pixels = empty_pixels(row, dtype)[0]
    return pixels


def converted(pixels: Pixels, *, floating: bool) -> Pixels:
    """Return samples as floating-point numbers, or clipped and rounded to levels from 0 to 255."""
    if floating:
        return pixels if pixels.dtype.kind == "f" else (pixels / 255).astype(np.float32)
    if pixels.dtype.kind != "f":
        return pixels
    # Use double precision, so that levels divided by 255 are converted back to the same levels.
    shares = np.clip(np.nan_to_num(pixels.astype(np.float64)), 0, 1)
    return np.rint(255 * shares).astype(np.uint8)


@dataclass(frozen=True, kw_only=True, eq=False)
class FileSet:
    """Files of a plate in a layout."""

    #: folder or file in the command
    place: Path
    layout: Layout
    #: paths by the counting numbers in their names
    files: dict[Index, Path]
    #: numbers that are equal in all names; see `Layout.stated`
    stated: Index
    shape: PlateShape
    #: number of pictures in the folder whose names do not match the layout, >= 0
    strangers: int

    @property
    def beyond(self) -> int:
        """Number of files with numbers beyond the plate."""
        counts = self.layout.counts(self.shape)
        return sum(any(n >= count for n, count in zip(i, counts, strict=True)) for i in self.files)

    @property
    def missing(self) -> int:
        """Number of files that the plate lacks."""
        return self.layout.file_count(self.shape) - len(self.files) + self.beyond

    def file_of_hogel(self, column: int, row: int) -> Path | None:
        """Return a hogel's own file; None if it has none."""
        index = self.layout.hogel_index(self.shape, column, row)
        return self.files.get(index) if self.layout.in_hogels else None

    def hogel(self, column: int, row: int) -> Picture:
        """Return a hogel's upright picture; InputError for a missing or damaged file."""
        if not self.layout.in_hogels:
            return Picture(pixels=self.plate.whole()[row, column], lossy=self.plate.lossy)
        picture = self._read(self.layout.hogel_index(self.shape, column, row))
        turned = picture.pixels[::-1, ::-1] if self.layout.turned else picture.pixels
        return replace(picture, pixels=turned)

    def rows(self) -> PlateRows:
        """Return the plate, read row by row if each file is one hogel.

        Raises InputError, here or on reading a row, if a file is missing, is damaged, or differs
        from the other files in size or pixel type.
        """
        if not self.layout.in_hogels:
            return self.plate
        # Report missing files before any work.
        for index in self.layout.indices(self.shape):
            self._path(index)
        first = self._read(next(self.layout.indices(self.shape)))

        def row(number: int) -> Pixels:
            hogels = empty_row(self.shape, first.pixels.dtype)
            for column, hogel in enumerate(hogels):
                picture = self.hogel(column, number)
                index = self.layout.hogel_index(self.shape, column, number)
                self._check_type(index, picture, first.pixels.dtype)
                hogel[...] = picture.pixels
            return hogels

        return PlateRows(shape=self.shape, dtype=first.pixels.dtype, row=row, lossy=first.lossy)

    @cached_property
    def plate(self) -> PlateRows:
        """All pixels of the plate; raises InputError as `rows` does."""
        if self.layout.view is None:
            rows = self.rows()
            return PlateRows.from_pixels(rows.whole(), rows.lossy)
        for index in self.layout.indices(self.shape):
            self._path(index)
        pixels, lossy = None, ""
        for index in self.layout.indices(self.shape):
            picture = self._read(index)
            if pixels is None:
                pixels = empty_pixels(self.shape, picture.pixels.dtype)
            self._check_type(index, picture, pixels.dtype)
            view = self.layout.view(pixels, index, self.stated)
            view[...] = picture.pixels.reshape(view.shape)
            lossy = lossy or picture.lossy
        assert pixels is not None
        return PlateRows.from_pixels(pixels, lossy)

    def _path(self, index: Index) -> Path:
        path = self.files.get(index)
        if path is None:
            tiles = (self.stated[0], self.stated[1]) if self.layout.name == "quilt" else None
            name = Target(layout=self.layout, tiles=tiles).file_name(index, self.shape)
            raise InputError(f"{self.place}: has no file such as {name}")
        return path

    def _check_type(self, index: Index, picture: Picture, dtype: np.dtype[Any]) -> None:
        if picture.pixels.dtype != dtype:
            raise InputError(
                f"{self._path(index)}: has another type of pixels than the other files"
            )

    def _read(self, index: Index) -> Picture:
        path = self._path(index)
        height, width = stored_size(self.layout, self.shape, self.stated)
        picture = read_picture(path)
        high, wide = picture.pixels.shape[:2]
        if self.layout.name == "quilt" and wide >= width and high >= height:
            # Tiles are rounded down to whole pixels; unused pixels are at the right and at the top.
            return replace(picture, pixels=picture.pixels[high - height :, :width])
        if (wide, high) != (width, height):
            raise InputError(f"{path}: is {wide} x {high}, and should be {width} x {height}")
        return picture


def stored_size(layout: Layout, shape: PlateShape, stated: Index) -> tuple[int, int]:
    """Return height and width of the pictures of a layout."""
    if layout.view is None:
        return shape.resolution[1], shape.resolution[0]
    # The view of a broadcast scalar has the shape of a file's pixels and takes no memory.
    first = (0,) * len(layout.numbers)
    held = layout.view(np.broadcast_to(np.uint8(0), shape.array), first, stated).shape[:-1]
    return (held[0] * held[1], held[2] * held[3]) if len(held) == 4 else (held[0], held[1])


def find_files(
    place: Path, known: PlateShape | None = None, layouts: Sequence[Layout] = LAYOUTS
) -> FileSet:
    """Return the files at a path, in the layout that matches their names.

    The layout that matches most names is used; ties are broken by the known plate, then by the
    order of layouts. Names do not prove the content of pictures: `verify` tests it. Raises
    InputError, with the reason, if no layout matches.
    """
    paths = pictures_at(place)
    candidates: list[FileSet] = []
    problems: list[str] = []
    for layout in layouts:
        named = [
            (numbers, path)
            for path in paths
            if (numbers := layout.read_name(path.name)) is not None
        ]
        single = not layout.numbers
        # A single picture is a mosaic only if its name matches no other layout.
        taken = single and not layout.stated and bool(candidates or problems)
        if not named or (single and len(paths) > 1) or taken:
            continue
        try:
            candidates.append(_file_set(place, layout, named, known, len(paths)))
        except InputError as error:
            problems.append(f"{layout.name}: {error}")
    if candidates:
        # Among equal candidates `max` returns the first, in the order of layouts.
        return max(
            candidates,
            key=lambda files: (-files.strangers, known is not None and files.shape == known),
        )
    names = list(dict.fromkeys(layout.name for layout in layouts))
    layout_name = names[0] if len(names) == 1 else "that their names fit"
    likely = [each.name for each in LAYOUTS if each.numbers and each.read_name(paths[0].name)]
    hint = f"; such names are of {likely[0]}" if likely else ""
    problems.append(f"{len(paths)} pictures, such as {paths[0].name}, have other names{hint}")
    raise InputError(f"{place}: cannot be read in the layout {layout_name}: {problems[0]}")


def pictures_at(place: Path) -> list[Path]:
    """Return the picture files at a path, without ground truths and hidden files.

    Raises InputError if there are none.
    """
    if not place.exists():
        raise InputError(
            f"{place}: no such file or folder; name a folder of pictures, or one picture"
        )
    if not place.is_dir():
        return [place]
    try:
        paths = sorted(place.iterdir())
    except OSError as error:
        raise InputError(f"{place}: cannot be read ({error.strerror})") from error
    pictures = [
        path
        for path in paths
        if path.suffix.lower() in PICTURE_SUFFIXES and not path.name.startswith((".", "gt_"))
    ]
    if not pictures:
        raise InputError(f"{place}: has no pictures; name a folder of pictures, or one picture")
    return pictures


Named = tuple[tuple[Index, Index], Path]  # counting and stated numbers of a file's name, and path


def _file_set(
    place: Path, layout: Layout, named: Sequence[Named], known: PlateShape | None, pictures: int
) -> FileSet:
    """Return the files of a layout; InputError if their names contradict each other."""
    files: dict[Index, Path] = {}
    for (index, _), path in named:
        if files.setdefault(index, path) is not path:
            raise InputError(
                f"{files[index].name} and {path.name} state the same numbers; keep one of them in "
                "the folder"
            )
    several = {stated for (_, stated), _ in named}
    if len(several) > 1:
        raise InputError(f"names of files state plates of different sizes: {sorted(several)[:3]}")
    first, (stated,) = files[min(files)], several
    known = _stated_shape(layout, first) or known
    return FileSet(
        place=place,
        layout=layout,
        files=files,
        stated=stated,
        shape=layout.shape(files.keys(), stated, picture_size(first), known),
        strangers=pictures - len(files),
    )


def _stated_shape(layout: Layout, first: Path) -> PlateShape | None:
    """Return the shape stated in a mosaic, or in the file beside pictures of hogels; else None."""
    plate_file = first.parent / PLATE_FILE
    try:
        if layout.name == "mosaic":
            stated: Any = picture_text(first)
        elif layout.in_hogels and plate_file.is_file():
            stated = json.loads(read_small(plate_file, "description of a plate", MAX_FACTS_BYTES))
        else:
            return None
        (columns, rows), (width, height) = (
            map(int, stated[key]) for key in ("hogels", "resolution")
        )
    except (KeyError, TypeError, ValueError, OverflowError, RecursionError):
        return None
    if min(columns, rows, width, height) < 1:
        return None
    return PlateShape(hogels=(columns, rows), resolution=(width, height))


def write_files(
    plate: PlateRows, target: Target, folder: Path, done: Callable[[], object] = lambda: None
) -> None:
    """Write a plate into a folder, and call `done` after each file.

    At most one row of hogels is in memory if each file is one hogel. Raises InputError if the
    layout or the file format cannot store such a plate, OSError if a file cannot be written.
    """
    shape, layout = plate.shape, target.layout

    def write(index: Index, pixels: Pixels) -> None:
        picture = Picture(
            pixels=np.ascontiguousarray(converted(pixels, floating=target.floating)),
            linear=plate.linear and layout.name == "quilt",
        )
        text: dict[str, object] | None = None
        if layout.name == "mosaic":
            # Names of mosaics do not state the number of hogels.
            text = {"layout": layout.name, "hogels": shape.hogels, "resolution": shape.resolution}
        write_picture(folder / target.file_name(index, shape), picture, text)
        done()

    if layout.view is None:
        for row in range(shape.hogels[1]):
            for column, hogel in enumerate(plate.row(row)):
                turned = hogel[::-1, ::-1] if layout.turned else hogel
                write(layout.hogel_index(shape, column, row), turned)
        return
    whole, stated = plate.whole(), target.stated(shape)
    size = *stored_size(layout, shape, stated), 3
    for index in layout.indices(shape):
        write(index, layout.view(whole, index, stated).reshape(size))
