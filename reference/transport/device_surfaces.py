"""Points of surfaces on the device that computes light paths, in double precision.

Only rays are in single precision. The formulas are those of `shading` and `interpolation`, written a second
time on purpose: each checks the other. CONVENTIONS.md, "Light", states them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from xfrustum.reference.llvm import mitsuba_backend
from xfrustum.reference.transport.device_tables import Table, Textures
from xfrustum.scenes.model.scene import Scene

MIN_SQUARED_AREA = 2.0**-1000
"""Smallest squared area that is divided by: it takes the place of that of a triangle without area."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Point:
    """A point of a surface as it is seen.

    Attributes
    ----------
    position
        The point, in scaled scene units.
    side, normal, eye
        Unit vectors: the triangle's own normal and the normal for shading, both turned to the side
        that is seen, and the eye vector.
    albedo
        Vertex color times texture.
    object
        Object number.
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
    """All triangles of a scene, by number.

    Parameters
    ----------
    scene
        Scene with the triangles.
    scale
        Factor by which lengths are multiplied.
    """

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
        """Return where lines meet the planes of triangles, as seen against the lines' directions.

        Parameters
        ----------
        triangle
            Number of the triangle.
        origin, direction
            The line; the direction has any length.
        """
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
