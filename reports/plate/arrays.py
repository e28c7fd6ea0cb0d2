"""Arrays of a plate in its Zarr group: names, types and labels, blocks of hogels, and checks.

Zarr reads a chunk whose file is missing as the fill value: without the file `x/c/0` all hogels of a
plate are at x = 0. The description of a plate determines all arrays and labels. Therefore every
command that opens a plate compares them with the description.
"""

from __future__ import annotations

import itertools
import json
import math
import warnings
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Self

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.abc.store import ByteRequest, Store
from zarr.codecs import ZstdCodec
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import LocalStore, MemoryStore

from xfrustum.scenes import NOTHING, Certainty, Frustum, InputError
from xfrustum.scenes.model.images import Channel, PlateContent, PlateDirection, PlateHogel
from xfrustum.scenes.plate import Aperture, ApertureBlocks, Plate

#: Default largest size of a block's pixels, bytes before compression; each process that fills a
#: shard has them in memory.
BLOCK_BYTES = 1 << 26

#: Default largest number of columns and of rows of a block: a killed process loses at most 256
#: hogels, and a plate of ten million hogels has 40,000 files per array.
MAX_BLOCK_SIDE = 16

#: Columns and rows of hogels and of pixels in a shard by directions, and rows of hogels in a chunk.
#: A shard has 8 MiB of triangle numbers in one file. Chunks are not smaller, because Zarr takes
#: some 200 us for each.
SHARD_HOGELS, SHARD_PIXELS, CHUNK_ROWS = (512, 64), (8, 8), 4

#: attribute of the group with all inputs that determine its pixels
ATTRIBUTE = "xfrustum"
#: key of a description with the size of blocks, which changes no pixel
LAYOUT = "layout"
#: names of arrays for readers
COLOR, TRIANGLE = Channel.COLOR.value, Channel.TRIANGLE.value
#: array over (row, column), 1 where a hogel is stored
FINISHED = "finished"
#: name of the description of a group or an array in its folder
METADATA = "zarr.json"
#: first two dimensions of every array
PLATE_DIMENSIONS = ("row", "column")

#: Level 1 takes little time compared with drawing; the checksum detects damage to a chunk.
COMPRESSOR = ZstdCodec(level=1, checksum=True)

#: Exceptions of Zarr for damaged files, including errors of codecs, JSON and checksums.
DAMAGE = (
    OSError,
    RuntimeError,
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    ArithmeticError,
)

