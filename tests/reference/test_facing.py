"""The side of a triangle that faces the viewer is decided exactly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.strategies import EIGHTHS
from tests.support.views import at
from xfrustum.reference.lines import RayBundle, drawn_triangles, facing, model_cameras
from xfrustum.scenes import Aperture, DoubleFrustum, Frustum
from xfrustum.scenes.plate import Cull

CORNERS = st.tuples(EIGHTHS, EIGHTHS, EIGHTHS)
NARROW = Frustum(resolution=(8, 8), reach=(12.0, 12.0), fov=(1.0, 1.0))


def camera_bundles(frustum: Frustum, aperture: Aperture, near: float = 0.5) -> list[RayBundle]:
    return [camera.bundle for camera in model_cameras(frustum, aperture, DoubleFrustum(near=near))]


@given(a=CORNERS, b=CORNERS, step=st.sampled_from([-1.0, 1.0]))
def test_one_rounding_off_the_plane_through_the_center_decides(
    a: tuple[float, float, float], b: tuple[float, float, float], step: float
) -> None:
    """Corners a, b and a + b span a plane through the center: edge-on up to one rounding."""
    bundle, _ = camera_bundles(NARROW, at(0.0, 0.0))
    item, other = np.array(a), np.array(b)
    middle = np.asarray(bundle.center)
    flat = np.array([[middle + item, middle + other, middle + item + other]])
    assert facing(flat, bundle).tolist() == [0]
    cofactor = np.cross(item, other)
    axis = int(np.argmax(np.abs(cofactor)))
    turned = flat.copy()
    turned[0, 2, axis] = np.nextafter(turned[0, 2, axis], step * np.inf)
    assert facing(turned, bundle).tolist() == [-int(np.sign(cofactor[axis]) * step)]


def test_without_culling_all_triangles_are_drawn_and_edge_on_ones_never_with_it() -> None:
    bundle, _ = camera_bundles(NARROW, at(0.0, 0.0))
    edge_on = np.array([[(0.0, 0.0, -1.0), (1.0, 0.0, -2.0), (2.0, 0.0, -2.0)]])
    assert drawn_triangles(edge_on, bundle, Cull.NONE).tolist() == [0]
    assert drawn_triangles(edge_on, bundle, Cull.BACK).tolist() == []
    assert drawn_triangles(edge_on[:, ::-1], bundle, Cull.BACK).tolist() == []
    with pytest.raises(ValueError, match="not a valid Cull"):
        Cull("front")
