"""The closed form of displacement, option by option, is what the certified model of the cameras draws."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.support.views import view
from xfrustum.compare.metrics.error_maps import lengths, pixel_centers
from xfrustum.compare.prediction.displacement import (
    TruePoints,
    displacement_lengths,
    displacements,
)
from xfrustum.compare.prediction.predict import Predictor
from xfrustum.reference import Reference
from xfrustum.reference.lines.lines import model_cameras
from xfrustum.scenes import Aperture, Camera, DoubleFrustum, Frustum, HogelImage
from xfrustum.scenes.arrays import Floats
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
@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_every_point_is_drawn_where_the_certified_cameras_draw_it(name: str, options: dict[str, Any]) -> None:
    scene = view(name, (96, 72))
    aperture = scene.plate.aperture(17, 41)
    truth = Reference(scene).trace(aperture)
    for near in NEARS:
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
@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_lengths_are_those_of_the_vectors(name: str, options: dict[str, Any]) -> None:
    scene = view(name, (48, 36))
    truth = Reference(scene).trace(scene.default_apertures()[-1])
    settings = DoubleFrustum(near=1e-2 * scene.frustum.longest_reach, **options)
    every = TruePoints.of(truth)
    for points in (every, every.shown()):
        vectors = displacements(points, scene.frustum, settings)
        found = displacement_lengths(points, scene.frustum, settings)
        np.testing.assert_allclose(found, np.hypot(vectors[..., 0], vectors[..., 1]), rtol=1e-12, atol=1e-12)
    assert np.isnan(displacement_lengths(every, scene.frustum, settings)[~truth.off_plate]).all()


RMS_ROUNDING = 1e-12
"""Relative rounding of a root mean square of some thousand lengths: 2^-53 for each of some thousand sums."""


@pytest.mark.parametrize("options", OPTIONS)
def test_links_do_not_depend_on_what_was_predicted_before(options: dict[str, Any]) -> None:
    scene = view("asymmetric-recentered", (48, 32))
    aperture, settings = scene.plate.aperture(0, 0), DoubleFrustum(near=2.0, **options)
    reference = Reference(scene)
    truth, gaps = reference.trace(aperture), reference.gaps(aperture)
    alone, after = (Predictor(truth, gaps, scene.frustum, 8) for _ in range(2))
    after.predict_links(settings)
    links = alone.predict_links(settings)[1]
    assert after.predict_links(settings)[1] == links

    plain = replace(settings, pivot=Pivot.APERTURE, fit=Fit.ANGLE, slabs=())
    moved = lengths(displacements(TruePoints.of(truth).shown(), scene.frustum, plain))
    known = moved[np.isfinite(moved)]
    expected = pytest.approx(np.sqrt(np.mean(known**2)), rel=RMS_ROUNDING) if known.size else None
    assert links[0].displacement_rms_px == expected
