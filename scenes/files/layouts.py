"""Layouts of files that store the pictures of a plate: one table row each.

A layout with one file per hogel is defined by the numbers in file names and by its orientation. In
all other layouts, each file is a NumPy view of the plate's pixels (row j, column i, pixel row r,
pixel column c, channel): reading assigns the file's pixels to this view, and writing stores the
view. Pixel values do not change.
"""

import math
import re
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from itertools import product
from typing import Any

from numpy.typing import NDArray

from xfrustum.scenes.arguments import InputError, settle, wholes
from xfrustum.scenes.disk import check_hogels

Pixels = NDArray[Any]  # samples in the type of their files: uint8, float16 or float32
Index = tuple[int, ...]  # numbers in the name of a file
#: suffixes of picture files, lower case
PICTURE_SUFFIXES = (".png", ".ppm", ".exr", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
#: columns and rows of tiles of commercial displays, by number of views
KNOWN_QUILTS = {48: (8, 6), 66: (11, 6), 49: (7, 7), 45: (5, 9), 40: (8, 5)}
MAX_DIGITS = 18  # largest number of digits in a number; file names with longer numbers do not match


@dataclass(frozen=True, kw_only=True)
class PlateShape:
    """Columns and rows of hogels of a plate, and width and height of each hogel in pixels.

    Raises InputError for a number below one, or for more hogels than `--max-hogels`.
    """

    hogels: tuple[int, int]
    resolution: tuple[int, int]

    def __post_init__(self) -> None:
        hogels, resolution = wholes(self.hogels, 2), wholes(self.resolution, 2)
        if min(*hogels, *resolution) < 1:
            raise InputError(f"a plate has at least one hogel of one pixel, not {self}")
        check_hogels(hogels[0], hogels[1])
        settle(self, hogels=hogels, resolution=resolution)

    def __str__(self) -> str:
        (columns, rows), (width, height) = self.hogels, self.resolution
        return f"{columns} x {rows} hogels of {width} x {height} pixels"

    @property
    def array(self) -> tuple[int, int, int, int, int]:
        """Shape (rows, columns, height, width, 3) of the pixel array."""
        return *self.hogels[::-1], *self.resolution[::-1], 3


@dataclass(frozen=True)
class Layout:
    """Names, order and orientation of the files of a plate."""

    #: name on the command line; several layouts may share a name
    name: str
    #: content of a file, one clause
    meaning: str
    #: regular expression of a file name without suffix; its groups are numbers
    pattern: str
    #: format of a file name without suffix
    stem_format: str
    #: groups that number the files: hogel column i and row j, pixel row r and column c
    numbers: str
    #: function of a plate's pixels, a file's numbers and the stated numbers that returns the view
    #: of the file's pixels: (H, W, 3), or (tile row, H, tile column, W, 3); None for one file per
    #: hogel
    view: Callable[[Pixels, Index, Index], Pixels] | None = field(default=None, repr=False)
    #: groups with the same value in all names
    stated: tuple[str, ...] = ()
    #: horizontal parallax only: one pixel row of each hogel
    horizontal: bool = False
    #: hogel rows counted from the bottom
    upward: bool = False
    #: pictures turned by 180 degrees
    turned: bool = False

    @property
    def in_hogels(self) -> bool:
        """True if each hogel has its own file, so that files of a plate may be missing."""
        return self.view is None

    def read_name(self, name: str) -> tuple[Index, Index] | None:
        """Return the counting and the stated numbers of a file name; None if it does not match."""
        suffixes = "|".join(map(re.escape, PICTURE_SUFFIXES))
        match = re.fullmatch(f"(?:{self.pattern})(?:{suffixes})", name, re.ASCII)
        if match is None or any(len(number) > MAX_DIGITS for number in match.groups()):
            return None
        return tuple(int(match[n]) for n in self.numbers), tuple(int(match[n]) for n in self.stated)

    def counts(self, shape: PlateShape) -> Index:
        """Return the number of values of each counting number."""
        rows, columns, height, width, _ = shape.array
        counted = {"i": columns, "j": rows, "r": height, "c": width}
        return tuple(counted[number] for number in self.numbers)

    def file_count(self, shape: PlateShape) -> int:
        """Return the number of files of a plate."""
        return math.prod(self.counts(shape))

    def indices(self, shape: PlateShape) -> Iterator[Index]:
        """Yield the numbers in the name of each file of a plate."""
        yield from product(*map(range, self.counts(shape)))

    def hogel_index(self, shape: PlateShape, column: int, row: int) -> Index:
        """Return the numbers in the name of a hogel's own file."""
        return column, shape.hogels[1] - 1 - row if self.upward else row

    def shape(
        self,
        counted: Collection[Index],
        stated: Index,
        size: tuple[int, int],
        known: PlateShape | None,
    ) -> PlateShape:
        """Return the shape of the plate that some files form; InputError if they form none.

        Parameters
        ----------
        counted, stated
            Numbers of the file names.
        size
            Width and height of a picture.
        known
            Shape that the scene, or a file beside the pictures, states.
        """
        # If names state the plate's size, or the plate is known, files may be missing.
        counts = []
        for axis in range(len(self.numbers)):
            numbers = {index[axis] for index in counted}
            if 0 not in numbers and not stated and (known is None or not self.in_hogels):
                raise InputError(
                    f"names of files count from {min(numbers)}, not from 0; rename them, or add "
                    "the rest"
                )
            counts.append(max(numbers) + 1)
        (width, height), hogels, resolution = size, size, size
        if self.in_hogels:
            hogels = (counts[0], counts[1]) if known is None else known.hogels
            hogels = (stated[0], stated[1]) if stated else hogels
        elif self.numbers == "i":
            hogels, resolution = (counts[0], height), (width, 1)
        elif self.numbers == "rc":
            resolution = counts[1], counts[0]
        elif self.horizontal:  # a tile has one pixel per hogel, rounded down by the specification
            columns, rows = stated
            if min(columns, rows) < 1:
                raise InputError(
                    f"{columns} x {rows} tiles do not exist; a quilt has at least 1 x 1"
                )
            hogels, resolution = (width // columns, height // rows), (columns * rows, 1)
        else:
            hogels, resolution = _mosaic(size, known)
        return PlateShape(hogels=hogels, resolution=resolution)


def _mosaic(
    size: tuple[int, int], known: PlateShape | None
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return hogels and resolution of a mosaic."""
    if known is None:
        raise InputError("a mosaic does not state its number of hogels; give --hogels COLUMNS,ROWS")
    (width, height), (columns, rows) = size, known.hogels
    if width % columns or height % rows:
        raise InputError(
            f"a mosaic of {width} x {height} pixels cannot be divided into {columns} x {rows} "
            "hogels"
        )
    return known.hogels, (width // columns, height // rows)


def _pixel_view(pixels: Pixels, index: Index, _: Index) -> Pixels:
    return pixels[:, :, index[0], index[1]]


def middle_row(pixels: Pixels) -> Pixels:
    """Return the view (rows, columns, width, 3) of each hogel's pixel row just below its middle."""
    return pixels[:, :, pixels.shape[2] // 2]


def tiled_views(pixels: Pixels, _: Index, tiles: Index) -> Pixels:
    """Return the view (tile row, plate row, tile column, plate column, 3) of a plate's pixels.

    View k = 0, 1, .. is the view of eye k from the left, and shows pixel k from the right of each
    hogel: the line of a pixel at u > 0 goes to the right behind the plate, and to the left in front
    of it.
    """
    eyes = middle_row(pixels)[:, :, ::-1]
    views = eyes.reshape(*eyes.shape[:2], tiles[1], tiles[0], -1)
    return views[:, :, ::-1].transpose(2, 0, 3, 1, 4)


def quilt_tiles(views: int, tiles: tuple[int, int] | None) -> Index:
    """Return columns and rows of tiles: as stated, of a known display, or close to a square."""
    rows = max(number for number in range(1, math.isqrt(views) + 1) if views % number == 0)
    tiles = tiles or KNOWN_QUILTS.get(views, (views // rows, rows))
    if math.prod(tiles) != views:
        raise InputError(f"{tiles[0]} x {tiles[1]} tiles hold no {views} views")
    return tiles


#: all layouts; the first that matches the file names is used
LAYOUTS = (
    # This layout comes first, because its names also fit the pattern of `hogels`.
    Layout("hocking", "one picture per hogel, rows counted upward, names state the plate's size",
           r"hogel_(?P<i>\d{4})_(?P<columns>\d{4})_(?P<j>\d{4})_(?P<rows>\d{4})",
           "hogel_{i:04}_{columns:04}_{j:04}_{rows:04}", "ij",
           stated=("columns", "rows"), upward=True),
    Layout("burnett", "one picture per hogel, row before column, turned by 180 degrees",
           r"Hogel_(?P<j>\d+)x(?P<i>\d+)", "Hogel_{j}x{i}", "ij", turned=True),
    Layout("hocking-columns", "one picture per hogel column, a line per hogel, mirrored",
           r"Hogel_Column_(?P<i>\d+)", "Hogel_Column_{i}", "i",
           lambda pixels, index, _: middle_row(pixels)[:, index[0], ::-1], horizontal=True),
    # The camera position of some names ends with an underscore.
    Layout("stanford", "one view per pixel of a hogel, row before column, with camera positions",
           r"out_(?P<r>\d+)_(?P<c>\d+)_-?\d+(?:\.\d*)?_-?\d+(?:\.\d*)?_?",
           "out_{r:02}_{c:02}_{v:.6f}_{u:.6f}", "rc", _pixel_view),
    Layout("views", "one view per pixel of a hogel, row before column",
           r"(?P<r>\d+)_(?P<c>\d+)", "{r}_{c}", "rc", _pixel_view),
    Layout("quilt", "one picture of views, view 0 of the leftmost eye at the bottom left, "
           "the name says columns x rows",
           r".*_qs(?P<columns>\d+)x(?P<rows>\d+)(?:a\d+(?:\.\d+)?)?",
           "{stem}_qs{columns}x{rows}a{aspect:.4g}", "",
           tiled_views,
           stated=("columns", "rows"), horizontal=True),
    # Names of other layouts begin with out_, hogel_ or Hogel_.
    Layout("burnett", "one aperture view per hogel, y before x, turned by 180 degrees",
           r"(?!out_|hogel_|Hogel_)[^\d_]+_(?P<j>\d+)_(?P<i>\d+)(?:_\d+_\d+)?", "name_{j}_{i}",
           "ij", turned=True),
    Layout("hogels", "one picture per hogel, column before row, row 0 at the top",
           r"[^\d]*(?P<i>\d+)[^\d]+(?P<j>\d+)", "hogel_{i}x{j}", "ij"),
    # This layout comes last, because its pattern matches every name.
    Layout("mosaic", "one picture, hogel (i, j) is the tile at column i, row j", r".+", "{stem}",
           "", lambda pixels, _, __: pixels.transpose(0, 2, 1, 3, 4)),
)  # fmt: skip
#: names on the command line
NAMES = tuple(dict.fromkeys(layout.name for layout in LAYOUTS))
#: layouts that consist of a single picture of any name
SINGLE_PICTURES = ("mosaic", "quilt")


def layouts_named(name: str) -> tuple[Layout, ...]:
    """Return the layouts with a name; InputError for an unknown name."""
    if name not in NAMES:
        raise InputError(f"layout {name!r} is not one of {', '.join(NAMES)}")
    return tuple(layout for layout in LAYOUTS if layout.name == name)


@dataclass(frozen=True, kw_only=True)
class Target:
    """Layout for writing, with the free parts of its file names."""

    layout: Layout
    suffix: str = ".png"
    #: beginning of the name of a single picture; the layout's name if empty
    stem: str = ""
    #: width over height of a quilt's plate; None selects the ratio of hogels
    aspect: float | None = None
    #: columns and rows of a quilt; None derives them from its views
    tiles: tuple[int, int] | None = None

    @property
    def floating(self) -> bool:
        """True if files have floating-point numbers instead of levels from 0 to 255."""
        return self.suffix == ".exr"

    def stated(self, shape: PlateShape) -> Index:
        """Return the numbers that all names state; InputError if tiles do not hold the views."""
        if self.layout.name == "quilt":
            return quilt_tiles(shape.resolution[0], self.tiles)
        return shape.hogels

    def file_name(self, index: Index, shape: PlateShape) -> str:
        """Return the name of a file; InputError if the layout cannot hold such a plate."""
        (columns, rows), (width, height) = self.stated(shape), shape.resolution
        values = dict(zip(self.layout.numbers, index, strict=True))
        stem = self.layout.stem_format.format(
            **values,
            columns=columns,
            rows=rows,
            # Film coordinates of a pixel: the position of its camera in an arbitrary unit, v
            # upward.
            v=1 - (2 * values.get("r", 0) + 1) / height,
            u=(2 * values.get("c", 0) + 1) / width - 1,
            stem=self.stem or self.layout.name,
            aspect=self.aspect or shape.hogels[0] / shape.hogels[1],
        )
        return stem + self.suffix
