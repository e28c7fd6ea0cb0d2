"""Displacement, measured from drawn surface points, is the closed form of docs/method.md."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.long_tail import thinned
from tests.support.views import reversed_d32f, view
from xfrustum.compare.attribution.budget import misplaced
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.compare.rounding.positions import POSITION_ROUNDINGS
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import NOTHING, HogelImage

NEARS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)
"""Near offsets as fractions of the reach."""
MOST_PX = 1e-3
"""Largest 99th percentile of the difference between measured and predicted displacement on meshes, px."""

MESHES = [
    ("car", (40, 30)),
    ("car", (12, 50)),
    ("car-recentered", (0, 0)),
    ("asymmetric", (25, 41)),
    ("asymmetric-recentered", (0, 0)),
    ("asymmetric-recentered", (80, 60)),
    ("beetle", (40, 30)),
    ("bunny-transfer", (150, 50)),
    ("bunny-transfer", (299, 99)),
    ("teapot-recentered", (119, 79)),
    ("teapot-recentered", (60, 40)),
    ("truck", (50, 30)),
]
OTHERS = [("crossing", (40, 30)), ("crossing", (31, 17)), ("large-triangles", (40, 30)), ("sheets", (40, 30))]


def closed_form(image: HogelImage, near: float) -> np.ndarray:
    """Return true minus drawn, (H, W, 2) columns and rows: +(W/2) u n/|z| and -(H/2) v n/|z|."""
    height, width = image.triangle.shape
    u = (2 * np.arange(width) + 1) / width - 1
    v = 1 - (2 * np.arange(height) + 1) / height
    per_film_unit = near / np.abs(image.height.astype(np.float64))
    return np.stack((width / 2 * u * per_film_unit, -height / 2 * v[:, None] * per_film_unit), axis=-1)


@pytest.mark.parametrize(("name", "index"), thinned(MESHES + OTHERS, 3))
def test_displacement_measured_pixel_by_pixel_is_the_closed_form(name: str, index: tuple[int, int]) -> None:
    assert POSITION_ROUNDINGS <= 16
    scene = view(name, (256, 192))
    aperture = scene.plate.aperture(*index)
    reference = Reference(scene)
    truth = reference.trace(aperture)
    largest_coordinate = np.abs(scene.triangles).max(axis=(1, 2))
    half_extent = np.array(truth.camera.half_extent)
    seen = 0
    with Rasterizer(scene) as raster:
        for near in np.array(NEARS) * scene.frustum.longest_reach:
            drawn = raster.render(aperture, reversed_d32f(float(near)), normals=False, color=False)
            measured = compare_images(truth, drawn, reference).maps.displacement
            shown = (drawn.triangle != NOTHING) & (drawn.height != 0)
            np.testing.assert_array_equal(np.isfinite(measured), np.repeat(shown[..., None], 2, axis=2))
            with np.errstate(divide="ignore", invalid="ignore"):
                off = np.abs(measured - closed_form(drawn, float(near)))[shown]
            z = np.abs(drawn.height[shown]).astype(np.float64)[:, None]
            # The points are computed on the drawn triangles: these must have been drawn there.
            assert not misplaced(scene, drawn, int(raster.device["subpixel_bits"])).any()
            known = POSITION_ROUNDINGS * 2.0**-24 * largest_coordinate[drawn.triangle[shown]][:, None]
            bound = known * np.array([256, 192]) / (2 * z * half_extent)
            assert (off <= bound).all()
            seen += len(off)
            if len(off) and (name, index) in MESHES:
                assert np.percentile(off.max(axis=1), 99) <= MOST_PX
    assert seen > 2000


@pytest.mark.parametrize("name", ["car", "asymmetric-recentered"])
def test_the_signs_a_small_near_moves_the_drawn_picture_toward_the_middle(name: str) -> None:
    scene = view(name, (128, 128))
    aperture = scene.plate.middle
    reference = Reference(scene)
    with Rasterizer(scene) as raster:
        drawn = raster.render(aperture, reversed_d32f(1.5))
    shift = compare_images(reference.trace(aperture), drawn, reference).maps.displacement
    right, below = slice(70, None), slice(70, None)
    for outward in (shift[:, right, 0], shift[below, :, 1], -shift[:, :58, 0], -shift[:58, :, 1]):
        assert np.isfinite(outward).any()
        assert (outward[np.isfinite(outward)] > 0).all()
