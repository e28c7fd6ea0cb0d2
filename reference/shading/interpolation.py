"""Normals, colors and texture coordinates between vertices, interpolated linearly in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from xfrustum.reference.backend import (
    Table,
    Vector,
    cross,
    difference,
    dot,
    dr,
    on_device,
    recording,
    table,
    vectors_on_device,
)
from xfrustum.scenes.arrays import Floats, Numbers
from xfrustum.scenes.model.scene import Scene


@dataclass(frozen=True, kw_only=True, eq=False)
class Places:
    """Points on triangles.

    Attributes
    ----------
    corners
        Vertex numbers of the first, second and third corner.
    of_second, of_third
        Barycentric coordinates: the weights of the second and the third corner.
    """

    corners: Sequence[Any]
    of_second: Any
    of_third: Any

    def interpolated(self, values: Table) -> list[Any]:
        """Return values between those of vertices; exact where all three corners are equal."""
        first, second, third = (values(corner) for corner in self.corners)
        return [
            a + (self.of_second * (b - a) + self.of_third * (c - a))
            for a, b, c in zip(first, second, third, strict=True)
        ]


class Corners:
    """The corners of a scene's triangles.

    Parameters
    ----------
    scene
        Scene with at least one triangle.
    """

    def __init__(self, scene: Scene) -> None:
        self._vertices, self._faces = table(scene.vertices), table(scene.faces)

    def places(self, triangle: Any, position: Vector) -> Places:
        """Return the place of each point on its triangle, by the areas that it cuts off along the normal."""
        corners = self._faces(triangle)
        origin, *others = (self._vertices(corner) for corner in corners)
        first, second = (difference(other, origin) for other in others)
        offset = difference(position, origin)
        normal = cross(first, second)
        area = dot(normal, normal)
        return Places(
            corners=corners,
            of_second=dot(normal, cross(offset, second)) / area,
            of_third=dot(normal, cross(first, offset)) / area,
        )


def smoothed(where: Places, vertex_normals: Table, flat: Vector) -> list[Any]:
    """Return unit normals between those of the vertices; the flat normal where a corner has none.

    Normals that cancel each other give the flat normal too: there is no direction between opposite ones.
    """
    normal = where.interpolated(vertex_normals)
    length = dr.sqrt(dot(normal, normal))
    found = length > 0.0
    inverse = dr.select(found, length, 1.0)
    return [dr.select(found, own / inverse, other) for own, other in zip(normal, flat, strict=True)]


def smooth_normals(scene: Scene, triangle: Numbers, position: Floats) -> Floats:
    """Return the unit normals (N, 3) between those of the vertices at points (N, 3) of triangles (N,)."""
    assert scene.surface.vertex_normals is not None
    if not len(triangle):
        return np.zeros((0, 3))
    with recording():
        where = Corners(scene).places(on_device(triangle), vectors_on_device(position))
        flat = vectors_on_device(scene.normals[triangle])
        normal = smoothed(where, table(scene.surface.vertex_normals), flat)
        dr.eval(*normal)
        return np.stack([part.numpy() for part in normal], axis=-1)
