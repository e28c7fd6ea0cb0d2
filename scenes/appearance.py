"""What a scene looks like: its materials and lights, and the default where it names none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from xfrustum.scenes.light import DEFAULT_LIGHT, DirectionalLight, Environment
from xfrustum.scenes.material import DEFAULT_MATERIAL, Material


@dataclass(frozen=True, kw_only=True, eq=False)
class Appearance:
    """Materials by name, lights, and an environment to be reflected.

    Attributes
    ----------
    materials
        By the name that objects refer to.
    lights
        Directional lights.
    environment
        Seen in reflections only; None if there is none.
    """

    materials: Mapping[str, Material] = field(default_factory=lambda: MappingProxyType({}))
    lights: tuple[DirectionalLight, ...] = (DEFAULT_LIGHT,)
    environment: Environment | None = None

    def material(self, name: str | None) -> Material:
        """Return the material that an object names; the default where it names none."""
        return DEFAULT_MATERIAL if name is None else self.materials[name]
