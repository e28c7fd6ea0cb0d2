"""Layouts: the ways in which people store the pictures of a plate, as a table of names and a function each.

A layout names, for each file, a view of the plate's pixels (row j, column i, pixel row r, pixel
column c, channel): reading assigns the file's pixels to it, writing stores it, and no pixel is
computed.
"""

import math
import re
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from itertools import product
from typing import Any

from numpy.typing import NDArray

from xfrustum.scenes.arguments import settle, wholes
from xfrustum.scenes.disk.input_files import check_hogels
from xfrustum.scenes.errors import InputError

Pixels = NDArray[
    Any
]  # samples of pictures in the type of their files: uint8, uint16, float16 or float32
Index = tuple[int, ...]  # the numbers that count the files of a layout, as their names state them
#: Suffixes of files that are taken for pictures, in lower case.
PICTURE_SUFFIXES = (".png", ".ppm", ".exr", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
VIDEO_SUFFIX = ".avi"  # suffix of videos, in lower case
#: Columns and rows of tiles that displays are sold with, by the number of views.
KNOWN_QUILTS = {48: (8, 6), 66: (11, 6), 49: (7, 7), 45: (5, 9), 40: (8, 5)}
#: Columns and rows of tiles of a CubeVi picture, and the size of each in pixels.
CUBEVI_TILES, CUBEVI_TILE_PX = (8, 5), (540, 960)
MAX_DIGITS = 18  # largest number of digits of a number in a file's name: longer ones count nothing


@dataclass(frozen=True, kw_only=True)
class PlateShape:
    """Columns and rows of hogels of a plate, and width and height of each hogel in pixels.

    Raises InputError where a number is below one, or there are more hogels than `--max-hogels`
    allows.
    """

    hogels: tuple[int, int]
    resolution: tuple[int, int]

    def __post_init__(self) -> None:
        hogels, resolution = wholes(self.hogels, 2), wholes(self.resolution, 2)
        if min(*hogels, *resolution) < 1:
            raise InputError(f"a plate has at least one hogel of one pixel, not {self.words}")
        check_hogels(hogels[0], hogels[1])
        settle(self, hogels=hogels, resolution=resolution)

    @property
    def array(self) -> tuple[int, int, int, int, int]:
        """Shape (rows, columns, height, width, 3) of the array of its pixels."""
        return *self.hogels[::-1], *self.resolution[::-1], 3

    @property
    def words(self) -> str:
        """The shape in words."""
        (columns, rows), (width, height) = self.hogels, self.resolution
        return f"{columns} x {rows} hogels of {width} x {height} pixels"


@dataclass(frozen=True, kw_only=True)
class Naming:
    """Facts that names of files state beside their numbers."""

    suffix: str = ".png"
    stem: str = ""  #: beginning of the names of single pictures; the layout's name where empty
    aspect: float | None = (
        None  #: width of the plate over its height, for quilts; None: that of the hogels
    )
    tiles: tuple[int, int] | None = (
        None  #: of a quilt; None for those of a display, or nearly a square
    )


@dataclass(frozen=True)
class Layout:
    """One way to store the pictures of a plate.

    `view` returns, of a plate's pixels, a file's numbers and what all names state, the view (.., 3)
    of the file's pixels: (H, W) of a picture, (tile row, H, tile column, W), or (frame, H, W) of a
    video. `states` returns what names state of a plate; InputError where the layout has no place
    for it.
    """

    name: str  #: on the command line
    words: str  #: meaning of its files, one clause
    #: regular expression of a file's name without its suffix; its groups are numbers and stated
    pattern: str
    stem_format: str  #: the same name as it is written, as a format of the numbers
    numbers: str  #: letters of the groups that count the files: hogels i, j, pixels r, c, cameras k
    view: Callable[[Pixels, Index, Index], Pixels] = field(repr=False)
    stated: tuple[str, ...] = ()  # names of the groups that all names state alike
    states: Callable[[PlateShape, Naming], Index] = field(
        default=lambda shape, naming: (), repr=False
    )
    suffixes: tuple[str, ...] = (
        PICTURE_SUFFIXES  #: first that of files for which nobody asks for another
    )
    horizontal: bool = (
        False  #: whether it keeps horizontal parallax alone: one row of pixels of each hogel
    )
    upward: bool = False  #: whether the number j is counted from the bottom
    turned: bool = False  #: whether pictures are turned by 180 degrees

    @property
    def suffix(self) -> str:
        """Suffix of its files where nobody asks for another."""
        return self.suffixes[0]

    @property
    def in_hogels(self) -> bool:
        """Whether each file is one hogel, so that some can be there without the others."""
        return self.numbers == "ij"

    @property
    def by_row(self) -> bool:
        """Whether each file has pixels of one row of hogels alone."""
        return "j" in self.numbers

    def read_name(self, name: str) -> tuple[Index, Index] | None:
        """Return the numbers that a file's name counts and states; None where the name is no such name."""
        suffixes = "|".join(map(re.escape, self.suffixes))
        found = re.fullmatch(f"(?:{self.pattern})(?:{suffixes})", name, re.ASCII)
        if found is None or any(len(number) > MAX_DIGITS for number in found.groups()):
            return None
        return tuple(int(found[n]) for n in self.numbers), tuple(int(found[n]) for n in self.stated)

    def stem(self, index: Index, shape: PlateShape, naming: Naming) -> str:
        """Return a file's name without its suffix; InputError where the layout has no place for the plate."""
        columns, rows = self.states(shape, naming) or shape.hogels
        (width, height), values = shape.resolution, dict(zip(self.numbers, index, strict=True))
        return self.stem_format.format(
            **values,
            columns=columns,
            rows=rows,
            # Film coordinates of a pixel, those of its camera in any unit: v upward, u to the
            # right.
            v=1 - (2 * values.get("r", 0) + 1) / height,
            u=(2 * values.get("c", 0) + 1) / width - 1,
            stem=naming.stem or self.name,
            aspect=naming.aspect or shape.hogels[0] / shape.hogels[1],
        )

    def counts(self, shape: PlateShape) -> Index:
        """Return how many files a plate has along each of the numbers."""
        rows, columns, height, width, _ = shape.array
        counted = {"i": columns, "j": rows, "r": height, "c": width, "k": height * width}
        return tuple(counted[number] for number in self.numbers)

    def file_count(self, shape: PlateShape) -> int:
        """Return the number of files of a plate."""
        return math.prod(self.counts(shape))

    def indices(self, shape: PlateShape, row: int | None = None) -> Iterator[Index]:
        """Yield the numbers of all files of a plate; row by row, or of one row, where files have one each."""
        if not self.by_row:
            yield from product(*map(range, self.counts(shape)))
            return
        *across, rows = self.counts(shape)
        for number in range(rows) if row is None else (row,):
            j = rows - 1 - number if self.upward else number
            yield from ((*others, j) for others in product(*map(range, across)))

    def shape(
        self,
        counted: Collection[Index],
        stated: Index,
        size: tuple[int, int],
        told: PlateShape | None,
    ) -> PlateShape:
        """Return the shape of the plate that some files form.

        They have names that count and state these numbers, and pictures or frames of a width and a
        height; the scene or a file beside the pictures may have told a shape. Raises InputError
        where they form none.
        """
        counts = []
        for axis in range(len(self.numbers)):
            numbers = {index[axis] for index in counted}
            if 0 not in numbers and not stated and (told is None or self.numbers != "ij"):
                raise InputError(
                    f"names of files count from {min(numbers)}, not from 0; rename them, or add the rest"
                )
            counts.append(max(numbers) + 1)
        (width, height), hogels, resolution = size, size, size
        match self.numbers:
            case "ij" if stated:
                hogels = stated[0], stated[1]
            case "ij":
                hogels = (counts[0], counts[1]) if told is None else told.hogels
            case "j" if told is not None:  # a video's frames
                hogels = told.hogels[0], counts[0]
            case "i":
                hogels, resolution = (counts[0], height), (width, 1)
            case "rc":
                resolution = counts[1], counts[0]
            case "k":
                resolution = _cameras(counts[0], told)
            case _ if (
                self.horizontal
            ):  # a tile has a pixel for each hogel, rounded down as the format says
                columns, rows = stated or CUBEVI_TILES
                if min(columns, rows) < 1:
                    raise InputError(f"{columns} x {rows} tiles are none")
                hogels, resolution = (width // columns, height // rows), (columns * rows, 1)
            case _:
                hogels, resolution = _mosaic(size, told)
        return PlateShape(hogels=hogels, resolution=resolution)


def _cameras(number: int, told: PlateShape | None) -> tuple[int, int]:
    if told is not None and math.prod(told.resolution) == number:
        return told.resolution
    side = math.isqrt(number)
    if side * side != number:
        raise InputError(
            f"{number} cameras form no square, and no parameters.cfg says num_cams_x and num_cams_y"
        )
    return side, side


def _mosaic(
    size: tuple[int, int], told: PlateShape | None
) -> tuple[tuple[int, int], tuple[int, int]]:
    if told is None:
        raise InputError(
            "a mosaic does not say how many hogels it has; say it with --hogels COLUMNS,ROWS"
        )
    (width, height), (columns, rows) = size, told.hogels
    if width % columns or height % rows:
        raise InputError(
            f"a mosaic of {width} x {height} pixels cannot be divided into {columns} x {rows} hogels"
        )
    return told.hogels, (width // columns, height // rows)


def _turned_hogel(pixels: Pixels, index: Index, _: Index) -> Pixels:
    return pixels[index[1], index[0], ::-1, ::-1]


def _pixel_view(pixels: Pixels, index: Index, _: Index) -> Pixels:
    return pixels[:, :, index[0], index[1]]


def _camera_view(pixels: Pixels, index: Index, _: Index) -> Pixels:
    # Lines of a film's right and lower pixels leave the plate to the viewer's left and upward. So
    # the camera at the top left takes the last column and the last row of pixels.
    height, width = pixels.shape[2:4]
    row, column = divmod(index[0], width)
    return pixels[:, :, height - 1 - row, width - 1 - column]


def middle_row(pixels: Pixels) -> Pixels:
    """Return the view (rows, columns, width, 3) of the pixel row just below the middle of each hogel."""
    return pixels[:, :, pixels.shape[2] // 2]


def tiled_views(pixels: Pixels, tiles: Index, *, downward: bool) -> Pixels:
    """Return the view (tile row, plate row, tile column, plate column, 3) of a plate's pixels.

    View k = 0, 1, .. is that of the eye k from the left: the pixel k from the right of each hogel.
    """
    eyes = middle_row(pixels)[:, :, ::-1]
    views = eyes.reshape(*eyes.shape[:2], tiles[1], tiles[0], -1)
    return (views if downward else views[:, :, ::-1]).transpose(2, 0, 3, 1, 4)


def _quilt_tiles(shape: PlateShape, naming: Naming) -> Index:
    """Return columns and rows of tiles: those asked for, those of a display, or nearly a square."""
    views = shape.resolution[0]
    rows = max(number for number in range(1, math.isqrt(views) + 1) if views % number == 0)
    tiles = naming.tiles or KNOWN_QUILTS.get(views, (views // rows, rows))
    if math.prod(tiles) != views:
        raise InputError(f"{tiles[0]} x {tiles[1]} tiles hold no {views} views")
    return tiles


def _cubevi_states(shape: PlateShape, _: Naming) -> Index:
    views = math.prod(CUBEVI_TILES)
    if shape.resolution[0] != views:
        raise InputError(
            f"a CubeVi picture has {views} views, and hogels have {shape.resolution[0]} columns of pixels; "
            f"draw hogels that are {views} pixels wide"
        )
    return ()


#: All layouts. Where names of files fit several and nobody says which is meant, the first one is
#: taken.
LAYOUTS = (
    Layout("hocking", "one picture for each hogel, rows counted upward, names state how many there are",
           r"hogel_(?P<i>\d{4})_(?P<columns>\d{4})_(?P<j>\d{4})_(?P<rows>\d{4})",
           "hogel_{i:04}_{columns:04}_{j:04}_{rows:04}", "ij",
           lambda pixels, index, _: pixels[pixels.shape[0] - 1 - index[1], index[0]],
           stated=("columns", "rows"), states=lambda shape, naming: shape.hogels, upward=True),
    Layout("burnett", "one picture for each hogel, row before column, turned by 180 degrees",
           r"Hogel_(?P<j>\d+)x(?P<i>\d+)", "Hogel_{j}x{i}", "ij", _turned_hogel, turned=True),
    Layout("burnett", "one video for each row of hogels, frames turned by 180 degrees",
           r"HogelRow_(?P<j>\d+)", "HogelRow_{j}", "j",
           lambda pixels, index, _: pixels[index[0], :, ::-1, ::-1], suffixes=(VIDEO_SUFFIX,)),
    Layout("hocking-columns", "one picture for each column of hogels, a line for each hogel, mirrored",
           r"Hogel_Column_(?P<i>\d+)", "Hogel_Column_{i}", "i",
           lambda pixels, index, _: middle_row(pixels)[:, index[0], ::-1], horizontal=True),
    Layout("stanford", "one view for each pixel of a hogel, row before column, with the camera's place",
           r"out_(?P<r>\d+)_(?P<c>\d+)_-?\d+(?:\.\d*)?_-?\d+(?:\.\d*)?_?",
           "out_{r:02}_{c:02}_{v:.6f}_{u:.6f}", "rc", _pixel_view),
    Layout("hci", "one view for each camera, numbered row by row from the top left",
           r"input_Cam(?P<k>\d{3,})", "input_Cam{k:03}", "k", _camera_view),
    Layout("pleno", "one view for each pixel of a hogel, t (row) before s (column), 10 bits",
           r"(?P<r>\d{3})_(?P<c>\d{3})", "{r:03}_{c:03}", "rc", _pixel_view, suffixes=(".ppm",)),
    Layout("views", "one view for each pixel of a hogel, row before column",
           r"(?P<r>\d+)_(?P<c>\d+)", "{r}_{c}", "rc", _pixel_view),
    Layout("quilt", "one picture of views, view 0 of the leftmost eye at the bottom left, "
           "the name says columns x rows",
           r".*_qs(?P<columns>\d+)x(?P<rows>\d+)(?:a\d+(?:\.\d+)?)?",
           "{stem}_qs{columns}x{rows}a{aspect:.4g}", "",
           lambda pixels, _, tiles: tiled_views(pixels, tiles, downward=False),
           stated=("columns", "rows"), states=_quilt_tiles, horizontal=True),
    Layout("burnett", "one aperture view for each hogel, y before x, turned by 180 degrees",
           r"(?!out_|hogel_|Hogel_)[^\d_]+_(?P<j>\d+)_(?P<i>\d+)(?:_\d+_\d+)?", "name_{j}_{i}", "ij",
           _turned_hogel, turned=True),
    Layout("hogels", "one picture for each hogel, column before row, row 0 at the top",
           r"[^\d]*(?P<i>\d+)[^\d]+(?P<j>\d+)", "hogel_{i}x{j}", "ij",
           lambda pixels, index, _: pixels[index[1], index[0]]),
    Layout("mosaic", "one picture, hogel (i, j) is the tile at column i, row j", r".+", "{stem}", "",
           lambda pixels, _, __: pixels.transpose(0, 2, 1, 3, 4)),
    Layout("cubevi", "one picture of 8 x 5 views, view 0 of the leftmost eye at the top left",
           r".+", "{stem}", "", lambda pixels, _, __: tiled_views(pixels, CUBEVI_TILES, downward=True),
           states=_cubevi_states, horizontal=True),
)  # fmt: skip
#: Names of layouts, as the command line takes them.
NAMES = (
    *(
        "hogels",
        "burnett",
        "hocking",
        "hocking-columns",
        "mosaic",
        "views",
        "stanford",
        "pleno",
        "hci",
    ),
    *("quilt", "cubevi"),
)


def layouts_named(name: str) -> tuple[Layout, ...]:
    """Return the layouts of a name, pictures before videos; InputError where no layout has this name."""
    if name not in NAMES:
        raise InputError(f"layout {name!r} is not one of {', '.join(NAMES)}")
    return tuple(layout for layout in LAYOUTS if layout.name == name)


def layout_for(name: str, suffix: str | None) -> Layout:
    """Return the layout of a name in which files with some suffix are written."""
    named = layouts_named(name)
    return next((layout for layout in named if layout.suffix == suffix), named[0])
