"""Points of surfaces where Mitsuba computes light paths, in double precision; only rays are single.

The formulas are those of `shading`, written a second time on purpose: each checks the other. CONVENTIONS.md,
"Light", states them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.llvm import mitsuba_backend, vector_backend
from xfrustum.reference.memory import padded
from xfrustum.reference.shading.surroundings import LINEAR
from xfrustum.scenes.appearance.appearance import Environment
from xfrustum.scenes.arrays import Bytes, Numbers
from xfrustum.scenes.model.scene import Scene

MIN_SQUARED_AREA = 2.0**-1000
"""Smallest squared area that is divided by: it takes the place of that of a triangle without area."""


class Table:
    """Numbers, or rows of three, looked up by index."""

    def __init__(self, entries: NDArray[Any]) -> None:
        mi = vector_backend().mitsuba
        kinds = {"float64": mi.Float64, "float32": mi.Float32, "int32": mi.Int32, "uint32": mi.UInt32}
        self._array = kinds[str(entries.dtype)](padded(entries, entries.dtype))
        self._vector = mi.Vector3f if entries.dtype == np.float32 else mi.Vector3d

    def number(self, index: Any) -> Any:
        """Return an entry; the index counts all entries of all rows."""
        return mitsuba_backend().drjit.gather(type(self._array), self._array, index)

    def vector(self, row: Any) -> Any:
        """Return a row of three as a vector of doubles."""
        backend = mitsuba_backend()
        return backend.mitsuba.Vector3d(backend.drjit.gather(self._vector, self._array, row))


class Textures:
    """All pictures in one table, four bytes a texel; see `shading.surroundings.Textures`."""

    def __init__(self, textures: tuple[Bytes, ...], texture_of_triangle: Numbers) -> None:
        packed = [np.ascontiguousarray(texture).view("<u4").ravel() for texture in textures]
        self._texels = Table(np.concatenate(packed).astype(np.uint32, copy=False))
        self._starts = Table(np.cumsum([0, *(len(part) for part in packed[:-1])]).astype(np.int32))
        self._heights, self._widths = (
            Table(np.array([texture.shape[axis] for texture in textures], dtype=np.int32)) for axis in (0, 1)
        )
        self._of_triangle = Table(texture_of_triangle.astype(np.int32))
        self._linear = Table(LINEAR)

    def color(self, triangle: Any, uv: Any) -> Any:
        """Return linear RGB at texture coordinates, x and y of a vector; 1 where there is no texture."""
        mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
        number = self._of_triangle.number(triangle)
        textured = number >= 0
        number = dr.maximum(number, 0)
        start, width, height = (t.number(number) for t in (self._starts, self._widths, self._heights))

        def texel(row: Any, column: Any) -> Any:
            code = self._texels.number(start + _repeated(row, height) * width + _repeated(column, width))
            return mi.Vector3d(*(self._linear.number((code >> bits) & 255) for bits in (0, 8, 16)))

        u, v = dr.select(textured, uv.x, 0.0), dr.select(textured, uv.y, 0.0)
        found = _between_texels(texel, (1.0 - v) * mi.Float64(height), u * mi.Float64(width))
        return dr.select(textured, found, mi.Vector3d(1.0))


class Surroundings:
    """The environment by direction."""

    def __init__(self, environment: Environment) -> None:
        self._height, self._width = environment.radiance.shape[:2]
        self._strength = environment.strength
        self._texels = Table(environment.radiance)

    def radiance(self, direction: Any) -> Any:
        """Return the environment's linear RGB in a direction, of any length."""
        dr = mitsuba_backend().drjit

        def texel(row: Any, column: Any) -> Any:
            inside = dr.clip(row, 0.0, self._height - 1.0)
            index = mitsuba_backend().mitsuba.Int32(inside) * self._width + _repeated(column, self._width)
            return self._texels.vector(index)

        around = dr.atan2(direction.x, -direction.z) / (2.0 * dr.pi) + 0.5
        down = 0.5 - dr.atan2(direction.y, dr.hypot(direction.x, direction.z)) / dr.pi
        return self._strength * _between_texels(texel, down * self._height, around * self._width)


