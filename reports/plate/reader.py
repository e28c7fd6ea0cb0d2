"""Reading of plates that `xfrustum plate` has drawn, with checks of all stored metadata."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from pydantic import PositiveInt, TypeAdapter, ValidationError

from xfrustum.compare.rounding.directions import DirectionPlate
from xfrustum.reference.lines import film_window
from xfrustum.reports.plate.arrays import (
    ATTRIBUTE,
    DAMAGE,
    FINISHED,
    PlateArrays,
    open_group,
    reason_of,
    require_arrays,
    shard_files,
)
from xfrustum.scenes import NOTHING, DoubleFrustum, Frustum, HogelCamera, InputError
from xfrustum.scenes.arrays import Numbers
from xfrustum.scenes.model.images import Channel, PlateContent
from xfrustum.scenes.plate import Aperture, DepthFormat, Plate, PlateTile

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
    """Yield columns in increasing order, each with its image in a row; see `read_hogel`.

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
