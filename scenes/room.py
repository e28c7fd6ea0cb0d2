"""Arrays with room behind their end: the ray tracers' kernels read them in whole packets, without a copy.

A kernel works on packets of lanes, and loads a whole packet where the last lanes have no values any more. See
`xfrustum.reference.devices.packets`, which copies arrays that have no such room. Vectors lie coordinate by
coordinate where kernels read them. In whatever order they lie, `picked` takes some without a copy of all.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

MAX_PACKET_LANES = 64
"""Largest number of lanes of a packet that there is room for. Dr.Jit 1.5 has 16 where a processor has
AVX-512, and fewer elsewhere. There is room for one more packet behind the last: Dr.Jit gathers single bytes
four at a time, and Embree reads 16 bytes where the last corner of a mesh has 12."""

ALIGNMENT_BYTES = 64
"""Alignment of arrays with room. Dr.Jit compiles a kernel anew for every mix of arrays that have it and
arrays that do not."""


def values_with_room(count: int) -> int:
    """Return how many values memory must hold so that there is room behind the first `count` of them."""
    return (-(-count // MAX_PACKET_LANES) + 1) * MAX_PACKET_LANES


def with_room(shape: tuple[int, ...], kind: DTypeLike) -> NDArray[Any]:
    """Return an array, not initialized, with room behind its end; the room holds zeros."""
    dtype, count = np.dtype(kind), math.prod(shape)
    memory = np.empty(values_with_room(count) * dtype.itemsize + ALIGNMENT_BYTES, dtype=np.uint8)
    start = -memory.ctypes.data % ALIGNMENT_BYTES
    values = memory[start : start + values_with_room(count) * dtype.itemsize].view(dtype)
    values[count:] = 0
    return values[:count].reshape(shape)


def vectors_with_room(shape: tuple[int, int], kind: DTypeLike) -> NDArray[Any]:
    """Return vectors (H, W, 3), not initialized, coordinate by coordinate, each with room behind its end.

    Formulas ask for one coordinate of all pixels at a time. Where these lie side by side, kernels and NumPy
    read them in whole packets; from every third place they have to be gathered.
    """
    count = math.prod(shape)
    coordinates = with_room((3, values_with_room(count)), kind)
    coordinates[:, count:] = 0
    return np.moveaxis(coordinates[:, :count].reshape(3, *shape), 0, -1)


def lie_by_coordinate(rows: NDArray[Any]) -> bool:
    """Return whether the vectors (N, C) lie in memory coordinate by coordinate, not one after the other."""
    return rows.ndim == 2 and rows.shape[1] > 1 and rows.strides[0] == rows.itemsize


def picked(rows: NDArray[Any], places: NDArray[np.integer[Any]]) -> NDArray[Any]:
    """Return the rows (N,) or (N, C) at some places (M,), which lie in memory as all of them do."""
    if lie_by_coordinate(rows):
        # NumPy's `take` would copy all rows first.
        return np.stack([coordinate.take(places) for coordinate in rows.T]).T
    return rows.take(places, axis=0)


def has_room(values: NDArray[Any]) -> bool:
    """Return whether an array is contiguous, aligned, and has room behind its end.

    The memory behind it must belong to the array of which it is a part.
    """
    if not values.flags.c_contiguous or values.ctypes.data % ALIGNMENT_BYTES:
        return False
    whole = values
    while isinstance(whole.base, np.ndarray):
        whole = whole.base
    # Memory of an array that is not contiguous does not end where its bytes are counted.
    if not whole.flags.c_contiguous:
        return False
    end = values.ctypes.data + values_with_room(values.size) * values.itemsize
    return end <= whole.ctypes.data + whole.nbytes
