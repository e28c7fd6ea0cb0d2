"""Light and color of a scene: Phong materials, lights, environment, sampling, light transport.

The formulas are in CONVENTIONS.md, "Light". Sampling over pixels and over the aperture, and light
transport, are off by default.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from xfrustum.scenes.arguments import InputError, one_of, real, reals, settle, switch, whole
from xfrustum.scenes.plate import Aperture, Plate

if TYPE_CHECKING:
    from xfrustum.scenes.arrays import Floats, Singles


Color = tuple[float, float, float]  #: linear RGB
#: Largest coefficient, and largest color of a light: their product, 1e30, and sums of products stay
#: within float32's range, 3e38.
LARGEST_COEFFICIENT = 1e15
#: Largest radiance of an environment: sums and products with coefficients stay within float32's
#: range in pictures, 3e38.
MAX_RADIANCE = 1e30


def _color(name: str, value: object) -> Color:
    """Return coefficients as linear RGB; InputError if a coefficient is outside its range."""
    color = reals(value, 3)
    if not all(0 <= part <= LARGEST_COEFFICIENT for part in color):
        raise InputError(
            f"{name} must be three numbers between 0 and {LARGEST_COEFFICIENT:.0e}, not {value!r}"
        )
    return color[0], color[1], color[2]


@dataclass(frozen=True, kw_only=True)
class Material:
    """A Phong material with added mirror reflection (paper, section 3, figure 3); linear RGB.

    Ambient and diffuse are multiplied by vertex color and texture. Reflectivity, 0 to 1 for each
    color, is the added share of the environment's radiance. Raises InputError outside the ranges.
    """

    ambient: Color = (0.1, 0.1, 0.1)
    diffuse: Color = (0.6, 0.6, 0.6)
    specular: Color = (0.0, 0.0, 0.0)
    exponent: float = 20.0
    reflectivity: Color = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("ambient", "diffuse", "specular", "reflectivity"):
            settle(self, **{name: _color(name, getattr(self, name))})
        if max(self.reflectivity) > 1:
            raise InputError(
                f"reflectivity must lie between 0 and 1, not {list(self.reflectivity)}"
            )
        exponent = real(self.exponent)
        if not (math.isfinite(exponent) and exponent > 0):
            raise InputError(f"exponent must be a positive number, not {self.exponent!r}")
        settle(self, exponent=exponent)


#: Material of objects without a material name: gray, with a soft highlight.
DEFAULT_MATERIAL = Material(specular=(0.2, 0.2, 0.2))


@dataclass(frozen=True, kw_only=True)
class DirectionalLight:
    """Light at infinity. Such a light is its own conjugate (paper, section 3).

    The direction points to the light and is normalized. The color is the irradiance divided by pi:
    the radiance of a white diffuse surface that faces the light. Raises InputError if the direction
    has no length.
    """

    direction: tuple[float, float, float]
    color: Color = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        direction = reals(self.direction, 3)
        length = math.hypot(*direction)
        if not (math.isfinite(length) and length > 0):
            raise InputError(f"direction must be a vector with a length, not {self.direction!r}")
        unit = tuple(part / length for part in direction)
        settle(self, direction=unit, color=_color("color", self.color))


#: Light of scenes without lights and environment: from above, left, and the viewer's side.
DEFAULT_LIGHT = DirectionalLight(direction=(-2.0, 3.0, 1.0))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Environment:
    """Radiance from all directions: a latitude-longitude map (H, W, 3), row 0 on top.

    The map's middle is behind the plate (-z), and its top is above (+y). From the middle to the
    right, directions turn to +x and then to +z; +z is at both ends. The map is visible only in
    reflections: a line that meets no surface is black. Raises InputError if the array has another
    shape, or radiance is negative or beyond `MAX_RADIANCE`.
    """

    radiance: Singles
    strength: float = 1.0  #: factor of the radiance, at least 0
    name: str = "environment"  #: file or origin of the map, for messages

    def __post_init__(self) -> None:
        import numpy as np  # noqa: PLC0415 - scene files are checked, and scenes listed, without it

        try:
            radiance = np.ascontiguousarray(self.radiance, dtype=np.float32)
        except (TypeError, ValueError) as error:
            raise InputError(
                f"{self.name}: an environment map is an RGB picture ({error})"
            ) from error
        strength = real(self.strength)
        if radiance.ndim != 3 or radiance.shape[2] != 3 or 0 in radiance.shape:
            raise InputError(
                f"{self.name}: an environment map is an RGB picture, not {radiance.shape}"
            )
        if not (np.isfinite(radiance).all() and radiance.min() >= 0):
            raise InputError(
                f"{self.name}: radiance must be finite and not negative; repair the map"
            )
        if not (math.isfinite(strength) and strength >= 0):
            raise InputError(f"strength must be a number of at least 0, not {self.strength!r}")
        if strength * float(radiance.max()) > MAX_RADIANCE:
            raise InputError(
                f"{self.name}: strength {self.strength} makes the map brighter than 32-bit "
                "images can hold; "
                f"at most {MAX_RADIANCE:.0e} in all"
            )
        radiance.flags.writeable = False
        settle(self, radiance=radiance, strength=strength)

    def __repr__(self) -> str:
        height, width = self.radiance.shape[:2]
        return f"Environment: {self.name!r}, {width} x {height} pixels, strength {self.strength:g}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Appearance:
    """Materials by name, lights, and an optional environment for reflections."""

    materials: Mapping[str, Material] = field(default_factory=dict)
    lights: tuple[DirectionalLight, ...] = (DEFAULT_LIGHT,)
    environment: Environment | None = None

    def __post_init__(self) -> None:
        one_of(self.materials, Mapping, "materials")
        for name, material in self.materials.items():
            one_of(material, Material, f"materials[{name!r}]")
        one_of(self.lights, Iterable, "lights")
        # Copy into a dictionary: scenes are pickled for worker processes, and proxies cannot be
        # pickled.
        settle(self, materials=dict(self.materials), lights=tuple(self.lights))
        for number, light in enumerate(self.lights):
            one_of(light, DirectionalLight, f"lights[{number}]")
        if self.environment is not None:
            one_of(self.environment, Environment, "environment")

    def material(self, name: str | None) -> Material:
        """Return a material by name, the default material for None; InputError if unknown."""
        if name is not None and name not in self.materials:
            known = ", ".join(self.materials) or "none"
            raise InputError(f"there is no material {name!r}; the appearance has {known}")
        return DEFAULT_MATERIAL if name is None else self.materials[name]


MAX_SAMPLES = 1 << 16  #: largest count of samples of any kind


@dataclass(frozen=True, kw_only=True)
class Sampling:
    """Samples of color per pixel and per aperture, 1 to `MAX_SAMPLES`; otherwise InputError."""

    supersample: int = 1  #: points along each side of a pixel, on a regular grid (box filter)
    #: coverage samples of the rasterizer; the reference averages over the same box
    multisample: int = 1
    #: sub-apertures over which the image is averaged (paper, section 6: band limiting)
    aperture: int = 1

    def __post_init__(self) -> None:
        for name in ("supersample", "multisample", "aperture"):
            count = whole(getattr(self, name))
            if not 1 <= count <= MAX_SAMPLES:
                raise InputError(
                    f"{name} must be a count between 1 and {MAX_SAMPLES}, not "
                    f"{getattr(self, name)!r}"
                )
            settle(self, **{name: count})


@dataclass(frozen=True, kw_only=True)
class Transport:
    """Shadows and interreflection, by light paths; InputError for values out of range."""

    shadows: bool = False  #: whether surfaces cast shadows on each other
    interreflection: bool = False  #: whether surfaces light each other
    samples: int = 64  #: light paths per pixel

    def __post_init__(self) -> None:
        samples = whole(self.samples)
        if not 2 <= samples <= MAX_SAMPLES:
            raise InputError(
                f"samples must be a count between 2 and {MAX_SAMPLES}, not {self.samples!r}: "
                "fewer than two have no variance"
            )
        shadows, lit = (
            switch(self.shadows, "shadows"),
            switch(self.interreflection, "interreflection"),
        )
        settle(self, samples=samples, shadows=shadows, interreflection=lit)

    @property
    def simulated(self) -> bool:
        """True if any light transport is simulated."""
        return self.shadows or self.interreflection


#: The real root of x^3 = x + 1. Its powers give an evenly distributed additive recurrence in two
#: dimensions.
PLASTIC = 1.32471795724474602596


def sub_apertures(plate: Plate, aperture: Aperture, count: int) -> tuple[Aperture, ...]:
    """Return points spread evenly over one hogel pitch about an aperture (paper, section 6).

    They follow the additive recurrence of Roberts, "The unreasonable effectiveness of quasirandom
    sequences" (2018): the error of a smooth integrand falls as 1 / count.
    """
    if count == 1:
        return (aperture,)
    offsets = additive_recurrence(count) - 0.5
    pitch = (plate.size[0] / plate.hogels[0], plate.size[1] / plate.hogels[1])
    return tuple(
        replace(aperture, x=aperture.x + float(x) * pitch[0], y=aperture.y + float(y) * pitch[1])
        for x, y in offsets
    )


def additive_recurrence(count: int) -> Floats:
    """Return (count, 2) points in [0, 1), centered: their mean tends to one half."""
    import numpy as np  # noqa: PLC0415 - scenes are listed without it

    steps = np.arange(count, dtype=np.float64)[:, None]
    return np.asarray((0.5 + (steps + 0.5) * [1 / PLASTIC, 1 / PLASTIC**2]) % 1.0)
