"""The camera of any hogel of a plate, from the attributes that its store has."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from pydantic import TypeAdapter, ValidationError

from xfrustum.reference.lines.lines import film_window
from xfrustum.reports.plate.store import ATTRIBUTE, METADATA
from xfrustum.scenes.disk.input_files import read_small
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.hogel_image import HogelCamera
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Plate

LARGEST_DESCRIPTION = 1 << 24
"""Largest description of a store that is read, in bytes."""


@runtime_checkable
class Attributed(Protocol):
    """Anything that has the attributes of a store: a group of Zarr, a dataset of xarray."""

    @property
    def attrs(self) -> Mapping[str, Any]:
        """Attributes by name."""


def camera_of(store: Path | str | Attributed, column: int, row: int) -> HogelCamera:
    """Return the crossed frustum of a hogel of a plate.

    Parameters
    ----------
    store
        Folder of the plate, or the plate as `zarr.open_group` or `xarray.open_zarr` opens it.
    column, row
        Place of the hogel on the plate.

    Returns
    -------
    HogelCamera
        Aperture, shear and half-extent in full double precision: the line of film coordinates u, v is
        (x, y, 0) + s (kx + u tx, ky + v ty, -1). It has the settings that the plate was drawn with.

    Raises
    ------
    InputError
        There is no plate, or no such hogel on it.
    """
    said = _attributes(store)
    name = store if isinstance(store, str | Path) else "the store"
    try:
        plate = TypeAdapter(Plate).validate_python(said["plate"])
        frustum = TypeAdapter(Frustum).validate_python(said["frustum"])
        given = said.get("settings")
        settings = None if given is None else TypeAdapter(DoubleFrustum).validate_python(given)
        scene, renderer = said["scene"], said["renderer"]
        source, scene_hash, device = (str(scene["source"]), str(scene["hash"]), str(renderer["device"]))
    except (KeyError, TypeError, ValidationError, InputError) as error:
        raise InputError(f"{name}: the description of the plate is damaged; draw it again") from error
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


def _attributes(store: Path | str | Attributed) -> Mapping[str, Any]:
    """Return what a store says of its plate."""
    if not isinstance(store, str | Path):
        found = store.attrs.get(ATTRIBUTE)
    else:
        text = read_small(Path(store) / METADATA, "description of a plate", LARGEST_DESCRIPTION)
        try:
            found = json.loads(text)["attributes"].get(ATTRIBUTE)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            found = None
    if not isinstance(found, Mapping):
        name = store if isinstance(store, str | Path) else "the store"
        raise InputError(f"{name}: is no plate of xfrustum; give one that `xfrustum plate` has made")
    return found
