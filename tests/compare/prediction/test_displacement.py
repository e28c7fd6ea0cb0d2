"""The closed form of displacement, option by option, is what the certified model of the cameras draws.

Shear: the ordinary off-axis projection against the paper's (docs/method.md, "The two cameras"; paper, section
5). With pivot `camera` each camera shears about its own center, and every surface point is drawn -k n / ((|z|
+ n) t) film units beside where pivot `aperture` draws it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given

from tests.support.long_tail import examples
from tests.support.strategies import apertures, frusta, triangles
from tests.support.views import soup, view
from xfrustum.compare.metrics.error_maps import displacement, lengths, pixel_centers
from xfrustum.compare.prediction.displacement import (
    TruePoints,
    displacement_lengths,
    displacements,
)
from xfrustum.compare.prediction.predict import Predictor
from xfrustum.compare.rounding.positions import POSITION_ROUNDINGS
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.lines.lines import model_cameras
from xfrustum.scenes import (
    Aperture,
    Camera,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Frustum,
    HogelImage,
    Scene,
)
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.device_model import LLVMPIPE
from xfrustum.scenes.plate.double_frustum import Fit, Offset, Pivot

SCENES = ("asymmetric", "asymmetric-recentered", "car-recentered", "crossing")
OPTIONS: tuple[dict[str, Any], ...] = (
    {},
    {"pivot": Pivot.CAMERA},
    {"fit": 30.0},
    {"fit": 30.0, "pivot": Pivot.CAMERA},
    {"slabs": (15.0, 60.0)},
    {"slabs": (40.0,), "fit": Fit.ANGLE, "pivot": Pivot.CAMERA},
    {"slabs": (40.0,), "fit": 90.0},
    {"offset": Offset.NONE},
    {"offset": Offset.NONE, "slabs": (40.0,), "pivot": Pivot.CAMERA},
    {"camera": Camera.C},
    {"camera": Camera.C_STAR, "pivot": Pivot.CAMERA},
)
NEARS = (15.0, 1e-1, 1e-6)

ROUNDING_PX = 1e-12
"""The model projects each point through a camera of its own: differences of pixel numbers of up to some
thousands, which doubles know to 2^-53 of that, times a dozen operations."""


def drawn_by_the_model(
    truth: HogelImage, frustum: Frustum, aperture: Aperture, settings: DoubleFrustum
) -> Floats:
    """Project every true point through the lines of the reference's own offset cameras."""
    found = np.full((*truth.triangle.shape, 2), np.nan)
    width, rows = truth.camera.resolution
    for camera in model_cameras(frustum, aperture, settings):
        lines, (low, high) = camera.pencil, camera.heights
        seen = truth.off_plate & (truth.height >= low) & (truth.height <= high)
        away = np.asarray(lines.center) - truth.position[seen]
        s = away[:, 2:]
        u, v = ((-away[:, :2] / s - lines.shear) / lines.half_extent).T
        drawn = np.stack(((u + 1) * width / 2 - 0.5, (1 - v) * rows / 2 - 0.5), axis=-1)
        found[seen] = pixel_centers(truth.camera)[seen] - drawn
    return found


@pytest.fixture(scope="module")
def asymmetric() -> tuple[Frustum, HogelImage]:
    scene = view("asymmetric", (96, 72))
    return scene.frustum, Reference(scene).trace(scene.plate.middle)


@pytest.mark.parametrize("name", SCENES)
def test_every_point_is_drawn_where_the_certified_cameras_draw_it(name: str) -> None:
    scene = view(name, (96, 72))
    aperture = scene.plate.aperture(17, 41)
    truth = Reference(scene).trace(aperture)
    for near, options in product(NEARS, OPTIONS):
        settings = DoubleFrustum(near=near, **options)
        predicted = displacements(TruePoints.of(truth), scene.frustum, settings)
        model = drawn_by_the_model(truth, scene.frustum, aperture, settings)
        np.testing.assert_array_equal(np.isfinite(predicted), np.isfinite(model))
        np.testing.assert_allclose(predicted, model, rtol=1e-12, atol=ROUNDING_PX)


def test_the_planes_of_the_fitted_height_are_drawn_exactly_and_beyond_the_first_slab_everything(
    asymmetric: tuple[Frustum, HogelImage],
) -> None:
    """The error changes its sign at the fitted height."""
    frustum, truth = asymmetric
    height = np.abs(truth.height)
    fitted = float(np.nanmedian(height))
    columns = displacements(TruePoints.of(truth), frustum, DoubleFrustum(near=1.0, fit=fitted))[..., 0]
    shown = truth.off_plate & (np.arange(96) > 48)
    np.testing.assert_array_equal(columns[shown] > 0, height[shown] < fitted)
    settings = DoubleFrustum(near=1.0, slabs=(40.0,), fit=Fit.ANGLE)
    moved = displacements(TruePoints.of(truth), frustum, settings)
    assert (height > 40).any() and (height < 40).any()
    np.testing.assert_array_equal(moved[height > 40], 0.0)
    assert (np.abs(moved[height < 40]).max(axis=-1) > 0).all()


