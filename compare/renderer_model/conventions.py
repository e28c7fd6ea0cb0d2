"""Conventions that a renderer's author may declare, and the symmetries of grids."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:  # the command line reads names from here before anything else is loaded
    from numpy.typing import NDArray

Place = TypeVar("Place", int, "NDArray[Any]")  #: columns, or rows, of one cell or of many

CONVENTIONS = ("orientation", "order", "shift", "fov", "pitch", "near")
"""Conventions that a renderer's author may declare; images are then judged by them."""

ENCODING = "encoding"
"""Name that `accept` uses for all encoding defects; lost numbers cannot be accepted."""

ACCEPTABLE = (*CONVENTIONS, ENCODING)

# Labels of pictures and of aperture orders, by (transpose, flip_x, flip_y).
_LABELS = {
    (False, False, False): ("upright", "as in the scene"),
    (False, True, False): ("mirrored left to right", "columns counted from the right"),
    (False, False, True): ("turned upside down (rows in reverse)", "rows counted from the bottom"),
    (False, True, True): (
        "turned by 180 degrees",
        "columns counted from the right, rows from the bottom",
    ),
    (True, False, False): ("transposed (rows and columns exchanged)", "column and row exchanged"),
    (True, True, True): (
        "transposed about the other diagonal",
        "column and row exchanged, both counted from the far end",
    ),
    (True, False, True): (
        "turned by 90 degrees counterclockwise",
        "column and row exchanged, then rows counted from the bottom",
    ),
    (True, True, False): (
        "turned by 90 degrees clockwise",
        "column and row exchanged, then columns counted from the right",
    ),
}


@dataclass(frozen=True, order=True)
class Orientation:
    """Map from stored cells to correct positions: exchange column and row, then reverse either.

    After the exchange, `flip_x` counts columns from the right, and `flip_y` counts rows from the
    bottom.
    """

    transpose: bool = False
    flip_x: bool = False
    flip_y: bool = False

    @property
    def changes(self) -> int:
        """Number of operations that differ from upright."""
        return self.transpose + self.flip_x + self.flip_y

    @property
    def labels(self) -> tuple[str, str]:
        """Labels of the orientation of stored pictures, and of the order of apertures."""
        return _LABELS[self.transpose, self.flip_x, self.flip_y]

    def cells(self, column: Place, row: Place, size: tuple[int, int]) -> tuple[Place, Place]:
        """Return the correct columns and rows of cells, on a grid of `size` columns and rows."""
        if self.transpose:
            column, row = row, column
        return size[0] - 1 - column if self.flip_x else column, size[
            1
        ] - 1 - row if self.flip_y else row

    def index(self, index: tuple[int, int], size: tuple[int, int]) -> tuple[int, int]:
        """Return the correct column and row of one cell."""
        return self.cells(*index, size)

    def upright(self, picture: NDArray[Any]) -> NDArray[Any]:
        """Return a stored picture (H, W, ..) in upright orientation."""
        return self._flipped(picture.swapaxes(0, 1) if self.transpose else picture)

    def applied(self, picture: NDArray[Any]) -> NDArray[Any]:
        """Return an upright picture (H, W, ..) in stored orientation: the inverse of `upright`."""
        picture = self._flipped(picture)
        return picture.swapaxes(0, 1) if self.transpose else picture

    def _flipped(self, picture: NDArray[Any]) -> NDArray[Any]:
        return picture[:: -1 if self.flip_y else 1, :: -1 if self.flip_x else 1]


UPRIGHT = Orientation()


def orientations(size: tuple[int, int]) -> Iterator[Orientation]:
    """Yield the symmetries of a grid of `size` columns and rows, beginning with upright."""
    for transpose, flip_y, flip_x in itertools.product((False, True), repeat=3):
        if not transpose or size[0] == size[1]:
            yield Orientation(transpose, flip_x, flip_y)
