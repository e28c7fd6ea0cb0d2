"""Placing a mesh in the scene, in double precision."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import SceneObject


def placement(
    scale: float = 1.0,
    rotate_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
    translate: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Floats:
    """Return the (4, 4) scene-from-mesh matrix: scale, then rotate, then translate.

    Parameters
    ----------
    scale
        Uniform factor.
    rotate_deg
        Angles in degrees about the fixed x, then y, then z axis, counterclockwise when looking
        against the axis.
    translate
        Offset in scene units.
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

    Faces keep their order and their winding, also where the matrix mirrors: the side that the winding
    faces then is the other one, and vertex normals change over with it.
    """
    x, y, z = part.vertices.T
    # Written out instead of a matrix product, because BLAS sums in other orders on other machines, and
    # the scene's content hash must be the same everywhere.
    with np.errstate(over="ignore", invalid="ignore"):
        moved = [row[0] * x + row[1] * y + row[2] * z + row[3] for row in scene_from_mesh[:3]]
    normals = part.vertex_normals
    if normals is not None:
        normals = normals @ _cofactors(scene_from_mesh[:3, :3]).T
    return replace(part, vertices=np.stack(moved, axis=1), vertex_normals=normals)


def _cofactors(linear: Floats) -> Floats:
    """Return the (3, 3) matrix that moves normals, up to one positive factor.

    It takes the cross product of two edges to that of the moved edges: it is the inverse transpose times the
    determinant, whose sign turns normals over where the matrix mirrors. Normals are not made unit
    vectors, so that their interpolation over a triangle stays linear in the original ones.
    """
    a, b, c = (linear / np.abs(linear).max()).T
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    return np.asarray(cofactors / np.abs(cofactors).max())
