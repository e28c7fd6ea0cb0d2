"""Formulas with one lane for each pixel or point, compiled by Dr.Jit."""

from __future__ import annotations

from typing import Any

import drjit as dr
from numpy.typing import NDArray

from xfrustum.reference.devices.arithmetic_jit import JIT, UInt32
from xfrustum.reference.devices.strict_jit import strict_arithmetic
from xfrustum.reference.lane_formulas import Formula


def evaluated(formula: Formula, count: int) -> list[NDArray[Any]]:
    """Return what a formula says of lanes 0 to `count`; see `lane_formulas.evaluated`."""
    with strict_arithmetic():
        values = formula(JIT)(dr.arange(UInt32, count))
        dr.eval(*values)
        return [value.numpy() for value in values]
