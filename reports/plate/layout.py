"""What a plate's store holds: its arrays and their labels, and the blocks of hogels that are their shards."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.model.hogel_image import NOTHING, Certainty
from xfrustum.scenes.model.plate_content import Channel, PlateContent
from xfrustum.scenes.plate.aperture_blocks import ApertureBlocks
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Aperture, Plate

BLOCK_BYTES = 1 << 26
"""Largest size of a block's pixels by default, before they are compressed: what one process has in memory
while it fills a shard."""

MAX_BLOCK_SIDE = 16
"""Largest number of columns and of rows of a block by default: 256 hogels are lost at most when a process is
killed, and a plate of ten million hogels has 40,000 files for each of its arrays."""

PLATE_DIMENSIONS = ("row", "column")
"""Names of the first two dimensions of every array."""

_IMAGES: Mapping[Channel, tuple[str, Any, tuple[str, ...], str]] = {
    Channel.COLOR: ("", 0, ("v", "u", "rgb"), "linear radiance"),
    Channel.TRIANGLE: ("<i4", NOTHING, ("v", "u"), "number of the visible triangle, -1 where there is none"),
    Channel.HEIGHT: ("<f4", np.nan, ("v", "u"), "height of the visible surface above the plate"),
    Channel.NORMAL: ("<f4", np.nan, ("v", "u", "xyz"), "unit normal of the visible triangle"),
    Channel.CERTAINTY: (
        "u1",
        int(Certainty.UNEXAMINED),
        ("v", "u"),
        "how the pixel was decided: 0 proven, 1 exact, 2 tie, 3 not examined",
    ),
}
"""Type, value of what is missing, dimensions and meaning of each image; the type of color is asked for."""

_OLD_DIMENSIONS = {"v": "y", "u": "x"}
"""Names of dimensions in plates that were made before there were blocks and labels."""


@dataclass(frozen=True, kw_only=True)
class PlateArray:
    """One array of a plate's store: an image for every hogel.

    Attributes
    ----------
    name, dtype, fill
        Name, type of the numbers, and value of hogels that are not there.
    shape
        Shape of one hogel's image.
    dimensions
        Names of all dimensions, those of the plate first.
    attributes
        Unit and meaning, as readers of Zarr show them.
    """

    name: str
    dtype: np.dtype[Any]
    fill: Any
    shape: tuple[int, ...]
    dimensions: tuple[str, ...]
    attributes: Mapping[str, str]

    @property
    def chunk_bytes(self) -> int:
        """Bytes of one hogel's image before it is compressed."""
        return math.prod(self.shape) * self.dtype.itemsize


@dataclass(frozen=True, kw_only=True)
class Block:
    """A rectangle of hogels that lie in one file of every array.

    Attributes
    ----------
    number
        Number of the block on the plate, row by row from the top left.
    place
        Row and column of the block among all blocks.
    columns, rows
        Columns and rows of its hogels; blocks at the right and lower ends of the plate may have fewer.
    side
        Columns and rows of a whole block.
    """

    number: int
    place: tuple[int, int]
    columns: range
    rows: range
    side: tuple[int, int]

    def place_of(self, aperture: Aperture) -> int:
        """Return the number of a hogel within the whole block."""
        return (aperture.row - self.rows.start) * self.side[0] + aperture.column - self.columns.start


@dataclass(frozen=True, kw_only=True)
class BlockPart:
    """The hogels of one block that are asked for, row by row."""

    block: Block
    apertures: tuple[Aperture, ...]


