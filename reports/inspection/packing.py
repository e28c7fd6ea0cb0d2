"""Channels as deflated bytes, without loss, which a browser turns into typed arrays again.

Neighboring pixels show neighboring points, and their floats share sign, exponent and the first bits of the
mantissa. So the bits of each value are replaced by their difference from those of the value before, modulo
2^32, and the four bytes of all values are stored apart, the highest of all values first; what then repeats,
deflate finds. The script `inspect.js` does the reverse.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

TYPES: dict[str, type[np.generic]] = {"float32": np.float32, "uint32": np.uint32, "uint8": np.uint8}
"""Types of channels by their names on a page."""

DEFLATE_LEVEL = 6
"""Effort of deflating: 9 saves a hundredth more, and takes several times as long."""


def packed(arrays: Iterable[NDArray[Any]]) -> bytes:
    """Return arrays of the types in `TYPES`, one after the other, as one zlib stream.

    Raises
    ------
    TypeError
        An array has another type.
    """
    deflate = zlib.compressobj(DEFLATE_LEVEL)
    parts = [deflate.compress(_filtered(array)) for array in arrays]
    return b"".join([*parts, deflate.flush()])


def unpacked(stream: bytes, kinds: Sequence[str], size: tuple[int, int]) -> list[NDArray[Any]]:
    """Return the arrays of a stream.

    Parameters
    ----------
    stream
        Bytes that `packed` has returned.
    kinds
        Name of each array's type.
    size
        Width and height.
    """
    content, place, arrays = zlib.decompress(stream), 0, []
    count = math.prod(size)
    for kind in kinds:
        length = count * np.dtype(TYPES[kind]).itemsize
        arrays.append(_restored(content[place : place + length], kind).reshape(size[::-1]))
        place += length
    if place != len(content):
        raise ValueError(
            f"{len(content)} bytes are not {len(kinds)} channels of {size[0]} x {size[1]} pixels"
        )
    return arrays


def _filtered(array: NDArray[Any]) -> bytes:
    flat = np.ascontiguousarray(array).reshape(-1)
    if flat.dtype == np.uint8:
        return flat.tobytes()
    if flat.dtype not in (np.float32, np.uint32):
        raise TypeError(f"a channel of {flat.dtype} cannot be packed")
    bits = flat.view(np.uint32)
    steps = np.diff(bits, prepend=np.uint32(0))
    # Little-endian on every machine: byte 3 is the highest.
    planes = steps.astype("<u4", copy=False).view(np.uint8).reshape(-1, 4)
    return planes[:, ::-1].T.tobytes()


def _restored(content: bytes, kind: str) -> NDArray[Any]:
    stored = np.frombuffer(content, dtype=np.uint8)
    if kind == "uint8":
        return stored
    steps = np.ascontiguousarray(stored.reshape(4, -1)[::-1].T).view("<u4").reshape(-1)
    return np.cumsum(steps, dtype=np.uint32).view(TYPES[kind])
