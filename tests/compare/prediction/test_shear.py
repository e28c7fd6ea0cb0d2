"""Shear: the ordinary off-axis projection against the paper's.

See docs/method.md, "The two cameras"; paper, section 5.

With pivot `camera` each camera shears about its own center, and every surface point is drawn
-k n / ((|z| + n) t) film units beside where pivot `aperture` draws it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings

from tests.support.strategies import apertures, frusta, triangles
from tests.support.views import soup, view
from xfrustum.compare.metrics.error_maps import displacement
from xfrustum.compare.prediction.displacement import TruePoints, displacements
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
    images' differ by k n / t, whatever they show there. Over -(|z| + n) that is the shift of the point
    at z.

    Attributes
    ----------
    px
        (N, 2) shift in columns and rows, px; rows are counted downward.
    height
        (N,) heights |z| of the points, scene units.
    bound
        (N, 2) px: how well positions are known, through the projection of both images' points.
    """

    px: Floats
    height: Floats
    bound: Floats

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


@pytest.mark.parametrize("name", SCENES)
def test_the_shift_grows_linearly_with_the_shear(name: str) -> None:
    """Points at one height shift in proportion to k from one aperture to the next, in columns and in rows."""
    scene = view(name, (96, 72))
    reference = Reference(scene)
    near = 0.01 * scene.frustum.longest_reach
    shears, shifts = [], []
    for aperture in from_middle_to_corner(scene):
        camera, paper = (reference.trace_model(aperture, one) for one in both_pivots(near))
        shift = Shift.between(scene, camera, paper, 2.0**-53)
        if len(shift.px):
            shears.append(camera.camera.shear)
            # Over the weight of its height, every point's shift is the same.
            shifts.append(np.median(shift.px * (shift.height + near)[:, None], axis=0))
    assert len(shears) > 2
    slopes = [
        (b - a) / np.subtract(after, before)
        for (before, a), (after, b) in pairwise(zip(shears, shifts, strict=True))
    ]
    for slope in slopes:
        np.testing.assert_allclose(slope, slopes[0], rtol=1e-9)
    assert slopes[0][0] < 0 < slopes[0][1]


@pytest.mark.parametrize("axis", [0, 1])
def test_without_shear_along_an_axis_nothing_shifts_along_it(axis: int) -> None:
    """An aperture opposite the screen's middle in x alone, or in y alone: columns and rows know of
    their own axis only. Where both pivots shear by nothing they are the same."""
    scene = view("asymmetric-recentered", (96, 72))
    screen = scene.frustum.screen
    assert screen is not None
    aperture = scene.plate.aperture(61, 12)
    there = (aperture.x, aperture.y)
    x, y = screen.center
    center = (there[0], y) if axis == 0 else (x, there[1])
    for middle in (center, there):
        moved = replace(scene.frustum, screen=replace(screen, center=middle))
        reference = Reference(replace(scene, frustum=moved))
        camera, paper = (reference.trace_model(aperture, one) for one in both_pivots(1.5))
        if middle == there:
            np.testing.assert_array_equal(camera.triangle, paper.triangle)
            np.testing.assert_array_equal(camera.position, paper.position)
            continue
        shift = Shift.between(scene, camera, paper, 2.0**-53)
        assert len(shift.px) > 500
        assert (np.abs(shift.px[:, axis]) <= shift.bound[:, axis]).all()
        assert (np.abs(shift.px[:, 1 - axis]) > 1e-2).all()


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


@pytest.mark.parametrize("name", SCENES)
def test_the_prediction_from_the_truth_has_the_same_shift(name: str) -> None:
    scene = view(name, (96, 72))
    aperture = scene.plate.corners[1]
    truth = Reference(scene).trace(aperture)
    near = 0.01 * scene.frustum.longest_reach
    camera, paper = (displacements(TruePoints.of(truth), scene.frustum, one) for one in both_pivots(near))
    shown = truth.off_plate
    assert shown.any()
    # Displacement is true minus drawn: the drawn point moves the other way.
    expected = -closed_form(truth, np.abs(truth.height[shown]), near)
    np.testing.assert_allclose((camera - paper)[shown], expected, rtol=1e-9, atol=1e-12)
