"""What a layout says: names of files, and the pixels of the plate that each file holds.

The pixels of a plate are one array with the axes (row j, column i, pixel row r, pixel column c, channel).
A layout names, for each file, a view of this array; reading assigns the file's pixels to that view, and
writing stores it. So one description serves both ways, and no pixel is computed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.arguments import settle, wholes
from xfrustum.scenes.errors import InputError

Pixels = NDArray[Any]
"""Samples of pictures in the type of their files: uint8, uint16, float16 or float32."""

Index = tuple[int, ...]
"""The numbers that a file's name states, in the order of the layout's own naming."""

PICTURE_SUFFIXES = (".png", ".ppm", ".exr", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
"""Suffixes of files that are taken for pictures, in lower case."""

SUFFIX_PATTERN = r"\.(?:png|ppm|exr|jpg|jpeg|bmp|tif|tiff|webp)"
"""Regular expression of these suffixes."""


@dataclass(frozen=True, kw_only=True)
class PlateShape:
    """The numbers of hogels and of pixels of a plate.

    Attributes
    ----------
    hogels
        Number of columns and rows of hogels.
    resolution
        Width and height of each hogel in pixels.
    """

    hogels: tuple[int, int]
    resolution: tuple[int, int]

    def __post_init__(self) -> None:
        hogels, resolution = wholes(self.hogels, 2), wholes(self.resolution, 2)
        if min(*hogels, *resolution) < 1:
            raise InputError(f"a plate has at least one hogel of one pixel, not {self.words}")
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
class Part:
    """One file of a layout.

    Attributes
    ----------
    index
        Numbers that the file's name states.
    name
        Name under which the file is written, with its suffix.
    size
        Width and height of its picture in pixels; of a video, those of its frames.
    select
        Function that returns the view (.., 3) of a plate's pixels that the file holds, in the order in which
        the file stores them.
    aperture
        Column and row of the hogel where the file holds one hogel and no other; else None.
    frames
        Number of the frames of a video; None for pictures.
    """

    index: Index
    name: str
    size: tuple[int, int]
    select: Callable[[Pixels], Pixels]
    aperture: tuple[int, int] | None = None
    frames: int | None = None


def row_of(part: Part, shape: PlateShape) -> int | None:
    """Return the row of hogels from which a file has all its pixels; None where there are several."""
    numbers = np.arange(shape.hogels[1]).reshape(-1, 1, 1, 1, 1)
    held = part.select(np.broadcast_to(numbers, shape.array))
    # A step of the view changes the number only where it leads to another row.
    alike = all(step == 0 or count == 1 for step, count in zip(held.strides, held.shape, strict=True))
    return int(held.flat[0]) if alike else None


def as_plate(hogels: Pixels, shape: PlateShape) -> Pixels:
    """Return a view with the axes of a plate, every row of which is one row of hogels (columns, H, W, 3)."""
    return np.lib.stride_tricks.as_strided(hogels, shape.array, (0, *hogels.strides))


@dataclass(frozen=True, kw_only=True)
class Naming:
    """Facts of the place that names of files state beside their indices.

    Attributes
    ----------
    suffix
        Suffix of picture files, such as .png.
    stem
        Beginning of the names of single pictures.
    aspect
        Width of the plate over its height, which quilts state; None for that of the number of hogels.
    tiles
        Columns and rows of tiles of a quilt; None where the layout chooses.
    """

    suffix: str = ".png"
    stem: str = ""
    aspect: float | None = None
    tiles: tuple[int, int] | None = None


class Layout(Protocol):
    """One way to store the pictures of a plate."""

    @property
    def name(self) -> str:
        """Name on the command line."""
        ...

    @property
    def words(self) -> str:
        """Meaning of its files, one clause."""
        ...

    @property
    def suffix(self) -> str:
        """Suffix of its files where nobody asks for another."""
        ...

    @property
    def horizontal(self) -> bool:
        """Whether it keeps horizontal parallax alone: one row of pixels of each hogel."""
        ...

    @property
    def in_hogels(self) -> bool:
        """Whether each file is one hogel, so that some can be there without the others."""
        ...

    def index_of(self, name: str) -> Index | None:
        """Return the numbers that a file's name states; None where it is no name of this layout."""
        ...

    def parts(self, shape: PlateShape, naming: Naming) -> Iterator[Part]:
        """Yield the files of a plate of some shape."""
        ...

    def shape_of(
        self, indices: Sequence[Index], size: tuple[int, int], told: PlateShape | None
    ) -> PlateShape:
        """Return the shape of a plate from its files.

        Parameters
        ----------
        indices
            Numbers that the names of all files state.
        size
            Width and height of one file's picture; of a video, those of its frames.
        told
            Shape that somebody states, be it the scene or the picture itself.

        Raises
        ------
        InputError
            The files do not say it, or what they say does not fit together.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class PatternedNames:
    """The names of a layout's files where one pattern describes them, and what most of these layouts share.

    Attributes
    ----------
    pattern
        Regular expression of a name; its groups are the numbers of the index.
    suffix, horizontal, in_hogels
        As in `Layout`.
    """

    pattern: ClassVar[str]
    suffix: ClassVar[str] = ".png"
    horizontal: ClassVar[bool] = False
    in_hogels: ClassVar[bool] = False

    def index_of(self, name: str) -> Index | None:
        """Return the numbers in a name; None where it is no name of this layout."""
        found = re.fullmatch(self.pattern, name, re.ASCII)
        return None if found is None else tuple(int(number) for number in found.groups())


def counts(indices: Sequence[Index], axis: int) -> int:
    """Return how many numbers, counted from 0, one axis of some indices has.

    Raises
    ------
    InputError
        No name states number 0.
    """
    numbers = {index[axis] for index in indices}
    if 0 not in numbers:
        raise InputError(
            f"names of files count from {min(numbers)}, not from 0; rename them, or add the rest"
        )
    return max(numbers) + 1


def middle_row(pixels: Pixels) -> Pixels:
    """Return the view (rows, columns, width, 3) of the pixel row just below the middle of each hogel.

    Horizontal parallax alone shows this row; where hogels have one row of pixels, it is this one.
    """
    return pixels[:, :, pixels.shape[2] // 2]
