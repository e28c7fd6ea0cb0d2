"""Stored plates: writing of blocks into the shards of a Zarr group, and checked reading.

Zarr writes every file under a temporary name and renames it. The array `finished` of a block is
written last, so that marked hogels are complete even if a process is killed. A killed process may
leave a file `*.partial`, which the next command on the plate removes.

Concurrent writers of one shard would lose each other's hogels (zarr-python 3682). Therefore a part
of a block is read, completed and written under an exclusive lock on the group's description. Whole
blocks are written under a shared lock, because all processes write the same bytes.

Readers check all stored metadata.
"""

from __future__ import annotations

import fcntl
import json
import math
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from pydantic import PositiveInt, TypeAdapter, ValidationError
from zarr.storage import LocalStore

from xfrustum.compare.rounding.causes import DirectionPlate
from xfrustum.process import delayed
from xfrustum.reference.lines import film_window
from xfrustum.reports.common.outputs import Staging, refused
from xfrustum.reports.parts import differences_words
from xfrustum.reports.plate.arrays import (
    ATTRIBUTE,
    DAMAGE,
    FINISHED,
    LAYOUT,
    METADATA,
    Block,
    PlateArrays,
    Tile,
    description_of,
    make_group,
    open_group,
    reason_of,
    require_arrays,
    shard_files,
)
from xfrustum.scenes import NOTHING, Aperture, DoubleFrustum, Frustum, HogelCamera, InputError
from xfrustum.scenes.arrays import Numbers
from xfrustum.scenes.disk import in_words
from xfrustum.scenes.model.images import Channel, PlateContent
from xfrustum.scenes.plate import ApertureBlocks, DepthFormat, Plate, PlateTile

SOURCE = "source"
"""Key of the path of a scene in a description; a continued plate may have another path."""


class PlateStore:
    """Stored hogels of a scene, drawn with one setting."""

    def __init__(self, out: Path, arrays: PlateArrays) -> None:
        # An existing store keeps its division into blocks.
        self.arrays = arrays.laid_out((description_of(out) or {}).get(LAYOUT)) or arrays
        self.out, self._place = out, out.resolve()
        require_arrays(out, self.arrays, exactly=True)
        group = open_group(out, "r+")

        def array(name: str) -> zarr.Array[Any]:
            # Write black hogels like all other hogels.
            stored: Any = group[name]
            return stored.with_config({"write_empty_chunks": True})  # type: ignore[no-any-return]

        self._finished = array(FINISHED)
        names = [image.name for image in arrays.images] + [name for name, _ in arrays.measures]
        self._arrays = {name: array(name) for name in names}

    def missing(self, block: Block, *, check: bool = False) -> tuple[tuple[Aperture, ...], int]:
        """Return the unfinished hogels of a block, and with `check` the number of damaged ones."""
        flags = self._flags(block)
        files = self.has_files(block)
        missing, damaged = [], 0
        for aperture in block.apertures:
            there = bool(flags[block.place_of(aperture)]) and files
            if there and check:
                try:
                    for array in self._arrays.values():
                        array[aperture.row, aperture.column]
                except DAMAGE:
                    damaged, there = damaged + 1, False
            if not there:
                missing.append(aperture)
        return tuple(missing), damaged

    def damaged(self, block: Block) -> NDArray[np.bool_]:
        """Return the hogels (rows, columns) of a block by directions with damaged pixels."""
        damaged = np.zeros(block.shape, np.bool_)
        # Read one file at a time, because a block fills the memory.
        (width, height), edges = self.arrays.side, block.image_selection[2:]
        for row in range(0, block.shape[0], height):
            for column in range(0, block.shape[1], width):
                rows, columns = (
                    block.rows[row : row + height],
                    block.columns[column : column + width],
                )
                part = replace(block, rows=rows, columns=columns).selection
                try:
                    for array in self._arrays.values():
                        array[(*part, *edges)]
                except DAMAGE:
                    damaged[row : row + height, column : column + width] = True
        return damaged

    def write(self, tile: Tile) -> None:
        """Add the images of a tile to its block; InputError if the disk is full."""
        block = tile.block
        if block.film is not None:
            self._write_pixels(tile)
            return
        whole = fcntl.LOCK_SH if tile.drawn.all() else fcntl.LOCK_EX
        with (
            refused(f"--out {self.out}: cannot write there"),
            (self._place / METADATA).open("r+b") as lock,
        ):
            fcntl.flock(lock, whole)
            flags = self._flags(block)
            flags[tile.drawn] = 0
            kept = [(int(row), int(column)) for row, column in np.argwhere(flags)]
            for name, array in self._arrays.items():
                values = tile.values[name]
                for row, column in kept:
                    try:
                        values[row, column] = array[block.rows[row], block.columns[column]]
                    except DAMAGE:
                        # The next command draws the hogel again.
                        flags[row, column] = 0
                try:
                    array[block.selection] = values
                except ValueError:
                    # Writing reads the index of the existing shard, and this index is damaged.
                    for file in self._files(name, block):
                        file.unlink()
                    array[block.selection] = values
            flags[tile.drawn] = 1
            self._finished[block.selection] = flags

    def _write_pixels(self, tile: Tile) -> None:
        """Write some pixels of all hogels of a tile, in whole shards of one file each.

        An existing file is complete, so a block by directions is complete if all its files exist.
        The writer of the last block marks the hogels as finished.
        """
        block = tile.block
        with (
            refused(f"--out {self.out}: cannot write there"),
            (self._place / METADATA).open("r+b") as lock,
        ):
            # A shared lock keeps `remove_partial` from deleting the files of a writer.
            fcntl.flock(lock, fcntl.LOCK_SH)
            for name, array in self._arrays.items():
                try:
                    array[block.image_selection] = tile.values[name]
                except OSError:
                    raise
                except DAMAGE:
                    # At the edges of the film, writing reads existing shards, and a shard is
                    # damaged.
                    for file in self._files(name, block):
                        file.unlink(missing_ok=True)
                    array[block.image_selection] = tile.values[name]
        self.mark(block)

    def mark(self, block: Block) -> bool:
        """Mark the hogels of a tile as finished if all pixels exist; return whether they do."""
        if self._flags(block).all():
            return True
        if not self.has_files(replace(block, film=None)):
            return False
        with refused(f"--out {self.out}: cannot write there"):
            self._finished[block.selection] = np.ones(block.shape, np.uint8)
        return True

    def remove_partial(self) -> None:
        """Remove the files of killed processes, unless a process is writing."""
        with (self._place / METADATA).open("r+b") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                return
            for path in self._place.rglob("*.partial"):
                path.unlink(missing_ok=True)

    def _flags(self, block: Block) -> NDArray[np.uint8]:
        """Return the flags of finished hogels (rows, columns); zeros if the file is damaged."""
        try:
            return np.array(self._finished[block.selection], np.uint8)
        except DAMAGE:
            return np.zeros(block.shape, np.uint8)

    def has_files(self, block: Block) -> bool:
        """Return whether all files of a block exist."""
        return all(file.is_file() for name in self._arrays for file in self._files(name, block))

    def _files(self, name: str, block: Block) -> Iterator[Path]:
        array = self._arrays[name]
        return shard_files(self._place, array, block.image_selection[: array.ndim])