#: Type, fill value, dimensions, meaning and unit of each image. An empty text stands for the type
#: of color, which is an option, and for the unit of height, which is the scene's.
_IMAGES: Mapping[Channel, tuple[str, Any, tuple[str, ...], str, str | None]] = {
    Channel.COLOR: ("", 0, ("v", "u", "rgb"), "linear radiance", "1"),
    Channel.TRIANGLE: (
        "<i4",
        NOTHING,
        ("v", "u"),
        "number of the visible triangle, -1 where there is none",
        None,
    ),
    Channel.HEIGHT: (
        "<f4",
        np.nan,
        ("v", "u"),
        "height of the visible surface above the plate",
        "",
    ),
    Channel.NORMAL: ("<f4", np.nan, ("v", "u", "xyz"), "unit normal of the visible triangle", "1"),
    Channel.CERTAINTY: (
        "u1",
        int(Certainty.UNEXAMINED),
        ("v", "u"),
        "how the pixel was decided: 0 proven, 1 exact, 2 tie, 3 not examined",
        None,
    ),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedPlateHogel(PlateHogel):
    """Images of a hogel, and its measures by array name, NaN if undefined."""

    measures: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class ImageArray:
    """Array with one image for every hogel."""

    name: str
    dtype: np.dtype[Any]
    #: fill value, for missing hogels
    fill: Any
    #: shape of one image
    shape: tuple[int, ...]
    dimensions: tuple[str, ...]
    attributes: Mapping[str, str]

    @property
    def image_bytes(self) -> int:
        """Size of one image before compression, bytes."""
        return math.prod(self.shape) * self.dtype.itemsize


@dataclass(frozen=True, kw_only=True)
class Block:
    """Rectangle of hogels in one shard of every array, with the requested hogels in it.

    By directions, a block is a rectangle of pixels of all hogels of a tile, in whole shards.
    """

    #: number of the block, row by row from the top left
    number: int
    columns: range
    rows: range
    #: requested hogels; empty for a block by directions
    apertures: tuple[Aperture, ...] = ()
    #: columns and rows of pixels of a block by directions; None for whole films
    film: tuple[range, range] | None = None

    @property
    def selection(self) -> tuple[slice, slice]:
        """Part of an array over (row, column)."""
        return _slice(self.rows), _slice(self.columns)

    @property
    def image_selection(self) -> tuple[slice, ...]:
        """Part of an array of images."""
        film = () if self.film is None else tuple(map(_slice, reversed(self.film)))
        return (*self.selection, *film)

    @property
    def pixels(self) -> list[tuple[int, int]]:
        """Columns and rows of the pixels by directions, row by row."""
        columns, rows = self.film or ((), ())
        return [(column, row) for row in rows for column in columns]

    @property
    def tile(self) -> tuple[range, range]:
        """Columns and rows of the hogels."""
        return self.columns, self.rows

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        return len(self.rows), len(self.columns)

    def place_of(self, aperture: Aperture) -> tuple[int, int]:
        """Return row and column within the block."""
        return aperture.row - self.rows.start, aperture.column - self.columns.start


def _slice(places: range) -> slice:
    return slice(places.start, places.stop)


@dataclass(kw_only=True, eq=False)
class Tile:
    """Images of a block, made by a source and written by a store."""

    block: Block
    #: (rows, columns, H, W, ..) by the name of the array; measures (rows, columns)
    values: dict[str, NDArray[Any]]
    #: mask (rows, columns) of hogels with images
    drawn: NDArray[np.bool_]

    @classmethod
    def empty(cls, block: Block, arrays: PlateArrays) -> Tile:
        """Return a tile of fill values."""
        values: dict[str, NDArray[Any]] = {
            array.name: _filled(block, array) for array in arrays.images
        }
        values |= {name: np.full(block.shape, np.nan) for name, _ in arrays.measures}
        return cls(block=block, values=values, drawn=np.zeros(block.shape, bool))

    def put(self, image: PlateHogel | PlateDirection) -> None:
        """Copy images and measures of a hogel, or one pixel of all hogels, into the block."""
        if isinstance(image, PlateDirection):
            assert self.block.film is not None
            columns, rows = self.block.film
            column, row = image.pixel[0] - columns.start, image.pixel[1] - rows.start
            for name, values in self.values.items():
                values[:, :, row, column] = image.image(Channel(name))
            return
        hogel = image
        place = self.block.place_of(hogel.aperture)
        measures = hogel.measures if isinstance(hogel, JudgedPlateHogel) else {}
        for name, values in self.values.items():
            values[place] = measures[name] if name in measures else hogel.image(Channel(name))
        self.drawn[place] = True


def _filled(block: Block, array: ImageArray) -> NDArray[Any]:
    """Return fill values (rows, columns, H, W, ..) of the pixels of a block."""
    if block.film is None:
        return np.full((*block.shape, *array.shape), array.fill, array.dtype)
    columns, rows = block.film
    # Each image by direction lies in contiguous memory, so that copying it in is fast.
    images = (len(rows), len(columns), *block.shape, *array.shape[2:])
    return np.full(images, array.fill, array.dtype).transpose(2, 3, 0, 1, *range(4, len(images)))


@dataclass(frozen=True, kw_only=True)
class PlateArrays:
    """Arrays of a plate and their division into blocks."""

    plate: Plate
    frustum: Frustum
    units: str
    content: PlateContent
    #: columns and rows of hogels in a shard
    side: tuple[int, int]
    #: columns and rows of pixels in a shard by directions; None for whole hogels
    film: tuple[int, int] | None = None
    #: Columns and rows of hogels that are drawn together by directions. The size of such a tile
    #: changes the rounding of pixels.
    tile: tuple[int, int] | None = None
    #: name and unit of each measure of judged hogels
    measures: tuple[tuple[str, str], ...] = ()

    @cached_property
    def images(self) -> tuple[ImageArray, ...]:
        """Arrays of images in the order in which they are written."""
        arrays = []
        for channel in self.content.channels:
            kind, fill, dimensions, meaning, unit = _IMAGES[channel]
            dtype = self.content.color.dtype if channel is Channel.COLOR else np.dtype(kind)
            if dtype == np.uint8 and channel is Channel.COLOR:
                meaning = f"{meaning} from 0 to 1 times 255, rounded"
            units = {} if unit is None else {"units": unit or self.units}
            array = ImageArray(
                name=channel,
                dtype=dtype,
                fill=fill,
                shape=(*self.frustum.resolution[::-1], *(3 for _ in dimensions[2:])),
                dimensions=(*PLATE_DIMENSIONS, *dimensions),
                attributes={"long_name": meaning, **units},
            )
            arrays.append(array)
        return tuple(arrays)

    @property
    def layout(self) -> dict[str, Any]:
        """Division into shards and tiles, as stored in the description of a plate."""
        sides = {"block": self.side, "film": self.film, "tile": self.tile}
        return {name: list(side) for name, side in sides.items() if side is not None}

    def laid_out(self, layout: object) -> Self | None:
        """Return the arrays in a stored layout; None if it does not fit."""
        own = self.layout
        if not isinstance(layout, dict) or layout.keys() != own.keys():
            return None
        most = {"film": self.frustum.resolution}
        for name, side in layout.items():
            if not (isinstance(side, list) and [type(count) for count in side] == [int, int]):
                return None
            bounds = zip(side, most.get(name, self.plate.hogels), strict=True)
            if not all(1 <= count <= bound for count, bound in bounds):
                return None
        pairs: dict[str, Any] = {name: tuple(side) for name, side in layout.items()}
        return replace(self, side=pairs.pop("block"), **pairs)

    def chunks(self, array: ImageArray) -> tuple[tuple[int, ...], tuple[int, ...] | None]:
        """Return the shapes of chunks and of shards (None without shards).

        Chunks by directions have few rows of hogels, because readers read hogels row by row.
        """
        columns, rows = self.side
        film = array.shape if self.film is None else (*self.film[::-1], *array.shape[2:])
        together = (1, 1) if self.film is None else (math.gcd(CHUNK_ROWS, rows), columns)
        chunk = (*together, *film)
        shard = (rows, columns, *film)
        return chunk, None if shard == chunk else shard

    @property
    def hogel_bytes(self) -> int:
        """Size of all images of a hogel before compression, bytes."""
        return sum(array.image_bytes for array in self.images)

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
        """Yield the blocks of apertures in the order of the apertures."""
        (width, height), hogels = self.side, self.plate.hogels
        across = -(-hogels[0] // width)
        # Rectangles may have millions of hogels: list them block by block.
        if isinstance(apertures, ApertureBlocks):
            requested: Container[Aperture] = apertures
            rectangles = apertures.blocks
        else:
            requested = cells = dict.fromkeys(apertures)
            rectangles = tuple(
                (range(cell.column, cell.column + 1), range(cell.row, cell.row + 1))
                for cell in cells
            )
        numbers = dict.fromkeys(
            row * across + column
            for columns, rows in rectangles
            for row in range(rows.start // height, -(-rows.stop // height))
            for column in range(columns.start // width, -(-columns.stop // width))
        )
        for number in numbers:
            row, column = divmod(number, across)
            columns = range(column * width, min((column + 1) * width, hogels[0]))
            rows = range(row * height, min((row + 1) * height, hogels[1]))
            every = ApertureBlocks(self.plate, ((columns, rows),))
            inside = tuple(aperture for aperture in every if aperture in requested)
            yield Block(number=number, columns=columns, rows=rows, apertures=inside)


def default_side(plate: Plate, frustum: Frustum, content: PlateContent) -> tuple[int, int]:
    """Return columns and rows of the largest block, a power of two, within `BLOCK_BYTES`."""
    arrays = PlateArrays(plate=plate, frustum=frustum, units="", content=content, side=(1, 1))
    side = MAX_BLOCK_SIDE
    while side > 1 and side * side * arrays.hogel_bytes > BLOCK_BYTES:
        side //= 2
    return min(side, plate.hogels[0]), min(side, plate.hogels[1])


class _RegularFiles(LocalStore):
    """Folder store that reads only regular files: reading a pipe would block."""

    async def get(
        self,
        key: str,
        prototype: BufferPrototype | None = None,
        byte_range: ByteRequest | None = None,
    ) -> Buffer | None:
        path = self.root / key
        if path.exists() and not path.is_file():
            raise OSError(f"{path} is no regular file")
        return await super().get(key, prototype, byte_range)


def open_group(place: Path, mode: str = "r", *, consolidated: bool | None = None) -> zarr.Group:
    """Open the Zarr group in a folder; InputError if it is missing or damaged.

    `consolidated` selects the copy of the metadata in the group's own file; None selects any copy.
    """
    files = _RegularFiles(place.resolve(), read_only=mode == "r")
    try:
        options: Any = {"mode": mode, "use_consolidated": consolidated}
        return zarr.open_group(files, **options)
    except DAMAGE as error:
        raise InputError(
            f"{place}: is no plate that can be read ({reason_of(error)}); draw one with "
            "`xfrustum plate`"
        ) from error


def reason_of(error: Exception) -> str:
    """Return the text of a Zarr exception as one short line."""
    return f"{' '.join(str(error).split()) or type(error).__name__:.200}"


def description_of(place: Path) -> dict[str, Any] | None:
    """Return the description of a stored plate of xfrustum, or None."""
    try:
        description = open_group(place).attrs.get(ATTRIBUTE)
    except InputError:
        return None
    return description if isinstance(description, dict) else None


def require_arrays(place: Path, arrays: PlateArrays, *, exactly: bool = False) -> None:
    """Raise InputError unless a group has the arrays and the coordinates of a plate.

    Both copies of the metadata are compared: in the folders of the arrays, and consolidated in the
    file of the group. With `exactly` chunks and codecs must be equal too.
    """
    for consolidated in (True, False):
        try:
            group = open_group(place, consolidated=consolidated)
            if problem := _difference(group, arrays, exactly=exactly):
                raise InputError(
                    f"{place}: {problem}; draw the plate again, at another place, or bring its "
                    "files back"
                )
        except DAMAGE as error:
            raise InputError(
                f"{place}: is damaged ({reason_of(error)}); draw the plate at another place"
            ) from error


@lru_cache(maxsize=8)
def _expected(arrays: PlateArrays, *, exactly: bool) -> dict[str, dict[str, str]]:
    """Return the facts that each array of a plate declares, by name."""
    group: Any = make_group(MemoryStore(), arrays, {})
    return {name: _declared(group[name], exactly=exactly) for name in group.array_keys()}


def _difference(group: zarr.Group, arrays: PlateArrays, *, exactly: bool) -> str | None:
    """Return the first difference of a group from the expected group in words; None if equal."""
    if group.attrs.get("units") != arrays.units:
        return f"its units are {group.attrs.get('units')}, and the scene's {arrays.units}"
    stored: dict[str, Any] = {}
    for name, expects in _expected(arrays, exactly=exactly).items():
        # Read each array once: every access to a group calls into Zarr's own thread.
        stored[name] = group.get(name)
        if stored[name] is None:
            return f"has no array {name}"
        facts = _declared(stored[name], exactly=exactly)
        for key in expects:
            if facts.get(key) != expects[key]:
                return f"{key} of {name} is {facts.get(key)}, and should be {expects[key]}"
    for name, _, places, _, _ in arrays.coordinates():
        values = np.asarray(stored[name][:])
        wrong = np.flatnonzero(values != places)
        if wrong.size:
            first = wrong[0]
            return (
                f"{wrong.size:,} of {values.size:,} values of {name} are not the scene's: "
                f"{name}[{first}] is {values[first]:.6g}, and should be {places[first]:.6g}"
            )
    return None


def _declared(array: Any, *, exactly: bool) -> dict[str, str]:
    """Return the facts that an array declares, by name."""
    facts = array.metadata.to_dict()
    facts["units"] = facts.get("attributes", {}).get("units")
    keys = ["shape", "data_type", "fill_value", "dimension_names", "units"]
    keys += [key for key in sorted(facts) if key not in keys and exactly]
    return {key.replace("_", " "): json.dumps(facts.get(key), default=str) for key in keys}


def shard_files(place: Path, array: Any, selection: Sequence[slice]) -> Iterator[Path]:
    """Yield the files of a part of an array, selected along its first axes."""
    whole = [slice(0, count) for count in array.shape[len(selection) :]]
    sides = array.shards or array.chunks
    numbers = (
        range(part.start // side, -(-part.stop // side))
        for part, side in zip((*selection, *whole), sides, strict=True)
    )
    folder = place / str(array.basename)
    for number in itertools.product(*numbers):
        yield folder / str(array.metadata.encode_chunk_key(number))


def make_group(store: Store, arrays: PlateArrays, description: Mapping[str, Any]) -> zarr.Group:
    """Create an empty group with the arrays of a plate, in their chunks and shards."""
    columns, rows = arrays.side
    chunks = {array.name: arrays.chunks(array) for array in arrays.images}
    # Store the unit of lengths also in the group, because xarray prints group attributes.
    attributes = {"coordinates": "x y", "units": arrays.units, ATTRIBUTE: dict(description)}
    group = zarr.create_group(store, attributes=attributes)
    for array in arrays.images:
        group.create_array(
            array.name,
            shape=(*arrays.plate.hogels[::-1], *array.shape),
            chunks=chunks[array.name][0],
            shards=chunks[array.name][1],
            dtype=array.dtype,
            compressors=[COMPRESSOR],
            fill_value=array.fill,
            dimension_names=array.dimensions,
            attributes=dict(array.attributes),
        )
    maps = [(name, "<f8", np.nan, name.replace("_", " "), unit) for name, unit in arrays.measures]
    maps.append((FINISHED, "u1", 0, "1 where the hogel is there", "1"))
    for name, dtype, fill, meaning, unit in maps:
        group.create_array(
            name,
            shape=arrays.plate.hogels[::-1],
            chunks=(rows, columns),
            dtype=dtype,
            compressors=[COMPRESSOR],
            fill_value=fill,
            dimension_names=PLATE_DIMENSIONS,
            attributes={"long_name": meaning, "units": unit},
        )
    for name, dimension, values, meaning, units in arrays.coordinates():
        group.create_array(
            name,
            data=values,
            chunks=values.shape,
            compressors=None,
            dimension_names=[dimension],
            attributes={"long_name": meaning, **units},
        )
    with warnings.catch_warnings():
        # Consolidated metadata speed up reading; Zarr format 3 does not define them yet, and warns.
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(store)
    return group
