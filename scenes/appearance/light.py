"""Lights: directional, and an environment around everything.

See docs/method.md, "Light"; paper, sections 3 and 6.

This module has parameters only; the two answers shade with formulas of their own, which CONVENTIONS.md states
under "Light".
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from xfrustum.scenes.appearance.material import LARGEST_COEFFICIENT, Color
from xfrustum.scenes.arguments import real, reals, settle
from xfrustum.scenes.errors import InputError

if TYPE_CHECKING:
    from xfrustum.scenes.arrays import Singles

MAX_RADIANCE = 1e30
"""Largest radiance of an environment: sums and products with coefficients stay within float32's range in
pictures, 3e38."""


@dataclass(frozen=True, kw_only=True)
class DirectionalLight:
    """A light at infinity, hence its own conjugate (paper, section 3).

    Attributes
    ----------
    direction
        Vector toward the light, scene axes; it is made a unit vector.
    color
        Linear RGB of the light's irradiance over pi, which a white diffuse surface that faces it shows.

    Raises
    ------
    InputError
        The direction has no length, or the color is negative or not finite.
    """

    direction: tuple[float, float, float]
    color: Color = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        direction, color = reals(self.direction, 3), reals(self.color, 3)
        length = math.hypot(*direction)
        if not (math.isfinite(length) and length > 0):
            raise InputError(f"direction must be a vector with a length, not {self.direction!r}")
        if not all(0 <= part <= LARGEST_COEFFICIENT for part in color):
            raise InputError(
                f"color must be three numbers between 0 and {LARGEST_COEFFICIENT:.0e}, not {self.color!r}"
            )
        settle(self, direction=tuple(part / length for part in direction), color=color)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Environment:
    """Radiance from all directions, as a latitude-longitude map.

    The map's middle lies behind the plate (-z), its top above (+y); to the right of the middle follows
    +x, then +z at both ends. It is seen only in reflections: a line that meets nothing shows black.

    Attributes
    ----------
    radiance
        (H, W, 3) float32 linear RGB, row 0 at the top; finite and at least 0.
    strength
        Factor of the radiance, at least 0.
    name
        Name of the file or of the maker, for messages.

    Raises
    ------
    InputError
        The array has another shape, or the radiance is negative, not finite, or beyond `MAX_RADIANCE`.
    """

    radiance: Singles
    strength: float = 1.0
    name: str = "environment"

    def __post_init__(self) -> None:
        import numpy as np  # noqa: PLC0415 - scene files are checked, and scenes listed, without it

        try:
            radiance = np.ascontiguousarray(self.radiance, dtype=np.float32)
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.name}: an environment map is an RGB picture ({error})") from error
        strength = real(self.strength)
        if radiance.ndim != 3 or radiance.shape[2] != 3 or 0 in radiance.shape:
            raise InputError(f"{self.name}: an environment map is an RGB picture, not {radiance.shape}")
        if not (np.isfinite(radiance).all() and radiance.min() >= 0):
            raise InputError(f"{self.name}: radiance must be finite and not negative; repair the map")
        if not (math.isfinite(strength) and strength >= 0):
            raise InputError(f"strength must be a number of at least 0, not {self.strength!r}")
        if strength * float(radiance.max()) > MAX_RADIANCE:
            raise InputError(
                f"{self.name}: strength {self.strength} makes the map brighter than 32-bit images can hold; "
                f"at most {MAX_RADIANCE:.0e} in all"
            )
        radiance.flags.writeable = False
        settle(self, radiance=radiance, strength=strength)

    def __repr__(self) -> str:
        height, width = self.radiance.shape[:2]
        return f"Environment: {self.name!r}, {width} x {height} pixels, strength {self.strength:g}"


DEFAULT_LIGHT = DirectionalLight(direction=(-2.0, 3.0, 1.0))
"""Light of scenes that name no light and no environment: from above, left, and the viewer's side."""