def open_store(
    out: Path, arrays: PlateArrays, description: Mapping[str, Any], *, free: bool = True
) -> PlateStore:
    """Open or create the plate of a scene; safe with concurrent processes.

    If `free`, an existing store keeps its size of blocks. Raises InputError if the plate has
    another scene or other settings, is damaged, or is not a plate.
    """
    expected = json.loads(json.dumps({**description, LAYOUT: arrays.layout}))
    if not out.exists():
        try:
            # Zarr writes in its own thread, which would continue after an interrupt.
            with Staging(out) as staging, delayed():
                make_group(LocalStore(staging.folder), arrays, expected)
                # This fails if another process was faster, because renaming cannot replace a folder
                # that contains files.
                staging.folder.rename(out.resolve())
        except InputError:
            if not (out / METADATA).is_file():
                raise
    stored = description_of(out)
    if stored is None:
        raise InputError(f"--out {out}: exists and is no plate of xfrustum; choose another place")
    # Keep the stored path of the scene, so that folders can be moved and bytes do not change.
    scene = stored.get("scene")
    if isinstance(scene, dict) and SOURCE in scene:
        expected["scene"][SOURCE] = scene[SOURCE]
    if free and arrays.laid_out(stored.get(LAYOUT)) is not None:
        expected[LAYOUT] = stored[LAYOUT]
    if stored != expected:
        raise InputError(
            f"--out {out}: was drawn with {differences_words(stored, expected)}; "
            "give what it was drawn with, or another place"
        )
    store = PlateStore(out, arrays)
    store.remove_partial()
    return store


IGNORING_OPTION = "--ignore-disk-space"


@dataclass(frozen=True, kw_only=True)
class PlateSize:
    """Size of the hogels that are still to be drawn, and free space on the disk."""

    place: Path
    hogels: int
    #: size of the hogels before compression, bytes
    needed: int
    #: free space, bytes
    free: int

    @property
    def words(self) -> str:
        """Size in one line."""
        return (
            f"{self.place}: {self.hogels:,} hogels to draw take at most {in_words(self.needed)} "
            f"before compression; the disk has {in_words(self.free)} free"
        )

    def require_room(self) -> None:
        """Raise InputError if the disk has less free space than the hogels may take."""
        if self.needed > self.free:
            raise InputError(
                f"--out {self.words}; free some space, draw fewer hogels with --apertures, or "
                f"begin all the same with {IGNORING_OPTION}, for hogels are compressed"
            )


