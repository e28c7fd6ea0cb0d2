"""Layouts: the ways in which people store the pictures of a plate, as a table of names and a function each.

The pixels of a plate are one array with the axes (row j, column i, pixel row r, pixel column c, channel). A
layout names, for each file, a view of this array; reading assigns the file's pixels to that view, and writing
stores it. So one description serves both ways, and no pixel is computed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

from numpy.typing import NDArray

from xfrustum.scenes.arguments import settle, wholes
from xfrustum.scenes.disk.input_files import check_hogels
from xfrustum.scenes.errors import InputError

Pixels = NDArray[Any]
"""Samples of pictures in the type of their files: uint8, uint16, float16 or float32."""

Index = tuple[int, ...]
"""The numbers that count the files of a layout, as their names state them."""

PICTURE_SUFFIXES = (".png", ".ppm", ".exr", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
"""Suffixes of files that are taken for pictures, in lower case."""

VIDEO_SUFFIX = ".avi"
"""Suffix of videos, in lower case."""

KNOWN_QUILTS = {48: (8, 6), 66: (11, 6), 49: (7, 7), 45: (5, 9), 40: (8, 5)}
"""Columns and rows of tiles that displays are sold with, by the number of views."""

CUBEVI_TILES, CUBEVI_TILE_PX = (8, 5), (540, 960)
"""Columns and rows of tiles of a CubeVi picture, and the size of each in pixels."""


@dataclass(frozen=True, kw_only=True)
class PlateShape:
    """Columns and rows of hogels of a plate, and width and height of each hogel in pixels.

    Raises
    ------
    InputError
        A number is below one, or there are more hogels than `--max-hogels` allows.
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
        (columns, rows), (width, height) = self.hogels, self.resolution
        return rows, columns, height, width, 3

    @property
    def words(self) -> str:
        """The shape in words."""
        (columns, rows), (width, height) = self.hogels, self.resolution
        return f"{columns} x {rows} hogels of {width} x {height} pixels"


@dataclass(frozen=True, kw_only=True)
class Naming:
    """Facts that names of files state beside their numbers.

    Attributes
    ----------
    suffix
        Suffix of picture files, such as .png.
    stem
        Beginning of the names of single pictures.
    aspect
        Width of the plate over its height, which quilts state; None for that of the number of hogels.
    tiles
        Columns and rows of tiles of a quilt; None for those of a display, or nearly a square.
    """

    suffix: str = ".png"
    stem: str = ""
    aspect: float | None = None
    tiles: tuple[int, int] | None = None


@dataclass(frozen=True, kw_only=True)
class FileNumbers:
    """What the names of a folder's files state, and the size of one file's picture.

    Attributes
    ----------
    counted
        Numbers that count the files.
    stated
        Numbers that all names state alike: those of hogels (`hocking`), or of tiles (`quilt`).
    size
        Width and height of a picture; of a video, those of its frames.
    told
        Shape that somebody states, be it the scene or a file beside the pictures.
    """

    counted: Collection[Index]
    stated: Index
    size: tuple[int, int]
    told: PlateShape | None

    def count(self, axis: int) -> int:
        """Return how many numbers, counted from 0, one axis of the names has.

        Raises
        ------
        InputError
            No name states number 0.
        """
        numbers = {index[axis] for index in self.counted}
        if 0 not in numbers:
            raise InputError(
                f"names of files count from {min(numbers)}, not from 0; rename them, or add the rest"
            )
        return max(numbers) + 1


