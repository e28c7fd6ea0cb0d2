"""Images as labelled arrays of xarray, with the names, units and signs of stored plates.

Pixels have the dimensions v and u, as in the groups that `plate` writes (CONVENTIONS.md, "Plates"): so an
image and a hogel of a stored plate are subtracted from each other as they are. xarray is loaded when the
first image is labelled.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.errors import InputError

if TYPE_CHECKING:
    import xarray

SCENE_UNITS = "scene units"
"""Unit of lengths where nobody says what a scene's own unit is."""

NO_UNIT = "1"
"""Unit of what has none, as in stored plates."""

FILM = {
    "u": "film coordinate of the pixel's center, to the right",
    "v": "film coordinate of the pixel's center, upward",
}
"""Meanings of both coordinates of pixels."""


@dataclass(frozen=True, kw_only=True)
class Labelled:
    """One array of an image.

    Attributes
    ----------
    values
        (H, W) or (H, W, 3), row 0 at the top; or a single value that belongs to the whole image.
    meaning
        What it is, in words.
    units
        Unit; None of numbers and classes.
    last
        Name of the third dimension.
    """

    values: NDArray[Any] | float
    meaning: str
    units: str | None = None
    last: str = "rgb"

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
    """Return arrays of an image as a dataset whose coordinates u and v are those of the pixels' centers.

    Parameters
    ----------
    images
        Arrays by name, the first of which is (H, W); None is left out.
    places
        Further coordinates by name, values that belong to the whole image.
    attributes
        Facts of the image; None is left out.

    Raises
    ------
    InputError
        xarray is not installed.
    """
    try:
        import xarray  # noqa: PLC0415 - it takes a second to load
    except ImportError as error:
        raise InputError(
            "labelled arrays need the package xarray, which is not installed: "
            "pip install '.[notebook]' in the checkout of xfrustum"
        ) from error
    known = {name: one.variable for name, one in images.items() if one is not None}
    height, width = next(iter(known.values()))[1].shape[:2]
    u, v = (2 * np.arange(width) + 1) / width - 1, 1 - (2 * np.arange(height) + 1) / height
    film = {
        name: (name, values, {"long_name": FILM[name], "units": NO_UNIT})
        for name, values in (("u", u), ("v", v))
    }
    return xarray.Dataset(
        known,
        coords={**film, **{name: one.variable for name, one in places.items()}},
        attrs={name: value for name, value in attributes.items() if value is not None},
    )