@dataclass(frozen=True, kw_only=True)
class BlockGrid:
    """The division of a plate into blocks.

    Attributes
    ----------
    plate
        Plate of the scene.
    side
        Columns and rows of a block.
    """

    plate: Plate
    side: tuple[int, int]

    @property
    def hogels_in_block(self) -> int:
        """Number of hogels of a whole block."""
        return self.side[0] * self.side[1]

    @property
    def blocks(self) -> tuple[int, int]:
        """Number of columns and rows of blocks."""
        (columns, rows), (width, height) = self.plate.hogels, self.side
        return -(-columns // width), -(-rows // height)

    def block(self, number: int) -> Block:
        """Return a block by its number, row by row from the top left."""
        row, column = divmod(number, self.blocks[0])
        (width, height), (columns, rows) = self.side, self.plate.hogels
        return Block(
            number=number,
            place=(row, column),
            columns=range(column * width, min((column + 1) * width, columns)),
            rows=range(row * height, min((row + 1) * height, rows)),
            side=self.side,
        )

    def block_of(self, aperture: Aperture) -> int:
        """Return the number of the block that a hogel lies in."""
        return aperture.row // self.side[1] * self.blocks[0] + aperture.column // self.side[0]

    def parts(self, apertures: Iterable[Aperture]) -> Iterator[BlockPart]:
        """Yield the hogels that are asked for, block by block, in the order in which blocks are first named.

        Rectangles of hogels are gone through block by block, and never listed.
        """
        if isinstance(apertures, ApertureBlocks):
            for number in self.touched(apertures):
                yield self.part(number, apertures)
            return
        found: dict[int, list[Aperture]] = {}
        for aperture in dict.fromkeys(apertures):
            found.setdefault(self.block_of(aperture), []).append(aperture)
        for number, some in found.items():
            yield BlockPart(block=self.block(number), apertures=tuple(some))

    def part(self, number: int, apertures: ApertureBlocks) -> BlockPart:
        """Return the hogels of a block that lie in any of some rectangles."""
        block = self.block(number)
        hogels = ((column, row) for row in block.rows for column in block.columns)
        inside = (
            index
            for index in hogels
            if any(index[0] in some and index[1] in rows for some, rows in apertures.blocks)
        )
        return BlockPart(block=block, apertures=tuple(self.plate.aperture(*index) for index in inside))

    def touched(self, apertures: ApertureBlocks) -> Iterator[int]:
        """Yield the numbers of the blocks that have a hogel in any of some rectangles, each once."""
        seen: set[int] = set()
        (width, height), across = self.side, self.blocks[0]
        for columns, rows in apertures.blocks:
            for row in range(rows.start // height, -(-rows.stop // height)):
                for column in range(columns.start // width, -(-columns.stop // width)):
                    number = row * across + column
                    if number not in seen:
                        seen.add(number)
                        yield number


@dataclass(frozen=True, kw_only=True)
class Layout(BlockGrid):
    """The arrays of a store and their division into blocks.

    Attributes
    ----------
    frustum, units
        Frustum and length unit of the scene.
    content
        The images that are stored.
    labelled
        Whether there are coordinates; plates that were made before there were any have none.
    measures
        Name and unit of each measure of a hogel; none where hogels are not judged.
    """

    frustum: Frustum
    units: str
    content: PlateContent
    labelled: bool = True
    measures: tuple[tuple[str, str], ...] = ()

    @cached_property
    def arrays(self) -> tuple[PlateArray, ...]:
        """The arrays in the order in which a block's are written: color comes last."""
        return tuple(self._array(channel) for channel in self.content.channels)

    def coordinates(self) -> Iterator[tuple[str, str, NDArray[Any], Mapping[str, str]]]:
        """Yield name, dimension, values and attributes of every coordinate."""
        columns, rows = self.plate.hogels
        width, height = self.frustum.resolution
        x = [self.plate.aperture(column, 0).x for column in range(columns)]
        y = [self.plate.aperture(0, row).y for row in range(rows)]
        length = {"units": self.units}
        yield "column", "column", np.arange(columns), {"long_name": "column of the hogel, from the left"}
        yield "row", "row", np.arange(rows), {"long_name": "row of the hogel, from the top"}
        yield "x", "column", np.array(x), {"long_name": "x of the aperture", **length}
        yield "y", "row", np.array(y), {"long_name": "y of the aperture", **length}
        film = {"units": "1"}
        u, v = (2 * np.arange(width) + 1) / width - 1, 1 - (2 * np.arange(height) + 1) / height
        yield "u", "u", u, {"long_name": "film coordinate of the pixel's center, to the right", **film}
        yield "v", "v", v, {"long_name": "film coordinate of the pixel's center, upward", **film}

    def _array(self, channel: Channel) -> PlateArray:
        kind, fill, dimensions, meaning = _IMAGES[channel]
        dtype = self.content.color.dtype if channel is Channel.COLOR else np.dtype(kind)
        width, height = self.frustum.resolution
        if dtype == np.uint8 and channel is Channel.COLOR:
            meaning = f"{meaning} from 0 to 1 times 255, rounded"
        names = dimensions if self.labelled else tuple(_OLD_DIMENSIONS.get(name, name) for name in dimensions)
        units = {Channel.HEIGHT: self.units, Channel.COLOR: "1", Channel.NORMAL: "1"}.get(channel)
        attributes = {"long_name": meaning, **({} if units is None else {"units": units})}
        return PlateArray(
            name=channel,
            dtype=dtype,
            fill=fill,
            shape=(height, width, *(3 for _ in dimensions[2:])),
            dimensions=(*PLATE_DIMENSIONS, *names),
            attributes=attributes if self.labelled else {},
        )


def default_side(plate: Plate, frustum: Frustum, content: PlateContent) -> tuple[int, int]:
    """Return the columns and rows of a block: the largest square of hogels that `BLOCK_BYTES` hold.

    Its side is a power of two, at most `MAX_BLOCK_SIDE`, and no longer than the plate.
    """
    whole = Layout(plate=plate, frustum=frustum, units="", content=content, side=(1, 1))
    hogel_bytes = sum(array.chunk_bytes for array in whole.arrays)
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
