"""Layouts of one picture for the whole plate: mosaics of hogels, and quilts of views."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
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
    middle_row,
)

KNOWN_QUILTS = {48: (8, 6), 66: (11, 6), 49: (7, 7), 45: (5, 9), 40: (8, 5)}
"""Columns and rows of tiles that displays are sold with, by the number of views."""

CUBEVI_TILES, CUBEVI_TILE_PX = (8, 5), (540, 960)
"""Columns and rows of tiles of a CubeVi picture, and the size of each in pixels."""


@dataclass(frozen=True, kw_only=True)
class Mosaic(PatternedNames):
    """One picture of all hogels: hogel (i, j) is the tile at column i, row j."""

    name: ClassVar[str] = "mosaic"
    words: ClassVar[str] = "one picture, hogel (i, j) is the tile at column i, row j"
    pattern: ClassVar[str] = rf".+{SUFFIX_PATTERN}"

    def parts(self, shape: PlateShape, naming: Naming) -> Iterator[Part]:
        """Yield the picture."""
        (columns, rows), (width, height) = shape.hogels, shape.resolution
        yield Part(
            index=(),
            name=f"{naming.stem or 'mosaic'}{naming.suffix}",
            size=(columns * width, rows * height),
            select=lambda pixels: pixels.transpose(0, 2, 1, 3, 4),
        )

    def shape_of(
        self, indices: Sequence[Index], size: tuple[int, int], told: PlateShape | None
    ) -> PlateShape:
        """Return the shape: the numbers of hogels must be told."""
        if told is None:
            raise InputError(
                "a mosaic does not say how many hogels it has; say it with --hogels COLUMNS,ROWS"
            )
        columns, rows = told.hogels
        if size[0] % columns or size[1] % rows:
            raise InputError(
                f"a mosaic of {size[0]} x {size[1]} pixels cannot be divided into {columns} x {rows} hogels"
            )
        return PlateShape(hogels=told.hogels, resolution=(size[0] // columns, size[1] // rows))


@dataclass(frozen=True, kw_only=True)
class Quilt(PatternedNames):
    """One picture of views side by side, for eyes from left to right (horizontal parallax alone).

    The leftmost eye sees what the rightmost pixel of each hogel shows.

    Attributes
    ----------
    downward
        Whether view 0 is at the top left, and not at the bottom left.
    exchanged
        Whether the name is read as rows x columns, which is a mistake.
    """

    downward: bool = False
    exchanged: bool = False
    name: ClassVar[str] = "quilt"
    horizontal: ClassVar[bool] = True
    pattern: ClassVar[str] = rf".*_qs(\d+)x(\d+)a\d+(?:\.\d+)?{SUFFIX_PATTERN}"

    @property
    def words(self) -> str:
        """Where view 0 lies, and what the name states."""
        corner = "top" if self.downward else "bottom"
        stated = "rows x columns" if self.exchanged else "columns x rows"
        return (
            f"one picture of views, view 0 of the leftmost eye at the {corner} left, the name says {stated}"
        )

    def index_of(self, name: str) -> Index | None:
        """Return the numbers of columns and rows of tiles."""
        stated = super().index_of(name)
        return stated[::-1] if stated is not None and self.exchanged else stated

    def parts(self, shape: PlateShape, naming: Naming) -> Iterator[Part]:
        """Yield the picture."""
        columns, rows = naming.tiles or quilt_tiles(shape.resolution[0])
        if columns * rows != shape.resolution[0]:
            raise InputError(f"{columns} x {rows} tiles hold no {shape.resolution[0]} views")
        aspect = naming.aspect or shape.hogels[0] / shape.hogels[1]
        stated = (rows, columns) if self.exchanged else (columns, rows)
        yield Part(
            index=(columns, rows),
            name=f"{naming.stem or 'quilt'}_qs{stated[0]}x{stated[1]}a{aspect:.4g}{naming.suffix}",
            size=(columns * shape.hogels[0], rows * shape.hogels[1]),
            select=lambda pixels: tiled_views(pixels, columns, rows, downward=self.downward),
        )

    def shape_of(
        self, indices: Sequence[Index], size: tuple[int, int], told: PlateShape | None
    ) -> PlateShape:
        """Return the shape: a tile has a pixel for each hogel, rounded down as the format says."""
        columns, rows = indices[0]
        return PlateShape(hogels=(size[0] // columns, size[1] // rows), resolution=(columns * rows, 1))


@dataclass(frozen=True, kw_only=True)
class CubeVi(PatternedNames):
    """A quilt of 8 x 5 tiles with view 0 at the top left.

    Attributes
    ----------
    downward
        Whether view 0 is at the top left; at the bottom left, as in other quilts, is a mistake.
    """

    downward: bool = True
    name: ClassVar[str] = "cubevi"
    horizontal: ClassVar[bool] = True
    pattern: ClassVar[str] = rf".+{SUFFIX_PATTERN}"

    @property
    def words(self) -> str:
        """Where view 0 lies."""
        corner = "top" if self.downward else "bottom"
        return f"one picture of 8 x 5 views, view 0 of the leftmost eye at the {corner} left"

    def parts(self, shape: PlateShape, naming: Naming) -> Iterator[Part]:
        """Yield the picture."""
        columns, rows = CUBEVI_TILES
        if shape.resolution[0] != columns * rows:
            raise InputError(
                f"a CubeVi picture has {columns * rows} views, and hogels have {shape.resolution[0]} columns "
                f"of pixels; draw hogels that are {columns * rows} pixels wide"
            )
        yield Part(
            index=(),
            name=f"{naming.stem or 'cubevi'}{naming.suffix}",
            size=(columns * shape.hogels[0], rows * shape.hogels[1]),
            select=lambda pixels: tiled_views(pixels, columns, rows, downward=self.downward),
        )

    def shape_of(
        self, indices: Sequence[Index], size: tuple[int, int], told: PlateShape | None
    ) -> PlateShape:
        """Return the shape: a tile has a pixel for each hogel."""
        columns, rows = CUBEVI_TILES
        return PlateShape(hogels=(size[0] // columns, size[1] // rows), resolution=(columns * rows, 1))


def tiled_views(pixels: Pixels, columns: int, rows: int, *, downward: bool) -> Pixels:
    """Return the view (tile row, plate row, tile column, plate column, 3) of a plate's pixels.

    View k = 0, 1, .. is that of the eye k from the left: the pixel k from the right of each hogel.
    """
    eyes = middle_row(pixels)[:, :, ::-1]
    plate_rows, plate_columns = eyes.shape[:2]
    tiles = eyes.reshape(plate_rows, plate_columns, rows, columns, -1)
    if not downward:
        tiles = tiles[:, :, ::-1]
    return tiles.transpose(2, 0, 3, 1, 4)


def quilt_tiles(views: int) -> tuple[int, int]:
    """Return columns and rows of tiles for a number of views: those of a display, or nearly a square."""
    if views in KNOWN_QUILTS:
        return KNOWN_QUILTS[views]
    rows = max(number for number in range(1, views + 1) if views % number == 0 and number * number <= views)
    return views // rows, rows
