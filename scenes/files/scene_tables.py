"""The tables of a scene file: their keys and the values that each may hold (see CONVENTIONS.md)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from xfrustum.scenes.appearance.light import DirectionalLight
from xfrustum.scenes.appearance.material import LARGEST_COEFFICIENT, Material
from xfrustum.scenes.appearance.sampling import MAX_SAMPLES, Sampling, Transport
from xfrustum.scenes.geometry.shape_names import SHAPE_NAMES

if TYPE_CHECKING:
    from xfrustum.scenes.arrays import Floats

ONE_OF = "one_of"
"""Type of an error that concerns a table as a whole, and whose message is complete."""


def _color(value: Any) -> tuple[float, float, float]:
    """Return a color: one number stands for gray, three for red, green and blue."""
    parts = value if isinstance(value, list) else [value] * 3
    if len(parts) != 3 or not all(_is_coefficient(part) for part in parts):
        raise PydanticCustomError("color", "not a color")
    red, green, blue = (float(part) for part in parts)
    return red, green, blue


def _is_coefficient(value: Any) -> bool:
    return (
        isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= LARGEST_COEFFICIENT
    )


def _share(value: Any) -> tuple[float, float, float]:
    """Return a color of at most one."""
    color = _color(value)
    if max(color) > 1:
        raise PydanticCustomError("color", "more than one")
    return color


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True)]
Samples = Annotated[int, Field(strict=True, ge=1, le=MAX_SAMPLES)]
Switch = Annotated[bool, Field(strict=True)]
Text = Annotated[str, Field(strict=True, min_length=1)]
Pair = tuple[Number, Number]
Triple = tuple[Number, Number, Number]
Row = tuple[Number, Number, Number, Number]
Color = Annotated[tuple[float, float, float], BeforeValidator(_color)]
Share = Annotated[tuple[float, float, float], BeforeValidator(_share)]

_COLOR = f"a number or [red, green, blue], each at least 0 and at most {LARGEST_COEFFICIENT:.0e}"
_SHARE = "a number or [red, green, blue], each between 0 and 1"
_SAMPLES = f"a count between 1 and {MAX_SAMPLES}"


class Table(BaseModel):
    """A table of a scene file, which refuses unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class PlateTable(Table):
    """The table `[plate]`."""

    size: Pair = Field(description="two positive lengths [width, height]")
    hogels: tuple[Count, Count] = Field(description="two counts [columns, rows], integers of at least 1")


class ScreenTable(Table):
    """The table `frustum.screen`."""

    height: Number = Field(description="a height above the plate, finite and not zero")
    center: Pair = Field(description="a point [x, y]")
    size: Pair = Field(description="two positive lengths [width, height]")


class FrustumTable(Table):
    """The table `[frustum]`."""

    resolution: tuple[Count, Count] = Field(
        description="two pixel counts [width, height], integers of at least 1"
    )
    fov_deg: tuple[Annotated[Number, Field(gt=0, lt=180)], Annotated[Number, Field(gt=0, lt=180)]] | None = (
        Field(None, description="two angles [x, y] between 0 and 180 degrees")
    )
    screen: ScreenTable | None = Field(None, description="a table with height, center and size")
    reach: Pair = Field(description="two positive lengths [toward the viewer, behind the plate]")


