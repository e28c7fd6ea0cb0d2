"""Normals and colors of meshes after placing, refining and smoothing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from xfrustum.scenes import Frustum, Plate, Scene, SceneObject
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.shapes import build_shape, magnification, place, refine, smoothed

ROUNDING = 1e-12
"""A few dozen operations of doubles on values of size one round to 1e-14. Matrices may be so close
to singular that they lose two more digits.
"""

MATRICES = npst.arrays(np.float64, (3, 3), elements=st.floats(-2, 2)).filter(
    lambda matrix: abs(matrix[0] @ np.cross(matrix[1], matrix[2])) > 0.1
)
VECTORS = npst.arrays(np.float64, (3, 3), elements=st.floats(-1, 1))


def alone(part: SceneObject) -> Scene:
    frustum = Frustum(resolution=(4, 4), reach=(10.0, 10.0), fov=(1.0, 1.0))
    return Scene(
        name="one", plate=Plate(size=(1, 1), hogels=(1, 1)), frustum=frustum, objects=(part,)
    )


def normals_of(part: SceneObject) -> Floats:
    assert part.vertex_normals is not None
    return part.vertex_normals


def winding_normals(part: SceneObject) -> Floats:
    a, b, c = np.moveaxis(part.vertices[part.faces], 1, 0)
    return np.cross(b - a, c - a)


@given(matrix=MATRICES, corners=VECTORS, shift=st.tuples(*[st.floats(-3, 3)] * 3))
def test_a_placed_normal_stays_upright_on_the_side_that_the_winding_faces(
    matrix: Floats, corners: Floats, shift: tuple[float, float, float]
) -> None:
    """For any matrix, mirrors included, the placed normal is the normal of the placed triangle."""
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    if np.linalg.norm(normal) < 0.05:
        return
    part = SceneObject(
        name="t",
        vertices=corners,
        faces=np.array([[0, 1, 2]]),
        vertex_normals=np.tile(normal, (3, 1)),
    )
    scene_from_mesh = np.eye(4)
    scene_from_mesh[:3, :3], scene_from_mesh[:3, 3] = matrix, shift
    moved = place(part, scene_from_mesh)
    [upright] = winding_normals(moved)
    for kept in normals_of(moved):
        cosine = kept @ upright / np.linalg.norm(kept) / np.linalg.norm(upright)
        assert cosine == pytest.approx(1, abs=1e-9)
    lengths = np.linalg.norm(matrix, axis=0)
    assert lengths.max() <= magnification(scene_from_mesh) * (1 + ROUNDING)


@given(normals=VECTORS, colors=VECTORS, levels=st.integers(1, 3))
def test_refining_keeps_interpolated_attributes(
    normals: Floats, colors: Floats, levels: int
) -> None:
    """Corners (0, 0), (1, 0) and (0, 1) have weights 1 - x - y, x and y at a point (x, y)."""
    part = SceneObject(
        name="t",
        vertices=np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]),
        faces=np.array([[0, 1, 2]]),
        vertex_normals=normals,
        vertex_colors=colors,
    )
    fine = refine(alone(part), levels).objects[0]
    x, y, _ = fine.vertices.T
    shares = np.stack([1 - x - y, x, y], axis=1)
    np.testing.assert_allclose(normals_of(fine), shares @ normals, atol=ROUNDING)
    np.testing.assert_allclose(fine.vertex_colors, shares @ colors, atol=ROUNDING)


def test_a_corner_without_a_normal_leaves_all_of_its_triangle_flat_however_fine() -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, -1, 0]])
    normals = np.array([[0.0, 0, 1], [0, 0, 1], [np.nan] * 3, [0, 0, 1]])
    faces = np.array([[0, 1, 2], [1, 0, 3]])
    part = SceneObject(name="t", vertices=corners, faces=faces, vertex_normals=normals)
    fine = refine(alone(part), 2).objects[0]
    smooth = np.isfinite(normals_of(fine)[fine.faces]).all(axis=(1, 2))
    assert smooth.tolist() == [False] * 16 + [True] * 16


def test_smoothing_does_not_depend_on_how_flat_faces_are_cut() -> None:
    """Each face of a box has two triangles, or eight: the corners get equal normals."""
    box = build_shape("box")
    fine = smoothed(refine(alone(box), 1).objects[0])
    coarse = smoothed(box)
    np.testing.assert_allclose(
        normals_of(fine)[: len(box.vertices)], normals_of(coarse), atol=1e-15
    )


def test_smoothing_joins_vertices_in_one_place_and_keeps_normals_that_are_there() -> None:
    box = build_shape("box")
    loose = SceneObject(
        name="soup",
        vertices=box.vertices[box.faces].reshape(-1, 3),
        faces=np.arange(36).reshape(-1, 3),
    )
    normals = normals_of(smoothed(loose))
    np.testing.assert_allclose(normals, np.sign(loose.vertices) / np.sqrt(3), atol=1e-15)
    own = np.full((8, 3), np.nan)
    own[5] = (0, 1, 0)
    kept = normals_of(smoothed(replace(box, vertex_normals=own)))
    np.testing.assert_array_equal(kept[5], [0, 1, 0])
    assert np.isfinite(kept).all()


@pytest.mark.parametrize("size", [1e-150, 1.0, 1e150])
def test_smoothing_a_sphere_of_any_size_gives_about_its_radii(size: float) -> None:
    """With 24 bands of 7.5 degrees, means of facet normals are within 0.5 degrees of the radii."""
    ball = build_shape("sphere")
    ball = smoothed(replace(ball, vertices=ball.vertices * size))
    outward = ball.vertices / size / 0.5
    assert np.einsum("vx,vx->v", outward, normals_of(ball)).min() > np.cos(np.radians(0.5))
