"""Phong on true hits, in double precision, with the true eye vector and no flips at all.

CONVENTIONS.md, "Light", states the formula. Shading does not distinguish the two cameras: the eye vector
is -d of the pixel's own line on both sides of the plate, and the normal is turned to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from xfrustum.reference.shading.environment import radiance_toward
from xfrustum.reference.shading.interpolation import Places, albedo, places, smooth_normals
from xfrustum.scenes.appearance.light import DirectionalLight
from xfrustum.scenes.arrays import Floats, Numbers
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect, needed
from xfrustum.scenes.model.region import FAR_MARGIN
from xfrustum.scenes.model.scene import Scene

COLOR_EFFECTS = frozenset({Effect.VERTEX_COLORS, Effect.TEXTURES})
"""Effects that can make a gray material colored."""

TERMS = ("ambient", "diffuse", "specular", "reflectivity")
"""Names of a material's coefficients."""


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


@dataclass(frozen=True, kw_only=True, eq=False)
class _Surface:
    """The surface as the lights meet it at each point.

    Attributes
    ----------
    normal
        (N, 3) unit normals for shading, by the winding.
    turn
        (N,) factors 1 or -1 that turn the normals to the viewer.
    direction, shrink
        (N, 3) directions d of the lines, and (N,) 1 / |d|: the eye vector is - shrink d.
    albedo
        (N, 3) albedo, or the number 1.
    material
        (N,) index of the material, or None where there is only one.
    """

    normal: Floats
    turn: Floats
    direction: Floats
    shrink: Floats
    albedo: Floats | float
    material: Numbers | None


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
        self._interpolated = {
            effect
            for effect, attribute in (
                (Effect.SMOOTH_NORMALS, surface.vertex_normals),
                (Effect.VERTEX_COLORS, surface.vertex_colors),
                (Effect.TEXTURES, surface.texture_of_triangle),
            )
            if effect in self.effects and attribute is not None
        }
        self._reflects = Effect.REFLECTION in self.effects and appearance.environment is not None
        materials = list(dict.fromkeys(scene.materials))
        number = {material: np.int32(index) for index, material in enumerate(materials)}
        self._material_of_object = np.array([number[m] for m in scene.materials], dtype=np.int32)
        colors = [light.color for light in appearance.lights]
        colors += [getattr(material, term) for material in materials for term in TERMS]
        gray = all(len(set(color)) == 1 for color in colors)
        # Where all is gray, one channel is computed, by the same arithmetic.
        self._channels = 1 if gray and not (self._interpolated & COLOR_EFFECTS or self._reflects) else 3
        self._coefficients = {
            term: np.array([getattr(m, term) for m in materials]).reshape(-1, 3)[:, : self._channels]
            for term in TERMS
        }
        self._exponents = np.array([material.exponent for material in materials])

    def radiance(self, hits: Hits) -> Floats:
        """Return linear RGB of some points toward the viewer, (N, 3), or (N, 1) where all is gray."""
        if self._automatic and self._out_of_sight(hits):
            return self._of_everything.radiance(hits)
        surface = self._surface(hits)
        facing = surface.turn * -_dot(surface.normal, surface.direction) * surface.shrink
        color = np.zeros((len(hits.triangle), self._channels))
        if Effect.AMBIENT in self.effects:
            color += self._of_material("ambient", surface) * surface.albedo
        for light in self._scene.appearance.lights:
            self._add_light(color, light, surface, facing)
        if self._reflects:
            assert self._scene.appearance.environment is not None
            eye = -surface.shrink[:, None] * surface.direction
            mirrored = 2.0 * (surface.turn * facing)[:, None] * surface.normal - eye
            seen = radiance_toward(self._scene.appearance.environment, mirrored)
            color += self._of_material("reflectivity", surface) * seen
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

    def _surface(self, hits: Hits) -> _Surface:
        scene, normal = self._scene, hits.normal
        where: Places | None = None
        if self._interpolated:
            where = places(scene, hits.triangle, hits.position)
            if Effect.SMOOTH_NORMALS in self._interpolated:
                normal = smooth_normals(scene, where, normal)
        return _Surface(
            normal=normal,
            # The side that is seen is that of the triangle, not that of a smoother normal.
            turn=np.where(_dot(hits.normal, hits.direction) > 0, -1.0, 1.0),
            direction=hits.direction,
            shrink=1.0 / np.sqrt(_dot(hits.direction, hits.direction)),
            albedo=1.0 if where is None else albedo(scene, where, self._interpolated),
            material=self._materials(hits.triangle),
        )

    def _add_light(self, color: Floats, light: DirectionalLight, surface: _Surface, facing: Floats) -> None:
        """Add diffuse light by N and L, and a highlight by L and R, the eye vector reflected across N."""
        toward, intensity = np.array(light.direction), np.array(light.color)[: self._channels]
        cosine = surface.turn * (surface.normal @ toward)
        if Effect.DIFFUSE in self.effects:
            diffuse = self._of_material("diffuse", surface) * surface.albedo * intensity
            color += diffuse * np.maximum(cosine, 0.0)[:, None]
        if Effect.SPECULAR in self.effects:
            toward_eye = -surface.shrink * (surface.direction @ toward)
            # A cosine rounded to more than one would overflow under a large exponent.
            along = np.minimum(2.0 * facing * cosine - toward_eye, 1.0)
            highlight = np.zeros(len(along))
            exponent = self._exponents[0 if surface.material is None else surface.material]
            np.power(along, exponent, out=highlight, where=(cosine > 0) & (along > 0))
            color += self._of_material("specular", surface) * intensity * highlight[:, None]

    def _materials(self, triangle: Numbers) -> Numbers | None:
        if len(self._exponents) == 1:
            return None
        return self._material_of_object[self._scene.object_of_triangle[triangle]]

    def _of_material(self, term: str, surface: _Surface) -> Floats:
        """Return a coefficient of each point's material, (N, C), or (C,) where there is one material."""
        return self._coefficients[term][0 if surface.material is None else surface.material]


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("ij,ij->i", a, b))