@dataclass(frozen=True, kw_only=True, eq=False)
class Point:
    """A point of a surface as it is seen, in scaled scene units.

    `side`, `normal` and `eye` are unit vectors: the triangle's own normal and the normal for shading, both
    turned to the side that is seen, and the eye vector. `albedo` is vertex color times texture.
    """

    position: Any
    side: Any
    normal: Any
    eye: Any
    albedo: Any
    object: Any

    @property
    def mirrored(self) -> Any:
        """The eye vector reflected across the normal."""
        return 2.0 * mitsuba_backend().drjit.dot(self.normal, self.eye) * self.normal - self.eye


class Surfaces:
    """All triangles of a scene, by number; lengths are multiplied by a scale."""

    def __init__(self, scene: Scene, scale: float) -> None:
        surface = scene.surface
        self._vertices = Table(scene.vertices * scale)
        self._faces = Table(scene.faces.astype(np.int32))
        self._normals = Table(scene.normals)
        self._objects = Table(scene.object_of_triangle)
        names = ("vertex_normals", "vertex_colors")
        self._vertex_normals, self._vertex_colors = (
            None if getattr(surface, name) is None else Table(getattr(surface, name)) for name in names
        )
        self._textures: tuple[Textures, Table] | None = None
        if surface.texture_of_triangle is not None and surface.uv is not None:
            pictures = Textures(surface.textures, surface.texture_of_triangle)
            # Texture coordinates are padded to rows of three, as all vectors of a `Table` are.
            self._textures = pictures, Table(np.pad(surface.uv, ((0, 0), (0, 1))))

    def point(self, triangle: Any, origin: Any, direction: Any) -> Point:
        """Return where lines, of any length, meet the planes of triangles, as seen against them."""
        mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
        face = [self._faces.number(3 * triangle + corner) for corner in range(3)]
        a, b, c = (self._vertices.vector(corner) for corner in face)
        flat = self._normals.vector(triangle)
        slope = dr.dot(flat, direction)
        turn = dr.select(slope > 0.0, -1.0, 1.0)
        met = origin + direction * (dr.dot(flat, a - origin) / dr.select(slope == 0.0, 1.0, slope)) - a

        # The point is kept on the triangle: a float32 ray may graze a triangle that the line misses.
        plane = dr.cross(b - a, c - a)
        inverse = 1.0 / dr.maximum(dr.squared_norm(plane), MIN_SQUARED_AREA)
        of_b = dr.clip(dr.dot(plane, dr.cross(met, c - a)) * inverse, 0.0, 1.0)
        of_c = dr.clip(dr.dot(plane, dr.cross(b - a, met)) * inverse, 0.0, 1.0 - of_b)
        weights = (1.0 - of_b - of_c, of_b, of_c)

        def between(table: Table) -> Any:
            parts = (weight * table.vector(corner) for weight, corner in zip(weights, face, strict=True))
            return sum(parts, mi.Vector3d(0.0))

        normal, albedo = flat, mi.Vector3d(1.0)
        if self._vertex_normals is not None:
            smooth = between(self._vertex_normals)
            # The flat normal where a corner has none, which makes the sum NaN, and where normals cancel.
            found = dr.squared_norm(smooth) > 0.0
            normal = dr.normalize(dr.select(found, smooth, flat))
        if self._vertex_colors is not None:
            albedo = albedo * between(self._vertex_colors)
        if self._textures is not None:
            pictures, uv = self._textures
            albedo = albedo * pictures.color(triangle, between(uv))
        return Point(
            position=a + of_b * (b - a) + of_c * (c - a),
            side=turn * flat,
            normal=turn * normal,
            eye=-dr.normalize(direction),
            albedo=albedo,
            object=self._objects.number(triangle),
        )


def _repeated(index: Any, size: Any) -> Any:
    """Return a whole number, given as a double, as an index modulo a size."""
    mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
    count = mi.Float64(size)
    whole = index - count * dr.floor(index / count)
    return mi.Int32(whole)


def _between_texels(texel: Callable[[Any, Any], Any], down: Any, right: Any) -> Any:
    """Mix the four texels whose centers, at halves, enclose a place; `texel` takes whole rows and columns."""
    dr = mitsuba_backend().drjit
    row, column = dr.floor(down - 0.5), dr.floor(right - 0.5)
    below, beside = down - 0.5 - row, right - 0.5 - column
    upper = dr.lerp(texel(row, column), texel(row, column + 1.0), beside)
    lower = dr.lerp(texel(row + 1.0, column), texel(row + 1.0, column + 1.0), beside)
    return dr.lerp(upper, lower, below)
