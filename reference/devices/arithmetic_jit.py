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
from drjit.llvm import Array3f, Array3f64, Array4f64, Array4i, Bool, Float32, Float64, Int32, UInt32
from numpy.typing import NDArray

from xfrustum.reference.devices.arithmetic import Arithmetic, Table
from xfrustum.reference.devices.packets import in_packets
from xfrustum.scenes.room import lie_by_coordinate

__all__ = [
    "JIT",
    "Array3f",
    "Array3f64",
    "Array4f64",
    "Array4i",
    "Bool",
    "Float32",
    "Float64",
    "Int32",
    "UInt32",
    "doubles_of",
    "length",
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


def on_device(values: NDArray[Any]) -> Any:
    """Return values as one flat array for lanes.

    They are copied unless they have room behind their end; see `in_packets`. Floating point of other
    precisions becomes double precision. Integers that need more than 32 bits become the smallest or the
    largest of 32 bits: as numbers of triangles and objects, these stand for nothing either.
    """
    if values.dtype in _KINDS:
        return _KINDS[values.dtype](in_packets(values))
    if values.dtype.kind == "f":
        return Float64(in_packets(values, np.float64))
    if values.dtype.itemsize >= _INT32.dtype.itemsize:
        values = np.clip(values, _INT32.min, _INT32.max)
    return Int32(in_packets(values, np.int32))


def on_lanes(rows: NDArray[Any], index: Any) -> list[Any]:
    """Return the columns of rows (N, ..), looked up by index."""
    return _table(rows)(index)


def _table(rows: NDArray[Any]) -> Table:
    if lie_by_coordinate(rows):
        columns = [on_device(column) for column in rows.T]
        return lambda index: [dr.gather(type(column), column, index) for column in columns]
    flat, count = on_device(rows), _columns(rows)
    if count % 4 == 0 and isinstance(flat, Float64):
        # Four numbers at a time, one beside the other, are read at once.
        fours = count // 4
        return lambda index: [
            value for four in range(fours) for value in dr.gather(Array4f64, flat, index * fours + four)
        ]
    return lambda index: [dr.gather(type(flat), flat, index * count + k) for k in range(count)]


def _columns(rows: NDArray[Any]) -> int:
    return math.prod(rows.shape[1:])


def _own(rows: NDArray[Any]) -> Table:
    columns = rows.reshape(len(rows), _columns(rows)).T
    # Each lane loads its own row, whichever lanes there are.
    if rows.dtype == np.float32:
        bits = [UInt32(in_packets(column.view(np.uint32))) for column in columns]
        return lambda _: [_doubled(column) for column in bits]
    own = [on_device(column) for column in columns]
    return lambda _: own


def doubles_of(rows: NDArray[np.floating]) -> Table:
    """Return the table of rows (N, C) of either precision, whose columns are doubles."""
    if rows.dtype != np.float32:
        return _table(rows)
    bits = _table(rows.view(np.uint32))
    return lambda index: [_doubled(one) for one in bits(index)]


def _doubled(bits: Any) -> Any:
    """Return numbers of single precision, given by their bits, as doubles.

    On some of its threads Dr.Jit takes numbers of single precision for zero that are smaller than those of
    full precision, and what a point shows must not depend on threads: these are made of their digits.
    """
    small: Any = Float64(bits & DIGITS) * SMALLEST_SINGLE
    small = dr.select(bits >> 31 == 0, small, -small)
    return dr.select((bits & EXPONENT) == 0, small, Float64(dr.reinterpret_array(Float32, bits)))


DIGITS, EXPONENT = 0x007FFFFF, 0x7F800000
"""Bits of a number of single precision that are its digits, and its exponent."""

SMALLEST_SINGLE = 2.0**-149
"""Smallest positive number of single precision, whose multiples all those below full precision are."""


def length(x: Any, y: Any) -> Any:
    """Return the lengths of vectors: NumPy's `abs` of complex numbers.

    NumPy, too, scales by the larger coordinate, and adds one to the square of the quotient in one rounding
    where the processor has an instruction for that. On some of its threads Dr.Jit takes coordinates below
    full precision for zero; differences of places on a film are no smaller than 2^-54, or zero.
    """
    x, y = dr.abs(x), dr.abs(y)
    larger, smaller = dr.maximum(x, y), dr.minimum(x, y)
    share = dr.select(larger > 0, smaller / larger, 0.0)
    found = dr.sqrt(dr.fma(share, share, 1.0)) * larger
    beyond = dr.select(dr.isinf(x) | dr.isinf(y), np.inf, np.nan)
    return dr.select(dr.isfinite(x) & dr.isfinite(y), found, beyond)


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
    length=length,
    power=_power,
    real=Float64,
    whole=Int32,
    table=_table,
    own=_own,
    constants=_constants,
)
