"""Plates that `xfrustum plate` has drawn, for readers, who believe nothing that the files declare unchecked.

Zarr reads a chunk whose file is gone as the fill value, so that a plate without the file `x/c/0`
has all of its hogels at x = 0. A plate's description decides all its arrays and their labels: they
are compared with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from pydantic import TypeAdapter, ValidationError

from xfrustum.reports.plate.store import (
    ATTRIBUTE,
    DAMAGE,
    FINISHED,
    Layout,
    has_shard,
    open_group,
    require_described,
)
from xfrustum.scenes import Frustum, InputError
from xfrustum.scenes.model.plate_content import Channel, ColorType, PlateContent
from xfrustum.scenes.plate.plate import Aperture, Plate

IMAGES = (*Channel, FINISHED)


def layout_described(place: Path, group: zarr.Group, said: Mapping[str, Any]) -> Layout:
    """Return the layout that a plate's description implies; InputError where that is damaged.

    Measures of hogels are those that the group has: which ones there are depends on the scene's
    look.
    """
    try:
        content = said["content"]
        channels = tuple(map(Channel, content.get("channels", ())))
        wanted = PlateContent(
            color=ColorType(content["color"]), ids=content["ids"], channels=channels
        )
        layout = Layout(
            plate=TypeAdapter(Plate).validate_python(said["plate"]),
            frustum=TypeAdapter(Frustum).validate_python(said["frustum"]),
            units=str(said["scene"]["units"]),
            content=wanted,
            side=(1, 1),
        )
        labels = {name for name, *_ in layout.coordinates()}
        named = sorted(set(group.array_keys()) - {*labels, *IMAGES})
        measures = tuple((name, str(group[name].attrs.get("units", ""))) for name in named)
    except (*DAMAGE, ValidationError, InputError) as error:
        raise InputError(
            f"{place}: the description of the plate is damaged; draw it again"
        ) from error
    return replace(layout, measures=measures if content.get("judged") else ())


def checked_group(place: Path) -> zarr.Group:
    """Open a Zarr group; InputError where it is none, or a drawn plate whose arrays are not as it describes.

    Groups of others, which have no description, are returned unchecked.
    """
    group = open_group(place)
    said = group.attrs.get(ATTRIBUTE)
    if isinstance(said, dict):
        require_described(place, layout_described(place, group, said))
    return group


class StoredPlate:
    """The hogels of a Zarr group that `xfrustum plate` has made, for those who read it.

    `description` is everything that decides the pixels, as the group says it; `arrays` are those of
    images by name, (rows, columns, H, W) or (rows, columns, H, W, 3).
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        group = checked_group(path)
        try:
            said, found = group.attrs.get(ATTRIBUTE), {name: group.get(name) for name in IMAGES}
        except DAMAGE as error:
            raise InputError(f"{path}: its description is damaged; draw the plate again") from error
        self.description: Mapping[str, Any] = said if isinstance(said, dict) else {}
        finished = found.pop(FINISHED)
        self.arrays = {
            name: array for name, array in found.items() if isinstance(array, zarr.Array)
        }
        shapes = {array.shape[:4] for array in self.arrays.values()}
        shape = next(iter(shapes), ())
        if not self.description or len(shapes) != 1 or len(shape) != 4 or 0 in shape:
            raise InputError(
                f"{path}: is no plate of xfrustum, or damaged; draw it with `xfrustum plate`"
            )
        # Plates of version 0.2 do not say which hogels are there: all are taken for finished.
        self._finished: Any = np.ones(shape[:2], np.uint8)
        if isinstance(finished, zarr.Array) and finished.shape == shape[:2]:
            self._finished = finished

    def finished(self, aperture: Aperture) -> bool:
        """Return whether a hogel is there."""
        try:
            return bool(self._finished[aperture.row, aperture.column])
        except DAMAGE as error:
            raise InputError(
                f"{self.path}: array {FINISHED} is damaged; draw the plate again"
            ) from error

    def image(self, name: str, column: int, row: int) -> Any:
        """Return an image of a finished hogel; InputError where its file is damaged or gone."""
        return read_hogel(self.path, self.arrays[name], column, row)


def read_hogel(
    place: Path, array: zarr.Array[Any], column: int, row: int, *, must_exist: bool = True
) -> Any:
    """Return an image of a hogel; InputError where its file is damaged, or gone although it must exist."""
    reason = "its file is gone"
    if not must_exist or has_shard(place, array, column, row):
        try:
            return np.asarray(array[row, column])
        except DAMAGE as error:
            reason = " ".join(str(error).split())[:200]
    raise InputError(
        f"{place}: hogel {column},{row} is damaged ({reason}); `xfrustum plate --check` draws it again"
    )
