"""Dr.Jit's arithmetic, and its arrays on the device: the processors, through LLVM.

This is the only module that says where Dr.Jit's arrays lie. `drjit.cuda` has the same arrays; but there the
driver's compiler may fuse a product and a sum into one rounding. The bounds of the certificate hold all the
same, for they count a rounding of each; which bits come out has not been tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np
from drjit.llvm import Array3f, Array3f64, Array4f64, Bool, Float32, Float64, Int32, UInt32
from numpy.typing import NDArray

from xfrustum.reference.devices.arithmetic import Arithmetic, Table

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


def on_device(values: NDArray[Any]) -> Any:
    """Return values as one flat array that lanes gather from; 64-bit integers must fit into 32 bits.

    Dr.Jit reads NumPy's memory in place and compiles anew for every mix of alignments of arrays that lanes
    load directly. Gathers do not depend on alignment.
    """
    flat = np.ascontiguousarray(values).ravel()
    if flat.dtype not in _KINDS:
        flat = flat.astype(np.int32)
    return _KINDS[flat.dtype](flat)


def on_lanes(rows: NDArray[Any], index: Any) -> list[Any]:
    """Return the columns of rows (N, ..), looked up by index."""
    return _table(rows)(index)


def _table(rows: NDArray[Any]) -> Table:
    flat, count = on_device(rows), rows.size // max(len(rows), 1)
    return lambda index: [dr.gather(type(flat), flat, index * count + k) for k in range(count)]


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
    whole=Int32,
    table=_table,
    constants=_constants,
)
