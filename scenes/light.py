"""The default light: what a scene without materials and lights is shown in.

Parameters only; the two answers shade with formulas of their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class DefaultLight:
    """A gray, two-sided Lambert material under one directional light.

    Attributes
    ----------
    direction
        Unit vector toward the light, scene axes: from above, left, and the viewer's side.
    albedo
        Linear gray.
    ambient
        Share of the light that comes from everywhere, 0 to 1.
    """

    direction: tuple[float, float, float]
    albedo: float
    ambient: float


DEFAULT_LIGHT = DefaultLight(
    direction=(-2 / math.sqrt(14), 3 / math.sqrt(14), 1 / math.sqrt(14)), albedo=0.7, ambient=0.15
)