def plate_size(
    out: Path,
    arrays: PlateArrays,
    apertures: ApertureBlocks | Sequence[Aperture],
    *,
    files: bool = False,
) -> PlateSize:
    """Return the size of the unfinished hogels of a plate.

    `files` adds the size of an image file of each hogel.
    """
    hogels = len(apertures) - _finished(out, apertures)
    per_hogel = arrays.hogel_bytes + 8 * len(arrays.measures)
    if files:
        per_hogel += arrays.images[-1].image_bytes
    place = next(folder for folder in (out.absolute(), *out.absolute().parents) if folder.is_dir())
    free = shutil.disk_usage(place).free
    return PlateSize(place=out, hogels=hogels, needed=hogels * per_hogel, free=free)


def _finished(out: Path, apertures: ApertureBlocks | Sequence[Aperture]) -> int:
    """Return the number of finished hogels among apertures; 0 without a readable plate."""
    try:
        there = np.asarray(open_group(out)[FINISHED][:]) != 0  # type: ignore[index]
        chosen = np.zeros_like(there)
        blocks = apertures.blocks if isinstance(apertures, ApertureBlocks) else ()
        for columns, rows in blocks:
            chosen[rows.start : rows.stop, columns.start : columns.stop] = True
        for aperture in () if blocks else apertures:
            chosen[aperture.row, aperture.column] = True
        return int(np.count_nonzero(there & chosen))
    except (InputError, *DAMAGE):  # opening the plate reports them
        return 0


#: largest size of images that are read together, bytes
MOST_BYTES = 1 << 28


@dataclass(frozen=True, kw_only=True)
class _Scene:
    """Scene of a plate."""

    units: str
    source: str
    hash: str


@dataclass(frozen=True, kw_only=True)
class _Content(PlateContent):
    """Images of a plate."""

    #: whether the plate also has measures
    judged: bool = False


@dataclass(frozen=True, kw_only=True)
class _Renderer:
    """Renderer of a plate."""

    device: str


@dataclass(frozen=True, kw_only=True)
class _Layout:
    """Layout of a plate."""

    #: columns and rows of hogels of a tile by directions
    tile: tuple[PositiveInt, PositiveInt] | None = None


@dataclass(frozen=True, kw_only=True)
class _Directions:
    """Settings of a plate that was drawn by directions."""

    depth: DepthFormat


@dataclass(frozen=True, kw_only=True)
class _Description:
    """Parts of a description that readers use; other parts are ignored."""

    plate: Plate
    frustum: Frustum
    scene: _Scene
    content: _Content
    renderer: _Renderer
    #: None for a plate of truths
    settings: DoubleFrustum | None = None
    #: None for a plate by hogels, or of truths
    directions: _Directions | None = None
    layout: _Layout = _Layout()


_DESCRIPTION = TypeAdapter(_Description)


def _described(place: object, attributes: Mapping[str, Any]) -> _Description:
    """Return the validated description in the attributes of a group."""
    description = attributes.get(ATTRIBUTE)
    if not isinstance(description, Mapping):
        raise InputError(f"{place}: is no plate of xfrustum; draw it with `xfrustum plate`")
    try:
        return _DESCRIPTION.validate_python(description)
    except (ValidationError, InputError) as error:
        raise InputError(
            f"{place}: the description of the plate is damaged; draw it again"
        ) from error


def checked_group(place: Path) -> zarr.Group:
    """Open a Zarr group; InputError if the arrays of a plate differ from its description.

    Groups of other programs have no description and are returned unchecked.
    """
    group = open_group(place)
    if isinstance(group.attrs.get(ATTRIBUTE), dict):
        stored = _described(place, group.attrs)
        arrays = PlateArrays(
            plate=stored.plate,
            frustum=stored.frustum,
            units=stored.scene.units,
            content=stored.content,
            side=(1, 1),
        )
        if stored.content.judged:
            # Measures are the remaining arrays; their names depend on the scene's appearance.
            others = {*(name for name, *_ in arrays.coordinates()), *Channel, FINISHED}
            names = sorted(set(group.array_keys()) - others)
            units = [str(group[name].attrs.get("units", "")) for name in names]
            arrays = replace(arrays, measures=tuple(zip(names, units, strict=True)))
        # A changed array would yield plausible pixels of another plate.
        require_arrays(place, arrays)
    return group


