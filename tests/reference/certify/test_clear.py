"""No point that clear triangles answer for is hidden, and most points of a picture lie on them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.reference.certify.test_occlusion import hidden_by_definition
from tests.support.strategies import ANYTHING, EIGHTHS, apertures, frusta, triangles
from tests.support.views import at, soup, view
from xfrustum.reference import Reference, SurfacePoints
from xfrustum.reference.backend import on_device, recording, vectors_on_device
from xfrustum.reference.certify import clear as module
from xfrustum.reference.certify.cells import film_places
from xfrustum.reference.certify.clear import ClearTriangles, clear_triangles
from xfrustum.reference.certify.cone import Triangles
from xfrustum.reference.lines.lines import Pencil, crossed_frustum
from xfrustum.scenes import Frustum, Scene
from xfrustum.scenes.arrays import Floats, Indices, Mask


def clear_of(scene: Scene, pencil: Pencil) -> ClearTriangles:
    with recording():
        found = clear_triangles(Triangles(scene.triangles), pencil)
    assert found is not None
    return found


def surely_seen(clear: ClearTriangles, points: SurfacePoints) -> Mask:
    """Return which points the formula says to be hidden by nothing."""
    with recording():
        s, _, place = film_places(clear.pencil, vectors_on_device(points.position))
        found: Mask = clear.seen(on_device(points.triangle), place, s, on_device(points.tolerance)).numpy()
    return found


def points_on(corners: Floats, number: Indices, shares: Floats, raised: float) -> SurfacePoints:
    """Return points of triangles by barycentric coordinates, moved along z, off the plate."""
    position = np.einsum("ij,ijk->ik", shares, corners[number])
    position[:, 2] += raised
    position[position[:, 2] == 0, 2] = 1.0
    return SurfacePoints(
        position=position,
        triangle=number.astype(np.int32),
        tolerance=np.full(len(number), 2.0**-20 * np.abs(corners).max()),
    )


FACING = np.array([[-2.0, -2.0, -6.0], [2.0, -2.0, -6.0], [0.0, 2.0, -6.0]])
"""Triangle behind the plate that faces the viewer."""


def neighbors() -> st.SearchStrategy[Floats]:
    """Return `FACING` and triangles that touch it, cross it, or lie near it on any side, (F, 3, 3)."""
    moved = st.sampled_from([0.0, 0.0, 0.125, -0.125, 1.0, -1.0, 4.0, -4.0])
    corner = st.builds(
        lambda number, x, y, z: FACING[number] + [x, y, z], st.integers(0, 2), moved, moved, moved
    )
    others = st.lists(st.tuples(corner, corner, corner), min_size=1, max_size=4)
    return others.map(lambda some: np.array([FACING, *some]))


@pytest.mark.parametrize(
    "scenes",
    [neighbors(), triangles(coordinates=EIGHTHS), triangles(coordinates=ANYTHING)],
    ids=["neighbors", "eighths", "anything"],
)
@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_no_point_of_a_clear_triangle_is_hidden(
    scenes: st.SearchStrategy[Floats], data: st.DataObject
) -> None:
    # Many triangles have common corners, edges and planes. Points that are not on their triangles at all are
    # asked about as well.
    corners = data.draw(scenes)
    scene = soup(corners, data.draw(frusta()))
    pencil = crossed_frustum(scene.frustum, data.draw(apertures()))
    random = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    number = np.repeat(np.arange(len(corners)), 4)
    shares = random.dirichlet((1, 1, 1), len(number))
    points = points_on(corners, number, shares, data.draw(st.sampled_from([0.0, 0.5, -0.5])))
    seen = surely_seen(clear_of(scene, pencil), points)
    assert not (seen & hidden_by_definition(scene, pencil, points)).any()


def test_a_triangle_is_clear_until_another_one_covers_a_part_of_it() -> None:
    frustum = view("sheets", (32, 32)).frustum
    far = FACING * [0.5, 0.5, 1.0]
    middle = np.array([[1 / 3, 1 / 3, 1 / 3]])
    pencil = crossed_frustum(frustum, at(0.0, 0.0))

    def seen_with(other: Floats) -> bool:
        corners = np.stack((far, other))
        points = points_on(corners, np.array([0]), middle, 0.0)
        return bool(surely_seen(clear_of(soup(corners, frustum), pencil), points)[0])

    assert seen_with(far - [0.0, 0.0, 1.0]), "behind it"
    assert seen_with(far * [1.0, 0.5, 0.5] - [0.0, 2.0, 0.0]), "in front of it, and beside it"
    assert seen_with(far * [1.0, -1.0, 1.0] - [0.0, 2.0, 0.0]), "with a common edge"
    # One that covers a corner, and not the middle, hides the middle as far as is known.
    corner = far * [0.2, 0.2, 0.5] + [0.0, 0.4, 0.0]
    assert not seen_with(corner), "in front of a corner"
    assert not seen_with(far * 0.5), "in front of all of it"
    assert not seen_with(far), "the same triangle twice"


def test_a_point_is_not_seen_because_its_triangle_is_if_it_lies_behind_another_one() -> None:
    # Points of the nearer of two sheets, known to within 0.2, and believed to be farther than the other one.
    frustum = view("sheets", (32, 32)).frustum
    corners = np.stack((FACING, FACING - [0.0, 0.0, 0.001]))
    scene, middle = soup(corners, frustum), np.array([[1 / 3, 1 / 3, 1 / 3]])
    pencil = crossed_frustum(frustum, at(0.0, 0.0))
    clear = clear_of(scene, pencil)
    for raised, hidden in ((-0.01, False), (-0.25, True)):
        points = replace(points_on(corners, np.array([0]), middle, raised), tolerance=np.array([0.2]))
        assert hidden_by_definition(scene, pencil, points) == [hidden]
        assert surely_seen(clear, points).tolist() == [not hidden]


def test_a_point_far_beside_the_film_is_not_inside_a_triangle_that_is_seen_edge_on() -> None:
    # There its edge functions are nothing but roundings, and all of them are large.
    edge_on = np.array(
        [
            [-0.5518501012821984, -1.0196321323604844, -3.704759053561295],
            [-1.0496529717809864, -1.789505267717623, -3.989181922571713],
            [-0.8964678107869335, -1.6077702051021063, -5.027017567772384],
        ]
    )
    frustum = Frustum(resolution=(64, 64), reach=(12.0, 12.0), fov=(math.pi / 2, math.pi / 2))
    points = SurfacePoints(
        position=np.array([[-9.05e-9, -1.37e-8, -2.16e-18]]),
        triangle=np.zeros(1, dtype=np.int32),
        tolerance=np.full(1, 2.0**-20),
    )
    clear = clear_of(soup(edge_on[None], frustum), crossed_frustum(frustum, at(0.0, 0.0)))
    assert not surely_seen(clear, points).any()


@pytest.mark.parametrize(("name", "least"), [("car", 0.4), ("beetle", 0.5)])
def test_most_points_of_a_picture_lie_on_clear_triangles(name: str, least: float) -> None:
    scene = view(name, (160, 120))
    truth = Reference(scene).trace(scene.plate.middle, colored=False)
    shown = truth.off_plate
    points = SurfacePoints(
        position=truth.position[shown].astype(np.float64),
        triangle=truth.triangle[shown],
        tolerance=np.full(int(shown.sum()), 1e-9 * scene.frustum.longest_reach),
    )
    clear = clear_of(scene, crossed_frustum(scene.frustum, scene.plate.middle))
    assert surely_seen(clear, points).mean() > least


def test_where_too_many_triangles_share_cells_none_is_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = view("sheets", (16, 16))
    monkeypatch.setattr(module, "MAX_ITEMS", 3)
    with recording():
        pencil = crossed_frustum(scene.frustum, scene.plate.middle)
        assert clear_triangles(Triangles(scene.triangles), pencil) is None
