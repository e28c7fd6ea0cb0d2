"""Layouts of one picture for each direction: views, as camera arrays and benchmarks store them.

A view shows the same pixel of every hogel: V_rc[j, i] = H_ij[r, c]. Its picture is the plate as it is seen
from one direction, or, where frusta are recentered, from one point of the projection screen.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import isqrt
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
)


@dataclass(frozen=True, kw_only=True)
class Views:
    """One picture for each pixel of a hogel.

    Attributes
    ----------
    name, words, suffix
        As in `Layout`.
    pattern
        Regular expression of a name without its suffix; its groups `r` and `c` are the row and column of the
        pixel.
    name_of
        Function that writes such a name for r, c and a shape.
    """

    name: str
    words: str
    pattern: str
    name_of: Callable[[int, int, PlateShape], str] = field(repr=False)
    suffix: str = ".png"
    suffixes: str = SUFFIX_PATTERN
    horizontal: ClassVar[bool] = False
    in_hogels: ClassVar[bool] = False

    def index_of(self, name: str) -> Index | None:
        """Return the row and the column of the pixel."""
        found = re.fullmatch(f"(?:{self.pattern}){self.suffixes}", name, re.ASCII)
        return None if found is None else (int(found["r"]), int(found["c"]))

    def parts(self, shape: PlateShape, naming: Naming) -> Iterator[Part]:
        """Yield one picture for each pixel of a hogel, row by row."""
        width, height = shape.resolution
        for r in range(height):
            for c in range(width):
                yield Part(
                    index=(r, c),
                    name=self.name_of(r, c, shape) + naming.suffix,
                    size=shape.hogels,
                    select=_pixel(r, c),
                )

    def shape_of(
        self, indices: Sequence[Index], size: tuple[int, int], told: PlateShape | None
    ) -> PlateShape:
        """Return the shape: a picture has a pixel for each hogel, and there is a picture for each pixel."""
        return PlateShape(hogels=size, resolution=(counts(indices, 1), counts(indices, 0)))


def _pixel(r: int, c: int) -> Callable[[Pixels], Pixels]:
    return lambda pixels: pixels[:, :, r, c]


def _film_center(number: int, count: int) -> float:
    return (2 * number + 1) / count - 1


def _stanford_name(r: int, c: int, shape: PlateShape) -> str:
    """Return the name of a view of the Stanford archive, whose cameras stand at (y, x).

    As places the film coordinates of the pixel are written, which are those of the camera in any unit: v
    upward, u to the right.
    """
    width, height = shape.resolution
    y, x = -_film_center(r, height), _film_center(c, width)
    return f"out_{r:02}_{c:02}_{y:.6f}_{x:.6f}"


VIEWS = Views(
    name="views",
    words="one view for each pixel of a hogel, row before column",
    pattern=r"(?P<r>\d+)_(?P<c>\d+)",
    name_of=lambda r, c, shape: f"{r}_{c}",
)

STANFORD = Views(
    name="stanford",
    words="one view for each pixel of a hogel, row before column, with the camera's place",
    pattern=r"out_(?P<r>\d+)_(?P<c>\d+)_-?\d+(?:\.\d*)?_-?\d+(?:\.\d*)?_?",
    name_of=_stanford_name,
)

PLENO = Views(
    name="pleno",
    words="one view for each pixel of a hogel, t (row) before s (column), 10 bits",
    pattern=r"(?P<r>\d{3})_(?P<c>\d{3})",
    name_of=lambda r, c, shape: f"{r:03}_{c:03}",
    suffix=".ppm",
    suffixes=r"\.ppm",
)


@dataclass(frozen=True, kw_only=True)
class NumberedCameras(PatternedNames):
    """Views by cameras in rows, numbered from the top left as they stand (4D light-field benchmark).

    Lines of a film's right and lower pixels leave the plate to the viewer's left and upward. So the camera at
    the top left takes the last column and the last row of pixels.
    """

    name: ClassVar[str] = "hci"
    words: ClassVar[str] = "one view for each camera, numbered row by row from the top left"
    pattern: ClassVar[str] = rf"input_Cam(\d{{3,}}){SUFFIX_PATTERN}"

    def parts(self, shape: PlateShape, naming: Naming) -> Iterator[Part]:
        """Yield one picture for each camera."""
        width, height = shape.resolution
        for number in range(width * height):
            row, column = divmod(number, width)
            yield Part(
                index=(number,),
                name=f"input_Cam{number:03}{naming.suffix}",
                size=shape.hogels,
                select=_pixel(height - 1 - row, width - 1 - column),
            )

    def shape_of(
        self, indices: Sequence[Index], size: tuple[int, int], told: PlateShape | None
    ) -> PlateShape:
        """Return the shape: `told` has the numbers of cameras; else there are as many rows as columns."""
        number = counts(indices, 0)
        if told is not None and told.resolution[0] * told.resolution[1] == number:
            return PlateShape(hogels=size, resolution=told.resolution)
        side = isqrt(number)
        if side * side != number:
            raise InputError(
                f"{number} cameras form no square, and no parameters.cfg says num_cams_x and num_cams_y"
            )
        return PlateShape(hogels=size, resolution=(side, side))
