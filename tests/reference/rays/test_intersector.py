"""The interface of trimesh: its own tests, ties, keywords, copies, and one-line errors."""

import copy
import os
import pickle
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from xfrustum.rays import ExactIntersector
from xfrustum.scenes import Certainty, InputError

UP = [[0.0, 0.0, 1.0]]


@pytest.fixture
def box() -> trimesh.Trimesh:
    """Return the unit cube about the origin; the middle of each side lies on a diagonal."""
    mesh = trimesh.creation.box()
    mesh.ray = ExactIntersector(mesh)
    return mesh


@pytest.mark.slow
def test_trimeshs_own_tests_pass() -> None:
    """Run tests/test_ray.py of a checkout of trimesh, in the version of requirements.lock."""
    folder = os.environ.get("XFRUSTUM_TRIMESH")
    if folder is None:
        pytest.skip("XFRUSTUM_TRIMESH names no checkout of trimesh, with its tests and models")
    if find_spec("manifold3d") is None:
        pytest.skip("manifold3d is not installed, which one of trimesh's tests needs")
    plugin = "in_place_of_trimesh"
    command = [sys.executable, "-m", "pytest", "-q", "-p", plugin, "-p", "no:cacheprovider"]
    # Run in its folder: its package `tests` would hide this project's.
    path = os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)])
    run = subprocess.run(
        [*command, "tests/test_ray.py"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    assert "11 passed" in run.stdout


def test_a_hit_on_a_shared_edge_has_one_place_and_all_triangles(box: trimesh.Trimesh) -> None:
    below = [[0.0, 0.0, -2.0]]
    triangle, ray = box.ray.intersects_id(below, UP)
    first, second = triangle[:2], triangle[2:]
    assert len(triangle) == 4 and (ray == 0).all()
    assert first[0] < first[1] and second[0] < second[1]
    heights = box.triangles[first][..., 2], box.triangles[second][..., 2]
    assert (heights[0] == -0.5).all() and (heights[1] == 0.5).all()
    places, ray, smallest = box.ray.intersects_location(below, UP)
    assert places.tolist() == [[0, 0, -0.5], [0, 0, 0.5]]
    assert smallest.tolist() == [first[0], second[0]]
    assert box.ray.intersects_id(below, UP, max_hits=3)[0].tolist() == triangle[:3].tolist()
    assert len(box.ray.intersects_location(below, UP, max_hits=1)[0]) == 1
    nearest, _, point = box.ray.intersects_id(below, UP, multiple_hits=False, return_locations=True)
    assert nearest.tolist() == [first[0]] and point.tolist() == [[0, 0, -0.5]]
    # Embree's class, which has the option `scale_to_box`, returns one triangle for each place.
    assert ExactIntersector(box, scale_to_box=False).intersects_id(below, UP)[0].tolist() == [
        first[0],
        second[0],
    ]


def test_first_hits_have_certainties_and_ties(box: trimesh.Trimesh) -> None:
    starts = [[0.2, 0.1, -2.0], [0.0, 0.0, -2.0], [0.7, 0.0, -2.0], [0.5, 0.1, -2.0]]
    first = box.ray.first(starts, UP * 4)
    assert first.certainty.tolist()[:3] == [Certainty.PROVEN, Certainty.TIE, Certainty.PROVEN]
    assert first.t.tolist()[:2] == [1.5, 1.5] and np.isnan(first.t[2])
    # The last ray lies in the plane of a side of the box: it meets the edge of the bottom, but not
    # the side.
    assert first.triangle[2] == -1 and first.triangle[3] >= 0 and first.t[3] == 1.5
    assert first.ties.tolist() == [[1, n] for n in sorted(first.ties[:, 1])]
    assert box.ray.intersects_first(starts, UP * 4).tolist() == first.triangle.tolist()
    assert box.ray.intersects_any(starts, UP * 4).tolist() == [True, True, False, True]


def test_a_ray_meets_the_surface_on_which_it_starts_by_default(
    box: trimesh.Trimesh,
) -> None:
    start = [[0.2, 0.1, -0.5]]
    assert box.ray.first(start, UP).t.tolist() == [0.0]
    beyond = float(np.nextafter(0, 1))
    assert box.ray.first(start, UP, t_min=beyond).t.tolist() == [1.0]
    assert box.ray.intersects_first(start, UP, t_min=[beyond], t_max=[0.5]).tolist() == [-1]
    assert len(box.ray.intersects_id(start, UP, t_min=-1.0, t_max=0.0)[0]) == 1
    # t is in units of the direction's length; directions are not normalized.
    assert box.ray.first(start, [[0, 0, 4]], t_min=beyond).t.tolist() == [0.25]


@pytest.mark.parametrize("several", [True, False])
@pytest.mark.parametrize(
    ("size", "start", "speed"),
    [(1.0, 0.0, 5e-324), (1.0, 0.0, 1e300), (2.0**-100, 0.0, 1e300), (2.0**-100, -1e300, 1.0)],
)
def test_points_are_finite_where_t_is_no_double(
    size: float, start: float, speed: float, several: bool
) -> None:
    """t is 1e323, or below the smallest double, or has no double value in units of the mesh."""
    corners = size * np.array([[-1.0, -1, 1], [1, -1, 1], [0, 1, 1]])
    ray = ExactIntersector(trimesh.Trimesh(corners, [[0, 1, 2]], process=False))
    point, _, triangle = ray.intersects_location(
        [[0, 0, start]], [[0, 0, speed]], multiple_hits=several
    )
    assert triangle.tolist() == [0]
    # A point has the rounding error of its ray's origin.
    assert point == pytest.approx(np.array([[0, 0, size]]), rel=1e-15, abs=1e-15 * abs(start))


def test_changes_of_the_mesh_take_effect_and_copies_agree(box: trimesh.Trimesh) -> None:
    below = [[0.2, 0.1, -2.0]]
    before = box.ray.first(below, UP)
    for other in (pickle.loads(pickle.dumps(box.ray)), copy.copy(box.ray), copy.deepcopy(box.ray)):
        assert other.first(below, UP).t == before.t
    assert pickle.loads(pickle.dumps(box)).ray.first(below, UP).triangle == before.triangle
    box.apply_translation([0, 0, 1])
    assert box.ray.first(below, UP).t == before.t + 1


def test_a_vertex_without_triangles_may_lie_anywhere(box: trimesh.Trimesh) -> None:
    """An unused vertex changes neither scale nor middle of the mesh."""
    vertices = np.concatenate(([[np.nan, 1e300, -np.inf]], box.vertices))
    mesh = trimesh.Trimesh(vertices, box.faces + 1, process=False)
    starts = np.random.default_rng(0).uniform(-0.6, 0.6, (50, 3)) - [0, 0, 2]
    expected, first = (ray.first(starts, UP * 50) for ray in (box.ray, ExactIntersector(mesh)))
    assert first.triangle.tolist() == expected.triangle.tolist()
    assert np.array_equal(first.t, expected.t, equal_nan=True)


@pytest.mark.parametrize("distance", [1e13, 1e300])
def test_rays_from_afar_meet_the_same_triangles(distance: float) -> None:
    """Parallel rays, some through vertices; exact integers decide the few pairs that remain."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    ray = ExactIntersector(ball)
    places = np.random.default_rng(1).uniform(-1.1, 1.1, (100, 2))
    starts = np.full((200, 3), -2.0)
    starts[:, :2] = np.concatenate((places, ball.vertices[:100, :2]))
    afar = starts * [1, 1, distance / 2]
    near, far = ray.first(starts, UP * 200), ray.first(afar, UP * 200)
    assert far.triangle.tolist() == near.triangle.tolist() and (near.triangle >= 0).sum() > 150
    assert far.ties.tolist() == near.ties.tolist()
    assert far.t[near.triangle >= 0] == pytest.approx(np.full((near.triangle >= 0).sum(), distance))
    every, all_afar = (ray.intersects_id(places, UP * 200) for places in (starts, afar))
    assert all(np.array_equal(a, b) for a, b in zip(every, all_afar, strict=True))


@pytest.mark.parametrize("distance", [2.0, 1e14])
def test_a_ray_alone_meets_no_triangle_twice(distance: float, box: trimesh.Trimesh) -> None:
    """Rays meet triangle 0 inside and, uncertain, at its edge; from afar the walk has no pair."""
    ray, away = ExactIntersector(box), box.face_normals[0] * distance
    for place in (box.triangles[0].mean(axis=0), box.triangles[0, :2].mean(axis=0)):
        first = ray.first([place + away], [-away])
        assert first.triangle.tolist() == [0] and not len(first.ties)
        numbers = ray.intersects_id([place + away], [-away])[0].tolist()
        assert numbers.count(0) == 1 and len(numbers) == len(set(numbers)) > 1


def test_trimesh_uses_the_exact_intersector(box: trimesh.Trimesh) -> None:
    assert box.contains([[0, 0, 0], [0, 0, 0.5], [0, 0, 0.6]]).tolist() == [True, False, False]


def test_empty_results_are_valid() -> None:
    empty = ExactIntersector(trimesh.Trimesh())
    assert empty.intersects_first([[0, 0, 0]], UP).tolist() == [-1]
    assert [len(part) for part in empty.intersects_location([[0, 0, 0]], UP)] == [0, 0, 0]
    assert empty.locate_points([[0, 0, 0]]).tolist() == [-1]
    some = ExactIntersector(trimesh.creation.box())
    for result in (some.intersects_id([], []), some.intersects_location([], [])):
        assert all(len(part) == 0 for part in result)
    assert some.intersects_any([], []).shape == (0,)
    assert some.contains_points([]).shape == (0,)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[0, 0]], UP), r"ray_origins: the shape is \(1, 2\)"),
        (([[0, 0, np.nan]], UP), "ray_origins: ray 0 is .*nan"),
        (([[0, 0, 0]] * 2, [[0, 0, 1], [0, np.inf, 0]]), "ray_directions: ray 1 is .*inf"),
        (([[0, 0, 0]] * 2, [[0, 0, 1], [0, 0, 0]]), "ray 1 is .*no direction"),
        (([[0, 0, 0]] * 2, UP), "1 directions for 2 origins"),
        (([["0", "0", "0"]], UP), "ray_origins: not an array of numbers but of <U1"),
        (([[0, 0, 1j]], UP), "ray_origins: not an array of numbers but of complex128"),
        (([[0, 0, 0]], np.array(UP, dtype=object)), "ray_directions: .* but of object"),
        (([[0, 0], [0, 0, 0]], UP), "ray_origins: rows differ in length"),
    ],
)
def test_bad_rays_are_refused_by_number(
    box: trimesh.Trimesh, arguments: tuple[Any, Any], message: str
) -> None:
    for query in (box.ray.first, box.ray.intersects_id, box.ray.intersects_location):
        with pytest.raises(InputError, match=message) as refused:
            query(*arguments)
        assert "\n" not in str(refused.value)


def test_bad_ranges_meshes_and_counts_are_refused(box: trimesh.Trimesh) -> None:
    start = [[0.0, 0.0, -2.0]]
    with pytest.raises(InputError, match="t_min: ray 0 is NaN"):
        box.ray.first(start, UP, t_min=np.nan)
    with pytest.raises(InputError, match=r"t_max: the shape is \(2,\)"):
        box.ray.first(start, UP, t_max=[1.0, 2.0])
    for wrong in ("a", None, 1j, object()):
        with pytest.raises(InputError, match="t_max: not an array of numbers"):
            box.ray.first(start, UP, t_max=wrong)
    for count in (0, None, 2.5, "3"):
        with pytest.raises(InputError, match=f"max_hits: {count!r} is no positive integer"):
            box.ray.intersects_id(start, UP, max_hits=count)
    with pytest.raises(InputError, match="points: point 1"):
        box.ray.contains_points([[0, 0, 0], [np.nan, 0, 0]])
    box.vertices[0, 0] = np.nan
    with pytest.raises(InputError, match="mesh: triangle 0 has a corner that is not finite"):
        box.ray.first(start, UP)
