"""The occlusion of surface points agrees with rational arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from tests.support.brute_force import exact_s
from tests.support.long_tail import examples
from tests.support.strategies import ANYTHING, EIGHTHS, apertures, frusta, triangles
from tests.support.views import at, soup, view
from xfrustum.reference import Reference, SurfacePoints
from xfrustum.reference.lines import RayBundle, crossed_frustum
from xfrustum.scenes import Frustum
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.images import NOTHING


def hidden(corners: Floats, bundle: RayBundle, points: SurfacePoints, frustum: Frustum) -> Mask:
    return Reference(soup(corners, frustum)).hidden_from(bundle, points)


def surface_points(position: Floats, triangle: ArrayLike, tolerance: float) -> SurfacePoints:
    """Return points (N, 3), each on a triangle, all with one tolerance."""
    count = len(position)
    return SurfacePoints(
        position=position,
        triangle=np.broadcast_to(np.asarray(triangle, np.int32), count),
        tolerance=np.full(count, tolerance),
    )


def hides(
    point: tuple[Floats, int, float], bundle: RayBundle, number: int, corners: Floats
) -> bool:
    """Return whether a triangle hides a point of another triangle, in rational numbers.

    It does if it meets the point's line before the range of the tolerance around the point, and the
    point's distance from its plane exceeds the tolerance.
    """
    (position, own, tolerance), center = point, np.array(bundle.center)
    s = center[2] - position[2]
    line = np.array([*((position[:2] - center[:2]) / s), -1.0])
    end = s - tolerance / (2 * np.sqrt(line[0] * line[0] + line[1] * line[1] + 1.0))
    met = exact_s(corners, center, line)
    if number == own or met is None or not Fraction(bundle.s_range[0]) <= met < Fraction(end):
        return False
    b0, b1, b2, p = np.vectorize(Fraction, otypes=[object])([*corners, position])
    n = np.cross(b1 - b0, b2 - b0)
    return bool(((p - b0) @ n) ** 2 > Fraction(float(tolerance)) ** 2 * (n @ n))


@st.composite
def points_of(
    draw: st.DrawFn, corners: Floats, coordinates: st.SearchStrategy[float]
) -> SurfacePoints:
    """Return points off the plate, on named triangles and elsewhere."""
    number = draw(st.lists(st.integers(0, len(corners) - 1), min_size=1, max_size=6))
    shares = [
        draw(st.sampled_from([(1, 0, 0), (0.5, 0.5, 0), (0.25, 0.25, 0.5), (0.5, 0, 0.5)]))
        for _ in number
    ]
    on = [np.array(share) @ corners[item] for share, item in zip(shares, number, strict=True)]
    anywhere = draw(
        st.lists(st.tuples(coordinates, coordinates, coordinates), min_size=1, max_size=6)
    )
    position = np.array([*on, *anywhere], dtype=np.float64)
    position[position[:, 2] == 0, 2] = 1.0
    tolerance = draw(st.sampled_from([0.0, 1e-6, 0.25]))
    return surface_points(position, [*number, *([NOTHING] * len(anywhere))], tolerance)


@pytest.mark.parametrize("coordinates", [EIGHTHS, ANYTHING], ids=["eighths", "anything"])
@examples(30)
@given(data=st.data())
def test_hidden_points_are_those_of_rational_arithmetic(
    coordinates: st.SearchStrategy[float], data: st.DataObject
) -> None:
    # With multiples of 1/8 as coordinates, lines run exactly through edges, corners and planes.
    corners = data.draw(triangles(coordinates=coordinates))
    frustum = data.draw(frusta())
    bundle = crossed_frustum(frustum, data.draw(apertures()))
    points = data.draw(points_of(corners, coordinates))
    expected = [
        any(hides(point, bundle, *triangle) for triangle in enumerate(corners))
        for point in zip(points.position, points.triangle, points.tolerance, strict=True)
    ]
    assert hidden(corners, bundle, points, frustum).tolist() == expected


FRUSTUM = view("sheets", (16, 16)).frustum


def test_surfaces_closer_than_float32_resolves_hide_each_other() -> None:
    """Two sheets are a hundredth of a float32 rounding apart: only the farther one is hidden."""
    gap, large = 6.0 * 2.0**-24 / 100, np.array([[-9.0, -9, 0], [9, -9, 0], [0, 18, 0]])
    corners = np.stack((large - [0, 0, 6], large - [0, 0, 6 + gap]))
    bundle, xy = crossed_frustum(FRUSTUM, at(0.0, 0.0)), np.indices((5, 5)).reshape(2, -1).T / 2 - 1
    for own in (0, 1):
        position = np.insert(xy, 2, corners[own, 0, 2], axis=1)
        # With a tolerance above the distance between the sheets, each point lies on both.
        for tolerance, is_hidden in ((gap / 4, own == 1), (4 * gap, False)):
            points = surface_points(position, own, tolerance)
            assert (hidden(corners, bundle, points, FRUSTUM) == is_hidden).all()


FLAT = ([-1.5, 1e-4 - 0.375, -9.0], [3.0, 0.75, 0.0], [0.0, 0.0, 6.0])
THROUGH = ([-1.5, -2.5, -4.5], [0.0, 4.0, 0.0], [3.0, 0.5, 9.0])


@pytest.mark.parametrize(
    ("sheet", "cells", "y"),
    [
        # Lines meet the sheet's plane at angles of about 1e-5. A point that rounding moves 1e-6
        # behind the plane has a line that met the plane 0.1 earlier, in another triangle of the
        # finest sheet.
        *((FLAT, (1, finer), 0.0) for finer in (1, 10, 1000)),
        # Every line to a point of the plane lies in the plane, but rounded points lie beside it:
        # their lines meet the triangle around the aperture at s = 0.
        *((THROUGH, cells, 0.25) for cells in ((1, 1), (16, 32))),
    ],
)
def test_a_sheet_does_not_hide_its_own_points_however_fine_it_is(
    sheet: tuple[list[float], ...], cells: tuple[int, int], y: float
) -> None:
    origin, *edges = map(np.array, sheet)
    i, j = (index.ravel()[:, None] for index in np.indices(cells))
    corner = [
        origin + (i + right) / cells[0] * edges[0] + (j + up) / cells[1] * edges[1]
        for right, up in ((0, 0), (1, 0), (1, 1), (0, 1))
    ]
    corners = np.concatenate(
        [np.stack([corner[k] for k in ks], 1) for ks in ((0, 1, 2), (0, 2, 3))]
    )
    random = np.random.default_rng(11)
    number = random.integers(0, len(corners), 400)
    exact = np.einsum("ij,ijk->ik", random.dirichlet((1, 1, 1), 400), corners[number])
    # Points as float32 stores them, with a tolerance of 16 roundings.
    stored, tolerance = (
        exact.astype(np.float32).astype(float),
        16 * 2.0**-24 * np.abs(corners).max(),
    )
    points = surface_points(stored, number, tolerance)
    assert not hidden(corners, crossed_frustum(FRUSTUM, at(0.0, y)), points, FRUSTUM).any()


def test_a_line_in_the_plane_of_a_triangle_about_the_aperture_does_not_meet_it() -> None:
    """A point a rounding off the plane, whose direction is rounded into the plane."""
    x, s = 1.9, 1.25
    y = np.nextafter(x, 2.0)
    assert x / s == y / s
    corners = np.array([[[x, x, -s], [-4.0, -4.0, -1.0], [-4.0, -4.0, 7.0]]])
    points = surface_points(np.array([[x, y, -s]]), NOTHING, 0.0)
    bundle = crossed_frustum(FRUSTUM, at(0.0, 0.0))
    assert not hidden(corners, bundle, points, FRUSTUM).any()
    # Beside the plane lines meet the triangle in the aperture.
    points = surface_points(np.array([[x, y + 1e-9, -s]]), NOTHING, 0.0)
    assert hidden(corners, bundle, points, FRUSTUM).all()


def test_many_layers_hide_what_lies_behind_them() -> None:
    """The number of pairs exceeds the initial capacity."""
    layer = np.array([[-90.0, -90, 0], [90, -90, 0], [0, 180, 0]])
    corners = layer - np.array([0.0, 0.0, 1.0]) * (1 + np.arange(40) / 8)[:, None, None]
    position = np.array([(x, 0.5, z) for x in np.linspace(-3, 3, 12) for z in (-0.5, -3.0, -9.0)])
    points = surface_points(position, NOTHING, 1e-6)
    result = hidden(corners, crossed_frustum(FRUSTUM, at(0.0, 0.0)), points, FRUSTUM)
    np.testing.assert_array_equal(result, position[:, 2] < -1)
