"""The pixels of a plate in files of any layout: found in a folder, read row by row, and written."""

from __future__ import annotations

import configparser
import json
import math
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from xfrustum.scenes.disk.input_files import read_small
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.layouts import (
    CUBEVI_TILE_PX,
    LAYOUTS,
    PICTURE_SUFFIXES,
    VIDEO_SUFFIX,
    Index,
    Layout,
    Naming,
    Pixels,
    PlateShape,
)
from xfrustum.scenes.files.pictures import (
    BYTE_LEVELS,
    PLENO_LEVELS,
    Picture,
    picture_size,
    picture_text,
    read_picture,
    read_video,
    video_size,
    write_picture,
    write_video,
)

PARAMETERS_FILE = "parameters.cfg"  # in which the 4D light-field benchmark describes its cameras
PLATE_FILE = (
    "plate.json"  # in which the script for Blender states the plate whose hogels it renders
)
#: Largest size of such a file that is read: room for a hundred thousand objects with their colors.
MAX_FACTS_BYTES = 1 << 24
#: Bytes of a plate's pixels that are held in memory; larger plates are held in a scratch file.
MAX_BYTES_IN_MEMORY = 1 << 28
#: Names of layouts of pictures for displays, which take their pixels for sRGB.
FOR_DISPLAYS = ("quilt", "cubevi")


@dataclass(kw_only=True, eq=False)
class PlateRows:
    """A plate whose pixels are had one row of hogels after the other."""

    shape: PlateShape
    levels: int | None  #: the largest level of integers; None of floating-point numbers
    dtype: np.dtype[Any]
    #: Function that returns the pixels (columns, H, W, 3) of a row of hogels; InputError where it
    #: cannot.
    row: Callable[[int], Pixels]
    linear: bool = (
        False  #: whether pixels are known to be linear radiance; else as their files have them
    )