@dataclass(frozen=True, kw_only=True)
class Layout:
    """One way to store the pictures of a plate.

    Attributes
    ----------
    name
        Name on the command line.
    words
        Meaning of its files, one clause.
    pattern
        Regular expression of a file's name without its suffix; its groups are `numbers` and `stated`.
    numbers
        Names of the groups that count the files.
    counts
        Function that returns how many files a plate has along each of these numbers.
    view
        Function that returns the view (.., 3) of a plate's pixels that a file holds, from the pixels, its
        numbers, and what the names state: (H, W) of a picture, (tile row, H, tile column, W) of a picture of
        tiles, or (frame, H, W) of a video.
    stem
        Function that writes a file's name without its suffix from its numbers, the shape and the naming.
    shape
        Function that returns the shape of the plate that some files form.
    stated
        Names of the groups that all names state alike.
    states
        Function that returns what the names of a plate's files state.
    suffix, suffixes
        Suffix of its files where nobody asks for another, and all that it may have.
    horizontal
        Whether it keeps horizontal parallax alone: one row of pixels of each hogel.
    in_hogels
        Whether each file is one hogel, so that some can be there without the others.
    by_row
        Whether each file has pixels of one row of hogels alone; its last number counts these rows.
    upward
        Whether that number is counted from the bottom.
    turned
        Whether pictures are turned by 180 degrees.
    """

    name: str
    words: str
    pattern: str
    numbers: tuple[str, ...]
    counts: Callable[[PlateShape], Index]
    view: Callable[[Pixels, Index, Index], Pixels] = field(repr=False)
    stem: Callable[[Index, PlateShape, Naming], str] = field(repr=False)
    shape: Callable[[FileNumbers], PlateShape] = field(repr=False)
    stated: tuple[str, ...] = ()
    states: Callable[[PlateShape, Naming], Index] = field(default=lambda shape, naming: (), repr=False)
    suffix: str = ".png"
    suffixes: tuple[str, ...] = PICTURE_SUFFIXES
    horizontal: bool = False
    in_hogels: bool = False
    by_row: bool = False
    upward: bool = False
    turned: bool = False

    def read_name(self, name: str) -> tuple[Index, Index] | None:
        """Return the numbers that a file's name counts and states; None where the name is no such name."""
        suffixes = "|".join(map(re.escape, self.suffixes))
        found = re.fullmatch(f"(?:{self.pattern})(?:{suffixes})", name, re.ASCII)
        if found is None or any(len(number) > MAX_DIGITS for number in found.groups()):
            return None
        return tuple(int(found[n]) for n in self.numbers), tuple(int(found[n]) for n in self.stated)

    def file_count(self, shape: PlateShape) -> int:
        """Return the number of files of a plate."""
        return math.prod(self.counts(shape))

    def has(self, index: Index, shape: PlateShape) -> bool:
        """Return whether a plate has a file of these numbers."""
        return all(number < count for number, count in zip(index, self.counts(shape), strict=True))

    def indices(self, shape: PlateShape) -> Iterator[Index]:
        """Yield the numbers of all files of a plate; of hogels and rows, row by row."""
        if not self.by_row:
            yield from product(*map(range, self.counts(shape)))
            return
        *across, rows = self.counts(shape)
        for number in range(rows):
            j = rows - 1 - number if self.upward else number
            yield from ((*others, j) for others in product(*map(range, across)))

    def row_of(self, index: Index, shape: PlateShape) -> int:
        """Return the row of hogels of a file, where each file has pixels of one row alone."""
        return shape.hogels[1] - 1 - index[-1] if self.upward else index[-1]

    def index_of_hogel(self, column: int, row: int, shape: PlateShape) -> Index:
        """Return the numbers of the file of one hogel, where each file is one."""
        return column, shape.hogels[1] - 1 - row if self.upward else row


MAX_DIGITS = 18
"""Largest number of digits of a number in a file's name: longer ones count nothing."""


