"""Bands of rows, which bound the memory of an image, and arrays for kernels to read in place."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

#: Pixels of a band of an image that is written band by band, `PIXEL_BYTES` each
BAND_PIXELS = 1 << 19

#: approximate memory for each pixel of a band in progress, bytes
PIXEL_BYTES = 400

#: Pixels of a band of an image that is kept whole: joining smaller bands would cost more time. A
#: band adds some 80 bytes a pixel to the image's own 70.
WHOLE_PIXELS = 1 << 22


def bands(width: int, rows: range, pixels: int = BAND_PIXELS) -> Iterator[range]:
    """Yield rows of an image in order, in bands of at most `pixels` pixels or one row."""
    size = max(1, pixels // width)
    for start in range(rows.start, rows.stop, size):
        yield range(start, min(start + size, rows.stop))


#: Number of values that kernels may read beyond the end of an array: they load vectors of up to 16
#: lanes and gather bytes four at a time, and NumPy arrays have no padding
PADDING = 64

#: Alignment of arrays, bytes: Dr.Jit compiles a kernel for each mix of alignments
ALIGNMENT = 64


def padded(values: NDArray[Any], kind: DTypeLike) -> NDArray[Any]:
    """Return a flat, aligned copy of values with `PADDING` behind it, for kernels to read."""
    dtype = np.dtype(kind)
    size = values.size * dtype.itemsize
    memory = np.empty(size + PADDING * dtype.itemsize + ALIGNMENT, dtype=np.uint8)
    start = -memory.ctypes.data % ALIGNMENT
    copy = memory[start : start + size].view(dtype)
    np.copyto(copy.reshape(values.shape), values, casting="unsafe")
    return copy
