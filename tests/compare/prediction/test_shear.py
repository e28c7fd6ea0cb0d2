"""Shear: the ordinary off-axis projection against the paper's.

See docs/method.md, "The two cameras"; paper, section 5.

With pivot `camera` each camera shears about its own center, and every surface point is drawn
-k n / ((|z| + n) t) film units beside where pivot `aperture` draws it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import assume, given, settings

from tests.support.strategies import apertures, frusta, triangles
from tests.support.views import soup, view
from xfrustum.compare.metrics.error_maps import displacement
from xfrustum.compare.rounding.positions import POSITION_ROUNDINGS
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import Aperture, DepthFormat, DepthMapping, DoubleFrustum, Frustum, HogelImage, Scene
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.plate.double_frustum import Pivot

SCENES = ("asymmetric-recentered", "car-recentered", "bunny-transfer", "teapot-recentered")
NEARS = (1e-1, 1e-3)
"""Near offsets as fractions of the reach."""
STEPS = 4
"""Number of steps from the middle of the plate to a corner."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Shift:
    """The shift of points from where pivot `aperture` draws them, measured from two images.

    Seen from the drawn pixel u, displacement is u n / |z| with pivot aperture, and (u n + k n / t) / |z|
    with pivot camera. Displacement times |z| thus says nothing of the point: in one pixel the two
    images' differ by k n / t, whatever they show there. Over -(|z| + n) that is the shift of the point at z.
    """

    px: Floats  # (N, 2) columns and rows; rows are counted downward
    height: Floats  # (N,) |z| of the points, scene units
    bound: Floats  # (N, 2) px: how well positions are known, through the projection of both images' points

    @classmethod
    def between(cls, scene: Scene, camera: HogelImage, aperture: HogelImage, rounding: float) -> Shift:
        near = camera.camera.settings.near if camera.camera.settings else 0.0
        same = (camera.triangle == aperture.triangle) & camera.off_plate & aperture.off_plate
        products, heights = [], []
        for image in (camera, aperture):
            heights.append(np.abs(image.height[same].astype(np.float64)))
            products.append(displacement(image, image.camera)[same] * heights[-1][:, None])
        frame = camera.camera
        width, k, t = (np.asarray(part) for part in (frame.resolution, frame.shear, frame.half_extent))
        # A point's coordinates, its height through the slope of its line, and the projection's own roundings.
        sizes = scene.largest_coordinates[camera.triangle[same]] + np.hypot(
            frame.aperture.x, frame.aperture.y
        )
        slope = (np.abs(k) + t) / t
        known = sizes[:, None] * width / (2 * t) * rounding
        projected = np.maximum(*heights)[:, None] * width * slope * 2.0**-53
        away = (heights[0] + near)[:, None]
        return cls(
            px=-(products[0] - products[1]) / away,
            height=heights[0],
            bound=2 * POSITION_ROUNDINGS * (known + projected) / away,
        )


def closed_form(image: HogelImage, height: Floats, near: float) -> Floats:
    """Return -k n / ((|z| + n) t) film units in columns and rows, (N, 2)."""
    (width, rows), k, t = image.camera.resolution, image.camera.shear, image.camera.half_extent
    per_k = -near / (height + near)
    return np.stack((per_k * k[0] / t[0] * width / 2, -per_k * k[1] / t[1] * rows / 2), axis=-1)


def both_pivots(near: float) -> tuple[DoubleFrustum, DoubleFrustum]:
    paper = DoubleFrustum(near=near, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED)
    return replace(paper, pivot=Pivot.CAMERA), paper


def from_middle_to_corner(scene: Scene) -> list[Aperture]:
    columns, middle = scene.plate.hogels[0], scene.plate.middle
    shares = np.linspace(0, 1, STEPS + 1)
    return [
        scene.plate.aperture(
            round(middle.column + share * (columns - 1 - middle.column)), round(middle.row * (1 - share))
        )
        for share in shares
    ]


@pytest.mark.parametrize("name", SCENES)
def test_every_point_shifts_by_the_closed_form_from_the_middle_to_the_corner(name: str) -> None:
    """The shift has its closed form, traced and rasterized, at each of five apertures."""
    scene = view(name, (96, 72))
    reference = Reference(scene)
    seen = 0
    with Rasterizer(scene) as rasterizer:
        for aperture in from_middle_to_corner(scene):
            for near in np.array(NEARS) * scene.frustum.longest_reach:
                traced = [reference.trace_model(aperture, one) for one in both_pivots(float(near))]
                drawn = [
                    rasterizer.render(aperture, one, normals=False, color=False)
                    for one in both_pivots(float(near))
                ]
                for (camera, paper), rounding in ((traced, 2.0**-53), (drawn, 2.0**-24)):
                    shift = Shift.between(scene, camera, paper, rounding)
                    expected = closed_form(camera, shift.height, float(near))
                    assert (np.abs(shift.px - expected) <= shift.bound).all()
                    seen += len(shift.px)
    assert seen > 5000


def test_opposite_the_middle_of_the_screen_both_pivots_are_the_same() -> None:
    scene = view("asymmetric-recentered", (96, 72))
    screen, aperture = scene.frustum.screen, scene.plate.aperture(61, 12)
    assert screen is not None
    frustum = replace(scene.frustum, screen=replace(screen, center=(aperture.x, aperture.y)))
    reference = Reference(replace(scene, frustum=frustum))
    camera, paper = (reference.trace_model(aperture, one) for one in both_pivots(1.5))
    np.testing.assert_array_equal(camera.triangle, paper.triangle)
    np.testing.assert_array_equal(camera.position, paper.position)


@given(frustum=frusta(), aperture=apertures(), corners=triangles())
@settings(max_examples=60, deadline=None)
def test_any_sheared_frustum_shifts_any_triangle_by_the_closed_form(
    frustum: Frustum, aperture: Aperture, corners: Floats
) -> None:
    """The closed form holds for screens before and behind the plate, and apertures on it and beside it."""
    assume(frustum.recentered)
    scene = soup(corners, frustum)
    reference = Reference(scene)
    camera, paper = (reference.trace_model(aperture, one) for one in both_pivots(0.7))
    shift = Shift.between(scene, camera, paper, 2.0**-53)
    assert (np.abs(shift.px - closed_form(camera, shift.height, 0.7)) <= shift.bound).all()
