"""The environment that surfaces reflect: radiance by direction, from a latitude-longitude map."""

from __future__ import annotations

import numpy as np

from xfrustum.reference.shading.textures import bilinear
from xfrustum.scenes.appearance.light import Environment
from xfrustum.scenes.arrays import Floats, Indices


def radiance_toward(environment: Environment, directions: Floats) -> Floats:
    """Return the environment's linear RGB (N, 3) in each direction (N, 3), of any length but zero.

    The map's middle lies toward -z, its top toward +y; +x follows to the right of the middle. The map is
    filtered bilinearly between texel centers: around in longitude, and clamped beyond the centers of its
    first and last row.
    """
    x, y, z = directions.T
    height, width = environment.radiance.shape[:2]
    longitude = np.arctan2(x, -z)
    # The arc tangent is exact near the poles, where the arc cosine of y is coarse.
    from_top = np.arctan2(np.hypot(x, z), y)

    def texel(rows: Indices, columns: Indices) -> Floats:
        found = environment.radiance[np.clip(rows, 0, height - 1), columns % width]
        return np.asarray(found, dtype=np.float64)

    right, down = (longitude / (2.0 * np.pi) + 0.5) * width, from_top / np.pi * height
    return np.asarray(environment.strength * bilinear(texel, down, right))
