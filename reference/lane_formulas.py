"""Formulas with one lane for each pixel or point, written once and evaluated by Dr.Jit or NumPy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.certify.processors import compiled, kernels_on_one_thread
from xfrustum.reference.devices.arithmetic import NUMPY, Arithmetic

Formula = Callable[[Arithmetic], Callable[[Any], Sequence[Any]]]
"""Function of an arithmetic that puts tables and constants where they can be looked up, and returns the
function from lanes to their values. Both arithmetics have the same operations, each rounded once."""

MIN_COMPILED_LANES = 1 << 12
"""Smallest number of lanes that are compiled: to start a kernel takes about as long as NumPy takes for so
many."""

LANES_PER_CHUNK = 1 << 16
"""Largest number of lanes that NumPy evaluates at once: one double for each takes 512 kB, and the caches of a
processor hold a few such arrays."""


def evaluated(formula: Formula, count: int) -> list[NDArray[Any]]:
    """Return what a formula says of lanes 0 to `count`, one array (count,) for each of its values."""
    if count >= MIN_COMPILED_LANES and compiled():
        # Imported only here, because Dr.Jit's arrays need the LLVM that `compiled` has chosen.
        on_device = import_module("xfrustum.reference.lane_formulas_jit").evaluated
        with kernels_on_one_thread(count):
            found: list[NDArray[Any]] = on_device(formula, count)
        return found
    lanes = formula(NUMPY)
    with np.errstate(all="ignore"):
        chunks = [
            lanes(np.arange(start, min(start + LANES_PER_CHUNK, count)))
            for start in range(0, max(count, 1), LANES_PER_CHUNK)
        ]
    return [np.concatenate(values) for values in zip(*chunks, strict=True)]
