"""Shader of a scene on NumPy arrays: its effects and channels, and the color of points."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from xfrustum.reference.backend import Float64, dr, on_device, recording, vectors_on_device
from xfrustum.reference.shading.light import TERMS, LightModel
from xfrustum.scenes.arrays import Floats, Mask, Numbers
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect, needed
from xfrustum.scenes.model.images import NOTHING
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.model.visibility import FAR_MARGIN

#: Effects that can make a gray material colored
COLOR_EFFECTS = frozenset({Effect.VERTEX_COLORS, Effect.TEXTURES})


class Shader:
    """The light model on one scene's surfaces.

    `effects` are the evaluated effects; None selects the effects that the scene needs, and all
    effects at points beyond the reach. Cameras among them have no influence, because the surface of
    each pixel is already decided.
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
        # If all colors are gray, one channel is computed, by the same arithmetic.
        self._channels = 1 if gray and not (interpolated & COLOR_EFFECTS or reflects) else 3

    @cached_property
    def model(self) -> LightModel:
        """The light model on the device."""
        with recording():
            return LightModel(self._scene, self.effects, self._channels)

    def radiance(
        self,
        triangle: Numbers,
        position: Floats,
        direction: Floats,
        hidden: Sequence[Mask] = (),
    ) -> Floats:
        """Return linear RGB of points toward the viewer, (N, 3), or (N, 1) where all is gray.

        Points (N, 3) lie on triangles with numbers (N,); (N, 3) directions d of their lines have
        any length, from the viewer to the back. `hidden` has for each light the points (N,) in its
        shadow; none for lights without shadows.
        """
        if self._automatic and self._out_of_sight(position[:, 2]):
            return self._of_everything.radiance(triangle, position, direction, hidden)
        if not len(triangle):
            return np.zeros((0, self._channels))
        with recording():
            channels = self.model.radiance(
                on_device(triangle),
                vectors_on_device(position),
                vectors_on_device(direction),
                [on_device(mask) for mask in hidden],
            )
            # A channel may be a single number for all lanes, for example without lights: broadcast
            # it.
            shown = [dr.zeros(Float64, len(triangle)) + part for part in channels]
            dr.eval(*shown)
            return np.stack([part.numpy() for part in shown], axis=-1)

    def picture(self, triangle: Numbers, position: Floats, direction: Floats) -> Floats:
        """Return linear RGB (.., 3) of points (.., 3) of triangles (..), black for no triangle."""
        color = np.zeros(position.shape)
        covered = triangle != NOTHING
        color[covered] = self.radiance(triangle[covered], position[covered], direction[covered])
        return color

    @cached_property
    def _of_everything(self) -> Shader:
        return Shader(self._scene, ALL_EFFECTS)

    def _out_of_sight(self, height: Floats) -> bool:
        """Return whether points lie beyond the reach of the effects, as with tiny nears."""
        toward, back = (FAR_MARGIN * reach for reach in self._scene.frustum.reach)
        return len(height) > 0 and not (-back <= height.min() and height.max() <= toward)
