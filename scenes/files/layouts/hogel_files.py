"""Layouts of one picture for each hogel, or for each row or column of hogels."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.layouts.layout import (
    SUFFIX_PATTERN,
    Index,
    Naming,
    Part,
    PatternedNames,
    Pixels,
    PlateShape,
    counts,
    middle_row,
)

NameOf = Callable[[int, int, PlateShape], str]
"""Function that returns the name, without a suffix, of the file of a column, a row and a shape."""


@dataclass(frozen=True, kw_only=True)
class HogelFiles:
    """One picture for each hogel.

    Attributes
    ----------
    name, words
        As in `Layout`.
    pattern
        Regular expression of a name without its suffix. Its groups `i` and `j` are the numbers along and
        across rows; groups `columns` and `rows`, where there are any, the numbers of hogels.
    name_of
        Function that writes such a name.
    upward
        Whether rows are counted from the bottom.
    turned
        Whether pictures are turned by 180 degrees.
    """

    name: str
    words: str
    pattern: str
    name_of: NameOf = field(repr=False)
    upward: bool = False
    turned: bool = False
    suffix: ClassVar[str] = ".png"
    horizontal: ClassVar[bool] = False
    in_hogels: ClassVar[bool] = True

    def index_of(self, name: str) -> Index | None:
        """Return i and j, and the numbers of columns and rows where the name states them."""
        found = re.fullmatch(f"(?:{self.pattern}){SUFFIX_PATTERN}", name, re.ASCII)
        if found is None:
            return None
        groups = found.groupdict()
        return tuple(int(groups[name]) for name in ("i", "j", "columns", "rows") if name in groups)

    def parts(self, shape: PlateShape, naming: Naming) -> Iterator[Part]:
        """Yield one picture for each hogel, row by row."""
        columns, rows = shape.hogels
        stated = shape.hogels if "<columns>" in self.pattern else ()
        for row in range(rows):
            for column in range(columns):
                j = rows - 1 - row if self.upward else row
                yield Part(
                    index=(column, j, *stated),
                    name=self.name_of(column, j, shape) + naming.suffix,
                    size=shape.resolution,
                    select=_one(row, column, turned=self.turned),
                    aperture=(column, row),
                )

    def shape_of(
        self, indices: Sequence[Index], size: tuple[int, int], told: PlateShape | None
    ) -> PlateShape:
        """Return the shape: pictures are hogels, and names state how many there are."""
        stated = {index[2:] for index in indices}
        if len(stated) > 1:
            raise InputError(f"names of files state plates of different sizes: {sorted(stated)}")
        named = next(iter(stated))
        if named:
            return PlateShape(hogels=(named[0], named[1]), resolution=size)
        if told is not None:
            return PlateShape(hogels=told.hogels, resolution=size)
        return PlateShape(hogels=(counts(indices, 0), counts(indices, 1)), resolution=size)


def _one(row: int, column: int, *, turned: bool) -> Callable[[Pixels], Pixels]:
    if turned:
        return lambda pixels: pixels[row, column, ::-1, ::-1]
    return lambda pixels: pixels[row, column]


HOGELS = HogelFiles(
    name="hogels",
    words="one picture for each hogel, column before row, row 0 at the top",
    pattern=r"[^\d]*(?P<i>\d+)[^\d]+(?P<j>\d+)",
    name_of=lambda i, j, shape: f"hogel_{i}x{j}",
)

BURNETT = HogelFiles(
    name="burnett",
    words="one picture for each hogel, row before column, turned by 180 degrees",
    pattern=r"Hogel_(?P<j>\d+)x(?P<i>\d+)",
    name_of=lambda i, j, shape: f"Hogel_{j}x{i}",
    turned=True,
)

BURNETT_VIEWS = HogelFiles(
    name="burnett",
    words="one aperture view for each hogel, y before x, turned by 180 degrees",
    pattern=r"(?!out_|hogel_|Hogel_)[^\d_]+_(?P<j>\d+)_(?P<i>\d+)(?:_\d+_\d+)?",
    name_of=lambda i, j, shape: f"name_{j}_{i}",
    turned=True,
)

HOCKING = HogelFiles(
    name="hocking",
    words="one picture for each hogel, rows counted upward, names state how many there are",
    pattern=r"hogel_(?P<i>\d{4})_(?P<columns>\d{4})_(?P<j>\d{4})_(?P<rows>\d{4})",
    name_of=lambda i, j, shape: f"hogel_{i:04}_{shape.hogels[0]:04}_{j:04}_{shape.hogels[1]:04}",
    upward=True,
)


@dataclass(frozen=True, kw_only=True)
class RowVideos(PatternedNames):
    """One video for each row of hogels, a frame for each hogel (T. Burnett)."""

    name: ClassVar[str] = "burnett"
    words: ClassVar[str] = "one video for each row of hogels, frames turned by 180 degrees"
    suffix: ClassVar[str] = ".avi"
    pattern: ClassVar[str] = r"HogelRow_(\d+)\.avi"

    def parts(self, shape: PlateShape, naming: Naming) -> Iterator[Part]:
        """Yield one video for each row."""
        columns, rows = shape.hogels

        def selected(row: int) -> Callable[[Pixels], Pixels]:
            return lambda pixels: pixels[row, :, ::-1, ::-1]

        for row in range(rows):
            yield Part(
                index=(row,),
                name=f"HogelRow_{row}.avi",
                size=shape.resolution,
                select=selected(row),
                frames=columns,
            )

    def shape_of(
        self, indices: Sequence[Index], size: tuple[int, int], told: PlateShape | None
    ) -> PlateShape:
        """Return the shape: names state the number of rows, and `told` has the number of frames."""
        if told is None:
            raise InputError("the number of frames of a video is not known")
        return PlateShape(hogels=(told.hogels[0], counts(indices, 0)), resolution=size)


@dataclass(frozen=True, kw_only=True)
class HogelColumns(PatternedNames):
    """One picture for each column of hogels: rows of hogels by mirrored directions (J. Hocking)."""

    name: ClassVar[str] = "hocking-columns"
    words: ClassVar[str] = "one picture for each column of hogels, a line for each hogel, mirrored"
    horizontal: ClassVar[bool] = True
    pattern: ClassVar[str] = rf"Hogel_Column_(\d+){SUFFIX_PATTERN}"

    def parts(self, shape: PlateShape, naming: Naming) -> Iterator[Part]:
        """Yield one picture for each column."""
        columns, rows = shape.hogels

        def selected(column: int) -> Callable[[Pixels], Pixels]:
            return lambda pixels: middle_row(pixels)[:, column, ::-1]

        for column in range(columns):
            yield Part(
                index=(column,),
                name=f"Hogel_Column_{column}{naming.suffix}",
                size=(shape.resolution[0], rows),
                select=selected(column),
            )

    def shape_of(
        self, indices: Sequence[Index], size: tuple[int, int], told: PlateShape | None
    ) -> PlateShape:
        """Return the shape: a picture is as wide as a hogel and as high as the plate has rows."""
        return PlateShape(hogels=(counts(indices, 0), size[1]), resolution=(size[0], 1))
