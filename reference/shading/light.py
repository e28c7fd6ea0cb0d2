"""Phong on true hits, in double precision, with the true eye vector and no flips at all.

CONVENTIONS.md, "Light", states the formula. Shading does not distinguish the two cameras: the eye vector
is -d of the pixel's own line on both sides of the plate, and the normal is turned to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from xfrustum.reference.backend import Float64, Table, UInt32, Vector, constants, dot, dr, table
from xfrustum.reference.shading.interpolation import Corners, Places, smoothed
from xfrustum.reference.shading.surroundings import Surroundings, Textures
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.scene import Scene

TERMS = ("ambient", "diffuse", "specular", "reflectivity")
"""Names of a material's coefficients."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """Surface points as they are seen, in the arrays of NumPy or Dr.Jit.

    Attributes
    ----------
    triangle
        Triangle numbers.
    normal
        Unit normals of the triangles, by the winding.
    position
        Points, scene units.
    direction
        Direction d of each point's line, of any length, from the viewer to the back.
    """

    triangle: Any
    normal: Vector
    position: Vector
    direction: Vector


@dataclass(frozen=True, kw_only=True, eq=False)
class _Lit:
    """Points as the lights meet them.

    Attributes
    ----------
    normal
        Unit normals for shading, by the winding.
    turn
        Factors 1 or -1 that turn the normals to the viewer.
    eye
        Unit eye vectors.
    facing
        Cosines between the eye vectors and the normals, turned to the viewer.
    albedo
        Albedo of each channel.
    terms
        Coefficients of the materials by `TERMS`, each with one entry for each channel.
    exponent
        Exponents of the materials.
    """

    normal: Vector
    turn: Any
    eye: Vector
    facing: Any
    albedo: Vector
    terms: dict[str, Vector]
    exponent: Any


class LightModel:
    """The light model on one scene's surfaces.

    Parameters
    ----------
    scene
        Scene with materials, lights, environment, normals, colors and textures.
    effects
        Effects that are evaluated.
    channels
        Number of channels that are computed: 1 where all is gray, else 3.
    """

    def __init__(self, scene: Scene, effects: frozenset[Effect], channels: int) -> None:
        self._effects, self._channels = effects, channels
        surface, appearance = scene.surface, scene.appearance
        self._normals: Table | None = None
        self._colors: Table | None = None
        self._pictures: tuple[Textures, Table] | None = None
        if Effect.SMOOTH_NORMALS in effects and surface.vertex_normals is not None:
            self._normals = table(surface.vertex_normals)
        if Effect.VERTEX_COLORS in effects and surface.vertex_colors is not None:
            self._colors = table(surface.vertex_colors)
        if Effect.TEXTURES in effects and surface.texture_of_triangle is not None:
            assert surface.uv is not None
            self._pictures = Textures(surface.textures, surface.texture_of_triangle), table(surface.uv)
        self._corners = Corners(scene) if self._normals or self._colors or self._pictures else None
        # Each material once: its exponent, and the coefficients of all terms.
        materials = list(dict.fromkeys(scene.materials))
        number = {material: np.int32(index) for index, material in enumerate(materials)}
        of_object = np.array([number[material] for material in scene.materials], dtype=np.int32)
        self._alike = len(materials) == 1
        self._material = table(of_object[scene.object_of_triangle])
        rows = [
            (material.exponent, *(value for term in TERMS for value in getattr(material, term)[:channels]))
            for material in materials
        ]
        self._coefficients = table(np.array(rows, dtype=np.float64))
        self._uniform = constants(rows[0])
        exponents = [material.exponent for material in materials]
        whole = all(float(exponent).is_integer() for exponent in exponents)
        self._digits = int(max(exponents)).bit_length() if whole else None
        self._lights = [
            (constants(light.direction), constants(light.color[:channels])) for light in appearance.lights
        ]
        self._environment: Surroundings | None = None
        if Effect.REFLECTION in effects and appearance.environment is not None:
            self._environment = Surroundings(appearance.environment)

    def radiance(self, seen: Seen) -> list[Any]:
        """Return each channel of linear RGB of some points toward the viewer."""
        lit = self._lit(seen)
        color: list[Any] = [0.0] * self._channels
        if Effect.AMBIENT in self._effects:
            color = [term * albedo for term, albedo in zip(lit.terms["ambient"], lit.albedo, strict=True)]
        for toward, intensity in self._lights:
            color = self._with_light(color, toward, intensity, lit)
        if self._environment is not None:
            across = 2.0 * (lit.turn * lit.facing)
            mirrored = [across * n - e for n, e in zip(lit.normal, lit.eye, strict=True)]
            found = self._environment.radiance(mirrored)
            term = lit.terms["reflectivity"]
            color = [own + k * light for own, k, light in zip(color, term, found, strict=True)]
        return color

    def _lit(self, seen: Seen) -> _Lit:
        normal = seen.normal
        albedo: Vector = [1.0] * self._channels
        if self._corners is not None:
            where = self._corners.places(seen.triangle, seen.position)
            if self._normals is not None:
                normal = smoothed(where, self._normals, normal)
            albedo = self._albedo(seen.triangle, where)
        # The side that is seen is that of the triangle, not that of a smoother normal.
        turn = dr.select(dot(seen.normal, seen.direction) > 0.0, -1.0, 1.0)
        shrink = 1.0 / dr.sqrt(dot(seen.direction, seen.direction))
        if self._alike:
            exponent, *coefficients = self._uniform
        else:
            exponent, *coefficients = self._coefficients(self._material(seen.triangle)[0])
        count = self._channels
        return _Lit(
            normal=normal,
            turn=turn,
            eye=[-shrink * coordinate for coordinate in seen.direction],
            facing=turn * -dot(normal, seen.direction) * shrink,
            albedo=albedo,
            terms={term: coefficients[count * k : count * (k + 1)] for k, term in enumerate(TERMS)},
            exponent=exponent,
        )

    def _albedo(self, triangle: Any, where: Places) -> Vector:
        """Return vertex color times texture, with 1 in place of each that is absent."""
        albedo: list[Any] = [1.0] * self._channels
        if self._colors is not None:
            albedo = where.interpolated(self._colors)
        if self._pictures is not None:
            pictures, uv = self._pictures
            painted = pictures.color(triangle, where.interpolated(uv))
            albedo = [own * paint for own, paint in zip(albedo, painted, strict=True)]
        return albedo

    def _with_light(self, color: list[Any], toward: Vector, intensity: Vector, lit: _Lit) -> list[Any]:
        """Add diffuse light by N and L, and a highlight by L and R, the eye vector reflected across N."""
        cosine = lit.turn * dot(lit.normal, toward)
        if Effect.DIFFUSE in self._effects:
            onto = dr.maximum(cosine, 0.0)
            color = [
                own + diffuse * albedo * light * onto
                for own, diffuse, albedo, light in zip(
                    color, lit.terms["diffuse"], lit.albedo, intensity, strict=True
                )
            ]
        if Effect.SPECULAR in self._effects:
            # A cosine rounded to more than one would overflow under a large exponent.
            along = dr.minimum(2.0 * lit.facing * cosine - dot(lit.eye, toward), 1.0)
            highlight = _power(along, lit.exponent, (cosine > 0.0) & (along > 0.0), self._digits)
            color = [
                own + specular * light * highlight
                for own, specular, light in zip(color, lit.terms["specular"], intensity, strict=True)
            ]
        return color


MIN_LOG2 = -1000.0
"""Smallest logarithm to base 2 of a power. Dr.Jit 1.5's `exp2`, and with it `power`, returns minus infinity
for some results below the smallest double of full precision, 2^-1022. Beside radiance, 2^-1000 is nothing."""

MAX_SQUARING_DIGITS = 10
"""Largest number of binary digits of whole exponents for which squarings are faster than a logarithm. Their
roundings add up to 2^10 2^-53 at most, far below those of a float32."""


def _power(base: Any, exponent: Any, where: Any, digits: int | None) -> Any:
    """Return the power where a mask is true, else zero.

    Where all exponents are whole numbers, `digits` is the number of binary digits of the largest; else None.
    """
    if digits is not None and digits <= MAX_SQUARING_DIGITS:
        whole, power = UInt32(exponent), Float64(1.0)
        for digit in range(digits):
            power = dr.select((whole >> digit) & 1 == 1, power * base, power)
            base = base * base
        return dr.select(where, power, 0.0)
    logarithm = exponent * dr.log2(dr.select(where, base, 1.0))
    return dr.select(where, dr.exp2(dr.maximum(logarithm, MIN_LOG2)), 0.0)
