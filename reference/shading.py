"""Color of true hits: Phong in double precision, the shader of a scene, and exact shadows.

**Light.** CONVENTIONS.md, "Light", states the formula. Shading does not distinguish the two
cameras: the eye vector is -d of the pixel's line on both sides of the plate, without a flip, and
the normal is turned toward it. Between vertices, normals, colors and texture coordinates are
interpolated linearly in space. Textures are decoded from sRGB, then filtered bilinearly between
texel centers, without mipmaps, and repeated. There is one lane of Dr.Jit for each point.

**Shadows** are exact for the doubles of point and light (docs/truth.md). A point is in shadow if
its ray to the light meets a triangle at t > 0. Triangles in the plane of the point's own triangle
are excluded by number: the ray meets this plane only in the point, which rounding has moved to
either side. A triangle does not shadow lights below its own plane, toward which smooth normals may
point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from xfrustum.reference.backend import (
    Float64,
    Int32,
    Table,
    UInt32,
    Vector,
    constants,
    cross,
    difference,
    dot,
    dr,
    on_device,
    recording,
    table,
    vectors_on_device,
)
from xfrustum.reference.certify.cone import ROUNDING
from xfrustum.reference.rays.filter import UNDERFLOW_BOUND, coordinates, integers, meet
from xfrustum.reference.rays.rays import ExactMesh, RayBatch
from xfrustum.scenes.appearance import Environment
from xfrustum.scenes.arrays import Bytes, Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect, needed
from xfrustum.scenes.model.images import NOTHING
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.model.visibility import FAR_MARGIN

_SRGB = np.arange(256) / 255.0
#: Linear light of each 8-bit sRGB value (IEC 61966-2-1)
LINEAR = np.where(_SRGB <= 0.04045, _SRGB / 12.92, ((_SRGB + 0.055) / 1.055) ** 2.4)


class Textures:
    """The pictures of a scene in one table, one texel after the other.

    Each picture is (H, W, 4) sRGB, row 0 at the top; alpha is ignored. `texture_of_triangle` (F,)
    has the index of each triangle's picture, negative for none.
    """

    def __init__(self, textures: Sequence[Bytes], texture_of_triangle: Numbers) -> None:
        packed = [np.ascontiguousarray(texture).view("<u4").ravel() for texture in textures]
        self._texel = table(np.concatenate([*packed, np.zeros(1)]).astype(np.uint32))
        starts = np.cumsum([0, *(len(part) for part in packed)])
        # Start, height and width of each picture. A last row serves scenes without pictures.
        sizes = [texture.shape[:2] for texture in textures]
        self._sizes = table(
            np.array(
                [(start, *size) for start, size in zip(starts, [*sizes, (1, 1)], strict=True)],
                np.int32,
            )
        )
        self._of_triangle = table(texture_of_triangle.astype(np.int32))
        self._linear = table(LINEAR)

    def color(self, triangle: Any, uv: Sequence[Any]) -> list[Any]:
        """Return the linear RGB of points on triangles; 1 for triangles without a picture.

        `uv` are in units of the picture: u to the right, v up, repeated beyond 0 to 1.
        """
        (number,) = self._of_triangle(triangle)
        textured = number >= 0
        start, height, width = self._sizes(dr.maximum(number, 0))

        def texel(row: Any, column: Any) -> list[Any]:
            place = start + _repeated(row, height) * width + _repeated(column, width)
            (code,) = self._texel(place)
            return [self._linear((code >> bits) & 255)[0] for bits in (0, 8, 16)]

        u, v = (dr.select(textured, coordinate, 0.0) for coordinate in uv)
        texel_color = _bilinear(texel, (1.0 - v) * height, u * width)
        return [dr.select(textured, channel, 1.0) for channel in texel_color]


class Surroundings:
    """An environment by direction."""

    def __init__(self, environment: Environment) -> None:
        height, width = environment.radiance.shape[:2]
        self._texel = table(environment.radiance.reshape(-1, 3))
        self._height, self._width, self._strength = constants((height, width, environment.strength))

    def radiance(self, directions: Sequence[Any]) -> list[Any]:
        """Return the environment's linear RGB in each direction, of any length but zero.

        The middle of the map is at -z, and its top is at +y; +x is to the right of the middle.
        The map is filtered bilinearly between texel centers, repeated in longitude, and clamped
        beyond its first and last row.
        """
        x, y, z = directions
        longitude = dr.atan2(x, -z)
        # Near the poles, the arc tangent is accurate, and the arc cosine of y is not.
        from_top = dr.atan2(dr.hypot(x, z), y)  # type: ignore[no-untyped-call]

        def texel(row: Any, column: Any) -> list[Any]:
            inside = _bounded(row, self._height - 1.0)
            return self._texel(Int32(inside * self._width) + _repeated(column, self._width))

        right, down = (
            (longitude / (2.0 * np.pi) + 0.5) * self._width,
            from_top / np.pi * self._height,
        )
        return [self._strength * channel for channel in _bilinear(texel, down, right)]


def radiance_toward(environment: Environment, directions: Floats) -> Floats:
    """Return the environment's linear RGB (N, 3) in directions (N, 3) of any length but zero."""
    if not len(directions):
        return np.zeros((0, 3))
    with recording():
        channels = Surroundings(environment).radiance(vectors_on_device(directions))
        dr.eval(*channels)
        return np.stack([channel.numpy() for channel in channels], axis=-1)


