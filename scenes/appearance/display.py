"""Radiance for display in pages and notebooks: clipped to 0..1, sRGB, 8 bits."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.arrays import Floats

LEVELS = 255  #: largest value of an 8-bit channel
Kind = TypeVar("Kind", bound=np.floating)


def encoding_curve(linear: NDArray[Kind]) -> NDArray[Kind]:
    """Return sRGB values of linear values from 0 to 1, in their precision (IEC 61966-2-1)."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def decoding_curve(shown: NDArray[Kind]) -> NDArray[Kind]:
    """Return linear values of sRGB values from 0 to 1, in their precision (IEC 61966-2-1)."""
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