def middle_row(pixels: Pixels) -> Pixels:
    """Return the view (rows, columns, width, 3) of the pixel row just below the middle of each hogel.

    Horizontal parallax alone shows this row; where hogels have one row of pixels, it is this one.
    """
    return pixels[:, :, pixels.shape[2] // 2]


def tiled_views(pixels: Pixels, tiles: Index, *, downward: bool) -> Pixels:
    """Return the view (tile row, plate row, tile column, plate column, 3) of a plate's pixels.

    View k = 0, 1, .. is that of the eye k from the left: the pixel k from the right of each hogel.
    """
    columns, rows = tiles
    eyes = middle_row(pixels)[:, :, ::-1]
    plate_rows, plate_columns = eyes.shape[:2]
    views = eyes.reshape(plate_rows, plate_columns, rows, columns, -1)
    if not downward:
        views = views[:, :, ::-1]
    return views.transpose(2, 0, 3, 1, 4)


def quilt_tiles(views: int) -> tuple[int, int]:
    """Return columns and rows of tiles for a number of views: those of a display, or nearly a square."""
    if views in KNOWN_QUILTS:
        return KNOWN_QUILTS[views]
    rows = max(number for number in range(1, math.isqrt(views) + 1) if views % number == 0)
    return views // rows, rows


def _shape_of_hogels(files: FileNumbers) -> PlateShape:
    if files.stated:
        return PlateShape(hogels=(files.stated[0], files.stated[1]), resolution=files.size)
    hogels = (files.count(0), files.count(1)) if files.told is None else files.told.hogels
    return PlateShape(hogels=hogels, resolution=files.size)


def _shape_of_videos(files: FileNumbers) -> PlateShape:
    if files.told is None:
        raise InputError("the number of frames of a video is not known")
    return PlateShape(hogels=(files.told.hogels[0], files.count(0)), resolution=files.size)


def _shape_of_columns(files: FileNumbers) -> PlateShape:
    return PlateShape(hogels=(files.count(0), files.size[1]), resolution=(files.size[0], 1))


def _shape_of_views(files: FileNumbers) -> PlateShape:
    return PlateShape(hogels=files.size, resolution=(files.count(1), files.count(0)))


def _shape_of_cameras(files: FileNumbers) -> PlateShape:
    number = files.count(0)
    if files.told is not None and math.prod(files.told.resolution) == number:
        return PlateShape(hogels=files.size, resolution=files.told.resolution)
    side = math.isqrt(number)
    if side * side != number:
        raise InputError(
            f"{number} cameras form no square, and no parameters.cfg says num_cams_x and num_cams_y"
        )
    return PlateShape(hogels=files.size, resolution=(side, side))


def _shape_of_mosaic(files: FileNumbers) -> PlateShape:
    if files.told is None:
        raise InputError("a mosaic does not say how many hogels it has; say it with --hogels COLUMNS,ROWS")
    (width, height), (columns, rows) = files.size, files.told.hogels
    if width % columns or height % rows:
        raise InputError(
            f"a mosaic of {width} x {height} pixels cannot be divided into {columns} x {rows} hogels"
        )
    return PlateShape(hogels=files.told.hogels, resolution=(width // columns, height // rows))


def _shape_of_tiles(files: FileNumbers) -> PlateShape:
    """Return the shape: a tile has a pixel for each hogel, rounded down as the format says."""
    columns, rows = files.stated or CUBEVI_TILES
    if min(columns, rows) < 1:
        raise InputError(f"{columns} x {rows} tiles are none")
    hogels = files.size[0] // columns, files.size[1] // rows
    return PlateShape(hogels=hogels, resolution=(columns * rows, 1))


def _stanford_stem(index: Index, shape: PlateShape, _: Naming) -> str:
    """Return the name of a view of the Stanford archive, whose cameras stand at (y, x).

    As places the film coordinates of the pixel are written, which are those of the camera in any unit: v
    upward, u to the right.
    """
    (r, c), (width, height) = index, shape.resolution
    y, x = 1 - (2 * r + 1) / height, (2 * c + 1) / width - 1
    return f"out_{r:02}_{c:02}_{y:.6f}_{x:.6f}"


def _camera_view(pixels: Pixels, index: Index, _: Index) -> Pixels:
    """Return the view of a camera, counted row by row from the top left as they stand.

    Lines of a film's right and lower pixels leave the plate to the viewer's left and upward. So the camera at
    the top left takes the last column and the last row of pixels.
    """
    height, width = pixels.shape[2:4]
    row, column = divmod(index[0], width)
    return pixels[:, :, height - 1 - row, width - 1 - column]


def _quilt_states(shape: PlateShape, naming: Naming) -> Index:
    columns, rows = naming.tiles or quilt_tiles(shape.resolution[0])
    if columns * rows != shape.resolution[0]:
        raise InputError(f"{columns} x {rows} tiles hold no {shape.resolution[0]} views")
    return columns, rows


def _quilt_stem(_: Index, shape: PlateShape, naming: Naming) -> str:
    columns, rows = _quilt_states(shape, naming)
    aspect = naming.aspect or shape.hogels[0] / shape.hogels[1]
    return f"{naming.stem or 'quilt'}_qs{columns}x{rows}a{aspect:.4g}"


def _cubevi_stem(_: Index, shape: PlateShape, naming: Naming) -> str:
    views = math.prod(CUBEVI_TILES)
    if shape.resolution[0] != views:
        raise InputError(
            f"a CubeVi picture has {views} views, and hogels have {shape.resolution[0]} columns of pixels; "
            f"draw hogels that are {views} pixels wide"
        )
    return naming.stem or "cubevi"


HOGELS = Layout(
    name="hogels",
    words="one picture for each hogel, column before row, row 0 at the top",
    pattern=r"[^\d]*(?P<i>\d+)[^\d]+(?P<j>\d+)",
    numbers=("i", "j"),
    counts=lambda shape: shape.hogels,
    view=lambda pixels, index, _: pixels[index[1], index[0]],
    stem=lambda index, shape, naming: f"hogel_{index[0]}x{index[1]}",
    shape=_shape_of_hogels,
    in_hogels=True,
    by_row=True,
)

BURNETT = replace(
    HOGELS,
    name="burnett",
    words="one picture for each hogel, row before column, turned by 180 degrees",
    pattern=r"Hogel_(?P<j>\d+)x(?P<i>\d+)",
    view=lambda pixels, index, _: pixels[index[1], index[0], ::-1, ::-1],
    stem=lambda index, shape, naming: f"Hogel_{index[1]}x{index[0]}",
    turned=True,
)

BURNETT_VIEWS = replace(
    BURNETT,
    words="one aperture view for each hogel, y before x, turned by 180 degrees",
    pattern=r"(?!out_|hogel_|Hogel_)[^\d_]+_(?P<j>\d+)_(?P<i>\d+)(?:_\d+_\d+)?",
    stem=lambda index, shape, naming: f"name_{index[1]}_{index[0]}",
)

BURNETT_VIDEOS = Layout(
    name="burnett",
    words="one video for each row of hogels, frames turned by 180 degrees",
    pattern=r"HogelRow_(?P<j>\d+)",
    numbers=("j",),
    counts=lambda shape: (shape.hogels[1],),
    view=lambda pixels, index, _: pixels[index[0], :, ::-1, ::-1],
    stem=lambda index, shape, naming: f"HogelRow_{index[0]}",
    shape=_shape_of_videos,
    suffix=VIDEO_SUFFIX,
    suffixes=(VIDEO_SUFFIX,),
    by_row=True,
)

HOCKING = replace(
    HOGELS,
    name="hocking",
    words="one picture for each hogel, rows counted upward, names state how many there are",
    pattern=r"hogel_(?P<i>\d{4})_(?P<columns>\d{4})_(?P<j>\d{4})_(?P<rows>\d{4})",
    view=lambda pixels, index, _: pixels[pixels.shape[0] - 1 - index[1], index[0]],
    stem=lambda index, shape, naming: (
        f"hogel_{index[0]:04}_{shape.hogels[0]:04}_{index[1]:04}_{shape.hogels[1]:04}"
    ),
    stated=("columns", "rows"),
    states=lambda shape, naming: shape.hogels,
    upward=True,
)

HOCKING_COLUMNS = Layout(
    name="hocking-columns",
    words="one picture for each column of hogels, a line for each hogel, mirrored",
    pattern=r"Hogel_Column_(?P<i>\d+)",
    numbers=("i",),
    counts=lambda shape: (shape.hogels[0],),
    view=lambda pixels, index, _: middle_row(pixels)[:, index[0], ::-1],
    stem=lambda index, shape, naming: f"Hogel_Column_{index[0]}",
    shape=_shape_of_columns,
    horizontal=True,
)

VIEWS = Layout(
    name="views",
    words="one view for each pixel of a hogel, row before column",
    pattern=r"(?P<r>\d+)_(?P<c>\d+)",
    numbers=("r", "c"),
    counts=lambda shape: shape.resolution[::-1],
    view=lambda pixels, index, _: pixels[:, :, index[0], index[1]],
    stem=lambda index, shape, naming: f"{index[0]}_{index[1]}",
    shape=_shape_of_views,
)

STANFORD = replace(
    VIEWS,
    name="stanford",
    words="one view for each pixel of a hogel, row before column, with the camera's place",
    pattern=r"out_(?P<r>\d+)_(?P<c>\d+)_-?\d+(?:\.\d*)?_-?\d+(?:\.\d*)?_?",
    stem=_stanford_stem,
)

PLENO = replace(
    VIEWS,
    name="pleno",
    words="one view for each pixel of a hogel, t (row) before s (column), 10 bits",
    pattern=r"(?P<r>\d{3})_(?P<c>\d{3})",
    stem=lambda index, shape, naming: f"{index[0]:03}_{index[1]:03}",
    suffix=".ppm",
    suffixes=(".ppm",),
)

HCI = Layout(
    name="hci",
    words="one view for each camera, numbered row by row from the top left",
    pattern=r"input_Cam(?P<k>\d{3,})",
    numbers=("k",),
    counts=lambda shape: (math.prod(shape.resolution),),
    view=_camera_view,
    stem=lambda index, shape, naming: f"input_Cam{index[0]:03}",
    shape=_shape_of_cameras,
)

QUILT = Layout(
    name="quilt",
    words="one picture of views, view 0 of the leftmost eye at the bottom left, the name says columns x rows",
    pattern=r".*_qs(?P<columns>\d+)x(?P<rows>\d+)a\d+(?:\.\d+)?",
    numbers=(),
    counts=lambda shape: (),
    view=lambda pixels, _, tiles: tiled_views(pixels, tiles, downward=False),
    stem=_quilt_stem,
    shape=_shape_of_tiles,
    stated=("columns", "rows"),
    states=_quilt_states,
    horizontal=True,
)

CUBEVI = Layout(
    name="cubevi",
    words="one picture of 8 x 5 views, view 0 of the leftmost eye at the top left",
    pattern=r".+",
    numbers=(),
    counts=lambda shape: (),
    view=lambda pixels, _, __: tiled_views(pixels, CUBEVI_TILES, downward=True),
    stem=_cubevi_stem,
    shape=_shape_of_tiles,
    horizontal=True,
)

MOSAIC = Layout(
    name="mosaic",
    words="one picture, hogel (i, j) is the tile at column i, row j",
    pattern=r".+",
    numbers=(),
    counts=lambda shape: (),
    view=lambda pixels, _, __: pixels.transpose(0, 2, 1, 3, 4),
    stem=lambda index, shape, naming: naming.stem or "mosaic",
    shape=_shape_of_mosaic,
)

LAYOUTS = (
    *(HOCKING, BURNETT, BURNETT_VIDEOS, HOCKING_COLUMNS, STANFORD, HCI, PLENO, VIEWS, QUILT),
    *(BURNETT_VIEWS, HOGELS, MOSAIC, CUBEVI),
)
"""All layouts. Where names of files fit several and nobody says which is meant, the first one is taken."""

NAMES = (
    *("hogels", "burnett", "hocking", "hocking-columns", "mosaic", "views", "stanford", "pleno", "hci"),
    *("quilt", "cubevi"),
)
"""Names of layouts, as the command line takes them."""


def layouts_named(name: str) -> tuple[Layout, ...]:
    """Return the layouts of a name: files of T. Burnett's program are pictures or videos.

    Raises
    ------
    InputError
        No layout has this name.
    """
    if name not in NAMES:
        raise InputError(f"layout {name!r} is not one of {', '.join(NAMES)}")
    return tuple(layout for layout in LAYOUTS if layout.name == name)


def layout_for(name: str, suffix: str | None) -> Layout:
    """Return the layout of a name in which files with some suffix are written."""
    named = layouts_named(name)
    return next((layout for layout in named if layout.suffix == suffix), named[0])
