"""Occlusion of surface points is decided as by rational arithmetic."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.brute_force import exact_s
from tests.support.long_tail import examples
from tests.support.strategies import ANYTHING, EIGHTHS, apertures, frusta, triangles
from tests.support.views import at, soup, view
from xfrustum.reference import Reference, SurfacePoints
from xfrustum.reference.certify import occlusion
from xfrustum.reference.lines.lines import RayBundle, crossed_frustum
from xfrustum.scenes import Scene
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.hogel_image import NOTHING


def hidden(scene: Scene, bundle: RayBundle, points: SurfacePoints) -> Mask:
    return Reference(scene).hidden_from(bundle, points)


def hidden_by_definition(scene: Scene, bundle: RayBundle, points: SurfacePoints) -> list[bool]:
    """Test every triangle against every point's own line, in rational numbers."""
    center = np.array(bundle.center)
    result = []
    for position, own, tolerance in zip(
        points.position, points.triangle, points.tolerance, strict=True
    ):
        s = center[2] - position[2]
        slopes = (position[:2] - center[:2]) / s
        line = np.array([*slopes, -1.0])
        end = s - tolerance / (2 * np.sqrt(slopes[0] * slopes[0] + slopes[1] * slopes[1] + 1.0))
        hides = False
        for number, corners in enumerate(scene.triangles):
            met = exact_s(corners, center, line)
            if (
                number == own
                or met is None
                or not Fraction(bundle.s_range[0]) <= met < Fraction(end)
            ):
                continue
            hides |= is_off_plane(position, corners, tolerance)
        result.append(hides)
    return result


def is_off_plane(point: Floats, corners: Floats, tolerance: float) -> bool:
    """Return whether (P - b0) . n exceeds the tolerance times |n|, in rational numbers."""
    b0, b1, b2, p = ([Fraction(float(value)) for value in row] for row in (*corners, point))
    u, v, w = ([to - start for to, start in zip(end, b0, strict=True)] for end in (b1, b2, p))
    n = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
    along = sum(a * b for a, b in zip(w, n, strict=True))
    return bool(along**2 > Fraction(float(tolerance)) ** 2 * sum(value**2 for value in n))


def sheet(origin: Floats, across: Floats, along: Floats, cells: tuple[int, int]) -> Floats:
    """Return a parallelogram in some cells of two triangles each, (F, 3, 3)."""
    i, j = np.meshgrid(np.arange(cells[0]), np.arange(cells[1]), indexing="ij")

    def corner(right: int, up: int) -> Floats:
        share = [((i + right) / cells[0]).ravel()[:, None], ((j + up) / cells[1]).ravel()[:, None]]
        return np.asarray(origin + share[0] * across + share[1] * along)

    halves = [
        (corner(0, 0), corner(1, 0), corner(1, 1)),
        (corner(0, 0), corner(1, 1), corner(0, 1)),
    ]
    return np.concatenate([np.stack(half, axis=1) for half in halves])


def points_drawn_on(corners: Floats, count: int) -> SurfacePoints:
    """Return points on some triangles as float32 stores them, known to 16 of its roundings."""
    random = np.random.default_rng(11)
    number = random.integers(0, len(corners), count).astype(np.int32)
    share = random.dirichlet((1, 1, 1), count)
    exact = np.einsum("ij,ijk->ik", share, corners[number])
    return SurfacePoints(
        position=exact.astype(np.float32).astype(np.float64),
        triangle=number,
        tolerance=np.full(count, 16 * 2.0**-24 * np.abs(corners).max()),
    )


@st.composite
def points_of(
    draw: st.DrawFn, corners: Floats, coordinates: st.SearchStrategy[float]
) -> SurfacePoints:
    """Return points off the plate: on named triangles, and anywhere."""
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
    named = np.array([*number, *([NOTHING] * len(anywhere))], dtype=np.int32)
    tolerance = draw(st.sampled_from([0.0, 1e-6, 0.25]))
    return SurfacePoints(
        position=position, triangle=named, tolerance=np.full(len(named), tolerance)
    )


