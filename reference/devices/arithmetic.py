"""Arithmetic that NumPy and Dr.Jit name differently, so that formulas are written once for both.

Vectors are sequences of coordinates, each an array with one lane for each point, line or row.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.arrays import Floats, Indices, Mask

Coordinates = Sequence[Any] | NDArray[Any]
"""Coordinates of vectors, each an array of NumPy or Dr.Jit, or a number for all lanes."""

Table = Callable[[Any], list[Any]]
"""Function from indices of rows to the columns of these rows."""


@dataclass(frozen=True, kw_only=True)
class Arithmetic:
    """Functions of NumPy or Dr.Jit.

    Attributes
    ----------
    select
        `numpy.where`.
    maximum, minimum, isfinite, sqrt, floor, arctan2, hypot
        What NumPy calls so.
    length
        Function of two coordinates of vectors, of full precision or zero: their lengths, as `abs` of complex
        numbers rounds them.
    power
        Function of base, exponent, mask and digits: the power where the mask is true, else zero. Where all
        exponents are whole numbers, `digits` is the number of binary digits of the largest; else it is None.
    real
        Function that turns numbers of any kind into doubles.
    whole
        Function that turns doubles without a fraction into indices.
    table
        Function that puts the rows of an array (N,) or (N, C) where they can be looked up.
    own
        Function that puts the rows of an array (N,) or (N, C) where each of N lanes finds its own row;
        numbers of single precision become doubles.
    constants
        Function that puts numbers where a kernel reads them, so that others do not compile another kernel.
    """

    select: Callable[[Any, Any, Any], Any]
    maximum: Callable[[Any, Any], Any]
    minimum: Callable[[Any, Any], Any]
    isfinite: Callable[[Any], Any]
    sqrt: Callable[[Any], Any]
    floor: Callable[[Any], Any]
    arctan2: Callable[[Any, Any], Any]
    hypot: Callable[[Any, Any], Any]
    length: Callable[[Any, Any], Any]
    power: Callable[[Any, Any, Any, int | None], Any]
    real: Callable[[Any], Any]
    whole: Callable[[Any], Any]
    table: Callable[[NDArray[Any]], Table]
    own: Callable[[NDArray[Any]], Table]
    constants: Callable[[Sequence[float]], list[Any]]


def dot(a: Coordinates, b: Coordinates) -> Any:
    """Return the dot products of vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Coordinates, b: Coordinates) -> list[Any]:
    """Return the cross products of vectors."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def difference(a: Coordinates, b: Coordinates) -> list[Any]:
    """Return a - b, coordinate by coordinate."""
    return [one - other for one, other in zip(a, b, strict=True)]


def _power(base: Floats, exponent: Floats | float, where: Mask, digits: int | None) -> Floats:
    # Powers are slow: only those that are wanted are computed.
    return np.power(base, exponent, out=np.zeros(len(base)), where=where)


def _length(x: Floats, y: Floats) -> Floats:
    vectors = np.empty(x.shape, dtype=np.complex128)
    vectors.real, vectors.imag = x, y
    return np.abs(vectors)


def _real(values: NDArray[Any]) -> Floats:
    return values.astype(np.float64, copy=False)


def _whole(values: Floats) -> Indices:
    return values.astype(np.int64)


def _table(rows: NDArray[Any]) -> Table:
    columns = [
        np.ascontiguousarray(column) for column in rows.reshape(len(rows), math.prod(rows.shape[1:])).T
    ]
    return lambda index: [column[index] for column in columns]


def _own(rows: NDArray[Any]) -> Table:
    return _table(rows.astype(np.float64, copy=False) if rows.dtype.kind == "f" else rows)


NUMPY = Arithmetic(
    select=np.where,
    maximum=np.maximum,
    minimum=np.minimum,
    isfinite=np.isfinite,
    sqrt=np.sqrt,
    floor=np.floor,
    arctan2=np.arctan2,
    hypot=np.hypot,
    length=_length,
    power=_power,
    real=_real,
    whole=_whole,
    table=_table,
    own=_own,
    constants=list,
)
