"""Device of Dr.Jit's arrays, their conversion from and to NumPy, and bands that bound their memory.

The arrays are on the CPU, through LLVM, or on a CUDA GPU, according to `ARRAYS`. Kernels have the
same source on CPU and GPU and return the same bits. A CUDA driver's compiler may fuse a product and
a sum into one rounding; products of doubles that affect a decision are therefore computed by
`product` (docs/truth.md).

Vectors are sequences of coordinates. Each coordinate is an array with one lane for each point, line
or row. `drjit.dot` and `drjit.cross` fuse products with sums; `dot` and `cross` of this module
round every product and every sum, as the error bounds assume.

Importing this module raises an `InputError` if there is no compiler for kernels.
"""

import importlib
import math
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from xfrustum.reference.llvm import array_device
from xfrustum.scenes.arrays import Floats

# `array_device` must select the LLVM before the first import of Dr.Jit. All other modules therefore
# import Dr.Jit from here.
ARRAYS = array_device()

import drjit as dr  # noqa: E402

_arrays: Any = importlib.import_module(f"drjit.{ARRAYS}")
Array3f, Array4f = _arrays.Array3f, _arrays.Array4f
Array3f64, Array4f64 = _arrays.Array3f64, _arrays.Array4f64
Float32, Float64, Int32, UInt32 = _arrays.Float32, _arrays.Float64, _arrays.Int32, _arrays.UInt32
UInt64, Bool = _arrays.UInt64, _arrays.Bool

__all__ = [
    "ARRAYS",
    "Array4f",
    "Array4f64",
    "Bool",
    "Float32",
    "Float64",
    "Int32",
    "UInt32",
    "UInt64",
    "constants",
    "cross",
    "difference",
    "dot",
    "dr",
    "interleaved",
    "on_device",
    "product",
    "recording",
    "table",
    "vectors_on_device",
]

#: Coordinates of vectors: arrays with a lane for each vector, or numbers for all lanes
Vector = Sequence[Any]

#: function from indices of rows to the columns of these rows
Table = Callable[[Any], list[Any]]

_KINDS = {
    np.dtype(np.float64): Float64,
    np.dtype(np.float32): Float32,
    np.dtype(np.int32): Int32,
    np.dtype(np.uint32): UInt32,
    np.dtype(np.bool_): Bool,
}

_INT32 = np.iinfo(np.int32)

#: Addend of `product` on CUDA. It is in memory, because a literal zero would be optimized away.
_MINUS_ZERO = dr.opaque(Float64, -0.0) if ARRAYS == "cuda" else None

#: Lock for recording kernels, one at a time per process; a kernel uses all processors
_RECORDER = threading.RLock()


@contextmanager
def recording() -> Iterator[None]:
    """Record kernels in IEEE arithmetic, which no compiler rearranges: proofs depend on it."""
    with _RECORDER, dr.scoped_set_flag(dr.JitFlag.FastMath, False):
        yield


def on_device(values: NDArray[Any]) -> Any:
    """Return a copy of values of any shape as one flat array of Dr.Jit.

    Floats of other types become doubles, and integers of other types are clipped to 32 bits; the
    smallest and the largest 32-bit integer are not triangle numbers.
    """
    if values.dtype not in _KINDS:
        is_float = values.dtype.kind == "f"
        values = values.astype(np.float64) if is_float else np.clip(values, _INT32.min, _INT32.max)
    kind = values.dtype if values.dtype in _KINDS else np.dtype(np.int32)
    return _KINDS[kind](padded(values, kind))


def vectors_on_device(rows: Floats) -> list[Any]:
    """Return the coordinates of vectors (N, C)."""
    return [on_device(column) for column in rows.T]


def table(rows: NDArray[Any]) -> Table:
    """Return the function that looks up rows (N,) or (N, C) by index."""
    # One gather per column: Dr.Jit has no vector type for rows of any length.
    flat, count = on_device(rows), math.prod(rows.shape[1:])
    return lambda index: [dr.gather(type(flat), flat, index * count + k) for k in range(count)]


def constants(values: Sequence[float]) -> list[Any]:
    """Return numbers in memory, so that other values do not compile another kernel."""
    return [dr.opaque(Float64, value) for value in values]


def interleaved(coordinates: Sequence[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """Return vectors of three coordinates as NumPy's array of a shape, (..., 3)."""
    kind = {Float32: Array3f, Float64: Array3f64}[type(coordinates[0])]
    flat: Any = dr.ravel(kind(*coordinates))
    rows: NDArray[Any] = flat.numpy()
    return rows.reshape(shape)


def product(a: Any, b: Any) -> Any:
    """Return a b, rounded separately from any sum that uses it.

    The CUDA driver's compiler may round a product and a sum once or twice. A fused a b - 0 is
    rounded once, has the sign of a b even at zero, and cannot be fused with another operation.
    """
    if _MINUS_ZERO is None or Float64 not in (type(a), type(b)):
        return a * b
    return dr.fma(a, b, _MINUS_ZERO)


def dot(a: Vector, b: Vector) -> Any:
    """Return the dot products of vectors."""
    return product(a[0], b[0]) + product(a[1], b[1]) + product(a[2], b[2])


def cross(a: Vector, b: Vector) -> list[Any]:
    """Return the cross products of vectors."""
    return [product(a[i], b[j]) - product(a[j], b[i]) for i, j in ((1, 2), (2, 0), (0, 1))]


def difference(a: Vector, b: Vector) -> list[Any]:
    """Return a - b."""
    return [first - second for first, second in zip(a, b, strict=True)]


#: Number of pixels in a band of an image that is written band by band, `PIXEL_BYTES` each
BAND_PIXELS = 1 << 19

#: approximate memory for each pixel of a band in progress, bytes
PIXEL_BYTES = 400

#: Number of pixels in a band of an image that is kept whole: joining smaller bands would cost more
#: time. A band adds some 80 bytes a pixel to the image's own 70.
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