def direction_plate(place: Path) -> DirectionPlate | None:
    """Return a plate drawn by directions with stored triangles; None for other plates."""
    group = open_group(place)
    if not isinstance(group.attrs.get(ATTRIBUTE), Mapping):
        return None
    described = _described(place, group.attrs)
    drawn, tile = described.directions, described.layout.tile
    if drawn is None or tile is None or Channel.TRIANGLE not in group:
        return None
    stored: Any = group[Channel.TRIANGLE]

    def shown(hogels: PlateTile, pixel: tuple[int, int]) -> Numbers:
        (columns, rows), (column, row) = (hogels.columns, hogels.rows), pixel
        part = slice(rows.start, rows.stop), slice(columns.start, columns.stop), row, column
        try:
            return np.asarray(stored[part])
        except DAMAGE:
            # A damaged hogel counts as empty where it is a neighbor; in its own place it counts as
            # missing.
            return np.full(hogels.size[::-1], NOTHING, dtype=np.int32)

    return DirectionPlate(depth=drawn.depth, tile=tile, shown=shown)


class PlateReader:
    """Hogels of a stored plate."""

    def __init__(self, path: Path) -> None:
        group = checked_group(path)
        attributes: Mapping[str, Any] = group.attrs
        _described(path, attributes)
        self.path = path
        #: all inputs that determine the pixels
        self.description: Mapping[str, Any] = attributes[ATTRIBUTE]
        #: Images by name, (rows, columns, H, W) or (rows, columns, H, W, 3).
        self.arrays: dict[str, Any] = {name: group[name] for name in Channel if name in group}
        self._finished: Any = group[FINISHED]

    def finished(self, aperture: Aperture) -> bool:
        """Return whether a hogel is stored."""
        try:
            return bool(self._finished[aperture.row, aperture.column])
        except DAMAGE as error:
            raise InputError(
                f"{self.path}: array {FINISHED} is damaged; draw the plate again"
            ) from error

    def image(self, name: str, column: int, row: int) -> Any:
        """Return an image of a finished hogel; InputError if its file is damaged or missing."""
        return read_hogel(self.path, self.arrays[name], column, row)


def read_hogel(
    place: Path, array: zarr.Array[Any], column: int, row: int, *, must_exist: bool = True
) -> Any:
    """Return an image of a hogel; InputError if a file is damaged, or missing but required."""
    ((_, image),) = read_hogels(place, array, row, [column], must_exist=must_exist)
    return image


def read_hogels(
    place: Path,
    array: zarr.Array[Any],
    row: int,
    columns: Sequence[int],
    *,
    must_exist: bool = True,
) -> Iterator[tuple[int, Any]]:
    """Yield columns, ascending, each with the image of its hogel in a row; see `read_hogel`.

    A chunk of a plate by directions has pixels of many hogels, so that columns are read together.
    """
    together = max(1, min(array.chunks[1], MOST_BYTES // image_bytes(array)))
    for _, group in groupby(columns, lambda column: column // together):
        some = list(group)
        part = slice(row, row + 1), slice(some[0], some[-1] + 1)
        reason = "its file is gone"
        # Zarr returns the fill value for a missing shard, which equals a black hogel.
        if not must_exist or all(file.is_file() for file in shard_files(place, array, part)):
            try:
                images = np.asarray(array[part])[0]
            except DAMAGE as error:
                reason = reason_of(error)
            else:
                yield from ((column, images[column - some[0]]) for column in some)
                continue
        raise InputError(
            f"{place}: hogel {some[0]},{row} is damaged ({reason}); `xfrustum plate --check` draws "
            "it again"
        )


def image_bytes(array: zarr.Array[Any]) -> int:
    """Return the size of the image of a hogel, bytes."""
    return math.prod(array.shape[2:]) * int(array.dtype.itemsize)


def camera_of(store: Any, column: int, row: int) -> HogelCamera:
    """Return the crossed frustum of a hogel of a plate, in full double precision.

    The line of film coordinates u, v is (x, y, 0) + s (kx + u tx, ky + v ty, -1), with the aperture
    x, y, the shear k and the half-extent t. The camera contains the settings of the plate. `store`
    is a folder, or the plate as opened by `zarr.open_group` or `xarray.open_zarr`.

    Raises InputError if there is no plate, or the plate has no such hogel.
    """
    in_folder = isinstance(store, str | Path)
    group = open_group(Path(store)) if in_folder else store
    described = _described(store if in_folder else "the store", group.attrs)
    frustum = described.frustum
    aperture = described.plate.aperture(column, row)
    shear, half_extent = film_window(frustum, aperture)
    return HogelCamera(
        aperture=aperture,
        resolution=frustum.resolution,
        shear=shear,
        half_extent=half_extent,
        reach=frustum.reach,
        scene=described.scene.source,
        scene_hash=described.scene.hash,
        renderer=described.renderer.device,
        settings=described.settings,
    )
