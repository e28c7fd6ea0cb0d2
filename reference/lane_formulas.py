"""Formulas with one lane for each pixel or point, in NumPy."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.arrays import Floats

Table = Callable[[Any], list[Any]]


def _table(rows: NDArray[Any]) -> Table:
    columns = [np.ascontiguousarray(one) for one in rows.reshape(len(rows), math.prod(rows.shape[1:])).T]
    return lambda index: [column[index] for column in columns]


def _length(x: Floats, y: Floats) -> Floats:
    vectors = np.empty(x.shape, dtype=np.complex128)
    vectors.real, vectors.imag = x, y
    return np.abs(vectors)


class Arithmetic:
    """Arithmetic of formulas."""

    select = staticmethod(np.where)
    maximum, isfinite, floor = np.maximum, np.isfinite, np.floor
    length, table, own, constants = staticmethod(_length), staticmethod(_table), staticmethod(_table), list

    @staticmethod
    def real(values: NDArray[Any]) -> Floats:
        """Return values as doubles."""
        return values.astype(np.float64, copy=False)


Formula = Callable[[Arithmetic], Callable[[Any], Sequence[Any]]]


_NUMPY = Arithmetic()


def evaluated(formula: Formula, count: int) -> list[NDArray[Any]]:
    """Return what a formula says of lanes 0 to `count`, one array (count,) for each of its values."""
    with np.errstate(all="ignore"):
        return [np.asarray(one) for one in formula(_NUMPY)(np.arange(count))]
