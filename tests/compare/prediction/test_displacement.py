"""Closed-form displacements agree with the certified camera model, for every option.

Shear: the ordinary off-axis projection, compared with the paper's (docs/method.md, "The two
cameras"; paper, section 5). With pivot `camera` each camera shears about its own center. It draws a
surface point -k n / ((|z| + n) t) film units beside its place with pivot `aperture`.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given

from tests.support.long_tail import examples
from tests.support.strategies import apertures, frusta, triangles
from tests.support.views import soup, view
from xfrustum.compare.error_maps import lengths, pixel_centers
from xfrustum.compare.prediction.displacement import TruePoints, displacement_lengths, displacements
from xfrustum.reference import Reference
from xfrustum.reference.lines import model_cameras
from xfrustum.scenes import (
    Aperture,
    Camera,
    DoubleFrustum,
    Frustum,
    HogelImage,
)
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.plate import Fit, Offset, Pivot

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
"""Rounding of displacements. The model projects each point through a separate camera: pixel numbers
of up to some thousands differ, each rounded to 2^-53 of itself by about a dozen operations.
"""


def drawn_by_the_model(
    truth: HogelImage, frustum: Frustum, aperture: Aperture, settings: DoubleFrustum
) -> Floats:
    """Project every true point along the lines of the reference's offset cameras."""
    displaced = np.full((*truth.triangle.shape, 2), np.nan)
    width, rows = truth.camera.resolution
    for camera in model_cameras(frustum, aperture, settings):
        lines, (low, high) = camera.bundle, camera.heights
        seen = truth.off_plate & (truth.height >= low) & (truth.height <= high)
        away = np.asarray(lines.center) - truth.position[seen]
        s = away[:, 2:]
        u, v = ((-away[:, :2] / s - lines.shear) / lines.half_extent).T
        drawn = np.stack(((u + 1) * width / 2 - 0.5, (1 - v) * rows / 2 - 0.5), axis=-1)
        displaced[seen] = pixel_centers(truth.camera)[seen] - drawn
    return displaced


@pytest.mark.parametrize("name", SCENES)
def test_every_point_is_drawn_where_the_certified_cameras_draw_it(name: str) -> None:
    scene = view(name, (96, 72))
    aperture = scene.plate.aperture(17, 41)
    truth = Reference(scene).trace(aperture)
    for near, options in product(NEARS, OPTIONS):
        settings = DoubleFrustum(near=near, **options)
        predicted = displacements(TruePoints.from_image(truth), scene.frustum, settings)
        model = drawn_by_the_model(truth, scene.frustum, aperture, settings)
        np.testing.assert_array_equal(np.isfinite(predicted), np.isfinite(model))
        np.testing.assert_allclose(predicted, model, rtol=1e-12, atol=ROUNDING_PX)
        lengths_px = displacement_lengths(TruePoints.from_image(truth), scene.frustum, settings)
        np.testing.assert_allclose(lengths_px, lengths(model), rtol=1e-12, atol=ROUNDING_PX)


@examples(30)
@given(frustum=frusta(), aperture=apertures(), corners=triangles())
def test_any_sheared_frustum_shifts_any_point_by_the_closed_form(
    frustum: Frustum, aperture: Aperture, corners: Floats
) -> None:
    """Screens lie before and behind the plate, and apertures on and beside it."""
    assume(frustum.recentered)
    near, truth = 0.7, Reference(soup(corners, frustum)).trace(aperture)
    paper, camera = (
        drawn_by_the_model(truth, frustum, aperture, DoubleFrustum(near=near, pivot=pivot))
        for pivot in (Pivot.APERTURE, Pivot.CAMERA)
    )
    (width, rows), k, t = (
        truth.camera.resolution,
        np.array(truth.camera.shear),
        truth.camera.half_extent,
    )
    # Displacement is true minus drawn; rows count downward.
    expected = -near * k / ((np.abs(truth.height)[..., None] + near) * t) * [width / 2, -rows / 2]
    shown = truth.off_plate
    np.testing.assert_allclose((paper - camera)[shown], expected[shown], rtol=1e-12, atol=1e-9)
