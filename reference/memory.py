"""Memory: bands of rows, which bound what an image takes, and arrays that kernels may read in place."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

BAND_PIXELS = 1 << 19
"""Pixels of a band of an image that is written band by band, `PIXEL_BYTES` each: of any size at all."""

PIXEL_BYTES = 400  #: approximate memory for each pixel of a band that is being made

WHOLE_PIXELS = 1 << 22
"""Pixels of a band of an image that is kept whole: to join smaller bands would take longer than to make them.
A band adds some 80 bytes a pixel to the image's own 70."""


def bands(width: int, rows: range, pixels: int = BAND_PIXELS) -> Iterator[range]:
    """Yield rows of an image in order, in bands of at most so many pixels unless a row has more."""
    size = max(1, pixels // width)
    for start in range(rows.start, rows.stop, size):
        yield range(start, min(start + size, rows.stop))


PADDING = 64
"""Values behind the end of an array that kernels may read. They load whole vectors of up to 16 lanes, and
gather single bytes four at a time; NumPy's arrays end where their last value does."""

ALIGNMENT = 64
"""Alignment of arrays in bytes: Dr.Jit compiles a kernel anew for every mix of arrays with and without it."""


def padded(values: NDArray[Any], kind: DTypeLike) -> NDArray[Any]:
    """Return a flat, aligned copy of values with `PADDING` behind it, which kernels may read in place."""
    dtype = np.dtype(kind)
    size = values.size * dtype.itemsize
    memory = np.empty(size + PADDING * dtype.itemsize + ALIGNMENT, dtype=np.uint8)
    start = -memory.ctypes.data % ALIGNMENT
    copy = memory[start : start + size].view(dtype)
    np.copyto(copy.reshape(values.shape), values, casting="unsafe")
    return copy
