"""Which side of a triangle the viewer sees is decided exactly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.strategies import EIGHTHS, apertures, frusta, triangles
from tests.support.views import at, soup
from xfrustum.reference import Reference
from xfrustum.reference.lines.lines import crossed_frustum, model_cameras
from xfrustum.reference.lines.triangles import drawn_triangles, facing
from xfrustum.scenes import Aperture, DoubleFrustum, Frustum
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.plate.double_frustum import Cull

CORNERS = st.tuples(EIGHTHS, EIGHTHS, EIGHTHS)
NARROW = Frustum(resolution=(8, 8), reach=(12.0, 12.0), fov=(1.0, 1.0))


def cameras_pencils(frustum: Frustum, aperture: Aperture, near: float = 0.5):  # type: ignore[no-untyped-def]
    return [camera.bundle for camera in model_cameras(frustum, aperture, DoubleFrustum(near=near))]


@given(a=CORNERS, b=CORNERS, step=st.sampled_from([-1.0, 1.0]))
def test_one_rounding_off_the_plane_through_the_center_decides(
    a: tuple[float, float, float], b: tuple[float, float, float], step: float
) -> None:
    """Corners at a, b and a + b from the center span a plane through it: seen edge-on but for a last bit."""
    bundle, _ = cameras_pencils(NARROW, at(0.0, 0.0))
    one, other = np.array(a), np.array(b)
    middle = np.asarray(bundle.center)
    flat = np.array([[middle + one, middle + other, middle + one + other]])
    assert facing(flat, bundle).tolist() == [0]
    cofactor = np.cross(one, other)
    axis = int(np.argmax(np.abs(cofactor)))
    turned = flat.copy()
    turned[0, 2, axis] = np.nextafter(turned[0, 2, axis], step * np.inf)
    assert facing(turned, bundle).tolist() == [-int(np.sign(cofactor[axis]) * step)]


@given(corners=triangles(), aperture=apertures(), frustum=frusta(exact=True))
def test_what_is_seen_is_turned_to_the_viewer_or_away(
    corners: Floats, aperture: Aperture, frustum: Frustum
) -> None:
    """By the definition of a front: the normal by the winding points against the line of a pixel."""
    scene = soup(corners, frustum)
    for side, bundle in zip(("c", "c-star"), cameras_pencils(frustum, aperture), strict=True):
        settings = DoubleFrustum(near=0.5, camera=side)  # type: ignore[arg-type]
        image = Reference(scene).trace_model(aperture, settings)
        directions = crossed_frustum(frustum, aperture).directions()[image.covered]
        shown = image.triangle[image.covered]
        edges = corners[shown, 1:] - corners[shown, :1]
        against = -np.sign(np.einsum("ij,ij->i", np.cross(edges[:, 0], edges[:, 1]), directions))
        np.testing.assert_array_equal(facing(corners, bundle)[shown], against)


def test_without_culling_all_triangles_are_drawn_and_edge_on_ones_never_with_it() -> None:
    bundle, _ = cameras_pencils(NARROW, at(0.0, 0.0))
    edge_on = np.array([[(0.0, 0.0, -1.0), (1.0, 0.0, -2.0), (2.0, 0.0, -2.0)]])
    assert drawn_triangles(edge_on, bundle, Cull.NONE).tolist() == [0]
    assert drawn_triangles(edge_on, bundle, Cull.BACK).tolist() == []
    assert drawn_triangles(edge_on[:, ::-1], bundle, Cull.BACK).tolist() == []
    with pytest.raises(ValueError, match="not a valid Cull"):
        Cull("front")
