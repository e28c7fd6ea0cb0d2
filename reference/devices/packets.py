"""Memory that kernels may read in whole packets of lanes.

Dr.Jit reads NumPy's memory in place. A kernel whose lanes load an array loads whole packets, and the last one
reaches beyond the end of the array unless the array is a whole number of packets long. Dr.Jit gives its own
arrays this room; NumPy does not. Where there is no memory behind the array, the read ends the process by a
segmentation fault. Gathers do not avoid it: Dr.Jit makes a load of a gather by the lanes' own numbers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

MAX_PACKET_LANES = 64
"""Largest number of lanes of a packet that there is room for. Dr.Jit 1.5 has 16 where a processor has
AVX-512, and fewer elsewhere. There is room for one more packet behind the last: Dr.Jit gathers single bytes
four at a time, and Embree reads 16 bytes where the last corner of a mesh has 12."""

ALIGNMENT_BYTES = 64
"""Alignment of the copies. Dr.Jit compiles a kernel anew for every mix of arrays that have it and arrays that
do not."""


def in_packets(values: NDArray[Any], kind: DTypeLike | None = None) -> NDArray[Any]:
    """Return a flat copy (N,) that kernels may load in whole packets; zeros are behind its end.

    Parameters
    ----------
    values
        N values in any shape.
    kind
        Type of the copy; None for that of the values. Values must fit into it.
    """
    dtype = np.dtype(values.dtype if kind is None else kind)
    packets_of_values = -(-values.size // MAX_PACKET_LANES)
    room = (packets_of_values + 1) * MAX_PACKET_LANES * dtype.itemsize
    memory = np.empty(room + ALIGNMENT_BYTES, dtype=np.uint8)
    start = -memory.ctypes.data % ALIGNMENT_BYTES
    packets = memory[start : start + room].view(dtype)
    copy = packets[: values.size]
    np.copyto(copy.reshape(values.shape), values, casting="unsafe")
    packets[values.size :] = 0
    return copy