class ObjectTable(Table):
    """One table `[[object]]`."""

    mesh: Text | None = Field(None, description="the path of a mesh file, relative to the scene file")
    shape: Text | None = Field(None, description=f"one of {', '.join(SHAPE_NAMES)}")
    transform: tuple[Row, Row, Row, Row] | None = Field(
        None, description="four rows of four finite numbers, the last row [0, 0, 0, 1], not singular"
    )
    scale: Annotated[Number, Field(gt=0)] | None = Field(None, description="a positive number")
    rotate_deg: Triple | None = Field(None, description="three angles in degrees [x, y, z]")
    translate: Triple | None = Field(None, description="three lengths [x, y, z]")
    material: Text | None = Field(None, description="the name of a [material.NAME] table")
    smooth: Switch = Field(False, description="true or false")
    chord_tolerance: Annotated[Number, Field(gt=0)] | None = Field(
        None, description="a positive length in scene units"
    )

    @model_validator(mode="after")
    def _one_of_each(self) -> Self:
        if (self.mesh is None) == (self.shape is None):
            raise PydanticCustomError(
                ONE_OF,
                "needs either mesh or shape, and not both: a mesh file, or a shape out of {shapes}",
                {"shapes": ", ".join(SHAPE_NAMES)},
            )
        parts = [k for k in ("scale", "rotate_deg", "translate") if getattr(self, k) is not None]
        if self.transform is not None and parts:
            raise PydanticCustomError(
                ONE_OF,
                "has both transform and {part}; give transform, or any of scale, rotate_deg and translate",
                {"part": parts[0]},
            )
        if self.chord_tolerance is not None and not self.is_patches:
            raise PydanticCustomError(
                ONE_OF, "has a chord_tolerance, which only Bezier patches (.bpt) have; leave it out"
            )
        return self

    @property
    def is_patches(self) -> bool:
        """Whether the mesh file holds Bezier patches."""
        return self.mesh is not None and self.mesh.lower().endswith(".bpt")

    def scene_from_mesh(self) -> Floats:
        """Return the (4, 4) matrix that places the mesh."""
        import numpy as np  # noqa: PLC0415 - keys are checked without it

        from xfrustum.scenes.geometry.placement import placement  # noqa: PLC0415 - likewise

        if self.transform is not None:
            return np.array(self.transform, dtype=np.float64)
        zero = (0.0, 0.0, 0.0)
        return placement(self.scale or 1.0, self.rotate_deg or zero, self.translate or zero)


class MaterialTable(Table):
    """One table `[material.NAME]`; its defaults are those of `Material`."""

    ambient: Color = Field(Material.ambient, description=_COLOR)
    diffuse: Color = Field(Material.diffuse, description=_COLOR)
    specular: Color = Field(Material.specular, description=_COLOR)
    exponent: Annotated[Number, Field(gt=0)] = Field(Material.exponent, description="a positive number")
    reflectivity: Share = Field(Material.reflectivity, description=_SHARE)


class LightTable(Table):
    """One table `[[light]]`."""

    direction: Triple = Field(description="a vector [x, y, z] toward the light, not zero")
    color: Color = Field(DirectionalLight.color, description=_COLOR)


class EnvironmentTable(Table):
    """The table `[environment]`."""

    map: Text = Field(
        description="the path of a latitude-longitude map (EXR or HDR), relative to the scene file"
    )
    strength: Annotated[Number, Field(ge=0)] = Field(1.0, description="a number of at least 0")


class SamplingTable(Table):
    """The table `[sampling]`."""

    supersample: Samples = Field(default=Sampling.supersample, description=_SAMPLES)
    multisample: Samples = Field(default=Sampling.multisample, description=_SAMPLES)
    aperture: Samples = Field(default=Sampling.aperture, description=_SAMPLES)


class TransportTable(Table):
    """The table `[transport]`."""

    shadows: Switch = Field(default=Transport.shadows, description="true or false")
    interreflection: Switch = Field(default=Transport.interreflection, description="true or false")
    samples: Annotated[int, Field(strict=True, ge=2, le=MAX_SAMPLES)] = Field(
        default=Transport.samples, description=f"a count between 2 and {MAX_SAMPLES}"
    )


class SceneTables(Table):
    """All tables of a scene file."""

    name: Text | None = Field(None, description="a text that is not empty")
    units: Text = Field("units", description="the name of the length unit, a text that is not empty")
    plate: PlateTable = Field(description="a table with size and hogels")
    frustum: FrustumTable = Field(description="a table with resolution, reach, and fov_deg or screen")
    objects: list[ObjectTable] = Field([], alias="object", description="a list of [[object]] tables")
    material: dict[str, MaterialTable] = Field({}, description="[material.NAME] tables")
    lights: list[LightTable] | None = Field(None, alias="light", description="a list of [[light]] tables")
    environment: EnvironmentTable | None = Field(None, description="a table with map and strength")
    sampling: SamplingTable = Field(
        SamplingTable(), description="a table with supersample, multisample and aperture"
    )
    transport: TransportTable = Field(
        TransportTable(), description="a table with shadows, interreflection and samples"
    )
