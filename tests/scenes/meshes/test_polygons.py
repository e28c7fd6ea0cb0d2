"""Triangulation of polygons of any shape and plane covers exactly their surface."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.long_tail import examples
from xfrustum.scenes import InputError
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.meshes.tessellation import cut_polygons, sizes_together

ROUNDING = 1e-9  # relative: about a hundred operations of doubles on coordinates of one size
SETTINGS = examples(200)


def refused(polygon: int, reason: str) -> InputError:
    return InputError(f"polygon {polygon} {reason}")


def cut(points: Floats, *polygons: Sequence[int]) -> Indices:
    """Return the triangles of polygons as indices; without a list, all points form one polygon."""
    rings = polygons or (range(len(points)),)
    corners, counts = np.concatenate(rings), np.array([len(ring) for ring in rings])
    return np.asarray(corners[cut_polygons(points, corners, counts, refused)])


def flat(ring: Sequence[tuple[float, float]] | Floats) -> Floats:
    """Return the points (n, 3) of an outline (n, 2) in z = 0."""
    return np.pad(np.asarray(ring, np.float64), ((0, 0), (0, 1)))


def circle(count: int, radii: Floats | float = 1.0) -> Floats:
    angles = np.arange(count) * 2 * np.pi / count
    return flat(np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1))


def crosses_of(triangles: Floats) -> Floats:
    edges = triangles[:, 1:] - triangles[:, :1]
    return np.asarray(np.cross(edges[:, 0], edges[:, 1]))


@st.composite
def star_shaped(draw: st.DrawFn) -> Floats:
    """Draw a polygon (n, 3) that is visible from the origin as a whole, with concave corners."""
    radii = draw(st.lists(st.floats(0.05, 1.0), min_size=4, max_size=24))
    return np.roll(circle(len(radii), np.array(radii)), draw(st.integers(0, 23)), axis=0)


@SETTINGS
@given(
    ring=star_shaped(),
    turn=st.lists(st.floats(-1, 1), min_size=6, max_size=6),
    shift=st.sampled_from([0.0, 3.0, 5e3]),
)
def test_triangles_cover_a_polygon_once_and_face_its_normal(
    ring: Floats, turn: list[float], shift: float
) -> None:
    axes, _ = np.linalg.qr((np.array(turn) + np.arange(6) ** 2 / 7).reshape(3, 2))
    points = ring[:, :2] @ axes.T + shift
    crosses = crosses_of(points[cut(points)])
    # Twice the vector area of the polygon, by Newell's sum over its edges
    shape = points - points[0]
    whole = np.cross(shape, np.roll(shape, -1, axis=0)).sum(axis=0)
    size = np.linalg.norm(whole)
    assert len(crosses) == len(points) - 2
    assert (crosses @ whole / size >= -ROUNDING * (1 + shift)).all()
    assert np.linalg.norm(crosses, axis=1).sum() == pytest.approx(
        size, abs=ROUNDING * (1 + shift) * len(points)
    )


@SETTINGS
@given(ring=star_shaped(), halves=st.integers(1, 3))
def test_corners_on_straight_edges_stay(ring: Floats, halves: int) -> None:
    """Neighbors share these corners: without them, rays would pass between the polygons."""
    shares = np.arange(halves)[:, None] / halves
    points = (ring[:, None] + (np.roll(ring, -1, axis=0) - ring)[:, None] * shares).reshape(-1, 3)
    triangles = cut(points)
    assert len(triangles) == len(points) - 2
    edges = set(
        map(tuple, np.stack([triangles, np.roll(triangles, -1, axis=1)], -1).reshape(-1, 2))
    )
    assert {(k, (k + 1) % len(points)) for k in range(len(points))} <= edges


@pytest.mark.parametrize(
    "ring",
    [
        [(4, 0), (4, 2), (2, 2), (2, 4), (0, 4), (0, 0), (2, 0)],  # straight at the last corner
        [(2, -2), (4, 0), (8, 0), (4, 4), (2, 0), (0, 4), (0, 0)],  # diagonal through a corner
    ],
)
def test_ears_leave_no_corner_on_their_edges(ring: list[tuple[float, float]]) -> None:
    points = flat(ring)
    assert (crosses_of(points[cut(points)])[:, 2] > 0).all()


def test_a_valid_fan_keeps_the_numbers_of_trimesh() -> None:
    assert cut(circle(7), [0, 1, 2, 3], [0, 1, 2, 3, 4], [2, 3, 4]).tolist() == [
        *([0, 1, 2], [2, 3, 0]),
        *([0, 1, 2], [0, 2, 3], [0, 3, 4]),
        [2, 3, 4],
    ]
    assert sizes_together(np.array([4, 5, 3, 4, 5])).tolist() == [5, 0, 6, 1, 7, 2, 3, 4, 8, 9, 10]
    corners_that_coincide = flat([(0, 0), (1, 0), (1, 1), (-1, 1), (-1, 0)])
    for ring in ([0, 0, 1, 2, 3], [0, 1, 2, 0, 3, 4]):
        fan = [[ring[0], a, b] for a, b in pairwise(ring[1:])]
        assert cut(corners_that_coincide, ring).tolist() == fan
    line = flat([(k, 2 * k) for k in (0, 3, 1, 2)])
    assert cut(line).tolist() == [[0, 1, 2], [2, 3, 0]]
    assert len(cut(np.zeros((5, 3)))) == 3


def test_a_concave_quadrilateral_is_cut_by_its_other_diagonal() -> None:
    points = flat([(0, 0), (4, -4), (1, 0), (4, 4)])
    assert cut(points, [1, 2, 3, 0]).tolist() == [[2, 3, 0], [0, 1, 2]]


def test_a_bridge_to_a_hole_is_cut_along() -> None:
    ring = [(0, 0), (10, 0), (10, 10), (0, 10), (0, 0), (3, 3), (3, 6), (6, 6), (6, 3), (3, 3)]
    points = flat(ring)
    crosses = crosses_of(points[cut(points)])[:, 2]
    assert len(crosses) == 8
    assert (crosses >= 0).all() and crosses.sum() / 2 == 100 - 9


SPIRAL: list[tuple[float, float]] = [(0, 0), (9, 0), (0, 9), (-9, 0), (0, -9), (10, 0), (0, 10)]
CROSSING: dict[str, list[tuple[float, float]]] = {
    "bow tie": [(0, 0), (1, 1), (1, 0), (0, 1)],
    "crossed pentagon": [(0, 0), (4, 4), (4, 0), (0, 4), (-3, 2)],
    "there and back": [(0, 0), (1, 0), (1, 1), (1, 0)],
    "twice around": [(0, 0), (1, 0), (0, 1)] * 2,
    "spiral": SPIRAL,
    "spiral with a double corner": [*SPIRAL[:2], *SPIRAL[1:]],
}


@pytest.mark.parametrize("kind", CROSSING)
def test_a_polygon_that_crosses_itself_is_refused(kind: str) -> None:
    points = flat(CROSSING[kind])
    with pytest.raises(InputError, match="polygon 1 crosses or covers itself"):
        cut(points, [0, 1, 2], range(len(points)))


def test_a_polygon_of_very_many_corners_is_refused_where_a_fan_does_not_cut_it() -> None:
    with pytest.raises(InputError, match=r"concave and has 5,000 corners"):
        cut(circle(5000, np.where(np.arange(5000) % 2, 1.0, 0.5)))