def _bilinear(texel: Callable[[Any, Any], list[Any]], down: Any, right: Any) -> list[Any]:
    """Return the channels between the centers of the four texels about each point.

    `texel` looks up rows and columns, whole numbers as doubles, also outside of the picture. `down`
    and `right` count texels from the top left corner of the picture; texel centers lie at halves.
    """
    row, column = dr.floor(down - 0.5), dr.floor(right - 0.5)
    below, right_share = down - 0.5 - row, right - 0.5 - column

    def mixed(first: list[Any], other: list[Any], share: Any) -> list[Any]:
        return [(1.0 - share) * a + share * b for a, b in zip(first, other, strict=True)]

    upper = mixed(texel(row, column), texel(row, column + 1.0), right_share)
    lower = mixed(texel(row + 1.0, column), texel(row + 1.0, column + 1.0), right_share)
    return mixed(upper, lower, below)


def _repeated(index: Any, size: Any) -> Any:
    """Return whole numbers, given as doubles, as indices modulo a size."""
    # The remainder of a large number may be just below zero, because the quotient is rounded up.
    return Int32(_bounded(index - size * dr.floor(index / size), size - 1.0))


def _bounded(index: Any, last: Any) -> Any:
    """Return whole numbers clipped to 0 and `last`, 0 for NaN: indices within a table."""
    index = dr.select(index > 0.0, index, 0.0)
    return dr.select(index < last, index, last)


TERMS = ("ambient", "diffuse", "specular", "reflectivity")  #: names of a material's coefficients

#: Smallest logarithm to base 2 of a power. `exp2` and `power` of Dr.Jit 1.5 return minus infinity
#: for some results below the smallest double of full precision, 2^-1022. A radiance of 2^-1000 is
#: negligible.
MIN_LOG2 = -1000.0

#: Largest number of binary digits of integer exponents for which squarings are faster than a
#: logarithm. Their rounding errors add up to at most 2^10 2^-53, far below the rounding of a
#: float32.
MAX_SQUARING_DIGITS = 10


