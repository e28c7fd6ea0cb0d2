"""What a plate's store holds: its arrays and their labels, and the blocks of hogels that are their shards."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes import NOTHING, Certainty, Frustum
from xfrustum.scenes.model.plate_content import Channel, PlateContent
from xfrustum.scenes.plate.plate import Aperture, ApertureBlocks, Plate

BLOCK_BYTES = 1 << 26
"""Largest size of a block's pixels by default, before they are compressed: what one process has in memory
while it fills a shard."""

MAX_BLOCK_SIDE = 16
"""Largest number of columns and of rows of a block by default: 256 hogels are lost at most when a process is
killed, and a plate of ten million hogels has 40,000 files for each of its arrays."""

PLATE_DIMENSIONS = ("row", "column")  # the first two of every array

_CERTAINTY = "how the pixel was decided: 0 proven, 1 exact, 2 tie, 3 not examined"
_IMAGES: Mapping[Channel, tuple[str, Any, tuple[str, ...], str]] = {
    Channel.COLOR: ("", 0, ("v", "u", "rgb"), "linear radiance"),
    Channel.TRIANGLE: ("<i4", NOTHING, ("v", "u"), "number of the visible triangle, -1 where there is none"),
    Channel.HEIGHT: ("<f4", np.nan, ("v", "u"), "height of the visible surface above the plate"),
    Channel.NORMAL: ("<f4", np.nan, ("v", "u", "xyz"), "unit normal of the visible triangle"),
    Channel.CERTAINTY: ("u1", int(Certainty.UNEXAMINED), ("v", "u"), _CERTAINTY),
}
"""Type, value of what is missing, dimensions and meaning of each image; the type of color is asked for."""


@dataclass(frozen=True, kw_only=True)
class ImageArray:
    """One array of a plate's store: an image of some shape for every hogel; `fill` where it was not drawn."""

    name: str
    dtype: np.dtype[Any]
    fill: Any
    shape: tuple[int, ...]
    dimensions: tuple[str, ...]
    attributes: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class Block:
    """A rectangle of hogels that lie in one shard of every array, and those of them that are asked for."""

    number: int  # row by row from the top left
    columns: range
    rows: range
    apertures: tuple[Aperture, ...]

    @property
    def selection(self) -> tuple[slice, slice]:
        """Its part of an array."""
        return slice(self.rows.start, self.rows.stop), slice(self.columns.start, self.columns.stop)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.rows), len(self.columns)

    def place_of(self, aperture: Aperture) -> tuple[int, int]:
        """Return row and column within the block."""
        return aperture.row - self.rows.start, aperture.column - self.columns.start


@dataclass(frozen=True, kw_only=True)
class Layout:
    """The arrays of a store and their division into blocks."""

    plate: Plate
    frustum: Frustum
    units: str
    content: PlateContent
    side: tuple[int, int]  # columns and rows of a block
    measures: tuple[tuple[str, str], ...] = ()  # name and unit of each, where hogels are judged

    @cached_property
    def arrays(self) -> tuple[ImageArray, ...]:
        """The arrays in the order in which a block's are written."""
        arrays, units = [], {Channel.HEIGHT: self.units, Channel.COLOR: "1", Channel.NORMAL: "1"}
        for channel in self.content.channels:
            kind, fill, dimensions, meaning = _IMAGES[channel]
            dtype = self.content.color.dtype if channel is Channel.COLOR else np.dtype(kind)
            if dtype == np.uint8 and channel is Channel.COLOR:
                meaning = f"{meaning} from 0 to 1 times 255, rounded"
            array = ImageArray(
                name=channel,
                dtype=dtype,
                fill=fill,
                shape=(*self.frustum.resolution[::-1], *(3 for _ in dimensions[2:])),
                dimensions=(*PLATE_DIMENSIONS, *dimensions),
                attributes={"long_name": meaning} | ({"units": units[channel]} if channel in units else {}),
            )
            arrays.append(array)
        return tuple(arrays)

    def coordinates(self) -> Iterator[tuple[str, str, NDArray[Any], str, Mapping[str, str]]]:
        """Yield name, dimension, values, meaning and unit of every coordinate."""
        columns, rows = self.plate.hogels
        width, height = self.frustum.resolution
        x = np.array([self.plate.aperture(column, 0).x for column in range(columns)])
        y = np.array([self.plate.aperture(0, row).y for row in range(rows)])
        u, v = (2 * np.arange(width) + 1) / width - 1, 1 - (2 * np.arange(height) + 1) / height
        length, film = {"units": self.units}, {"units": "1"}
        yield "column", "column", np.arange(columns), "column of the hogel, from the left", {}
        yield "row", "row", np.arange(rows), "row of the hogel, from the top", {}
        yield "x", "column", x, "x of the aperture", length
        yield "y", "row", y, "y of the aperture", length
        yield "u", "u", u, "film coordinate of the pixel's center, to the right", film
        yield "v", "v", v, "film coordinate of the pixel's center, upward", film

    def blocks(self, apertures: Iterable[Aperture]) -> Iterator[Block]:
        """Yield the blocks of the hogels that are asked for, in the order in which they are first named.

        The hogels of rectangles are listed block by block: a plate has millions.
        """
        (width, height), hogels = self.side, self.plate.hogels
        across = -(-hogels[0] // width)
        named: dict[int, list[Aperture]] = {}
        if isinstance(apertures, ApertureBlocks):
            for columns, rows in apertures.blocks:
                for row in range(rows.start // height, -(-rows.stop // height)):
                    first, last = (row * across + end // width for end in (columns.start, columns.stop - 1))
                    named |= {number: [] for number in range(first, last + 1)}
        else:
            for one in dict.fromkeys(apertures):
                named.setdefault(one.row // height * across + one.column // width, []).append(one)
        for number, some in named.items():
            row, column = divmod(number, across)
            columns = range(column * width, min((column + 1) * width, hogels[0]))
            rows = range(row * height, min((row + 1) * height, hogels[1]))
            inside = some or [
                one for j in rows for i in columns if (one := self.plate.aperture(i, j)) in apertures
            ]
            yield Block(number=number, columns=columns, rows=rows, apertures=tuple(inside))


def default_side(plate: Plate, frustum: Frustum, content: PlateContent) -> tuple[int, int]:
    """Return the columns and rows of the largest block, a power of two, that `BLOCK_BYTES` hold."""
    whole = Layout(plate=plate, frustum=frustum, units="", content=content, side=(1, 1))
    hogel_bytes = sum(math.prod(array.shape) * array.dtype.itemsize for array in whole.arrays)
    side = MAX_BLOCK_SIDE
    while side > 1 and side * side * hogel_bytes > BLOCK_BYTES:
        side //= 2
    return min(side, plate.hogels[0]), min(side, plate.hogels[1])


def side_of(found: object, plate: Plate) -> tuple[int, int] | None:
    """Return the columns and rows of a block as a store's description has them; None where it has none."""
    side = found.get("block") if isinstance(found, dict) else None
    if not (isinstance(side, Sequence) and len(side) == 2 and all(type(count) is int for count in side)):
        return None
    columns, rows = side
    inside = 1 <= columns <= plate.hogels[0] and 1 <= rows <= plate.hogels[1]
    return (columns, rows) if inside else None
