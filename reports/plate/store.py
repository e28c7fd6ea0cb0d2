"""Writing of a plate: blocks of hogels into shards of its Zarr group.

Zarr writes every file aside and renames it. The array `finished` is written after all others of a
block, so that the hogels that it marks are complete, however a process ends. A killed process may
leave a file `*.partial`, which the next command on the plate removes.

Concurrent writers of one shard would lose each other's hogels (zarr-python 3682). Therefore a part
of a block is read, completed and written under an exclusive lock on the group's description. Whole
blocks are written under a shared lock, because all processes write the same bytes.
"""

from __future__ import annotations

import fcntl
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.storage import LocalStore

from xfrustum.interrupts import delayed
from xfrustum.reports.common.outputs import Staging, refused
from xfrustum.reports.parts import differences_words
from xfrustum.reports.plate.arrays import (
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
    require_arrays,
    shard_file,
)
from xfrustum.scenes import Aperture, InputError
from xfrustum.scenes.disk.input_files import in_words
from xfrustum.scenes.plate.plate import ApertureBlocks, Plate

SOURCE = "source"
"""Key of the place of a scene in its description, for people: it need not agree to go on."""


class PlateStore:
    """Stored hogels of one scene, drawn with one choice of settings."""

    def __init__(self, out: Path, arrays: PlateArrays) -> None:
        # An existing store keeps its blocks, even if a new one would have others.
        side = _stored_side((description_of(out) or {}).get(LAYOUT), arrays.plate)
        self.arrays = arrays if side is None else replace(arrays, side=side)
        self.out, self._place = out, out.resolve()
        require_arrays(out, self.arrays, exactly=True)
        group = open_group(out, "r+")

        def array(name: str) -> zarr.Array[Any]:
            # Black hogels are written like all others.
            stored: Any = group[name]
            return stored.with_config({"write_empty_chunks": True})  # type: ignore[no-any-return]

        self._finished = array(FINISHED)
        names = [image.name for image in arrays.images] + [name for name, _ in arrays.measures]
        self._arrays = {name: array(name) for name in names}

    def missing(self, block: Block, *, check: bool = False) -> tuple[tuple[Aperture, ...], int]:
        """Return the unfinished hogels of a block, and the number of damaged ones with `check`."""
        flags = self._flags(block)
        files = all(self._shard(name, block).is_file() for name in self._arrays)
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

    def write(self, tile: Tile) -> None:
        """Add the hogels of a tile to its block; InputError if the disk is full."""
        block = tile.block
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
                        # The next command draws it again.
                        flags[row, column] = 0
                try:
                    array[block.selection] = values
                except ValueError:
                    # Zarr reads the index of an existing shard, and this one is damaged.
                    self._shard(name, block).unlink()
                    array[block.selection] = values
            flags[tile.drawn] = 1
            self._finished[block.selection] = flags

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
        """Return the flags of finished hogels (rows, columns); zeros where they are damaged."""
        try:
            return np.array(self._finished[block.selection], np.uint8)
        except DAMAGE:
            return np.zeros(block.shape, np.uint8)

    def _shard(self, name: str, block: Block) -> Path:
        return shard_file(self._place, self._arrays[name], block.columns.start, block.rows.start)


def open_store(
    out: Path, arrays: PlateArrays, description: Mapping[str, Any], *, free: bool = True
) -> PlateStore:
    """Open the plate of a scene, or make it, safely among processes.

    If `free`, an existing store keeps its size of blocks. InputError if it was drawn from another
    scene or with other settings, is something else, or is damaged.
    """
    expected = json.loads(json.dumps({**description, LAYOUT: {"block": arrays.side}}))
    if not out.exists():
        try:
            # Zarr writes from its own thread, which would continue after an interrupt.
            with Staging(out) as staging, delayed():
                make_group(LocalStore(staging.folder), arrays, expected)
                # This fails if another process was faster, because renaming does not replace a
                # folder with files.
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
    if free and _stored_side(stored.get(LAYOUT), arrays.plate) is not None:
        expected[LAYOUT] = stored[LAYOUT]
    if stored != expected:
        raise InputError(
            f"--out {out}: was drawn with {differences_words(stored, expected)}; "
            "give what it was drawn with, or another place"
        )
    store = PlateStore(out, arrays)
    store.remove_partial()
    return store


def _stored_side(layout: object, plate: Plate) -> tuple[int, int] | None:
    """Return columns and rows of a block by a description; None if it is damaged."""
    side = layout.get("block") if isinstance(layout, dict) else None
    if not (isinstance(side, list) and [type(count) for count in side] == [int, int]):
        return None
    inside = all(1 <= count <= most for count, most in zip(side, plate.hogels, strict=True))
    return (side[0], side[1]) if inside else None


IGNORING_OPTION = "--ignore-disk-space"


@dataclass(frozen=True, kw_only=True)
class PlateSize:
    """Size of the hogels still to be drawn, and the free space on the disk."""

    place: Path
    hogels: int
    #: bytes before compression
    needed: int
    #: bytes
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
    """Return the size of the given hogels of a plate, without finished ones.

    With `files`, one image of each hogel is written a second time, in a layout of files.
    """
    hogels = len(apertures) - _finished(out, apertures)
    per_hogel = arrays.hogel_bytes + 8 * len(arrays.measures)
    if files:
        per_hogel += arrays.images[-1].image_bytes
    place = next(folder for folder in (out.absolute(), *out.absolute().parents) if folder.is_dir())
    free = shutil.disk_usage(place).free
    return PlateSize(place=out, hogels=hogels, needed=hogels * per_hogel, free=free)


def _finished(out: Path, apertures: ApertureBlocks | Sequence[Aperture]) -> int:
    """Return the number of finished hogels among these; 0 if there is no readable plate."""
    try:
        there = np.asarray(open_group(out)[FINISHED][:]) != 0  # type: ignore[index]
        chosen = np.zeros_like(there)
        blocks = apertures.blocks if isinstance(apertures, ApertureBlocks) else ()
        for columns, rows in blocks:
            chosen[rows.start : rows.stop, columns.start : columns.stop] = True
        for aperture in () if blocks else apertures:
            chosen[aperture.row, aperture.column] = True
        return int(np.count_nonzero(there & chosen))
    except (InputError, *DAMAGE):  # reported when the plate is opened
        return 0
