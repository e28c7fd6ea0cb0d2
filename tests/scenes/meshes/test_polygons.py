"""Polygons cut into triangles: exactly their surface, whatever their shape and plane."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.long_tail import examples
from xfrustum.scenes import InputError
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.meshes.polygons import cut_polygons, sizes_together

ROUNDING = 1e-9  # relative: some hundred operations of doubles on coordinates of one size

SETTINGS = examples(200)


def refused(polygon: int, reason: str) -> InputError:
    return InputError(f"polygon {polygon} {reason}")


def cut(points: Floats, *polygons: list[int]) -> Indices:
    """Return the triangles of polygons as indices of points."""
    corners = np.concatenate([np.array(polygon) for polygon in polygons])
    counts = np.array([len(polygon) for polygon in polygons])
    return np.asarray(
        corners[cut_polygons(np.asarray(points, np.float64), corners, counts, refused)]
    )


def newell(points: Floats) -> Floats:
    """Return twice the area vector of a polygon, by Newell's sum over its edges."""
    return np.asarray(np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0))


def plane(turn: Floats) -> Floats:
    """Return (2, 3) orthonormal axes of some plane."""
    axes, _ = np.linalg.qr(turn.reshape(3, 2))
    return np.asarray(axes.T)


@st.composite
def star_shaped(draw: st.DrawFn) -> Floats:
    """Draw a polygon (n, 2) that is seen whole from the origin: concave at every short radius."""
    count = draw(st.integers(4, 24))
    radii = draw(st.lists(st.floats(0.05, 1.0), min_size=count, max_size=count))
    angles = 2 * np.pi * (np.arange(count) + draw(st.floats(0, 1))) / count
    return np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1)


@SETTINGS
@given(
    flat=star_shaped(),
    turn=st.lists(st.floats(-1, 1), min_size=6, max_size=6),
    shift=st.sampled_from([0.0, 3.0, 5e3]),
    first=st.integers(0, 23),
)
def test_triangles_cover_a_polygon_once_and_face_its_normal(
    flat: Floats, turn: list[float], shift: float, first: int
) -> None:
    axes = plane(np.array(turn) + np.arange(6) ** 2 / 7)
    points = np.roll(flat, first, axis=0) @ axes + shift
    triangles = points[cut(points, list(range(len(points))))]
    crosses = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    whole = newell(points - points[0])
    size = np.linalg.norm(whole)
    assert len(triangles) == len(points) - 2
    assert (crosses @ whole / size >= -ROUNDING * (1 + shift)).all()
    assert np.linalg.norm(crosses, axis=1).sum() == pytest.approx(
        size, abs=ROUNDING * (1 + shift) * len(points)
    )


@SETTINGS
@given(flat=star_shaped(), halves=st.integers(1, 3))
def test_corners_on_straight_edges_stay(flat: Floats, halves: int) -> None:
    """Neighbors share these corners: without them, rays would pass between."""
    between = [
        flat + (np.roll(flat, -1, axis=0) - flat) * share for share in np.arange(halves) / halves
    ]
    points = np.column_stack(
        [np.stack(between, axis=1).reshape(-1, 2), np.zeros(halves * len(flat))]
    )
    triangles = cut(points, list(range(len(points))))
    assert len(triangles) == len(points) - 2
    edges = {
        (int(a), int(b))
        for triangle in triangles
        for a, b in zip(triangle, np.roll(triangle, -1), strict=True)
    }
    assert {(k, (k + 1) % len(points)) for k in range(len(points))} <= edges


def test_a_fan_that_is_right_stays_as_trimesh_numbers_it() -> None:
    angles = np.arange(7) * 2 * np.pi / 7
    points = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(7)])
    assert cut(points, [0, 1, 2, 3], [0, 1, 2, 3, 4], [2, 3, 4]).tolist() == [
        *([0, 1, 2], [2, 3, 0]),
        *([0, 1, 2], [0, 2, 3], [0, 3, 4]),
        [2, 3, 4],
    ]
    assert sizes_together(np.array([4, 5, 3, 4])).tolist() == [5, 0, 6, 1, 7, 2, 3, 4]


def test_a_concave_quadrilateral_is_cut_by_its_other_diagonal() -> None:
    points = np.array([[0.0, 0, 0], [4, -4, 0], [1, 0, 0], [4, 4, 0]])
    assert cut(points, [1, 2, 3, 0]).tolist() == [[2, 3, 0], [0, 1, 2]]


def test_a_bridge_to_a_hole_is_cut_along() -> None:
    ring = [(0, 0), (10, 0), (10, 10), (0, 10), (0, 0), (3, 3), (3, 6), (6, 6), (6, 3), (3, 3)]
    points = np.column_stack([np.array(ring, np.float64), np.zeros(10)])
    triangles = points[cut(points, list(range(10)))]
    crosses = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])[:, 2]
    assert len(triangles) == 8
    assert (crosses >= 0).all() and crosses.sum() / 2 == 100 - 9


def test_corners_that_coincide_keep_a_fan_that_is_right() -> None:
    for ring in ([0, 0, 1, 2, 3], [0, 1, 2, 2, 3], [0, 1, 2, 3, 0], [0, 1, 2, 0, 3, 4]):
        corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (-1, 1, 0), (-1, 0, 0)], np.float64)
        fan = [[ring[0], ring[a], ring[b]] for a, b in pairwise(range(1, len(ring)))]
        assert cut(corners, ring).tolist() == fan


def test_corners_on_one_line_stay_a_fan_without_area() -> None:
    line = np.array([[k, 2.0 * k, 0] for k in (0, 3, 1, 2)])
    assert cut(line, [0, 1, 2, 3]).tolist() == [[0, 1, 2], [2, 3, 0]]
    assert len(cut(np.zeros((5, 3)), [0, 1, 2, 3, 4])) == 3


@pytest.mark.parametrize(
    "ring",
    [
        pytest.param([(0, 0), (1, 1), (1, 0), (0, 1)], id="bow tie"),
        pytest.param([(0, 0), (4, 4), (4, 0), (0, 4), (-3, 2)], id="crossed pentagon"),
        pytest.param([(0, 0), (1, 0), (1, 1), (1, 0)], id="there and back"),
        pytest.param([(0, 0), (1, 0), (0, 1)] * 2, id="twice around"),
        pytest.param([(0, 0), (9, 0), (0, 9), (-9, 0), (0, -9), (10, 0), (0, 10)], id="spiral"),
        pytest.param(
            [(0, 0), (9, 0), (9, 0), (0, 9), (-9, 0), (0, -9), (10, 0), (0, 10)], id="double corner"
        ),
    ],
)
def test_a_polygon_that_crosses_itself_is_refused(ring: list[tuple[int, int]]) -> None:
    points = np.column_stack([np.array(ring, np.float64), np.zeros(len(ring))])
    with pytest.raises(InputError, match="polygon 1 crosses or covers itself"):
        cut(points, [0, 1, 2], list(range(len(ring))))


def test_a_polygon_of_very_many_corners_is_refused_where_a_fan_does_not_cut_it() -> None:
    angles = np.arange(5000) * 2 * np.pi / 5000
    radii = np.where(np.arange(5000) % 2, 1.0, 0.5)
    points = np.column_stack([radii * np.cos(angles), radii * np.sin(angles), np.zeros(5000)])
    with pytest.raises(InputError, match=r"concave and has 5,000 corners"):
        cut(points, list(range(5000)))