class LightModel:
    """Light model of a scene's surfaces for some effects; 1 channel in a gray scene, else 3."""

    def __init__(self, scene: Scene, effects: frozenset[Effect], channels: int) -> None:
        self._effects, self._channels = effects, channels
        surface, appearance = scene.surface, scene.appearance
        self._flat = table(scene.normals)
        self._normals: Table | None = None
        self._colors: Table | None = None
        self._pictures: tuple[Textures, Table] | None = None
        if Effect.SMOOTH_NORMALS in effects and surface.vertex_normals is not None:
            self._normals = table(surface.vertex_normals)
        if Effect.VERTEX_COLORS in effects and surface.vertex_colors is not None:
            self._colors = table(surface.vertex_colors)
        if Effect.TEXTURES in effects and surface.texture_of_triangle is not None:
            assert surface.uv is not None
            self._pictures = (
                Textures(surface.textures, surface.texture_of_triangle),
                table(surface.uv),
            )
        self._corners = _Corners(scene) if self._normals or self._colors or self._pictures else None
        # Store exponent and coefficients of all terms once for each distinct material.
        materials = list(dict.fromkeys(scene.materials))
        number = {material: np.int32(index) for index, material in enumerate(materials)}
        of_object = np.array([number[material] for material in scene.materials], dtype=np.int32)
        self._alike = len(materials) == 1
        self._material = table(of_object[scene.object_of_triangle])
        rows = [
            (
                material.exponent,
                *(value for term in TERMS for value in getattr(material, term)[:channels]),
            )
            for material in materials
        ]
        self._coefficients = table(np.array(rows, dtype=np.float64))
        self._uniform = constants(rows[0])
        exponents = [material.exponent for material in materials]
        whole = all(float(exponent).is_integer() for exponent in exponents)
        self._digits = int(max(exponents)).bit_length() if whole else None
        self._lights = [
            (constants(light.direction), constants(light.color[:channels]))
            for light in appearance.lights
        ]
        self._environment: Surroundings | None = None
        if Effect.REFLECTION in effects and appearance.environment is not None:
            self._environment = Surroundings(appearance.environment)

    def radiance(
        self, triangle: Any, position: Vector, direction: Vector, hidden: Sequence[Any] = ()
    ) -> list[Any]:
        """Return the channels of linear RGB toward the viewer at points of triangles, scene units.

        `direction` is d of each point's line, of any length, from the viewer to the back. `hidden`
        masks the points in the shadow of each light; none for lights without shadows.
        """
        flat = self._flat(triangle)
        normal, albedo = self._surface(triangle, position, flat)
        # The triangle's own normal decides the visible side, not the smooth normal.
        turn = dr.select(dot(flat, direction) > 0.0, -1.0, 1.0)
        shrink = 1.0 / dr.sqrt(dot(direction, direction))
        eye = [-shrink * coordinate for coordinate in direction]
        facing = turn * -dot(normal, direction) * shrink
        ambient, diffuse, specular, reflectivity, exponent = self._materials(triangle)
        color: list[Any] = [0.0] * self._channels
        if Effect.AMBIENT in self._effects:
            color = [term * own for term, own in zip(ambient, albedo, strict=True)]
        masks = hidden or [False] * len(self._lights)
        for (toward, intensity), mask in zip(self._lights, masks, strict=True):
            # Lights behind the surface and hidden lights contribute nothing.
            cosine = dr.select(mask, 0.0, turn * dot(normal, toward))
            if Effect.DIFFUSE in self._effects:
                onto = dr.maximum(cosine, 0.0)
                terms = zip(color, diffuse, albedo, intensity, strict=True)
                color = [own + term * painted * light * onto for own, term, painted, light in terms]
            if Effect.SPECULAR in self._effects:
                # Use L and R, the eye vector reflected across N. A cosine rounded to more than one
                # would overflow with a large exponent.
                along = dr.minimum(2.0 * facing * cosine - dot(eye, toward), 1.0)
                highlight = _power(along, exponent, (cosine > 0.0) & (along > 0.0), self._digits)
                lit = zip(color, specular, intensity, strict=True)
                color = [own + term * light * highlight for own, term, light in lit]
        if self._environment is not None:
            across = 2.0 * (turn * facing)
            mirrored = [across * n - e for n, e in zip(normal, eye, strict=True)]
            seen = zip(color, reflectivity, self._environment.radiance(mirrored), strict=True)
            color = [own + term * light for own, term, light in seen]
        return color

    def _surface(self, triangle: Any, position: Vector, flat: Vector) -> tuple[Vector, Vector]:
        """Return unit normals for shading, on the winding's side, and albedo (color, texture)."""
        normal: Vector = flat
        albedo: list[Any] = [1.0] * self._channels
        if self._corners is None:
            return normal, albedo
        where = self._corners.places(triangle, position)
        if self._normals is not None:
            normal = _smoothed(where, self._normals, flat)
        if self._colors is not None:
            albedo = where.interpolated(self._colors)
        if self._pictures is not None:
            pictures, uv = self._pictures
            painted = pictures.color(triangle, where.interpolated(uv))
            albedo = [own * paint for own, paint in zip(albedo, painted, strict=True)]
        return normal, albedo

    def _materials(self, triangle: Any) -> list[Any]:
        """Return coefficients of each term and channel, in the order of `TERMS`, and exponents."""
        values = self._uniform
        if not self._alike:
            values = self._coefficients(self._material(triangle)[0])
        exponent, *coefficients = values
        count = self._channels
        return [*(coefficients[count * k : count * (k + 1)] for k in range(len(TERMS))), exponent]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Places:
    """Points on triangles: vertex numbers, and barycentric weights of corners two and three."""

    corners: Sequence[Any]
    of_second: Any
    of_third: Any

    def interpolated(self, values: Table) -> list[Any]:
        """Return values interpolated between vertices; exact where all three corners are equal."""
        first, second, third = (values(corner) for corner in self.corners)
        return [
            a + (self.of_second * (b - a) + self.of_third * (c - a))
            for a, b, c in zip(first, second, third, strict=True)
        ]


