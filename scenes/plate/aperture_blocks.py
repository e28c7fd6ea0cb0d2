"""Apertures by blocks of columns and rows: counted and gone through without ever being listed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, overload

if TYPE_CHECKING:
    from xfrustum.scenes.plate.plate import Aperture, Plate

Block = tuple[range, range]
"""Columns and rows of a block."""


@dataclass(frozen=True, eq=False)
class ApertureBlocks(Sequence["Aperture"]):
    """Blocks of apertures, each row by row from the top left; an aperture in several blocks comes once.

    Attributes
    ----------
    plate
        The plate that the apertures are cells of.
    blocks
        Columns and rows of each block.
    """

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
            (stop - start) * _covered([columns for columns, rows in self.blocks if start in rows])
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


def _covered(spans: Sequence[range]) -> int:
    """Return how many numbers lie in any of some ranges."""
    total, reached = 0, -1
    for span in sorted(spans, key=lambda one: one.start):
        total += max(0, span.stop - max(span.start, reached + 1))
        reached = max(reached, span.stop - 1)
    return total
