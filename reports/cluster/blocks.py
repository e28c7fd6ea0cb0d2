"""Blocks of hogels: pieces of a plate, or of samples of it, each computed by its number.

A block is one task, one Parquet part, one shard of a store. Nothing is listed: a plate of ten million hogels
is cut into blocks without being gone through.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from xfrustum.scenes.plate.aperture_blocks import ApertureBlocks
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Aperture, Plate

PIXELS_PER_BLOCK = 1 << 22
"""Pixels that are drawn and judged in a block, those that a hogel costs anyway included: 10 to 60 s of one
core, while a task costs the scheduler a few milliseconds."""

PIXELS_PER_HOGEL = 1 << 16
"""Pixels that take as long as what a hogel costs however small it is: on the car, whose triangles are all
transformed for each drawing and each link of its error budget, about as many as 256 x 256."""

MIN_BLOCKS = 16
"""Number of blocks that even a small sample is cut into where it has as many hogels, so that there is
something for several workers to do."""


def hogels_per_block(hogels: int, frustum: Frustum, settings: int) -> int:
    """Return how many hogels a block has; it depends on the work alone, never on the number of workers.

    Parameters
    ----------
    hogels
        Number of all hogels.
    frustum
        Frustum whose resolution they have.
    settings
        Number of settings that each is judged with.
    """
    cost = (math.prod(frustum.resolution) + PIXELS_PER_HOGEL) * settings
    return max(1, min(PIXELS_PER_BLOCK // cost, math.ceil(hogels / MIN_BLOCKS)))


class Blocks(ABC):
    """Blocks of hogels, numbered from 0 through one or several looks."""

    looks: int
    """Number of looks; those after the first are taken only where they are needed."""

    @abstractmethod
    def numbers(self, look: int) -> range:
        """Return the numbers of the blocks that a look adds."""

    @abstractmethod
    def hogels(self, look: int) -> int:
        """Return the number of hogels of the blocks that a look adds."""

    @abstractmethod
    def apertures(self, number: int) -> Sequence[Aperture]:
        """Return the apertures of a block, in their order."""

    @property
    def description(self) -> dict[str, object]:
        """Everything that decides which hogels are in which block."""
        return {key: value for key, value in vars(self).items() if not key.startswith("_")}


@dataclass(frozen=True, kw_only=True)
class Tiles(Blocks):
    """A whole plate in rectangles of hogels, row by row from the top left; those at the ends may be smaller.

    Attributes
    ----------
    plate
        The plate.
    side
        Columns and rows of a rectangle.
    """

    plate: Plate
    side: tuple[int, int]

    looks = 1

    @classmethod
    def of(cls, plate: Plate, hogels: int) -> Tiles:
        """Cut a plate into rectangles of about so many hogels, as square as the plate allows."""
        columns, rows = plate.hogels
        across = min(columns, max(1, math.isqrt(hogels)))
        down = min(rows, max(1, hogels // across))
        return cls(plate=plate, side=(min(columns, max(1, hogels // down)), down))

    def numbers(self, look: int) -> range:
        """Return the numbers of all rectangles."""
        return range(math.prod(self._counts)) if look == 0 else range(0)

    def hogels(self, look: int) -> int:
        """Return the number of hogels of the plate."""
        return math.prod(self.plate.hogels) if look == 0 else 0

    def apertures(self, number: int) -> ApertureBlocks:
        """Return the apertures of a rectangle, row by row."""
        place = divmod(number, self._counts[0])[::-1]
        columns, rows = (
            range(at * side, min((at + 1) * side, count))
            for at, side, count in zip(place, self.side, self.plate.hogels, strict=True)
        )
        return ApertureBlocks(self.plate, ((columns, rows),))

    @property
    def _counts(self) -> tuple[int, int]:
        columns, rows = (-(-count // side) for count, side in zip(self.plate.hogels, self.side, strict=True))
        return columns, rows


@dataclass(frozen=True, kw_only=True)
class ListedBlocks(Blocks):
    """Hogels that are named one by one, in blocks of so many.

    Attributes
    ----------
    plate
        The plate.
    indices
        Column and row of each.
    size
        Number of hogels of a block; the last one may have fewer.
    """

    plate: Plate
    indices: tuple[tuple[int, int], ...]
    size: int

    looks = 1

    def numbers(self, look: int) -> range:
        """Return the numbers of all blocks."""
        return range(-(-len(self.indices) // self.size)) if look == 0 else range(0)

    def hogels(self, look: int) -> int:
        """Return the number of hogels."""
        return len(self.indices) if look == 0 else 0

    def apertures(self, number: int) -> list[Aperture]:
        """Return the apertures of a block."""
        some = self.indices[number * self.size : (number + 1) * self.size]
        return [self.plate.aperture(*index) for index in some]