class _Corners:
    """The corners of a scene's triangles, at least one."""

    def __init__(self, scene: Scene) -> None:
        self._vertices, self._faces = table(scene.vertices), table(scene.faces)

    def places(self, triangle: Any, position: Vector) -> _Places:
        """Return the barycentric place of each point on its triangle, by areas along the normal."""
        corners = self._faces(triangle)
        origin, *others = (self._vertices(corner) for corner in corners)
        first, second = (difference(other, origin) for other in others)
        offset = difference(position, origin)
        normal = cross(first, second)
        area = dot(normal, normal)
        return _Places(
            corners=corners,
            of_second=dot(normal, cross(offset, second)) / area,
            of_third=dot(normal, cross(first, offset)) / area,
        )


def smooth_normals(scene: Scene, triangle: Numbers, position: Floats) -> Floats:
    """Return interpolated unit normals (N, 3) at points (N, 3) of triangles (N,)."""
    assert scene.surface.vertex_normals is not None
    if not len(triangle):
        return np.zeros((0, 3))
    with recording():
        where = _Corners(scene).places(on_device(triangle), vectors_on_device(position))
        flat = vectors_on_device(scene.normals[triangle])
        normal = _smoothed(where, table(scene.surface.vertex_normals), flat)
        dr.eval(*normal)
        return np.stack([part.numpy() for part in normal], axis=-1)


def _smoothed(where: _Places, vertex_normals: Table, flat: Vector) -> list[Any]:
    """Return unit normals interpolated between vertices; the flat normal where a corner has none.

    Normals that cancel each other also give the flat normal, because opposite normals have no
    direction between them.
    """
    normal = where.interpolated(vertex_normals)
    length = dr.sqrt(dot(normal, normal))
    defined = length > 0.0
    inverse = dr.select(defined, length, 1.0)
    return [
        dr.select(defined, own / inverse, other) for own, other in zip(normal, flat, strict=True)
    ]


def _power(base: Any, exponent: Any, where: Any, digits: int | None) -> Any:
    """Return the power where a mask is true, else zero; exponents have at most `digits` bits."""
    if digits is not None and digits <= MAX_SQUARING_DIGITS:
        whole, power = UInt32(exponent), Float64(1.0)
        for digit in range(digits):
            power = dr.select((whole >> digit) & 1 == 1, power * base, power)
            base = base * base
        return dr.select(where, power, 0.0)
    logarithm = exponent * dr.log2(dr.select(where, base, 1.0))
    return dr.select(where, dr.exp2(dr.maximum(logarithm, MIN_LOG2)), 0.0)


#: Effects that can make a gray material colored
COLOR_EFFECTS = frozenset({Effect.VERTEX_COLORS, Effect.TEXTURES})


