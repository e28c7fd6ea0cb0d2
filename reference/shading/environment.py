"""The environment that surfaces reflect: radiance by direction, from a latitude-longitude map."""

from __future__ import annotations

from typing import Any

import numpy as np

from xfrustum.reference.devices.arithmetic import NUMPY, Arithmetic, Coordinates
from xfrustum.reference.shading.textures import bilinear, bounded, repeated
from xfrustum.scenes.appearance.light import Environment
from xfrustum.scenes.arrays import Floats


class Surroundings:
    """An environment by direction.

    Parameters
    ----------
    by
        Arithmetic of the directions.
    environment
        The environment.
    """

    def __init__(self, by: Arithmetic, environment: Environment) -> None:
        self._by = by
        height, width = environment.radiance.shape[:2]
        self._texel = by.table(environment.radiance.reshape(-1, 3))
        self._height, self._width, self._strength = by.constants((height, width, environment.strength))

    def radiance(self, directions: Coordinates) -> list[Any]:
        """Return the environment's linear RGB in each direction, of any length but zero.

        The map's middle lies toward -z, its top toward +y; +x follows to the right of the middle. The map is
        filtered bilinearly between texel centers: around in longitude, and clamped beyond the centers of its
        first and last row.
        """
        by, (x, y, z) = self._by, directions
        longitude = by.arctan2(x, -z)
        # The arc tangent is exact near the poles, where the arc cosine of y is coarse.
        from_top = by.arctan2(by.hypot(x, z), y)

        def texel(row: Any, column: Any) -> list[Any]:
            inside = bounded(by, row, self._height - 1.0)
            return self._texel(by.whole(inside * self._width) + repeated(by, column, self._width))

        right, down = (longitude / (2.0 * np.pi) + 0.5) * self._width, from_top / np.pi * self._height
        return [self._strength * channel for channel in bilinear(by, texel, down, right)]


def radiance_toward(environment: Environment, directions: Floats) -> Floats:
    """Return the environment's linear RGB (N, 3) in each direction (N, 3), of any length but zero."""
    return np.stack(Surroundings(NUMPY, environment).radiance(directions.T), axis=-1)
