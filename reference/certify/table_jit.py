"""The corners of a scene's triangles on Dr.Jit's device, put there once for all pencils."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from xfrustum.reference.devices.arithmetic_jit import Array4f64, Float64, UInt32, on_device
from xfrustum.reference.devices.strict_jit import strict_arithmetic
from xfrustum.scenes.arrays import Floats


class CornerTable:
    """Corners in two orders: side by side for each triangle, and side by side for each coordinate.

    Kernels with a lane for each triangle read coordinate after coordinate without gathering; those that look
    triangles up find the coordinates of a corner next to each other. Together they take 170 bytes a triangle.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners, in scene units.
    """

    def __init__(self, triangles: Floats) -> None:
        self.size = len(triangles)
        padded = np.zeros((self.size, 3, 4))
        padded[..., :3] = triangles
        with strict_arithmetic():
            lane = dr.arange(UInt32, self.size)
            self._rows = on_device(padded)
            corners = [dr.gather(Array4f64, self._rows, lane * 3 + k) for k in range(3)]
            self.points = [[Float64(corner[axis]) for axis in range(3)] for corner in corners]
            dr.eval(*(one for point in self.points for one in point))

    def look_up(self, number: Any) -> list[list[Any]]:
        """Return the three corners of triangles by their numbers, each with three coordinates."""
        corners = [dr.gather(Array4f64, self._rows, number * 3 + k) for k in range(3)]
        return [[Float64(corner[axis]) for axis in range(3)] for corner in corners]
