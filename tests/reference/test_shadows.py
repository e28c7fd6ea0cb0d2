"""Exact shadows: rational brute force, planes of many triangles, and excluded neighbors."""

from fractions import Fraction

import numpy as np
import pytest

from tests.support.brute_force import exact_s
from tests.support.lit import CENTERED
from tests.support.views import soup
from xfrustum.reference.backend import cross, difference, dot
from xfrustum.reference.shading import ShadowedShader
from xfrustum.scenes.arrays import Floats, Indices

LIGHT = np.array([0.3, -0.2, 0.9])
DOWN = np.array([0.1, 0.2, -1.0])


def in_one_plane(first: Floats, second: Floats) -> bool:
    a, b = ([[Fraction(x) for x in row] for row in corners.tolist()] for corners in (first, second))
    normal = cross(difference(a[1], a[0]), difference(a[2], a[0]))
    return all(dot(normal, difference(corner, a[0])) == 0 for corner in b)


def expected(triangles: Floats, own: int, point: Floats) -> bool:
    """Return whether a triangle off the point's plane lies toward the light, in rationals."""
    places = (
        exact_s(corners, point, LIGHT)
        for corners in triangles
        if not in_one_plane(triangles[own], corners)
    )
    return any(place is not None and place > 0 for place in places)


def points_on(triangles: Floats) -> tuple[Indices, Floats]:
    """Return three points of each triangle: inside, on an edge, and near a corner."""
    weights = np.array([[0.3, 0.3, 0.4], [0.5, 0.5, 0.0], [1 - 2e-16, 1e-16, 1e-16]])
    own = np.repeat(np.arange(len(triangles), dtype=np.int64), len(weights))
    position: Floats = np.einsum("wk,fki->fwi", weights, triangles).reshape(-1, 3)
    return own, position


@pytest.mark.parametrize("grid", [False, True])
def test_shadows_are_those_of_rationals(grid: bool) -> None:
    """Corners lie anywhere, or on a grid, where edges, planes and points coincide."""
    triangles = np.random.default_rng(6).uniform(-4, 4, (24, 3, 3))
    triangles = np.round(triangles) if grid else triangles
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    triangles = triangles[np.abs(normals[:, 2]) > 0.5]
    scene = soup(triangles, CENTERED)
    own, position = points_on(scene.triangles)
    # Viewer and light on the same side
    facing = np.sign(scene.normals[own] @ LIGHT)[:, None]
    direction = -facing * scene.normals[own]
    hidden = ShadowedShader(scene).hidden(own, position, direction, LIGHT)
    assert 0.2 < hidden.mean() < 0.9
    for k, point in enumerate(position):
        assert hidden[k] == expected(scene.triangles, int(own[k]), point)
    # With the viewer on the other side, light does not reach the visible side anyway.
    assert not ShadowedShader(scene).hidden(own, position, -direction, LIGHT).any()


def test_a_flat_floor_of_many_triangles_hides_no_light_from_itself(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Rounding moves points to either side of their plane; triangles are excluded by number."""
    rng = np.random.default_rng(2)
    x, y = rng.integers(-512, 512, (2, 80, 3)) / 64
    # The plane passes through its corners without rounding; triangles overlap.
    floor = np.stack((x, y, x / 8 + y / 4 - 3), axis=2)
    first, second = np.diff(floor, axis=1).swapaxes(0, 1)
    floor = floor[np.abs(np.cross(first, second)[:, 2]) > 1]
    scene = soup(floor, CENTERED)
    own = np.repeat(np.arange(len(floor)), 5)
    position = np.einsum("ni,nij->nj", rng.dirichlet(np.ones(3), len(own)), scene.triangles[own])
    direction = np.tile(DOWN, (len(own), 1))
    shader = ShadowedShader(scene)
    assert not shader.hidden(own, position, direction, LIGHT).any()
    monkeypatch.setattr(shader, "_coplanar", lambda first, second: first == second)
    assert shader.hidden(own, position, direction, LIGHT).any()
