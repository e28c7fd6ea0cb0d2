"""The appearance of a scene: its materials and lights, and the default where it names none."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from xfrustum.scenes.appearance.light import DEFAULT_LIGHT, DirectionalLight, Environment
from xfrustum.scenes.appearance.material import DEFAULT_MATERIAL, Material
from xfrustum.scenes.arguments import one_of, settle
from xfrustum.scenes.errors import InputError


@dataclass(frozen=True, kw_only=True, eq=False)
class Appearance:
    """Materials by name, lights, and an environment to be reflected.

    Attributes
    ----------
    materials
        Materials by the name that objects refer to.
    lights
        Directional lights.
    environment
        Environment, which shows in reflections only; None if there is none.

    Raises
    ------
    InputError
        An attribute is no material, light or environment; `material` is asked for one that is missing.
    """

    materials: Mapping[str, Material] = field(default_factory=lambda: MappingProxyType({}))
    lights: tuple[DirectionalLight, ...] = (DEFAULT_LIGHT,)
    environment: Environment | None = None

    def __post_init__(self) -> None:
        one_of(self.materials, Mapping, "materials")
        for name, material in self.materials.items():
            one_of(material, Material, f"materials[{name!r}]")
        one_of(self.lights, Iterable, "lights")
        lights = tuple(self.lights)
        for number, light in enumerate(lights):
            one_of(light, DirectionalLight, f"lights[{number}]")
        if self.environment is not None:
            one_of(self.environment, Environment, "environment")
        settle(self, lights=lights)

    def material(self, name: str | None) -> Material:
        """Return the material that an object names; the default where it names none."""
        if name is not None and name not in self.materials:
            known = ", ".join(self.materials) or "none"
            raise InputError(f"there is no material {name!r}; the appearance has {known}")
        return DEFAULT_MATERIAL if name is None else self.materials[name]
