"""The eight symmetries of the rectangle's grid: how a picture may be turned, or apertures be counted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_WORDS = {
    (False, False, False): "upright",
    (False, True, False): "mirrored left to right",
    (False, False, True): "turned upside down (rows in reverse)",
    (False, True, True): "turned by 180 degrees",
    (True, False, False): "transposed (rows and columns exchanged)",
    (True, True, True): "transposed about the other diagonal",
    (True, False, True): "turned by 90 degrees counterclockwise",
    (True, True, False): "turned by 90 degrees clockwise",
}

_ORDER_WORDS = {
    (False, False, False): "as in the scene",
    (False, True, False): "columns counted from the right",
    (False, False, True): "rows counted from the bottom",
    (False, True, True): "columns counted from the right, rows from the bottom",
    (True, False, False): "column and row exchanged",
    (True, True, True): "column and row exchanged, both counted from the far end",
    (True, False, True): "column and row exchanged, then rows counted from the bottom",
    (True, True, False): "column and row exchanged, then columns counted from the right",
}


@dataclass(frozen=True, order=True)
class Orientation:
    """Where cell (column, row) of what was found belongs: exchange the two, then reverse either.

    Attributes
    ----------
    transpose
        Column and row are exchanged first.
    flip_x, flip_y
        Then columns are counted from the right, rows from the bottom.
    """

    transpose: bool = False
    flip_x: bool = False
    flip_y: bool = False

    @property
    def key(self) -> tuple[bool, bool, bool]:
        """The three decisions as a tuple."""
        return (self.transpose, self.flip_x, self.flip_y)

    @property
    def changes(self) -> int:
        """How many decisions differ from upright."""
        return sum(self.key)

    @property
    def words(self) -> str:
        """What was done to an upright picture to give the one found."""
        return _WORDS[self.key]

    @property
    def order_words(self) -> str:
        """How apertures are counted that need this to be put in order."""
        return _ORDER_WORDS[self.key]

    def fits(self, size: tuple[int, int]) -> bool:
        """Return whether a grid of this many columns and rows keeps its size."""
        return not self.transpose or size[0] == size[1]

    def cells(
        self, column: NDArray[Any], row: NDArray[Any], size: tuple[int, int]
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return where cells belong, on a grid of some columns and rows."""
        if self.transpose:
            column, row = row, column
        if self.flip_x:
            column = size[0] - 1 - column
        if self.flip_y:
            row = size[1] - 1 - row
        return column, row

    def index(self, index: tuple[int, int], size: tuple[int, int]) -> tuple[int, int]:
        """Return where one cell belongs."""
        column, row = self.cells(np.array(index[0]), np.array(index[1]), size)
        return int(column), int(row)

    def upright(self, picture: NDArray[Any]) -> NDArray[Any]:
        """Return a picture (H, W, ..) as it belongs."""
        if self.transpose:
            picture = np.swapaxes(picture, 0, 1)
        if self.flip_x:
            picture = picture[:, ::-1]
        if self.flip_y:
            picture = picture[::-1]
        return picture

    def applied(self, picture: NDArray[Any]) -> NDArray[Any]:
        """Return an upright picture (H, W, ..) as it was found: the inverse of `upright`."""
        if self.flip_y:
            picture = picture[::-1]
        if self.flip_x:
            picture = picture[:, ::-1]
        return np.swapaxes(picture, 0, 1) if self.transpose else picture


UPRIGHT = Orientation()


def orientations(size: tuple[int, int]) -> Iterator[Orientation]:
    """Yield those symmetries that keep a grid of this many columns and rows, the plainest first."""
    for transpose in (False, True):
        for flip_y in (False, True):
            for flip_x in (False, True):
                orientation = Orientation(transpose, flip_x, flip_y)
                if orientation.fits(size):
                    yield orientation
