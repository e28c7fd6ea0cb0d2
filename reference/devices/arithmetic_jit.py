"""Dr.Jit's arithmetic, and its arrays on the device: the processors, through LLVM.

This is the only module that says where Dr.Jit's arrays lie. `drjit.cuda` has the same arrays; but there the
driver's compiler may fuse a product and a sum into one rounding. The bounds of the certificate hold all the
same, for they count a rounding of each; which bits come out has not been tried.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np
from drjit.llvm import Array3f, Array3f64, Array4f64, Bool, Float32, Float64, Int32, UInt32
from numpy.typing import NDArray

from xfrustum.reference.devices.arithmetic import Arithmetic, Table
from xfrustum.reference.devices.packets import in_packets

__all__ = [
    "JIT",
    "Array3f",
    "Array3f64",
    "Array4f64",
    "Bool",
    "Float32",
    "Float64",
    "Int32",
    "UInt32",
    "in_double_precision",
    "on_device",
    "on_lanes",
]

_KINDS = {
    np.dtype(np.float64): Float64,
    np.dtype(np.float32): Float32,
    np.dtype(np.int32): Int32,
    np.dtype(np.uint32): UInt32,
    np.dtype(np.bool_): Bool,
}


_INT32 = np.iinfo(np.int32)


def in_double_precision(values: NDArray[np.floating]) -> Any:
    """Return numbers as one flat array of doubles for lanes.

    NumPy makes the doubles: on some of its threads Dr.Jit takes numbers of single precision for zero that are
    smaller than those of full precision, and what a point shows must not depend on threads.
    """
    return Float64(in_packets(values, np.float64))


def on_device(values: NDArray[Any]) -> Any:
    """Return values as one flat array for lanes.

    The values are copied, so that kernels may read them in whole packets; see `packets`. Floating point of
    other precisions becomes double precision. Integers that need more than 32 bits become the smallest or the
    largest of 32 bits: as numbers of triangles and objects, these stand for nothing either.
    """
    if values.dtype in _KINDS:
        return _KINDS[values.dtype](in_packets(values))
    if values.dtype.kind == "f":
        return in_double_precision(values)
    if values.dtype.itemsize >= _INT32.dtype.itemsize:
        values = np.clip(values, _INT32.min, _INT32.max)
    return Int32(in_packets(values, np.int32))


def on_lanes(rows: NDArray[Any], index: Any) -> list[Any]:
    """Return the columns of rows (N, ..), looked up by index."""
    return _table(rows)(index)


def _table(rows: NDArray[Any]) -> Table:
    flat, count = on_device(rows), rows.size // max(len(rows), 1)
    if count % 4 == 0 and isinstance(flat, Float64):
        # Four numbers at a time, one beside the other, are read at once.
        fours = count // 4
        return lambda index: [
            value for four in range(fours) for value in dr.gather(Array4f64, flat, index * fours + four)
        ]
    return lambda index: [dr.gather(type(flat), flat, index * count + k) for k in range(count)]


def _own(rows: NDArray[Any]) -> Table:
    put = in_double_precision if rows.dtype.kind == "f" else on_device
    columns = [put(column) for column in rows.reshape(len(rows), math.prod(rows.shape[1:])).T]
    # Each lane loads its own row, whichever lanes there are.
    return lambda _: columns


MIN_LOG2 = -1000.0
"""Smallest logarithm to base 2 of a power. Dr.Jit 1.5's `exp2`, and with it `power`, returns minus infinity
for some results below the smallest double of full precision, 2^-1022. Beside radiance, 2^-1000 is nothing."""


MAX_SQUARING_DIGITS = 10
"""Largest number of binary digits of whole exponents for which squarings are faster than a logarithm. Their
roundings add up to 2^10 2^-53 at most, far below those of a float32."""


def _power(base: Any, exponent: Any, where: Any, digits: int | None) -> Any:
    if digits is not None and digits <= MAX_SQUARING_DIGITS:
        whole, power = UInt32(exponent), Float64(1.0)
        for digit in range(digits):
            power = dr.select((whole >> digit) & 1 == 1, power * base, power)
            base = base * base
        return dr.select(where, power, 0.0)
    logarithm = exponent * dr.log2(dr.select(where, base, 1.0))
    return dr.select(where, dr.exp2(dr.maximum(logarithm, MIN_LOG2)), 0.0)


def _constants(values: Sequence[float]) -> list[Any]:
    return [dr.opaque(Float64, value) for value in values]


JIT = Arithmetic(
    select=dr.select,
    maximum=dr.maximum,
    minimum=dr.minimum,
    isfinite=dr.isfinite,
    sqrt=dr.sqrt,
    floor=dr.floor,
    arctan2=dr.atan2,
    hypot=dr.hypot,
    power=_power,
    real=Float64,
    whole=Int32,
    table=_table,
    own=_own,
    constants=_constants,
)
