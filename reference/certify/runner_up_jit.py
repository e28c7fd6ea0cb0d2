"""Second surfaces compiled by Dr.Jit: one more walk over the lanes of the narrow phase."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from xfrustum.reference.certify.narrow_jit import JitNarrowPhase, Lanes, walk
from xfrustum.reference.certify.rows import Rows
from xfrustum.reference.devices.arithmetic_jit import Float64, on_device
from xfrustum.reference.devices.strict_jit import strict_arithmetic
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats


class JitRunnersUp(JitNarrowPhase):
    """Second surfaces on Dr.Jit; see `runner_up.RunnerUpPhase`."""

    def __init__(self, pencil: Pencil, rows: range) -> None:
        super().__init__(pencil, rows)
        with strict_arithmetic():
            self._limit = dr.opaque(Float64, np.inf, self._pixels)

    def add(self, rows: Rows) -> None:
        """Take more triangles into account."""
        with strict_arithmetic():
            self._lanes.append(lanes := self._cut(rows))
            self._lower(lanes)

    def first(self) -> Floats:
        """Return the largest s at which the first surface of each pixel can lie; infinite without one."""
        return np.asarray(self._limit.numpy())

    def behind(self, first: Floats) -> Floats:
        """Return the smallest s of what surely lies behind, on the same side; infinite without any."""
        with strict_arithmetic():
            before = on_device(first)
            second = dr.opaque(Float64, np.inf, self._pixels)
            for lanes in self._lanes:
                self._lower_second(lanes, before, second)
                dr.eval(second)
            return np.asarray(second.numpy())

    def _lower_second(self, lanes: Lanes, before: Any, second: Any) -> None:
        def lower(column: Any) -> None:
            s, error, sure, _ = self._evaluated(lanes, column)
            pixel = lanes.base + column
            limit = dr.gather(Float64, before, pixel)
            chosen = sure & (s - error > limit) & ((limit >= 0) | (s + error <= 0))
            # In the mode Direct, as in `add`.
            dr.scatter_reduce(dr.ReduceOp.Min, second, s, pixel, chosen, mode=dr.ReduceMode.Direct)

        walk(lanes, lower)
