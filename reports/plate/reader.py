"""Reading of plates that `xfrustum plate` has drawn: nothing that the files declare is trusted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from pydantic import TypeAdapter, ValidationError

from xfrustum.reference.lines.lines import film_window
from xfrustum.reports.plate.arrays import (
    ATTRIBUTE,
    DAMAGE,
    FINISHED,
    PlateArrays,
    description_of,
    open_group,
    reason_of,
    require_arrays,
    shard_file,
)
from xfrustum.reports.plate.store import SOURCE
from xfrustum.scenes import DoubleFrustum, Frustum, HogelCamera, InputError
from xfrustum.scenes.model.plate_content import Channel, ColorType, PlateContent
from xfrustum.scenes.plate.plate import Aperture, Plate


def _arrays_described(
    place: Path, group: zarr.Group, description: Mapping[str, Any]
) -> PlateArrays:
    """Return the arrays that a description implies; InputError where it is damaged.

    The measures are those that the group has, for the scene's look decides which there are.
    """
    try:
        content = description["content"]
        channels = tuple(map(Channel, content.get("channels", ())))
        arrays = PlateArrays(
            plate=TypeAdapter(Plate).validate_python(description["plate"]),
            frustum=TypeAdapter(Frustum).validate_python(description["frustum"]),
            units=str(description["scene"]["units"]),
            content=PlateContent(
                color=ColorType(content["color"]), ids=content["ids"], channels=channels
            ),
            side=(1, 1),
        )
        # Measures of verdicts are the remaining arrays, whose names depend on the comparison.
        others = {*(name for name, *_ in arrays.coordinates()), *Channel, FINISHED}
        measures = sorted(set(group.array_keys()) - others) if content.get("judged") else ()
        units = tuple((name, str(group[name].attrs.get("units", ""))) for name in measures)
    except (*DAMAGE, ValidationError, InputError) as error:
        raise InputError(
            f"{place}: the description of the plate is damaged; draw it again"
        ) from error
    return replace(arrays, measures=units)


def checked_group(place: Path) -> zarr.Group:
    """Open a Zarr group; InputError where a drawn plate differs from its own description.

    Groups of other programs, which have no description, are returned unchecked.
    """
    group = open_group(place)
    description = group.attrs.get(ATTRIBUTE)
    if isinstance(description, dict):
        # A changed array would yield plausible pixels of another plate.
        require_arrays(place, _arrays_described(place, group, description))
    return group


class PlateReader:
    """Hogels of a stored plate."""

    def __init__(self, path: Path) -> None:
        group = checked_group(path)
        description = group.attrs.get(ATTRIBUTE)
        if not isinstance(description, dict):
            raise InputError(f"{path}: is no plate of xfrustum; draw it with `xfrustum plate`")
        self.path = path
        #: everything that decides the pixels
        self.description: Mapping[str, Any] = description
        #: Images by name, (rows, columns, H, W) or (rows, columns, H, W, 3).
        self.arrays: dict[str, Any] = {name: group[name] for name in Channel if name in group}
        self._finished: Any = group[FINISHED]

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
    """Return an image of a hogel; InputError where its file is damaged, or gone and must exist."""
    reason = "its file is gone"
    # Zarr returns the fill value for a missing shard, which equals a black hogel.
    if not must_exist or shard_file(place, array, column, row).is_file():
        try:
            return np.asarray(array[row, column])
        except DAMAGE as error:
            reason = reason_of(error)
    raise InputError(
        f"{place}: hogel {column},{row} is damaged ({reason}); `xfrustum plate --check` draws it "
        "again"
    )


def camera_of(store: Any, column: int, row: int) -> HogelCamera:
    """Return the crossed frustum of a hogel of a plate, in full double precision.

    The line of film coordinates u, v is (x, y, 0) + s (kx + u tx, ky + v ty, -1), with the aperture
    x, y, the shear k and the half-extent t. It has the settings that the plate was drawn with. The
    store is a folder, or the plate as `zarr.open_group` or `xarray.open_zarr` opens it.

    InputError where there is no plate, or no such hogel on it.
    """
    in_folder = isinstance(store, str | Path)
    description = description_of(Path(store)) if in_folder else store.attrs.get(ATTRIBUTE)
    name = store if in_folder else "the store"
    if not isinstance(description, Mapping):
        raise InputError(
            f"{name}: is no plate of xfrustum; give one that `xfrustum plate` has made"
        )
    try:
        plate = TypeAdapter(Plate).validate_python(description["plate"])
        frustum = TypeAdapter(Frustum).validate_python(description["frustum"])
        settings = TypeAdapter(DoubleFrustum | None).validate_python(description.get("settings"))
        scene, device = description["scene"], str(description["renderer"]["device"])
        source, scene_hash = str(scene[SOURCE]), str(scene["hash"])
    except (KeyError, TypeError, ValidationError, InputError) as error:
        raise InputError(
            f"{name}: the description of the plate is damaged; draw it again"
        ) from error
    aperture = plate.aperture(column, row)
    shear, half_extent = film_window(frustum, aperture)
    return HogelCamera(
        aperture=aperture,
        resolution=frustum.resolution,
        shear=shear,
        half_extent=half_extent,
        reach=frustum.reach,
        scene=source,
        scene_hash=scene_hash,
        renderer=device,
        settings=settings,
    )
