"""The shader of a scene: effects, channels, and points given in NumPy's arrays."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from xfrustum.reference.devices.arithmetic import NUMPY, Arithmetic
from xfrustum.reference.shading.light import TERMS, LightModel, Seen
from xfrustum.scenes.arrays import Floats, Numbers
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect, needed
from xfrustum.scenes.model.region import FAR_MARGIN
from xfrustum.scenes.model.scene import Scene

COLOR_EFFECTS = frozenset({Effect.VERTEX_COLORS, Effect.TEXTURES})
"""Effects that can make a gray material colored."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Hits:
    """Surface points that are shaded.

    Attributes
    ----------
    triangle
        (N,) triangle numbers.
    normal
        (N, 3) unit normals of the triangles, by the winding.
    position
        (N, 3) points, scene units.
    direction
        (N, 3) direction d of each point's line, of any length, from the viewer to the back.
    """

    triangle: Numbers
    normal: Floats
    position: Floats
    direction: Floats


class Shader:
    """The light model on one scene's surfaces.

    Parameters
    ----------
    scene
        Scene with materials, lights, environment, normals, colors and textures.
    effects
        Effects that are evaluated; None for those that the scene calls for and, at points out of sight, for
        all. The cameras among them are not used, for the surface that a pixel shows has been decided.

    Attributes
    ----------
    effects
        Effects that are evaluated.
    """

    def __init__(self, scene: Scene, effects: frozenset[Effect] | None = None) -> None:
        self._scene = scene
        self.effects = needed(scene) if effects is None else effects
        self._automatic = effects is None
        surface, appearance = scene.surface, scene.appearance
        interpolated = {
            effect
            for effect, attribute in (
                (Effect.SMOOTH_NORMALS, surface.vertex_normals),
                (Effect.VERTEX_COLORS, surface.vertex_colors),
                (Effect.TEXTURES, surface.texture_of_triangle),
            )
            if effect in self.effects and attribute is not None
        }
        materials = scene.materials
        colors = [light.color for light in appearance.lights]
        colors += [getattr(material, term) for material in materials for term in TERMS]
        gray = all(len(set(color)) == 1 for color in colors)
        reflects = Effect.REFLECTION in self.effects and appearance.environment is not None
        # Where all is gray, one channel is computed, by the same arithmetic.
        self._channels = 1 if gray and not (interpolated & COLOR_EFFECTS or reflects) else 3
        self._models: dict[int, LightModel] = {}

    def on(self, by: Arithmetic) -> LightModel:
        """Return the light model in some arithmetic."""
        if id(by) not in self._models:
            self._models[id(by)] = LightModel(by, self._scene, self.effects, self._channels)
        return self._models[id(by)]

    def radiance(self, hits: Hits) -> Floats:
        """Return linear RGB of some points toward the viewer, (N, 3), or (N, 1) where all is gray."""
        if self._automatic and self._out_of_sight(hits):
            return self._of_everything.radiance(hits)
        color = np.empty((len(hits.triangle), self._channels))
        if not len(color):
            return color
        # Coordinate by coordinate, because numpy is several times slower along rows of three.
        normal, position, direction = (
            np.ascontiguousarray(vectors.T) for vectors in (hits.normal, hits.position, hits.direction)
        )
        seen = Seen(triangle=hits.triangle, normal=normal, position=position, direction=direction)
        for channel, values in enumerate(self.on(NUMPY).radiance(seen)):
            color[:, channel] = values
        return color

    @cached_property
    def _of_everything(self) -> Shader:
        """The light model with all effects."""
        return Shader(self._scene, ALL_EFFECTS)

    def _out_of_sight(self, hits: Hits) -> bool:
        """Return whether some points lie beyond everything that effects were decided for.

        With a tiny near some depth buffers show surfaces beyond the reach.
        """
        toward, back = (FAR_MARGIN * reach for reach in self._scene.frustum.reach)
        height = hits.position[:, 2]
        return len(height) > 0 and not (-back <= height.min() and height.max() <= toward)
