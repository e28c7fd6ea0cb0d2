"""A plate on disk for those who read it: what it says of itself, and which of its hogels are finished."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import zarr
from zarr.errors import GroupNotFoundError

from xfrustum.reports.plate.layout import BlockGrid, side_of
from xfrustum.reports.plate.shards import BlockFile, read_places
from xfrustum.reports.plate.store import ATTRIBUTE, LAYOUT
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.plate_content import Channel
from xfrustum.scenes.plate.plate import Aperture, Plate

KEPT_FILES = 256
"""Number of files whose index is kept: readers ask for the hogels of a block one after the other."""


class StoredPlate:
    """The hogels of a Zarr group that `xfrustum plate` has made, in blocks or, as older ones, one by one.

    Parameters
    ----------
    path
        Folder of the group.

    Attributes
    ----------
    description
        Everything that decides the pixels, as the group says it.
    arrays
        Arrays of images by name, (rows, columns, H, W) or (rows, columns, H, W, 3).

    Raises
    ------
    InputError
        There is no group, or it is no plate.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            group = zarr.open_group(path, mode="r")
            said = group.attrs.get(ATTRIBUTE)
            members = {channel.value: group.get(channel.value) for channel in Channel}
        except (GroupNotFoundError, OSError, ValueError, TypeError, KeyError) as error:
            raise InputError(f"{path}: is no plate; draw one with `xfrustum plate`") from error
        self.description: Mapping[str, Any] = said if isinstance(said, dict) else {}
        self.arrays = {name: array for name, array in members.items() if isinstance(array, zarr.Array)}
        shapes = {array.shape[:4] for array in self.arrays.values()}
        if not self.description or len(shapes) != 1 or len(shape := shapes.pop()) != 4 or 0 in shape:
            raise InputError(f"{path}: is no plate of xfrustum, or damaged; draw it with `xfrustum plate`")
        plate = Plate(size=(1.0, 1.0), hogels=(shape[1], shape[0]))
        side = side_of(self.description[LAYOUT], plate) if LAYOUT in self.description else (1, 1)
        if side is None:
            raise InputError(f"{path}: its description is damaged; draw the plate again")
        self._grid = BlockGrid(plate=plate, side=side)
        self._file = lru_cache(KEPT_FILES)(self._read_file)

    def finished(self, aperture: Aperture) -> bool:
        """Return whether a hogel is there and, as far as the layout of its files tells, whole."""
        block = self._grid.block(self._grid.block_of(aperture))
        place = block.place_of(aperture)
        return all(place in self._file(name, block.place).places for name in self.arrays)

    def _read_file(self, name: str, place: tuple[int, int]) -> BlockFile:
        array = self.arrays[name]
        inner = array.shape[2:]
        path = self.path / name / "c" / Path(*map(str, (*place, *(0 for _ in inner))))
        content_bytes = array.dtype.itemsize
        for count in inner:
            content_bytes *= count
        return read_places(path, self._grid.hogels_in_block, content_bytes)
