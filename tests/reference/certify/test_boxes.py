"""Boxes of triangles on the film, found by a kernel and found in NumPy: the same ones."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.views import at, view
from xfrustum.reference.certify import processors
from xfrustum.reference.certify.certify import corner_table
from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.certify.footprints import Footprints, footprints, footprints_on_device
from xfrustum.reference.certify.sides import sorted_by_side
from xfrustum.reference.devices.arithmetic import NUMPY
from xfrustum.reference.certify.cone import Planes
from xfrustum.reference.lines.lines import Pencil, crossed_frustum, model_cameras
from xfrustum.scenes import DoubleFrustum, Frustum
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.plate.double_frustum import Pivot

pytestmark = pytest.mark.skipif(not processors.compiled(), reason="there is no LLVM for Dr.Jit here")

FRUSTUM = Frustum(resolution=(12, 9), reach=(12.0, 9.0), fov=(math.radians(70), math.radians(50)))
GRID = st.integers(-6, 6).map(lambda step: step / 2)


def assert_same_boxes(triangles: Floats, pencil: Pencil) -> None:
    table = corner_table(triangles)
    assert table is not None
    exact = ExactPencil(triangles, pencil)
    plain = in_order(footprints(sorted_by_side(triangles, pencil), pencil, exact))
    found = in_order(footprints_on_device(table, pencil, exact))
    for name in ("number", "side", "holds_center", "box"):
        np.testing.assert_array_equal(getattr(found, name), getattr(plain, name), err_msg=name)
    if found.turned is not None:
        points = list(triangles[plain.number].transpose(1, 2, 0))
        planes = Planes.of(NUMPY, points, pencil.center, plain.holds_center)
        turn = np.where(planes.plane < 0, -plain.side, plain.side)
        in_doubt = np.abs(planes.plane) <= planes.plane_bound
        np.testing.assert_array_equal(found.turned, np.where(in_doubt, 2 * turn, turn))


def in_order(found: Footprints) -> Footprints:
    order = np.lexsort((found.side, found.number))
    return replace(
        found,
        number=found.number[order],
        side=found.side[order],
        holds_center=found.holds_center[order],
        box=found.box[:, order],
        turned=None if found.turned is None else found.turned[order],
    )


@settings(max_examples=40)
@given(
    corners=st.lists(st.lists(st.tuples(GRID, GRID, GRID), min_size=3, max_size=3), min_size=1, max_size=12),
    x=GRID,
    y=GRID,
    near=st.sampled_from([1e-9, 0.5, 1.0, 7.0]),
)
def test_triangles_on_a_grid_have_the_same_boxes(
    corners: list[list[tuple[float, float, float]]], x: float, y: float, near: float
) -> None:
    """Triangles that lie in the plate or end there, contain a camera, are flat, or beyond the reach."""
    aperture = at(x, y)
    cameras = model_cameras(FRUSTUM, aperture, DoubleFrustum(near=near, slabs=(2.0,)))
    for pencil in (crossed_frustum(FRUSTUM, aperture), *(camera.pencil for camera in cameras)):
        assert_same_boxes(np.array(corners), pencil)


@pytest.mark.parametrize("name", ["crossing", "asymmetric-recentered"])
def test_so_have_those_of_a_scene(name: str) -> None:
    scene = view(name, (40, 30))
    for aperture in (scene.plate.middle, *scene.plate.corners):
        for near in (1e-6, 3.0):
            cameras = model_cameras(scene.frustum, aperture, DoubleFrustum(near=near, pivot=Pivot.CAMERA))
            for pencil in (crossed_frustum(scene.frustum, aperture), *(one.pencil for one in cameras)):
                assert_same_boxes(scene.triangles, pencil)
