"""Shifts of surface points on a film, compiled by Dr.Jit: one lane for each pixel."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.devices.arithmetic_jit import JIT, Float64, UInt32, on_device
from xfrustum.reference.devices.strict_jit import strict_arithmetic
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats


def compiled_shifts(position: NDArray[np.floating], pencil: Pencil) -> tuple[Floats, Floats]:
    """Return columns and rows (H W,) of `film_shifts`, by the same operations in the same order."""
    size = pencil.resolution[0] * pencil.resolution[1]
    with strict_arithmetic():
        lane, flat = dr.arange(UInt32, size), on_device(position)
        x, y, z = (Float64(dr.gather(type(flat), flat, lane * 3 + axis)) for axis in range(3))
        center, shear, half = map(JIT.constants, (pencil.center, pencil.shear, pencil.half_extent))
        width, height = JIT.constants(pencil.resolution)
        # A quotient in doubles: it is off by less than the half that is added, and faster than of integers.
        row = dr.floor((Float64(lane) + 0.5) / width)
        depth = -(z - center[2])
        across, down = (
            ((value - center[axis]) / depth - shear[axis]) / half[axis] for axis, value in enumerate((x, y))
        )
        shown = dr.isfinite(x) & dr.isfinite(y) & dr.isfinite(z) & (z != 0)
        column = _place(across + 1, width) - (Float64(lane) - row * width)
        columns, rows = (
            dr.select(shown, value, np.nan) for value in (column, _place(1 - down, height) - row)
        )
        dr.eval(columns, rows)
        return columns.numpy(), rows.numpy()


def _place(along: Any, side: Any) -> Any:
    """Return the place in pixels of what lies so far along a side of the film, which is two long."""
    return along * side / 2 - 0.5
