"""The built-in scenes are reproducible, and each fits its stated purpose."""

import itertools
import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

from xfrustum.scenes import open_scene
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.library import builtin
from xfrustum.scenes.shapes import SHAPES, build_shape, refine


def areas(triangles: Floats) -> Floats:
    edges = triangles[:, 1:] - triangles[:, :1]
    return np.asarray(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2)


@pytest.mark.parametrize("name", builtin.names())
def test_a_built_in_scene_is_reproducible_and_states_its_purpose(name: str) -> None:
    scene = open_scene(name)
    assert scene.source == scene.name == name
    builtin.build.cache_clear()
    assert open_scene(name).content_hash == scene.content_hash
    [entry] = [e for e in builtin.listing() if e.name == name]
    assert entry.triangles == len(scene.faces)
    assert entry.purpose and "\n" not in entry.purpose


@pytest.mark.parametrize("name", [n for n in builtin.names() if n not in ("empty", "car-transfer")])
def test_a_built_in_scene_lies_on_both_sides_of_the_plate_without_flat_triangles(name: str) -> None:
    scene = open_scene(name)
    assert scene.vertices[:, 2].min() < 0 < scene.vertices[:, 2].max()
    assert areas(scene.triangles).min() > 0
    if name != "large-triangles":
        assert np.abs(scene.vertices[:, 2]).max() < scene.frustum.longest_reach


def test_no_flip_or_swap_of_axes_maps_the_asymmetric_scene_near_itself() -> None:
    """Each of the 47 other signed permutations moves some vertex by more than a millimeter."""
    vertices = open_scene("asymmetric").vertices
    tree = cKDTree(vertices)
    images = itertools.product(
        itertools.permutations(range(3)), itertools.product((1, -1), repeat=3)
    )
    moved = [
        np.isinf(tree.query(vertices[:, order] * signs, distance_upper_bound=1.0)[0]).any()
        for order, signs in images
    ]
    assert moved == [False] + [True] * 47


@pytest.mark.parametrize("name", ["asymmetric", "large-triangles"])
def test_refining_splits_every_triangle_in_four_on_the_same_surface(name: str) -> None:
    scene = open_scene(name)
    fine = refine(scene, 2)
    assert len(fine.faces) == 16 * len(scene.faces)
    parents = np.repeat(np.arange(len(scene.faces)), 16)
    np.testing.assert_array_equal(fine.object_of_triangle, scene.object_of_triangle[parents])
    np.testing.assert_allclose(
        areas(fine.triangles), areas(scene.triangles)[parents] / 16, rtol=1e-6
    )
    # A middle is rounded once per level: half an ulp per coordinate, for two levels, and sqrt(3)
    # for the length of the vector.
    rounding = 2 * math.sqrt(3) * np.spacing(np.abs(scene.vertices).max())
    offsets = fine.triangles - scene.triangles[parents, :1]
    assert np.abs(np.einsum("tcx,tx->tc", offsets, scene.normals[parents])).max() < 8 * rounding


@pytest.mark.parametrize("name", [n for n in SHAPES if n != "square"])
def test_shapes_are_closed_and_face_outward(name: str) -> None:
    shape = build_shape(name)
    corners = shape.vertices[shape.faces]
    volume = np.einsum("tx,tx->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert volume > 0
    keys = np.unique(shape.vertices, axis=0, return_inverse=True)[1].reshape(-1)[shape.faces]
    directed = np.stack([keys, np.roll(keys, -1, axis=1)], axis=-1).reshape(-1, 2)
    edges = set(map(tuple, directed.tolist()))
    assert edges == {(b, a) for a, b in edges}, "every edge is walked once in each direction"
