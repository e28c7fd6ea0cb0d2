"""Error bounds of numbers in OpenEXR files, by pixel type and lossy compression."""

from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from xfrustum.scenes.arrays import Floats

_DWA = (OpenEXR.DWAA_COMPRESSION, OpenEXR.DWAB_COMPRESSION)
_B44 = (OpenEXR.B44_COMPRESSION, OpenEXR.B44A_COMPRESSION)
#: last letters of channels that DWA changes; it keeps every bit of all others
_DWA_CHANNELS = frozenset({"R", "G", "B", "Y", "RY", "BY"})
#: rounding to half precision: relative error, and absolute error of subnormal numbers
HALF_ROUNDING, HALF_SUBNORMAL = 2.0**-11, 2.0**-25
#: relative error; PXR24 keeps 15 of the 23 bits of a fraction
PXR24_ROUNDING = 2.0**-16
#: level of files that state none
DWA_LEVEL = 45.0
DWA_TABLE_NORM = 53.668
"""Norm of JPEG's luminance table over its least entry, 10.

DWA allows the coefficient k of an 8 x 8 block an error of level / 100,000 times table_k / 10.
"""


def lossy(name: str, kind: np.dtype[Any], compression: Any) -> str | None:
    """Return the name of a compression that changes a channel of some type, else None."""
    if compression in _DWA:
        changed = name.rpartition(".")[2].upper() in _DWA_CHANNELS and kind != np.uint32
    else:
        changed = compression in _B44 and kind == np.float16
    return str(compression.name).removesuffix("_COMPRESSION") if changed else None


def largest_whole(kind: np.dtype[Any], compression: Any) -> int:
    """Return the largest number up to which a channel holds all whole numbers."""
    if kind == np.float16:
        return 1 << 11
    if kind == np.float32:
        return 1 << (16 if compression == OpenEXR.PXR24_COMPRESSION else 24)
    return int(np.iinfo(np.uint32).max)


def uncertainty(
    values: NDArray[Any], name: str, compression: Any, level: float | None
) -> Floats | None:
    """Return the error bounds of a channel's values; None where they are exact in float32.

    B44 has no useful bound, and is refused for positions.
    """
    if lossy(name, values.dtype, compression) is not None:
        assert compression in _DWA
        return _dwa(values.astype(np.float64), DWA_LEVEL if level is None else level)
    if values.dtype == np.float16:
        return np.asarray(HALF_ROUNDING * np.abs(values.astype(np.float64)) + HALF_SUBNORMAL)
    if values.dtype == np.float32 and compression == OpenEXR.PXR24_COMPRESSION:
        return np.asarray(PXR24_ROUNDING * np.abs(values.astype(np.float64)))
    return None


def _dwa(values: Floats, level: float) -> Floats:
    """Return the error bounds of values compressed by DWA.

    DWA rounds a value to half precision and takes a curve v of it, the power 1 / 2.2 up to 1 and a
    logarithm beyond. It rounds the coefficients of the cosine transform of 8 x 8 values v, whose
    basis is orthonormal: at each pixel the squares of its functions add up to 1. Errors e_k of the
    coefficients thus change v by at most the square root of the sum of e_k^2. Coefficients are
    rounded to half precision, which changes v by 2^-11 of their norm, at most 8 max |v|; v itself
    is rounded twice.
    """
    magnitude = np.where(np.isfinite(values), np.abs(values), 0.0)
    curve = np.where(
        magnitude <= 1, magnitude ** (1 / 2.2), np.log(np.maximum(magnitude, 1)) / 2.2 + 1
    )
    error = level / 100_000 * DWA_TABLE_NORM + (8 + 2) * HALF_ROUNDING * curve.max(initial=0.0)

    def value(curve: Floats) -> Floats:
        size = np.abs(curve)
        return np.asarray(np.sign(curve) * np.where(size <= 1, size**2.2, np.exp(2.2 * (size - 1))))

    off = np.maximum(value(curve + error) - magnitude, magnitude - value(curve - error))
    # Rounding to half precision at both ends.
    return np.asarray(off + 2 * (HALF_ROUNDING * magnitude + HALF_SUBNORMAL))
