"""Values for display: short strings for numbers, short `repr`, labelled arrays, and sRGB colors.

Radiance is clipped to 0..1 and rounded to 8 bits for pages and notebooks.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Floats

if TYPE_CHECKING:
    import xarray


def digits(value: float) -> str:
    """Write a number with three digits, such as `0.0474`; thousands in full: `7,470`."""
    written = f"{value:.3g}"
    return f"{float(written):,.0f}" if 1e3 <= abs(value) < 1e9 else plain(written)


def percent(fraction: float) -> str:
    """Write a fraction as percent with two digits, such as `0.012 %`; `100 %` has three."""
    return plain(f"{100 * fraction:.0f} %" if fraction >= 0.1 else f"{100 * fraction:.2g} %")


def percent_up(share: float) -> str:
    """Write an upper bound in percent, rounded up to two digits."""
    if share <= 0 or share >= 1:
        return f"{100 * share:.0f} %"
    step = 10.0 ** (math.floor(math.log10(100 * share)) - 1)
    # Without this margin, rounding errors would raise a share that has exactly two digits.
    return f"{min(math.ceil(100 * share / step - 1e-9) * step, 100.0):.3g} %"


def sides(lengths: Iterable[float]) -> str:
    """Write lengths or counts of sides, such as `60 x 40`."""
    return " x ".join(f"{length:,.6g}" for length in lengths)


def counted(number: int, name: str) -> str:
    """Write a number with its noun, such as `1 object` or `2,000 triangles`."""
    return f"{number:,} {name if number == 1 else name + 's'}"


def plain(text: str) -> str:
    """Remove the leading zero of small exponents in Python's notation."""
    return re.sub(r"e([+-])0(\d)", r"e\1\2", text).replace("e+", "e")


LONGEST_PART = 100  #: largest number of characters of a nested record in a representation


class ShortRepr:
    """Dataclass whose `repr` shows its fields, with only the type of arrays and large parts."""

    def __repr__(self) -> str:
        names = [part.name for part in fields(self)]  # type: ignore[arg-type]
        named = (f"{name}={_kind(getattr(self, name))}" for name in names)
        return f"{type(self).__name__}({', '.join(named)})"


def _kind(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape}"
    if isinstance(value, tuple | list) and len(value) > 0:
        return f"{len(value)} of {type(value[0]).__name__}"
    if value is None or isinstance(value, bool | int | float | str):
        return repr(value)
    if is_dataclass(value) and len(text := repr(value)) <= LONGEST_PART:
        return text
    return f"<{type(value).__name__}>"


# Labelled arrays of xarray
# -------------------------------------------------------------------------------------------------

SCENE_UNITS = "scene units"  #: unit name for lengths if the scene's unit is not available
NO_UNIT = "1"  #: unit of quantities without dimension, as in stored plates


@dataclass(frozen=True)
class Labelled:
    """Array of an image, (H, W) or (H, W, 3), row 0 at the top, or one value; None if missing."""

    values: NDArray[Any] | float | None
    meaning: str  #: description, one phrase
    units: str | None = None  #: unit; None for numbers and classes
    last: str = "rgb"  #: name of the third dimension

    @property
    def variable(self) -> tuple[tuple[str, ...], NDArray[Any], dict[str, str]]:
        """Dimensions, values and attributes, in the form for xarray."""
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
    `attributes` are its properties. Values of None are left out. Raises InputError if xarray is not
    installed.
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


LEVELS = 255  #: largest value of an 8-bit channel
Kind = TypeVar("Kind", bound=np.floating)


def encoding_curve(linear: NDArray[Kind]) -> NDArray[Kind]:
    """Return sRGB values of linear values from 0 to 1, in the same precision (IEC 61966-2-1)."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def decoding_curve(shown: NDArray[Kind]) -> NDArray[Kind]:
    """Return linear values of sRGB values from 0 to 1, in the same precision (IEC 61966-2-1)."""
    return np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)


def encoded(radiance: NDArray[np.floating]) -> Floats:
    """Return sRGB values of linear radiance clipped to 0..1; NaN becomes black."""
    return encoding_curve(
        np.clip(np.nan_to_num(np.asarray(radiance, dtype=np.float64), posinf=1.0), 0.0, 1.0)
    )


def decoded(shown: NDArray[np.floating]) -> Floats:
    """Return the linear radiance of sRGB values from 0 to 1."""
    return decoding_curve(np.asarray(shown, dtype=np.float64))


def through_8_bits(radiance: NDArray[np.floating]) -> Floats:
    """Return linear radiance after rounding to 8-bit sRGB."""
    return decoded(np.rint(LEVELS * encoded(radiance)) / LEVELS)
