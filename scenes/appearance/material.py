"""Phong materials: how a surface reflects light (paper, section 3, figure 3).

This module has parameters only; the two answers shade with formulas of their own, which CONVENTIONS.md states
under "Light".
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from xfrustum.scenes.arguments import real, reals, settle
from xfrustum.scenes.errors import InputError

Color = tuple[float, float, float]
"""Linear RGB."""

LARGEST_COEFFICIENT = 1e15
"""Largest coefficient, and largest color of a light: their product, 1e30, and sums of products stay within
float32's range, 3e38."""


@dataclass(frozen=True, kw_only=True)
class Material:
    """A Phong material with a mirror over it.

    Attributes
    ----------
    ambient, diffuse, specular
        Linear RGB coefficients, each at least 0. Ambient and diffuse are multiplied by the mesh's
        vertex color and texture, where it has them; specular is not.
    exponent
        Exponent of the specular term, above 0; the larger it is, the smaller is the highlight.
    reflectivity
        Share of the environment's radiance that is added, linear RGB, each 0 to 1.

    Raises
    ------
    InputError
        A coefficient lies outside its range.
    """

    ambient: Color = (0.1, 0.1, 0.1)
    diffuse: Color = (0.6, 0.6, 0.6)
    specular: Color = (0.0, 0.0, 0.0)
    exponent: float = 20.0
    reflectivity: Color = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("ambient", "diffuse", "specular", "reflectivity"):
            color = reals(getattr(self, name), 3)
            if not all(0 <= part <= LARGEST_COEFFICIENT for part in color):
                raise InputError(
                    f"{name} must be three numbers between 0 and {LARGEST_COEFFICIENT:.0e}, "
                    f"not {getattr(self, name)!r}"
                )
            settle(self, **{name: color})
        if max(self.reflectivity) > 1:
            raise InputError(f"reflectivity must lie between 0 and 1, not {list(self.reflectivity)}")
        exponent = real(self.exponent)
        if not (math.isfinite(exponent) and exponent > 0):
            raise InputError(f"exponent must be a positive number, not {self.exponent!r}")
        settle(self, exponent=exponent)


DEFAULT_MATERIAL = Material(
    ambient=(0.1, 0.1, 0.1), diffuse=(0.6, 0.6, 0.6), specular=(0.2, 0.2, 0.2), exponent=20.0
)
"""Material of every object that names none: gray, with a soft highlight."""