class Plates(PlateRows):
    """All pixels (rows, columns, H, W, 3) of a plate; `lossy` names a format that changes pixels."""

    def __init__(self, pixels: Pixels, levels: int | None) -> None:
        rows, columns, height, width, _ = pixels.shape
        shape = PlateShape(hogels=(columns, rows), resolution=(width, height))
        super().__init__(
            shape=shape, levels=levels, dtype=np.dtype(pixels.dtype), row=pixels.__getitem__
        )
        self.pixels, self.lossy = pixels, ""

    @classmethod
    def empty(cls, shape: PlateShape, dtype: np.dtype[Any], levels: int | None) -> Plates:
        """Return a plate of zeros, in memory or, above `MAX_BYTES_IN_MEMORY`, in a scratch file."""
        size = math.prod(shape.array) * dtype.itemsize
        if size <= MAX_BYTES_IN_MEMORY:
            return cls(pixels=np.zeros(shape.array, dtype), levels=levels)
        try:
            with tempfile.TemporaryFile() as file:
                return cls(pixels=np.memmap(file, dtype, "w+", shape=shape.array), levels=levels)
        except (OSError, ValueError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or "too large for a file"
            raise InputError(
                f"{tempfile.gettempdir()}: cannot hold the plate's pixels, {size:,} bytes ({reason}); "
                "set TMPDIR to another folder"
            ) from error


def empty_row(rows: PlateRows) -> Pixels:
    """Return zeros (columns, H, W, 3) for a row of hogels, as `Plates.empty` holds them."""
    alone = PlateShape(hogels=(rows.shape.hogels[0], 1), resolution=rows.shape.resolution)
    return Plates.empty(alone, rows.dtype, rows.levels).row(0)


def whole_plate(rows: PlateRows) -> Plates:
    """Return all pixels of a plate."""
    if isinstance(rows, Plates):
        return rows
    plate = Plates.empty(rows.shape, rows.dtype, rows.levels)
    for number, pixels in enumerate(plate.pixels):
        pixels[...] = rows.row(number)
    return plate


def _as_plate(hogels: Pixels, shape: PlateShape) -> Pixels:
    """Return a view with the axes of a plate, every row of which is one row of hogels (columns, H, W, 3)."""
    return np.lib.stride_tricks.as_strided(hogels, shape.array, (0, *hogels.strides))


def with_levels(pixels: Pixels, before: int | None, after: int | None) -> Pixels:
    """Return samples with another largest level, rounded; more levels turn back into the same bits."""
    if before == after:
        return pixels
    floats = pixels.astype(np.float64)
    shares = np.clip(np.nan_to_num(floats), 0, 1) if before is None else floats / before
    if after is None:
        return shares.astype(np.float32)
    return np.rint(shares * after).astype(np.uint8 if after <= BYTE_LEVELS else np.uint16)


def plate_with_levels(plate: PlateRows, levels: int | None) -> PlateRows:
    """Return a plate with another largest level; see `with_levels`."""
    return PlateRows(
        shape=plate.shape,
        levels=levels,
        linear=plate.linear,
        dtype=with_levels(np.empty(0, plate.dtype), plate.levels, levels).dtype,
        row=lambda number: with_levels(plate.row(number), plate.levels, levels),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class FileSet:
    """Files that are read in a layout."""

    place: Path  #: the folder or file that was named
    layout: Layout
    files: dict[Index, Path]  #: paths by the numbers that count them
    stated: Index  # numbers that all names state alike; see `Layout.stated`
    shape: PlateShape
    strangers: int  # number of pictures in the folder whose names are none of this layout

    @property
    def beyond(self) -> int:
        """Number of files that are there and that the layout does not have for such a plate."""
        counts = self.layout.counts(self.shape)
        return sum(any(n >= count for n, count in zip(i, counts, strict=True)) for i in self.files)

    @property
    def missing(self) -> int:
        """Number of files that the layout has for such a plate and that are not there."""
        return self.layout.file_count(self.shape) - len(self.files) + self.beyond

    @property
    def reasons(self) -> tuple[str, ...]:
        """What speaks for the layout, one clause each."""
        count, total = len(self.files), self.layout.file_count(self.shape)
        fit = f"{count} of {count + self.strangers} names fit: {self.layout.words}"
        lacking = [f"{self.missing} of {total} files are not there"] if self.missing else []
        return fit, f"such as {self.files[min(self.files)].name}", *lacking, self.shape.words

    @property
    def words(self) -> str:
        """The layout, the shape and the reasons in one line."""
        return f"{self.layout.name} ({'; '.join(self.reasons)})"

    def file_of_hogel(self, column: int, row: int) -> Path | None:
        """Return the file that holds one hogel and no other; None where there is no such file."""
        return self.files.get(self._index(column, row)) if self.layout.in_hogels else None

    def hogel(self, column: int, row: int) -> Picture:
        """Return the picture of a hogel, upright; InputError where a file is missing or damaged."""
        if not self.layout.in_hogels:
            whole = self.plate
            return Picture(pixels=whole.pixels[row, column], levels=whole.levels, lossy=whole.lossy)
        picture = self._read(self._index(column, row))
        return (
            replace(picture, pixels=picture.pixels[::-1, ::-1]) if self.layout.turned else picture
        )

    def _index(self, column: int, row: int) -> Index:
        return column, self.shape.hogels[1] - 1 - row if self.layout.upward else row

    def rows(self) -> PlateRows:
        """Return the plate row by row where files allow it; InputError here or where rows are read."""
        if not self.layout.by_row:
            return self.plate
        self._check_complete()
        first = self._read(next(self.layout.indices(self.shape)))

        def row(number: int) -> Pixels:
            hogels = empty_row(rows)
            for index in self.layout.indices(self.shape, number):
                self._put(index, self._read(index), rows, _as_plate(hogels, self.shape))
            return hogels

        rows = PlateRows(shape=self.shape, levels=first.levels, dtype=first.pixels.dtype, row=row)
        return rows

    @cached_property
    def plate(self) -> Plates:
        """The whole plate; InputError where a file is missing, damaged or of another size than the others."""
        self._check_complete()
        plate: Plates | None = None
        for index in self.layout.indices(self.shape):
            picture = self._read(index)
            plate = plate or Plates.empty(self.shape, picture.pixels.dtype, picture.levels)
            self._put(index, picture, plate, plate.pixels)
            plate.lossy = plate.lossy or picture.lossy
        assert plate is not None
        return plate

    def _check_complete(self) -> None:
        for index in self.layout.indices(self.shape):
            self._path(index)

    def _path(self, index: Index) -> Path:
        path = self.files.get(index)
        if path is None:
            tiles = (self.stated[0], self.stated[1]) if self.layout.name == "quilt" else None
            stem = self.layout.stem(index, self.shape, Naming(tiles=tiles))
            raise InputError(f"{self.place}: has no file such as {stem}{self.layout.suffix}")
        return path

    def _put(self, index: Index, picture: Picture, plate: PlateRows, pixels: Pixels) -> None:
        """Copy a file's pixels to their places in a plate."""
        if (picture.pixels.dtype, picture.levels) != (plate.dtype, plate.levels):
            raise InputError(f"{self._path(index)}: has another type of pixels than the others")
        view = self.layout.view(pixels, index, self.stated)
        view[...] = picture.pixels.reshape(view.shape)

    def _read(self, index: Index) -> Picture:
        path = self._path(index)
        *frames, height, width = _stored_shape(self.layout, self.shape, index, self.stated)
        if frames:
            return read_video(path, frames[0], (width, height))
        picture = read_picture(path)
        high, wide = picture.pixels.shape[:2]
        if self.layout.name == "quilt" and wide >= width and high >= height:
            # Tiles are rounded down to whole pixels; what is left over lies at the right and at the
            # top.
            return replace(picture, pixels=picture.pixels[high - height :, :width])
        if (wide, high) != (width, height):
            raise InputError(f"{path}: is {wide} x {high}, and should be {width} x {height}")
        return picture


def _stored_shape(
    layout: Layout, shape: PlateShape, index: Index, stated: Index
) -> tuple[int, ...]:
    """Return (H, W) of the picture in which a file is stored, or (frames, H, W) of its video."""
    held = layout.view(np.broadcast_to(np.uint8(0), shape.array), index, stated).shape[:-1]
    return (held[0] * held[1], held[2] * held[3]) if len(held) == 4 else held  # four axes of tiles


def find_files(
    place: Path, told: PlateShape | None = None, layouts: Sequence[Layout] = LAYOUTS
) -> FileSet:
    """Return the files of a place in the layout, out of some, that their names fit.

    It is the one that most names fit, then the one that forms the plate that somebody tells, then
    the first. Whether pictures are what a layout claims, no name says: `xfrustum verify` finds it.
    Raises InputError, with the reason, where there are no such files.
    """
    paths = pictures_at(place)
    found: list[FileSet] = []
    problems: list[str] = []
    for layout in layouts:
        named = [
            (numbers, path)
            for path in paths
            if (numbers := layout.read_name(path.name)) is not None
        ]
        alone = not layout.numbers
        # A layout of one picture fits a folder of one; a name that states numbers is not that of
        # any picture.
        if (
            not named
            or (alone and len(paths) > 1)
            or (alone and not layout.stated and (found or problems))
        ):
            continue
        try:
            found.append(_file_set(place, layout, named, told, len(paths)))
        except InputError as error:
            problems.append(f"{layout.name}: {error}")
    if found:
        return max(found, key=lambda one: (-one.strangers, told is not None and one.shape == told))
    stated = layouts[0].name if len({layout.name for layout in layouts}) == 1 else None
    likely = next(
        (one for one in LAYOUTS if one.numbers and all(one.read_name(p.name) for p in paths)), None
    )
    why = "have names of no layout"
    if stated and likely is not None:
        why = f"are not named as those of {stated}; they look like {likely.name}"
    problems.append(f"its files ({len(paths)} pictures, such as {paths[0].name}) {why}")
    name = stated or "that their names fit"
    raise InputError(f"{place}: cannot be read in the layout {name}: {problems[0]}")


def pictures_at(place: Path) -> list[Path]:
    """Return the files that layouts are made of, neither ground truths nor hidden ones; else InputError."""
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
    known = (*PICTURE_SUFFIXES, VIDEO_SUFFIX)
    pictures = [
        p for p in paths if p.suffix.lower() in known and not p.name.startswith((".", "gt_"))
    ]
    if not pictures:
        raise InputError(f"{place}: has no pictures; name a folder of pictures, or one picture")
    return pictures


Named = tuple[tuple[Index, Index], Path]  # a file, and the numbers that its name counts and states


def _file_set(
    place: Path, layout: Layout, named: Sequence[Named], told: PlateShape | None, pictures: int
) -> FileSet:
    """Return the files of a layout; InputError where what they say does not fit together."""
    files: dict[Index, Path] = {}
    for (index, _), path in named:
        if files.setdefault(index, path) is not path:
            raise InputError(
                f"{files[index].name} and {path.name} state the same numbers; keep one of them in the folder"
            )
    stated = {states for (_, states), _ in named}
    if len(stated) > 1:
        raise InputError(f"names of files state plates of different sizes: {sorted(stated)[:3]}")
    first, (said,) = files[min(files)], stated
    if first.suffix.lower() == VIDEO_SUFFIX:
        frames, size = video_size(first)
        told = PlateShape(hogels=(frames, 1), resolution=size)
    else:
        size = picture_size(first)
        told = _told_beside(layout, first) or told
    shape, strangers = layout.shape(files.keys(), said, size, told), pictures - len(files)
    return FileSet(
        place=place, layout=layout, files=files, stated=said, shape=shape, strangers=strangers
    )


def _told_beside(layout: Layout, first: Path) -> PlateShape | None:
    """Return the shape that a picture or the file beside it states; None where they state none."""
    try:
        if layout.name == "mosaic":
            stated: Any = picture_text(first)
        elif layout.in_hogels and (path := first.parent / PLATE_FILE).is_file():
            stated = json.loads(read_small(path, "description of a plate", MAX_FACTS_BYTES))
        elif layout.name == "hci" and (path := first.parent / PARAMETERS_FILE).is_file():
            parser = configparser.ConfigParser(interpolation=None)
            parser.read_string(read_small(path, "file of parameters", MAX_FACTS_BYTES).decode())
            values = {key: value for section in parser.values() for key, value in section.items()}
            counts = int(values["num_cams_x"]), int(values["num_cams_y"])
            stated = {"hogels": (1, 1), "resolution": counts}
        else:
            return None
        (columns, rows), (width, height) = (
            map(int, stated[key]) for key in ("hogels", "resolution")
        )
    except (configparser.Error, KeyError, TypeError, ValueError, OverflowError, RecursionError):
        return None
    if min(columns, rows, width, height) < 1:
        return None
    return PlateShape(hogels=(columns, rows), resolution=(width, height))


@dataclass(frozen=True, kw_only=True)
class Target:
    """The layout of files that are to be written, and what their names state."""

    layout: Layout
    naming: Naming

    def levels(self, before: int | None) -> int | None:
        """Return the largest level of the files' pixels; None where they are floating-point numbers."""
        ppm = PLENO_LEVELS if self.layout.name == "pleno" else before or BYTE_LEVELS
        levels = {".ppm": ppm, ".png": BYTE_LEVELS, VIDEO_SUFFIX: BYTE_LEVELS, ".exr": None}
        if self.naming.suffix not in levels:
            raise InputError(
                f"files that end in {self.naming.suffix} are not written; choose .png, .ppm or .exr"
            )
        return levels[self.naming.suffix]

    def file_name(self, index: Index, shape: PlateShape) -> str:
        """Return the name of a file; InputError where the layout has no place for such a plate."""
        return self.layout.stem(index, shape, self.naming) + self.naming.suffix

    def losses(self, plate: PlateRows) -> tuple[str, ...]:
        """Return what is lost when a plate is written, one clause each; none where every bit is kept."""
        found = []
        height, after = plate.shape.resolution[1], self.levels(plate.levels)
        if self.layout.horizontal and height > 1:
            found.append(
                f"vertical parallax: of {height} rows of pixels of each hogel, row {height // 2} "
                "(from 0 at the top) is kept"
            )
        if plate.levels is None and after is not None:
            found.append(
                f"floating-point numbers: radiance is clipped to 0 and 1 and rounded to {after} levels"
            )
        elif plate.levels is not None and after is not None and after < plate.levels:
            found.append(f"levels: {plate.levels} are rounded to {after}")
        return tuple(found)

    def notes(self, plate: PlateRows) -> tuple[str, ...]:
        """Return what readers of this layout may expect and files do not have, one sentence each."""
        return (*self._layout_notes(plate.shape), *self._encoding_notes(plate))

    def _encoding_notes(self, plate: PlateRows) -> tuple[str, ...]:
        """Return how the pixels of pictures for displays are encoded, which take them for sRGB."""
        if self.layout.name not in FOR_DISPLAYS:
            return ()
        if not plate.linear:
            return (
                "pixels are encoded as in the files that were read; displays take them for sRGB",
            )
        linear = (
            "pixels are linear radiance, as the plate stores them, and displays take them for sRGB"
        )
        told = " (a PNG file says so: gAMA)" if self.naming.suffix == ".png" else ""
        return (f"{linear}{told}; `view --quilt` writes sRGB",)

    def _layout_notes(self, shape: PlateShape) -> tuple[str, ...]:
        if self.layout.name == "burnett":
            return (
                "its own renderer samples pixels at their corners; re-arranging moves no sample",
            )
        if self.layout.name == "quilt":
            return (
                "views are evenly spaced on the film (in tangents), a display's eyes evenly in angle",
            )
        if self.layout.name == "cubevi" and shape.hogels != CUBEVI_TILE_PX:
            size = f"{CUBEVI_TILE_PX[0]} x {CUBEVI_TILE_PX[1]}"
            return (f"the display has tiles of {size} pixels, and this plate {shape.words}",)
        return ()


def write_files(
    plate: PlateRows, target: Target, folder: Path, done: Callable[[], object] = lambda: None
) -> None:
    """Write a plate into a folder; `done` is called after each file.

    Where each file has pixels of one row of hogels alone, no more than a row is held in memory.
    Raises InputError where the layout or the files cannot hold such a plate, OSError where a file
    cannot be written.
    """
    shape, layout = plate.shape, target.layout
    levels, stated = target.levels(plate.levels), layout.states(shape, target.naming)
    text: dict[str, object] | None = None
    if layout.name == "mosaic":
        text = {"layout": layout.name, "hogels": shape.hogels, "resolution": shape.resolution}
    whole = None if layout.by_row else whole_plate(plate).pixels
    for row in range(shape.hogels[1] if whole is None else 1):
        pixels = _as_plate(plate.row(row), shape) if whole is None else whole
        for index in layout.indices(shape, row):
            path = folder / target.file_name(index, shape)
            held = np.ascontiguousarray(layout.view(pixels, index, stated))
            stored = held.reshape(*_stored_shape(layout, shape, index, stated), 3)
            linear = plate.linear and layout.name in FOR_DISPLAYS
            values = with_levels(stored, plate.levels, levels)
            picture = Picture(pixels=values, levels=levels, linear=linear)
            if layout.suffix == VIDEO_SUFFIX:
                write_video(path, picture.pixels)
            else:
                write_picture(path, picture, text)
            done()