@pytest.mark.parametrize("coordinates", [EIGHTHS, ANYTHING], ids=["eighths", "anything"])
@examples(30)
@given(data=st.data())
def test_a_point_is_hidden_where_rational_arithmetic_says_so(
    coordinates: st.SearchStrategy[float], data: st.DataObject
) -> None:
    # Coordinates of eighths make lines run through edges, corners and planes exactly.
    corners = data.draw(triangles(coordinates=coordinates))
    scene = soup(corners, data.draw(frusta()))
    bundle = crossed_frustum(scene.frustum, data.draw(apertures()))
    points = data.draw(points_of(corners, coordinates))
    assert hidden(scene, bundle, points).tolist() == hidden_by_definition(scene, bundle, points)


def test_surfaces_are_told_apart_that_float32_cannot_tell() -> None:
    # Two sheets whose distance is a hundredth of a rounding of float32, and points on the farther
    # one.
    scene = view("sheets", (16, 16))
    sheet = np.array([[-9.0, -9, 0], [9, -9, 0], [0, 18, 0]])
    gap = 6.0 * 2.0**-24 / 100
    scene = soup(np.stack((sheet - [0, 0, 6], sheet - [0, 0, 6 + gap])), scene.frustum)
    x, y = (value.ravel() for value in np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 5)))
    bundle = crossed_frustum(scene.frustum, scene.plate.middle)
    for own, other in ((0, 1), (1, 0)):
        points = SurfacePoints(
            position=np.stack((x, y, np.full(x.size, scene.triangles[own, 0, 2])), axis=1),
            triangle=np.full(x.size, own, dtype=np.int32),
            tolerance=np.full(x.size, gap / 4),
        )
        assert (hidden(scene, bundle, points) == (own == 1)).all()
        # Known less exactly than the sheets lie apart, each point lies on both of them.
        blurred = replace(points, tolerance=np.full(x.size, 4 * gap))
        assert not hidden(scene, bundle, blurred).any()
        assert other != own


@pytest.mark.parametrize("times_finer", [1, 10, 100, 1000])
def test_a_flat_sheet_does_not_hide_its_own_points_however_fine_it_is(times_finer: int) -> None:
    # Lines meet the sheet's plane at angles of some 1e-5: where rounding moves a point by 1e-6
    # behind it, its line met it 0.1 before, in another triangle of the finest sheet.
    frustum = view("sheets", (32, 32)).frustum
    corners = sheet(
        np.array([-1.5, 1e-4 - 0.375, -9.0]),
        np.array([3.0, 0.75, 0.0]),
        np.array([0.0, 0.0, 6.0]),
        (1, times_finer),
    )
    points = points_drawn_on(corners, 400)
    bundle = crossed_frustum(frustum, at(0.0, 0.0))
    assert not hidden(soup(corners, frustum), bundle, points).any()


@pytest.mark.parametrize("cells", [(1, 1), (16, 32)])
def test_a_plane_through_the_aperture_does_not_hide_its_own_points(cells: tuple[int, int]) -> None:
    # Every line to a point of the plane lies in the plane, but rounded points lie beside it: their
    # lines meet the triangle about the aperture at s = 0.
    frustum = view("sheets", (32, 32)).frustum
    corners = sheet(
        np.array([-1.5, -2.5, -4.5]), np.array([0.0, 4.0, 0.0]), np.array([3.0, 0.5, 9.0]), cells
    )
    bundle = crossed_frustum(frustum, at(0.0, 0.25))
    points = points_drawn_on(corners, 400)
    assert not hidden(soup(corners, frustum), bundle, points).any()


def test_many_layers_hide_what_lies_behind_them(monkeypatch: pytest.MonkeyPatch) -> None:
    # More pairs than there is room for at first.
    monkeypatch.setattr(occlusion, "MIN_PAIRS", 5)
    frustum = view("sheets", (8, 8)).frustum
    layer = np.array([[-90.0, -90, 0], [90, -90, 0], [0, 180, 0]])
    corners = layer - np.array([0.0, 0.0, 1.0]) * (1 + np.arange(40) / 8)[:, None, None]
    x, y, z = (
        value.ravel() for value in np.meshgrid(np.linspace(-3, 3, 12), [0.5], [-0.5, -3.0, -9.0])
    )
    points = SurfacePoints(
        position=np.stack((x, y, z), axis=1),
        triangle=np.full(x.size, NOTHING, dtype=np.int32),
        tolerance=np.full(x.size, 1e-6),
    )
    result = hidden(soup(corners, frustum), crossed_frustum(frustum, at(0.0, 0.0)), points)
    np.testing.assert_array_equal(result, z < -1)
