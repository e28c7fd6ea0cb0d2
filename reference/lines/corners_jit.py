"""The corners of a scene's triangles on Dr.Jit's device, put there once for all pencils."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from xfrustum.reference.devices.arithmetic_jit import Array4f64, Float64, UInt32, on_device
from xfrustum.reference.devices.strict_jit import strict_arithmetic
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats, Indices

HEIGHT_SLACK = 2.0**-40
"""Slack of heights that are compared with the plate's, relative to the largest height of a triangle or a
pencil's center. Heights below a center are differences, rounded by 2^-53, and are widened by 2^-52 of
themselves (`cone.s_bounds`): both are some 2^-51 of that largest height at most."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Listed:
    """Some triangles, one lane each.

    Attributes
    ----------
    number
        (N,) triangle numbers, ascending.
    points
        The three corners, each with three coordinates, as Dr.Jit's arrays.
    """

    number: Indices
    points: list[list[Any]]


class CornerTable:
    """Corners of triangles in two orders: by triangle, and by coordinate for each side of the plate.

    Kernels that look triangles up find the coordinates of a corner next to each other; those that go through
    all triangles read coordinate after coordinate without gathering. Together they take 168 to 312 bytes a
    triangle.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners of at least one triangle, in scene units.
    """

    def __init__(self, triangles: Floats) -> None:
        padded = np.zeros((len(triangles), 3, 4))
        padded[..., :3] = triangles
        with strict_arithmetic():
            self._rows = on_device(padded)
        heights = triangles[..., 2]
        self._lowest, self._highest = heights.min(axis=1), heights.max(axis=1)
        self._largest = float(np.abs(heights).max())
        self._lists: dict[int, Listed | None] = {}

    def listed(self, pencil: Pencil) -> Listed | None:
        """Return all triangles that a pencil can image, and perhaps others; None where there are none.

        Most cameras image one side of the plate alone, and need the triangles of that side.
        """
        height, (first, last) = pencil.center[2], pencil.s_range
        side = 0
        if abs(height) <= self._largest:
            side = -1 if height - first <= 0 else 1 if height - last >= 0 else 0
        if side not in self._lists:
            self._lists[side] = self._list(side)
        return self._lists[side]

    def _list(self, side: int) -> Listed | None:
        """Return the triangles that reach above the plate (1), below it (-1), or all (0)."""
        slack = HEIGHT_SLACK * self._largest
        reaching = {1: self._highest >= -slack, -1: self._lowest <= slack}
        number = np.flatnonzero(reaching[side]) if side else np.arange(len(self._lowest))
        if not len(number):
            return None
        points = self.look_up(UInt32(on_device(number)))
        dr.eval(*(coordinate for point in points for coordinate in point))
        return Listed(number=number, points=points)

    def look_up(self, number: Any) -> list[list[Any]]:
        """Return the three corners of triangles by their numbers, each with three coordinates."""
        corners = [dr.gather(Array4f64, self._rows, number * 3 + k) for k in range(3)]
        return [[Float64(corner[axis]) for axis in range(3)] for corner in corners]
