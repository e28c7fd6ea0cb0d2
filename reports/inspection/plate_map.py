"""What is known of a plate's hogels, as cells of a map."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.plate.plate import Plate

MAX_MAP_CELLS = 120
"""Largest number of cells along a side of a map; a cell of a larger plate stands for several hogels. On the
page a map is some 360 pixels wide, so that a cell has at least three."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateMap:
    """One number of the hogels of a plate.

    Attributes
    ----------
    words
        What the number is: a share, if that is their first word.
    cells
        (rows, columns) of cells, the largest value in each; NaN where no hogel is known.
    """

    words: str
    cells: Floats

    @property
    def in_percent(self) -> bool:
        """Whether the number is told in percent."""
        return self.words.startswith("Share")

    @classmethod
    def of(cls, plate: Plate, words: str, values: Iterable[tuple[int, int, float]]) -> PlateMap:
        """Make a map of hogels by column and row."""
        columns, rows = (min(count, MAX_MAP_CELLS) for count in plate.hogels)
        cells = np.full((rows, columns), np.nan)
        for column, row, value in values:
            place = row * rows // plate.hogels[1], column * columns // plate.hogels[0]
            cells[place] = np.fmax(cells[place], value)
        return cls(words=words, cells=cells)