def test_a_small_near_loses_no_digits(asymmetric: tuple[Frustum, HogelImage]) -> None:
    """u n / (|z| + n), not a difference of nearly equal numbers: 1e-12 of the reach is as good as a tenth."""
    frustum, truth = asymmetric
    small, smaller = (
        displacements(TruePoints.of(truth), frustum, DoubleFrustum(near=near)) for near in (1e-9, 1e-10)
    )
    shown = truth.off_plate
    # To first order in n over the smallest height.
    tolerance = 1e-9 / float(np.abs(truth.height[shown]).min())
    np.testing.assert_allclose(small[shown], 10 * smaller[shown], rtol=2 * tolerance)


@pytest.mark.parametrize("name", SCENES)
def test_lengths_are_those_of_the_vectors(name: str) -> None:
    scene = view(name, (48, 36))
    truth = Reference(scene).trace(scene.default_apertures()[-1])
    every = TruePoints.of(truth)
    for options, points in product(OPTIONS, (every, every.shown())):
        settings = DoubleFrustum(near=1e-2 * scene.frustum.longest_reach, **options)
        vectors = displacements(points, scene.frustum, settings)
        found = displacement_lengths(points, scene.frustum, settings)
        np.testing.assert_allclose(found, np.hypot(vectors[..., 0], vectors[..., 1]), rtol=1e-12, atol=1e-12)
        if points is every:
            assert np.isnan(found[~truth.off_plate]).all()


RMS_ROUNDING = 1e-12
"""Relative rounding of a root mean square of some thousand lengths: 2^-53 for each of some thousand sums."""


@pytest.mark.parametrize("options", OPTIONS)
def test_links_do_not_depend_on_what_was_predicted_before(options: dict[str, Any]) -> None:
    scene = view("asymmetric-recentered", (48, 32))
    aperture, settings = scene.plate.aperture(0, 0), DoubleFrustum(near=2.0, **options)
    reference = Reference(scene)
    truth = reference.trace(aperture)
    alone, after = (Predictor(truth, reference, LLVMPIPE) for _ in range(2))
    after.predict_each([settings])[0]
    links = alone.predict_each([settings])[0][1]
    assert after.predict_each([settings])[0][1] == links

    plain = replace(settings, pivot=Pivot.APERTURE, fit=Fit.ANGLE, slabs=())
    moved = lengths(displacements(TruePoints.of(truth).shown(), scene.frustum, plain))
    known = moved[np.isfinite(moved)]
    expected = pytest.approx(np.sqrt(np.mean(known**2)), rel=RMS_ROUNDING) if known.size else None
    assert links[0].displacement_rms_px == expected


SHEARED = ("asymmetric-recentered", "car-recentered", "bunny-transfer", "teapot-recentered")
SHEAR_NEARS = (1e-1, 1e-3)  #: near offsets as fractions of the reach
STEPS = 2  #: number of steps from the middle of the plate to a corner


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


@pytest.mark.parametrize("name", SHEARED)
def test_every_point_shifts_by_the_closed_form_from_the_middle_to_the_corner(name: str) -> None:
    """The shift has its closed form, traced and rasterized, at each of three apertures."""
    scene = view(name, (96, 72))
    reference = Reference(scene)
    seen = 0
    with Rasterizer(scene) as rasterizer:
        for aperture in from_middle_to_corner(scene):
            for near in np.array(SHEAR_NEARS) * scene.frustum.longest_reach:
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
    assert seen > 3000


def test_opposite_the_middle_of_the_screen_both_pivots_are_the_same() -> None:
    scene = view("asymmetric-recentered", (96, 72))
    screen, aperture = scene.frustum.screen, scene.plate.aperture(61, 12)
    frustum = replace(scene.frustum, screen=replace(screen, center=(aperture.x, aperture.y)))
    reference = Reference(replace(scene, frustum=frustum))
    camera, paper = (reference.trace_model(aperture, one) for one in both_pivots(1.5))
    np.testing.assert_array_equal(camera.triangle, paper.triangle)
    np.testing.assert_array_equal(camera.position, paper.position)


@given(frustum=frusta(), aperture=apertures(), corners=triangles())
@examples(30)
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
