"""The plate and its apertures (paper, section 3; frames in CONVENTIONS.md)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from xfrustum.scenes.arguments import real, reals, settle, whole, wholes
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.plate.aperture_blocks import ApertureBlocks


@dataclass(frozen=True, kw_only=True)
class Aperture:
    """One aperture (hogel) of the plate: the point that every line of its image passes through.

    Attributes
    ----------
    column, row
        Index on the plate; row 0 is at the top.
    x, y
        Center in scene units; its z is 0, the plate.

    Raises
    ------
    InputError
        The column or row is no count, or a coordinate is not finite.
    """

    column: int
    row: int
    x: float
    y: float

    def __post_init__(self) -> None:
        index, center = (whole(self.column), whole(self.row)), (real(self.x), real(self.y))
        if min(index) < 0:
            raise InputError(
                f"an aperture's column and row must be counts from 0, not {self.column!r}, {self.row!r}"
            )
        if not all(map(math.isfinite, center)):
            raise InputError(f"an aperture's x and y must be finite, not {self.x!r}, {self.y!r}")
        settle(self, column=index[0], row=index[1], x=center[0], y=center[1])

    @property
    def index(self) -> tuple[int, int]:
        """Column and row, in the order in which the command line takes them."""
        return (self.column, self.row)


@dataclass(frozen=True, kw_only=True)
class Plate:
    """The holographic plate: a rectangle in z = 0 about the origin, divided into apertures.

    Attributes
    ----------
    size
        Width and height in scene units, both positive.
    hogels
        Number of columns and rows of apertures, both at least 1.
    """

    size: tuple[float, float]
    hogels: tuple[int, int]

    def __post_init__(self) -> None:
        size, hogels = reals(self.size, 2), wholes(self.hogels, 2)
        if not all(math.isfinite(s) and s > 0 for s in size):
            raise InputError(f"plate.size must be two positive lengths, not {self.size!r}")
        if not all(n >= 1 for n in hogels):
            raise InputError(f"plate.hogels must be two counts of at least 1, not {self.hogels!r}")
        settle(self, size=size, hogels=hogels)

    def aperture(self, column: int, row: int) -> Aperture:
        """Return the aperture in a column and row.

        Raises
        ------
        InputError
            The index lies outside the plate.
        """
        columns, rows = self.hogels
        given, column, row = (column, row), whole(column), whole(row)
        if not (0 <= column < columns and 0 <= row < rows):
            raise InputError(
                f"aperture {given[0]},{given[1]} lies outside the plate: "
                f"columns run from 0 to {columns - 1}, rows from 0 to {rows - 1}"
            )
        width, height = self.size
        return Aperture(
            column=column,
            row=row,
            x=(column + 0.5) * width / columns - width / 2,
            y=height / 2 - (row + 0.5) * height / rows,
        )

    def apertures(self) -> ApertureBlocks:
        """Return all apertures, row by row from the top left, as a sequence that is no list."""
        columns, rows = self.hogels
        return ApertureBlocks(self, ((range(columns), range(rows)),))

    @property
    def middle(self) -> Aperture:
        """The default aperture: column Nx // 2, row Ny // 2."""
        return self.aperture(self.hogels[0] // 2, self.hogels[1] // 2)

    @property
    def corners(self) -> tuple[Aperture, Aperture]:
        """Two opposite corners, top left and bottom right: where a recentered frustum shears most."""
        return self.aperture(0, 0), self.aperture(self.hogels[0] - 1, self.hogels[1] - 1)
