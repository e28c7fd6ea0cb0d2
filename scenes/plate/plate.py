"""The plate and its apertures (paper, section 3; frames in CONVENTIONS.md)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import overload

from xfrustum.scenes.arguments import real, reals, settle, whole, wholes
from xfrustum.scenes.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Aperture:
    """One aperture (hogel): the point that every line of its image passes through; else InputError."""

    column: int
    row: int  #: 0 is at the top
    x: float  #: center in scene units; its z is 0, the plate
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
    """The holographic plate: a rectangle in z = 0 about the origin, divided into apertures."""

    size: tuple[float, float]  #: width and height in scene units
    hogels: tuple[int, int]  #: columns and rows of apertures

    def __post_init__(self) -> None:
        size, hogels = reals(self.size, 2), wholes(self.hogels, 2)
        if not all(math.isfinite(s) and s > 0 for s in size):
            raise InputError(f"plate.size must be two positive lengths, not {self.size!r}")
        if not all(n >= 1 for n in hogels):
            raise InputError(f"plate.hogels must be two counts of at least 1, not {self.hogels!r}")
        settle(self, size=size, hogels=hogels)

    def aperture(self, column: int, row: int) -> Aperture:
        """Return the aperture in a column and row; InputError where it lies outside the plate."""
        (columns, rows), given = self.hogels, f"{column},{row}"
        column, row = whole(column), whole(row)
        if not (0 <= column < columns and 0 <= row < rows):
            raise InputError(
                f"aperture {given} lies outside the plate: "
                f"columns run from 0 to {columns - 1}, rows from 0 to {rows - 1}"
            )
        width, height = self.size
        x, y = (column + 0.5) * width / columns - width / 2, height / 2 - (row + 0.5) * height / rows
        return Aperture(column=column, row=row, x=x, y=y)

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


Block = tuple[range, range]  #: columns and rows of a block


@dataclass(frozen=True, eq=False)
class ApertureBlocks(Sequence[Aperture]):
    """Blocks of apertures, row by row from the top left, never listed; one in several blocks comes once."""

    plate: Plate
    blocks: tuple[Block, ...]

    def __iter__(self) -> Iterator[Aperture]:
        """Yield the apertures of one block after the other."""
        for number, (columns, rows) in enumerate(self.blocks):
            earlier = self.blocks[:number]
            for row in rows:
                for column in columns:
                    if not any(column in other and row in others for other, others in earlier):
                        yield self.plate.aperture(column, row)

    def __len__(self) -> int:
        """Return the number of different apertures."""
        # Rows between two neighboring ends of blocks lie in the same blocks, and have the same columns.
        ends = sorted({end for _, rows in self.blocks for end in (rows.start, rows.stop)})
        return sum(
            (stop - start) * len(set[int]().union(*(c for c, rows in self.blocks if start in rows)))
            for start, stop in pairwise(ends)
        )

    @overload
    def __getitem__(self, index: int) -> Aperture: ...
    @overload
    def __getitem__(self, index: slice) -> list[Aperture]: ...
    def __getitem__(self, index: int | slice) -> Aperture | list[Aperture]:
        """Return an aperture by its place; a single block computes it, several are gone through."""
        if isinstance(index, slice):
            return [self[place] for place in range(*index.indices(len(self)))]
        place = index + len(self) if index < 0 else index
        if not 0 <= place < len(self):
            raise IndexError(index)
        if len(self.blocks) == 1:
            columns, rows = self.blocks[0]
            row, column = divmod(place, len(columns))
            return self.plate.aperture(columns[column], rows[row])
        return next(aperture for number, aperture in enumerate(self) if number == place)

    def __contains__(self, aperture: object) -> bool:
        """Return whether an aperture lies in one of the blocks."""
        index = getattr(aperture, "index", None)
        return index is not None and any(
            index[0] in columns and index[1] in rows for columns, rows in self.blocks
        )
