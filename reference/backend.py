"""Where Dr.Jit's arrays lie, and the border between them and NumPy's: the one place that says so.

The arrays are those of the processors, through LLVM. `drjit.cuda` has the same arrays under the same names;
there the driver's compiler may fuse a product and a sum into one rounding. The bounds of the certificate
hold all the same, for they count a rounding of each; which bits come out may differ (docs/truth.md).

Vectors are sequences of coordinates, each an array with one lane for each point, line or row. `drjit.dot`
and `drjit.cross` fuse products with sums; `dot` and `cross` here round each of them, as bounds assume.

Importing this module raises an `InputError` where there is no LLVM to compile kernels with.
"""

import math
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.llvm import require_llvm
from xfrustum.reference.memory import padded
from xfrustum.scenes.arrays import Floats

# Dr.Jit takes the LLVM that is named when it is first imported, so that all others import it from here.
require_llvm()

import drjit as dr  # noqa: E402
from drjit.llvm import (  # noqa: E402
    Array3f,
    Array3f64,
    Array4f64,
    Bool,
    Float32,
    Float64,
    Int32,
    UInt32,
)

__all__ = [
    "Array4f64",
    "Bool",
    "Float32",
    "Float64",
    "Int32",
    "UInt32",
    "constants",
    "cross",
    "difference",
    "dot",
    "dr",
    "interleaved",
    "on_device",
    "recording",
    "table",
    "vectors_on_device",
]

Vector = Sequence[Any]
"""Coordinates of vectors, each an array with one lane for each vector, or a number for all lanes."""

Table = Callable[[Any], list[Any]]  #: function from indices of rows to the columns of these rows

_KINDS = {
    np.dtype(np.float64): Float64,
    np.dtype(np.float32): Float32,
    np.dtype(np.int32): Int32,
    np.dtype(np.uint32): UInt32,
    np.dtype(np.bool_): Bool,
}

_INT32 = np.iinfo(np.int32)

_RECORDER = threading.RLock()
"""Lock for recording kernels, which Dr.Jit does once per process; a kernel itself uses all processors."""


@contextmanager
def recording() -> Iterator[None]:
    """Record kernels in IEEE arithmetic: a proof must not depend on how a compiler rearranges it."""
    with _RECORDER, dr.scoped_set_flag(dr.JitFlag.FastMath, False):
        yield


def on_device(values: NDArray[Any]) -> Any:
    """Return a copy of values of any shape as one flat array of Dr.Jit.

    Other floats become doubles, other integers those of 32 bits, clipped: as numbers of triangles, the
    smallest and the largest stand for nothing either.
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
    flat, count = on_device(rows), math.prod(rows.shape[1:])
    return lambda index: [dr.gather(type(flat), flat, index * count + k) for k in range(count)]


def constants(values: Sequence[float]) -> list[Any]:
    """Return numbers where a kernel reads them: others do not compile another kernel."""
    return [dr.opaque(Float64, value) for value in values]


def interleaved(coordinates: Sequence[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """Return vectors of three coordinates as NumPy's array of a shape, (..., 3)."""
    kind = {Float32: Array3f, Float64: Array3f64}[type(coordinates[0])]
    flat: Any = dr.ravel(kind(*coordinates))
    found: NDArray[Any] = flat.numpy()
    return found.reshape(shape)


def dot(a: Vector, b: Vector) -> Any:
    """Return the dot products of vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> list[Any]:
    """Return the cross products of vectors."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def difference(a: Vector, b: Vector) -> list[Any]:
    """Return a - b."""
    return [one - other for one, other in zip(a, b, strict=True)]
