"""Points of surfaces where light paths are computed, in double precision: only rays are in single.

What `shading` and `interpolation` say with NumPy is said here a second time, on purpose: each checks the
other. CONVENTIONS.md, "Light", has the model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from xfrustum.reference.devices.dr_jit import backend
from xfrustum.reference.transport.device_tables import Table, Textures
from xfrustum.scenes.model.scene import Scene

TINY = 2.0**-1000
"""In place of the squared area of a triangle that has none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Point:
    """A point of a surface as it is seen.

    Attributes
    ----------
    position
        Where it is.
    side, normal, eye
        Unit vectors: the triangle's own normal and the one to shade with, both turned to the side
        that is seen, and the direction that it is seen from.
    albedo
        Vertex color times texture.
    object
        Its number.
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
        return 2.0 * backend().drjit.dot(self.normal, self.eye) * self.normal - self.eye


class Surfaces:
    """All triangles of a scene, by number.

    Parameters
    ----------
    scene
        What is there.
    scale
        Lengths are multiplied by this.
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
        self._textures = None
        if surface.texture_of_triangle is not None and surface.uv is not None:
            self._textures = Textures(surface.textures, surface.texture_of_triangle)
            # Rows of three, as all vectors here.
            self._uv = Table(np.pad(surface.uv, ((0, 0), (0, 1))))

    def point(self, triangle: Any, origin: Any, direction: Any) -> Point:
        """Return where lines meet the planes of triangles, as seen against the lines' directions.

        Parameters
        ----------
        triangle
            Its number.
        origin, direction
            The line; the direction has any length.
        """
        mi, dr = backend().mitsuba, backend().drjit
        face = [self._faces.number(3 * triangle + corner) for corner in range(3)]
        a, b, c = (self._vertices.vector(corner) for corner in face)
        flat = self._normals.vector(triangle)
        slope = dr.dot(flat, direction)
        turn = dr.select(slope > 0.0, -1.0, 1.0)
        met = origin + direction * (dr.dot(flat, a - origin) / dr.select(slope == 0.0, 1.0, slope)) - a

        # Kept on the triangle, which a float32 ray that grazes it may meet where the line does not.
        plane = dr.cross(b - a, c - a)
        inverse = 1.0 / dr.maximum(dr.squared_norm(plane), TINY)
        of_b = dr.clip(dr.dot(plane, dr.cross(met, c - a)) * inverse, 0.0, 1.0)
        of_c = dr.clip(dr.dot(plane, dr.cross(b - a, met)) * inverse, 0.0, 1.0 - of_b)
        weights = (1.0 - of_b - of_c, of_b, of_c)

        def between(table: Table) -> Any:
            parts = (weight * table.vector(corner) for weight, corner in zip(weights, face, strict=True))
            return sum(parts, mi.Vector3d(0.0))

        normal, albedo = flat, mi.Vector3d(1.0)
        if self._vertex_normals is not None:
            smooth = between(self._vertex_normals)
            # Not where a corner has none, which is NaN, nor where they cancel each other.
            found = dr.squared_norm(smooth) > 0.0
            normal = dr.normalize(dr.select(found, smooth, flat))
        if self._vertex_colors is not None:
            albedo = albedo * between(self._vertex_colors)
        if self._textures is not None:
            albedo = albedo * self._textures.color(triangle, between(self._uv))
        return Point(
            position=a + of_b * (b - a) + of_c * (c - a),
            side=turn * flat,
            normal=turn * normal,
            eye=-dr.normalize(direction),
            albedo=albedo,
            object=self._objects.number(triangle),
        )
