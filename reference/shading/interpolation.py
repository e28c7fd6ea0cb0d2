"""Normals, colors and textures between vertices, interpolated linearly in space."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, fields

import numpy as np

from xfrustum.reference.shading.textures import texture_color
from xfrustum.scenes.arrays import Floats, Indices, Numbers
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.scene import Scene


@dataclass(frozen=True, kw_only=True, eq=False)
class Places:
    """Points on triangles.

    Attributes
    ----------
    triangle
        (N,) numbers.
    corners
        (N, 3) vertex numbers.
    of_second, of_third
        (N,) barycentric coordinates: the weights of the second and the third corner.
    """

    triangle: Numbers
    corners: Indices
    of_second: Floats
    of_third: Floats

    def __getitem__(self, some: Indices) -> Places:
        return Places(**{item.name: getattr(self, item.name)[some] for item in fields(self)})

    def interpolated(self, values: Floats) -> Floats:
        """Return (N, C) values between those of vertices (V, C); exact where all three corners are equal."""
        first, second, third = (values[self.corners[:, k]] for k in range(3))
        step = self.of_second[:, None] * (second - first) + self.of_third[:, None] * (third - first)
        return np.asarray(first + step)


def places(scene: Scene, triangle: Numbers, position: Floats) -> Places:
    """Return the place of each point on its triangle, by the areas that it cuts off along the normal."""
    corners = scene.triangles[triangle]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    offset = position - corners[:, 0]
    normal = np.cross(first, second)
    area = np.einsum("ij,ij->i", normal, normal)
    return Places(
        triangle=triangle,
        corners=scene.faces[triangle],
        of_second=np.einsum("ij,ij->i", normal, np.cross(offset, second)) / area,
        of_third=np.einsum("ij,ij->i", normal, np.cross(first, offset)) / area,
    )


def smooth_normals(scene: Scene, where: Places, flat: Floats) -> Floats:
    """Return (N, 3) unit normals between those of the vertices; the flat normal where a corner has none.

    Normals that cancel each other give the flat normal too: there is no direction between opposite ones.
    """
    assert scene.surface.vertex_normals is not None
    normal = where.interpolated(scene.surface.vertex_normals)
    length = np.sqrt(np.einsum("ij,ij->i", normal, normal))[:, None]
    found = length > 0
    return np.where(found, normal / np.where(found, length, 1.0), flat)


def albedo(scene: Scene, where: Places, effects: Collection[Effect]) -> Floats | float:
    """Return (N, 3) vertex color times texture, with 1 in place of each that is absent; 1 without both."""
    color: Floats | float = 1.0
    surface = scene.surface
    if Effect.VERTEX_COLORS in effects:
        assert surface.vertex_colors is not None
        color = where.interpolated(surface.vertex_colors)
    if Effect.TEXTURES in effects:
        assert surface.texture_of_triangle is not None
        assert surface.uv is not None
        numbers = surface.texture_of_triangle[where.triangle]
        textured = np.ones((len(numbers), 3))
        for number, texture in enumerate(surface.textures):
            here = np.flatnonzero(numbers == number)
            if len(here):
                textured[here] = texture_color(texture, where[here].interpolated(surface.uv))
        color = color * textured
    return color
