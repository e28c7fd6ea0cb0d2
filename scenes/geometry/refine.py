"""The same surfaces in more triangles: for results that must not depend on the tessellation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.model.scene import Scene, SceneObject


def refine(scene: Scene, levels: int) -> Scene:
    """Return the scene with every triangle split in four, `levels` times over.

    Each triangle is split at the middles of its edges, in its own plane, so the surface is the
    same up to the rounding of the middles. Triangle t becomes 4 t to 4 t + 3. A middle has the mean of
    its ends' normals, colors and texture coordinates, and the normal is not made a unit vector: linear
    interpolation over a triangle is then the same over its parts.

    Parameters
    ----------
    scene
        Scene whose triangles are split.
    levels
        Number of times; 0 returns the same triangles.
    """
    objects = scene.objects
    for _ in range(levels):
        objects = tuple(_split(part) for part in objects)
    return replace(scene, objects=objects)


def _split(part: SceneObject) -> SceneObject:
    """Split every triangle of an object in four, sharing the new vertices of shared edges."""
    sides = np.stack([part.faces, np.roll(part.faces, -1, axis=1)], axis=-1)
    edges, edge_of_side = np.unique(np.sort(sides.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    middle = edge_of_side.reshape(-1, 3) + len(part.vertices)
    (a, b, c), (ab, bc, ca) = part.faces.T, middle.T
    faces = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=-1).reshape(-1, 3)
    textured = part.texture_of_triangle
    return replace(
        part,
        # Halves first: the sum of two huge coordinates may overflow.
        vertices=np.concatenate([part.vertices, (part.vertices[edges] / 2).sum(axis=1)]),
        faces=faces,
        uv=_with_middles(part.uv, edges),
        vertex_normals=_with_middles(part.vertex_normals, edges),
        vertex_colors=_with_middles(part.vertex_colors, edges),
        texture_of_triangle=None if textured is None else np.repeat(textured, 4),
    )


def _with_middles(values: Floats | None, edges: Indices) -> Floats | None:
    """Append the mean over each edge's ends to values at vertices, (V, N); NaN where an end has none."""
    return None if values is None else np.concatenate([values, values[edges].mean(axis=1)])
