"""How much of the disk a plate will take, before it is drawn."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import zarr

from xfrustum.reports.plate.store import DAMAGE, FINISHED, Layout, open_group
from xfrustum.scenes import Aperture, InputError
from xfrustum.scenes.plate.plate import ApertureBlocks

IGNORING_OPTION = "--ignore-disk-space"


@dataclass(frozen=True, kw_only=True)
class PlateSize:
    """Bytes that the hogels take which are still to be drawn, before compression, and those that are free."""

    place: Path
    hogels: int
    needed: int
    free: int

    @property
    def words(self) -> str:
        """The size in one line."""
        size = (
            f"{self.hogels:,} hogels to draw take at most {_sized(self.needed)} before compression"
        )
        return f"{self.place}: {size}; the disk has {_sized(self.free)} free"

    def require_room(self) -> None:
        """Raise InputError where the disk has less free space than the hogels may take."""
        if self.needed > self.free:
            raise InputError(
                f"--out {self.words}; free some space, draw fewer hogels with --apertures, or begin all the "
                f"same with {IGNORING_OPTION}, for hogels are compressed"
            )


def _sized(size: int) -> str:
    for unit, bytes_per_unit in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= bytes_per_unit:
            count = size / bytes_per_unit
            return f"{count:,.0f} {unit}" if count >= 10 else f"{count:.2g} {unit}"
    return f"{size} bytes"


def plate_size(
    out: Path,
    layout: Layout,
    apertures: ApertureBlocks | Sequence[Aperture],
    *,
    files: bool = False,
) -> PlateSize:
    """Return the size of some hogels of a plate without those that are there already.

    With `files`, one image of each is written once more, in a layout of files.
    """
    hogels = len(apertures) - _finished(out, apertures)
    per_hogel = (
        layout.hogel_bytes + 8 * len(layout.measures) * 2
    )  # measures are in maps and in a table
    if files:
        per_hogel += layout.array_bytes(layout.arrays[-1])
    place = out.absolute()
    while not place.is_dir() and place != place.parent:
        place = place.parent
    free = shutil.disk_usage(place).free
    return PlateSize(place=out, hogels=hogels, needed=hogels * per_hogel, free=free)


def _finished(out: Path, apertures: ApertureBlocks | Sequence[Aperture]) -> int:
    """Return how many of some hogels a plate has; 0 where there is none that can be read."""
    if not out.exists():
        return 0
    try:
        flags = open_group(out).get(FINISHED)
        if not isinstance(flags, zarr.Array):
            return 0
        there = np.asarray(flags[:]) != 0
        asked = np.zeros_like(there)
        blocks = apertures.blocks if isinstance(apertures, ApertureBlocks) else ()
        for columns, rows in blocks:
            asked[rows.start : rows.stop, columns.start : columns.stop] = True
        for one in () if blocks else apertures:
            asked[one.row, one.column] = True
        return int(np.count_nonzero(there & asked))
    except (InputError, *DAMAGE):  # whoever opens the plate says what is wrong with it
        return 0