class Shader:
    """The light model on one scene's surfaces.

    `effects` are the evaluated effects; None selects the effects that the scene needs, and all
    effects at points beyond the reach. Effects of cameras have no influence, because the surface of
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

        `position` (N, 3) are points on triangles (N,). `direction` (N, 3) is d of each point's
        line, of any length, from the viewer to the back. `hidden` has a mask (N,) of the points in
        the shadow of each light; it is empty for lights without shadows.
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
        """Return whether any point is beyond the reach within which effects were selected."""
        toward, back = (FAR_MARGIN * reach for reach in self._scene.frustum.reach)
        return len(height) > 0 and not (-back <= height.min() and height.max() <= toward)


#: first t of a ray to a light: above zero, because a surface that touches the point hides nothing
FIRST = float(np.nextafter(0.0, 1.0))


class ShadowedShader:
    """The light model of a scene with at least one triangle, and the shadows of its lights."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._shader = Shader(scene)
        self._mesh = ExactMesh(scene.vertices, scene.faces)

    def picture(self, triangle: Numbers, position: Floats, direction: Floats) -> Floats:
        """Return linear RGB of points; see `Shader.picture`."""
        color = np.zeros(position.shape)
        covered = triangle != NOTHING
        points = triangle[covered].astype(np.int64), position[covered], direction[covered]
        hidden = [
            self.hidden(*points, np.asarray(light.direction))
            for light in self._scene.appearance.lights
        ]
        color[covered] = self._shader.radiance(triangle[covered], *points[1:], hidden)
        return color

    def hidden(self, triangle: Indices, position: Floats, direction: Floats, light: Floats) -> Mask:
        """Return a mask (N,) of points (N, 3) of triangles (N,) that are hidden from a light.

        `direction` (N, 3) leads from the viewer to each point; `light` (3,) leads to the light.
        """
        hidden = np.zeros(len(triangle), dtype=np.bool_)
        normal = self._scene.normals[triangle]
        # The visible side faces the light if viewer and light are on one side of the plane.
        facing = np.flatnonzero(np.einsum("ij,ij->i", normal, direction) * (normal @ light) < 0)
        rays = RayBatch(
            origins=position[facing],
            directions=np.tile(light, (len(facing), 1)),
            ends=np.tile([FIRST, np.inf], (len(facing), 1)),
        )
        pairs = self._mesh.candidates(rays)
        pairs = pairs[~self._coplanar(triangle[facing[pairs.ray]], pairs.triangle)]
        hidden[facing[pairs.ray[pairs.sure]]] = True
        doubtful = pairs[~pairs.sure & ~hidden[facing[pairs.ray]]]
        some = rays[doubtful.ray]
        decided = meet(
            self._mesh.triangles[doubtful.triangle], some.origins, some.directions, some.ends
        )
        hidden[facing[doubtful.ray[decided.met]]] = True
        return hidden

    def _coplanar(self, first: Indices, second: Indices) -> Mask:
        """Return a mask (K,) of triangles in the plane of another triangle, decided in integers."""
        a, b = self._mesh.triangles[first], self._mesh.triangles[second]
        coplanar: Mask = first == second
        # Doubles exclude most pairs: a corner is off the plane by more than its rounding bound.
        edges = np.abs(a[:, 1:] - a[:, :1])
        offsets = b - a[:, :1]
        normal = np.cross(a[:, 1] - a[:, 0], a[:, 2] - a[:, 0])
        height = np.abs(np.einsum("kij,kj->ki", offsets, normal))
        magnitude = np.einsum("kij,kj->ki", np.abs(offsets), _unsigned_cross(edges))
        close = (height <= ROUNDING * magnitude + UNDERFLOW_BOUND).all(axis=1)
        possible = np.flatnonzero(close & ~coplanar)
        (own, other), _ = integers(a[possible], b[possible])
        p, q = coordinates(own), coordinates(other)
        corners, others = ([[axis[:, k] for axis in v] for k in range(3)] for v in (p, q))
        plane = cross(difference(corners[1], corners[0]), difference(corners[2], corners[0]))
        flat = [dot(plane, difference(corner, corners[0])) == 0 for corner in others]
        coplanar[possible] = np.logical_and.reduce([part.astype(np.bool_) for part in flat])
        return coplanar


def _unsigned_cross(edges: Floats) -> Floats:
    """Return cross products of unsigned vectors (K, 2, 3), with sums in place of differences."""
    (ax, ay, az), (bx, by, bz) = edges[:, 0].T, edges[:, 1].T
    return np.stack((ay * bz + az * by, az * bx + ax * bz, ax * by + ay * bx), axis=1)
