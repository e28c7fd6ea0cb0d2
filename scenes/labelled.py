"""Images as labelled arrays of xarray."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.errors import InputError

if TYPE_CHECKING:
    import xarray

SCENE_UNITS = "scene units"  #: unit of lengths of images whose scene is not at hand
NO_UNIT = "1"  #: unit of quantities without dimension, as in stored plates


@dataclass(frozen=True)
class Labelled:
    """One array of an image, (H, W) or (H, W, 3), row 0 at the top, or one value; None for none."""

    values: NDArray[Any] | float | None
    meaning: str  #: in words
    units: str | None = None  #: None of numbers and classes
    last: str = "rgb"  #: name of the third dimension

    @property
    def variable(self) -> tuple[tuple[str, ...], NDArray[Any], dict[str, str]]:
        """Dimensions, values and attributes, as xarray takes them."""
        values = np.asarray(self.values)
        units = {} if self.units is None else {"units": self.units}
        return ("v", "u", self.last)[: values.ndim], values, {"long_name": self.meaning, **units}


def dataset(
    images: Mapping[str, Labelled | None],
    places: Mapping[str, Labelled],
    attributes: Mapping[str, object],
) -> xarray.Dataset:
    """Return arrays of an image as a dataset, with names, units and signs of stored plates.

    Pixels have the dimensions v and u, as in the groups that `plate` writes (CONVENTIONS.md,
    "Plates"). The first of `images` is (H, W); `places` are coordinates of the whole image,
    `attributes` its facts. None is left out. Raises InputError where xarray is not installed.
    """
    try:
        import xarray  # noqa: PLC0415 - it takes a second to load
    except ImportError as error:
        raise InputError(
            "labelled arrays need the package xarray, which is not installed: "
            "pip install '.[notebook]' in the checkout of xfrustum"
        ) from error
    known = {
        name: image.variable
        for name, image in images.items()
        if image is not None and image.values is not None
    }
    height, width = next(iter(known.values()))[1].shape[:2]
    u, v = (2 * np.arange(width) + 1) / width - 1, 1 - (2 * np.arange(height) + 1) / height
    film = {
        name: (
            name,
            values,
            {"long_name": f"film coordinate of the pixel's center, {way}", "units": NO_UNIT},
        )
        for name, values, way in (("u", u, "to the right"), ("v", v, "upward"))
    }
    return xarray.Dataset(
        known,
        coords={**film, **{name: place.variable for name, place in places.items()}},
        attrs={name: value for name, value in attributes.items() if value is not None},
    )
