"""Bezier patches: triangles within a chord tolerance, without cracks, with true normals."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from scipy.spatial import cKDTree
from trimesh.triangles import closest_point

from tests.support.long_tail import examples
from xfrustum.scenes import InputError, SceneObject, open_scene
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.meshes.mesh_file import load_mesh
from xfrustum.scenes.meshes.tessellation import (
    cut,
    evenly,
    load_patches,
    matched_steps,
    normals,
    read_patches,
    second_derivative_bounds,
    steps_for,
    surface,
    tessellate,
)

ROUNDING = 1e-12
"""Largest rounding of a few hundred operations of doubles on values of size ten."""

PRINTED = math.sqrt(3) * 0.5e-6
"""A mesh file with six decimals rounds each coordinate by up to half a unit of the last decimal."""

NETS = st.tuples(st.integers(1, 3), st.integers(1, 3)).flatmap(
    lambda degrees: npst.arrays(
        np.float64, (degrees[0] + 1, degrees[1] + 1, 3), elements=st.floats(-3, 3)
    )
)


#: Net of (u, v, 3 u v); all its second derivatives vanish except the mixed one
TWIST: Floats = np.array([[[u, v, 3.0 * u * v] for v in (0.0, 1.0)] for u in (0.0, 1.0)])


def paraboloid() -> Floats:
    """Return the net of (u, v, u^2 + 2 u v): second derivatives 2, 2 and 0 everywhere."""
    third = np.arange(3) / 2
    x, y = np.meshgrid(third, third, indexing="ij")
    square = np.array([0.0, 0.0, 1.0])[:, None]
    return np.stack([x, y, square + 2 * x * y], axis=-1)


def chord_error(net: Floats, part: SceneObject, steps: tuple[int, int], samples: int) -> float:
    """Return the largest distance of a patch from its triangles, at dense samples.

    Each sample is compared only with triangles of its own cell, which gives an upper bound.
    """
    (a, b), errors = steps, []
    grid = part.vertices.reshape(a + 1, b + 1, 3)
    within = (np.arange(samples) + 0.5) / samples
    for i, j in np.ndindex(a, b):
        points = surface(net, (i + within) / a, (j + within) / b).reshape(-1, 3)
        p, q, r, s = grid[i, j], grid[i + 1, j], grid[i + 1, j + 1], grid[i, j + 1]
        halves = (np.tile(half, (len(points), 1, 1)) for half in ([p, q, r], [p, r, s]))
        apart = [np.linalg.norm(closest_point(half, points) - points, axis=1) for half in halves]
        errors.append(np.minimum(*apart).max())
    return float(max(errors))


def teapot(shared_data: Path) -> list[Floats]:
    return read_patches(shared_data / "data" / "teapot.bpt")


def test_a_surface_of_known_polynomials_is_evaluated_exactly() -> None:
    u, v = evenly(7), evenly(5)
    points = surface(paraboloid(), u, v)
    x, y = np.meshgrid(u, v, indexing="ij")
    np.testing.assert_allclose(points, np.stack([x, y, x**2 + 2 * x * y], axis=-1), atol=1e-15)
    direction = np.stack([-(2 * x + 2 * y), -2 * x, np.ones_like(x)], axis=-1)
    expected = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    np.testing.assert_allclose(normals(paraboloid(), u, v), expected, atol=1e-14)


def test_the_bound_of_filip_and_others_is_attained_by_a_parabola() -> None:
    """An arch of height 1/4: the middle one of n level chords lies 1/(4 n^2) below its top."""
    net = np.array(
        [[[u, v, z] for v in (0.0, 1.0)] for u, z in ((0.0, 0.0), (0.5, 0.5), (1.0, 0.0))]
    )
    assert second_derivative_bounds(net) == [2.0, 0.0, 0.0]
    for count in (1, 3, 7):
        sagitta = 1 / (4 * count**2)
        assert steps_for(net, sagitta * (1 + ROUNDING)) == (count, 1)
        error = chord_error(net, cut([net], [(count, 1)], name="arch"), (count, 1), 41)
        assert error == pytest.approx(sagitta, rel=1e-3)


@examples(15)
@given(net=NETS, tolerance=st.sampled_from([1.0, 0.3, 0.1]))
@example(net=TWIST, tolerance=0.1)
def test_any_patch_keeps_its_chord_tolerance(net: Floats, tolerance: float) -> None:
    try:
        part = tessellate([net], tolerance, name="any")
    except InputError:  # all points coincide
        return
    error = chord_error(net, part, steps_for(net, tolerance), 4)
    assert error <= tolerance + ROUNDING


@examples(40)
@given(
    net=npst.arrays(np.float64, (4, 7, 3), elements=st.floats(-3, 3)),
    turns=st.tuples(*[st.booleans()] * 4),
)
def test_patches_that_share_an_edge_share_its_points_to_the_last_bit(
    net: Floats, turns: tuple[bool, bool, bool, bool]
) -> None:
    """Two halves of a net of 4 x 7 points, each with another direction and order of points."""
    assume(len(np.unique(net[:, 3], axis=0)) > 1)
    pair, ways = [net[:, :4], net[:, 3:]], (turns[:2], turns[2:])
    for index, (swap, reverse) in enumerate(ways):
        pair[index] = pair[index][:: -1 if reverse else 1]
        pair[index] = pair[index].swapaxes(0, 1) if swap else pair[index]
    try:
        part = tessellate(pair, 0.2, name="pair")
    except InputError:  # both without area
        return
    least = [steps_for(half, 0.2) for half in pair]
    steps = matched_steps(pair, least)
    assert (np.array(steps) >= least).all()
    halves = np.split(part.vertices, [(steps[0][0] + 1) * (steps[0][1] + 1)])
    borders = []
    for half, (u, v), (swap, reverse), column in zip(halves, steps, ways, (-1, 0), strict=True):
        grid = half.reshape(u + 1, v + 1, 3)
        grid = grid.swapaxes(0, 1) if swap else grid
        borders.append(grid[:: -1 if reverse else 1, column])
    np.testing.assert_array_equal(borders[0], borders[1])


def test_a_collapsed_edge_has_the_normal_of_the_limit() -> None:
    """Lines up to a cone's tip have different normals; lines up to a dome's top share one."""
    ring = np.array([[1.0, 0.0], [1.0, 0.55], [0.55, 1.0], [0.0, 1.0]])
    heights = {"cone": (0.0, 1 / 3, 2 / 3, 1.0), "dome": (0.0, 0.6, 1.0, 1.0)}
    for kind, rise in heights.items():
        net = np.array([[[*(ring[i] * (1 - j / 3)), rise[j]] for j in range(4)] for i in range(4)])
        values = normals(net, evenly(6), evenly(5))
        assert np.isfinite(values).all()
        if kind == "dome":
            np.testing.assert_allclose(values[:, -1], [[0, 0, 1]] * 7, atol=1e-15)
        else:
            # On a cone, the normal is constant along a line to the tip.
            np.testing.assert_allclose(values[:, -1], values[:, 0], atol=1e-14)
        for turned, expected in (
            (net[:, ::-1], values[:, ::-1]),
            (net.swapaxes(0, 1), values.swapaxes(0, 1)),
        ):
            u, v = (evenly(expected.shape[axis] - 1) for axis in (0, 1))
            np.testing.assert_allclose(normals(turned, u, v), -expected, atol=1e-14)


def test_the_teapot_cut_ten_by_ten_is_the_mesh_of_the_teapot(shared_data: Path) -> None:
    """(x, y, z) of the patches is (x, z, -y) of the mesh: equal points, as many triangles."""
    part = cut(teapot(shared_data), [(10, 10)] * 32, name="teapot")
    mesh = load_mesh(shared_data / "data" / "teapot.obj")
    x, y, z = part.vertices.T
    turned = np.stack([x, z, -y], axis=1)
    assert len(part.faces) == len(mesh.faces) == 6320
    assert cKDTree(turned).query(mesh.vertices)[0].max() <= PRINTED
    assert cKDTree(mesh.vertices).query(turned)[0].max() <= PRINTED


HEAD = (
    "[plate]\nsize = [8, 6]\nhogels = [8, 6]\n"
    "[frustum]\nresolution = [8, 8]\nfov_deg = [60, 60]\nreach = [50, 50]\n"
)


def patch_text(net: Floats) -> str:
    rows, columns = net.shape[:2]
    return f"{rows - 1} {columns - 1}\n" + "".join(
        f"{x!r} {y!r} {z!r}\n" for x, y, z in net.reshape(-1, 3).tolist()
    )


@pytest.mark.parametrize("scale", [0.01, 1.0, 100.0])
def test_the_chord_tolerance_of_a_scene_file_is_a_length_of_the_scene(
    tmp_path: Path, scale: float
) -> None:
    (tmp_path / "one.bpt").write_text("1\n" + patch_text(paraboloid()))
    entry = f'[[object]]\nmesh = "one.bpt"\nscale = {scale}\n'
    path = tmp_path / "scene.toml"
    counts = []
    for tolerance in (0.01, 0.01 * scale):
        path.write_text(HEAD + entry + f"chord_tolerance = {tolerance}\n")
        counts.append(len(open_scene(str(path)).faces))
    steps = steps_for(paraboloid(), 0.01 / scale), steps_for(paraboloid(), 0.01)
    assert counts == [2 * u * v for u, v in steps]


def test_degrees_and_order_of_points_are_those_of_the_file(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    nets = [random.normal(size=shape) for shape in [(2, 4, 3), (4, 3, 3)]]
    (tmp_path / "two.bpt").write_text("2\n" + "".join(map(patch_text, nets)))
    for patch, net in zip(read_patches(tmp_path / "two.bpt"), nets, strict=True):
        np.testing.assert_array_equal(patch, net)


def test_without_a_tolerance_it_is_relative_to_the_size(tmp_path: Path) -> None:
    counts = set()
    for size in (1e-3, 1.0, 1e3):
        (tmp_path / "one.bpt").write_text("1\n" + patch_text(paraboloid() * size))
        counts.add(len(load_patches(tmp_path / "one.bpt").faces))
    assert len(counts) == 1
