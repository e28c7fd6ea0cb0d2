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

from xfrustum.scenes.room import has_room, with_room


def in_packets(values: NDArray[Any], kind: DTypeLike | None = None) -> NDArray[Any]:
    """Return values as a flat array (N,) that kernels may load in whole packets.

    It is a copy, unless the values have room behind their end already. Where they are not copied, they must
    not change as long as a kernel may read them, and no kernel may write them.

    Parameters
    ----------
    values
        N values in any shape.
    kind
        Type of the array; None for that of the values. Values must fit into it.
    """
    dtype = np.dtype(values.dtype if kind is None else kind)
    if values.dtype == dtype and has_room(values):
        return values.reshape(-1)
    copy = with_room(values.shape, dtype)
    np.copyto(copy, values, casting="unsafe")
    return copy.reshape(-1)
