"""Meshes made from meshes: placed in the scene, refined, and smoothed, in double precision."""

import math
from dataclasses import replace

import numpy as np

from xfrustum.scenes import Scene, SceneObject
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.model.scene import NormalsMade

Vector = tuple[float, float, float]


def placement(
    scale: float = 1.0, rotate_deg: Vector = (0.0, 0.0, 0.0), translate: Vector = (0.0, 0.0, 0.0)
) -> Floats:
    """Return the (4, 4) scene-from-mesh matrix: scale, then rotate, then translate.

    Angles turn about the fixed x, then y, then z axis, counterclockwise when looking against the axis.
    """
    # Computed row by row and not as matrix products, for the reason in `place`.
    matrix = np.diag([scale, scale, scale, 1.0])
    for axis, angle in enumerate(rotate_deg):
        cosine, sine = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        first, second = (axis + 1) % 3, (axis + 2) % 3
        old_first, old_second = matrix[first].copy(), matrix[second].copy()
        matrix[first] = cosine * old_first - sine * old_second
        matrix[second] = sine * old_first + cosine * old_second
    matrix[:3, 3] = translate
    return matrix


def magnification(scene_from_mesh: Floats) -> float:
    """Return the largest factor by which a (4, 4) affine matrix stretches any length."""
    return float(np.linalg.norm(scene_from_mesh[:3, :3], ord=2))


def place(part: SceneObject, scene_from_mesh: Floats) -> SceneObject:
    """Return the object with its vertices and their normals moved by a (4, 4) affine matrix.

    Where the matrix mirrors, the winding keeps its order, so that normals change to the other side with it.
    """
    x, y, z = part.vertices.T
    # Written out instead of a matrix product, because BLAS sums in other orders on other machines, and
    # the scene's content hash must be the same everywhere.
    with np.errstate(over="ignore", invalid="ignore"):
        moved = [row[0] * x + row[1] * y + row[2] * z + row[3] for row in scene_from_mesh[:3]]
    normals = part.vertex_normals
    if normals is not None:
        # Cofactors take the cross product of two edges to that of the moved edges: they are the inverse
        # transpose times the determinant, whose sign turns normals over where the matrix mirrors. Normals
        # are not made unit vectors, so that their interpolation stays linear in the original ones.
        linear = scene_from_mesh[:3, :3]
        a, b, c = (linear / np.abs(linear).max()).T
        cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
        normals = normals @ (cofactors / np.abs(cofactors).max()).T
    return replace(part, vertices=np.stack(moved, axis=1), vertex_normals=normals)


def refine(scene: Scene, levels: int) -> Scene:
    """Return the scene with every triangle split in four at the middles of its edges, `levels` times over.

    Triangle t becomes 4 t to 4 t + 3. A middle has the mean of its ends' normals, colors and texture
    coordinates, not made a unit vector: interpolation over a triangle is then the same over its parts.
    """
    for _ in range(levels):
        scene = replace(scene, objects=tuple(map(_in_four, scene.objects)))
    return scene


def _in_four(part: SceneObject) -> SceneObject:
    def with_middles(values: Floats | None) -> Floats | None:
        """Append the mean over each edge's ends to values at vertices, (V, N); NaN where an end has none."""
        return None if values is None else np.concatenate([values, values[edges].mean(axis=1)])

    sides = np.stack([part.faces, np.roll(part.faces, -1, axis=1)], axis=-1)
    edges, edge_of_side = np.unique(np.sort(sides.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    middle = edge_of_side.reshape(-1, 3) + len(part.vertices)
    (a, b, c), (ab, bc, ca) = part.faces.T, middle.T
    textured = part.texture_of_triangle
    return replace(
        part,
        # Halves first: the sum of two huge coordinates may overflow.
        vertices=np.concatenate([part.vertices, (part.vertices[edges] / 2).sum(axis=1)]),
        faces=np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=-1).reshape(-1, 3),
        uv=with_middles(part.uv),
        vertex_normals=with_middles(part.vertex_normals),
        vertex_colors=with_middles(part.vertex_colors),
        texture_of_triangle=None if textured is None else np.repeat(textured, 4),
    )


def smoothed(part: SceneObject) -> SceneObject:
    """Return the object with normals at the vertices that have none of their own.

    Faces count by their angles at a point, so that how a flat surface is cut does not matter (Thürmer and
    Wüthrich, "Computing vertex normals from polygonal facets", 1998). Vertices in the same place count as
    one. Where the mean is zero there still is none.
    """
    mean, own = _mean_normals(part.vertices, part.faces), part.vertex_normals
    if own is None or not np.isfinite(own).any():
        return replace(part, vertex_normals=mean, normals_made=NormalsMade.ALL)
    normals = np.where(np.isfinite(own), own, mean)
    added = bool((np.isfinite(normals) & ~np.isfinite(own)).any())
    made = NormalsMade.SOME if added else part.normals_made
    return replace(part, vertex_normals=normals, normals_made=made)


def _mean_normals(vertices: Floats, faces: Indices) -> Floats:
    """Return (V, 3) unit normals, weighted by angles; NaN where there are none."""
    # Scale sides to size one: products of the sides of tiny or huge triangles would under- or overflow.
    triangles = vertices[faces]
    sides = np.roll(triangles, -1, axis=1) - triangles
    scale = np.abs(sides).max(axis=(1, 2), keepdims=True)
    after = sides / np.where(scale > 0, scale, 1.0)
    before = -np.roll(after, 1, axis=1)
    # Normals of the triangles (F, 3, 3), once for each corner, as long as the angle there.
    cross = np.cross(after, before)
    twice_area = np.linalg.norm(cross, axis=2, keepdims=True)
    angle = np.arctan2(twice_area, (after * before).sum(axis=2, keepdims=True))
    weighted = np.divide(cross, twice_area, out=np.zeros(cross.shape), where=twice_area > 0) * angle
    points, point_of_vertex = np.unique(vertices, axis=0, return_inverse=True)
    corners = point_of_vertex.reshape(-1)[faces].reshape(-1)
    total = np.stack([np.bincount(corners, axis, len(points)) for axis in weighted.reshape(-1, 3).T], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    unit = np.divide(total, length, out=np.full(total.shape, np.nan), where=length > 0)
    return np.asarray(unit[point_of_vertex.reshape(-1)])
