"""What is computed at some pixels only is what plain formulas say of whole images, bit for bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.views import view
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.compare.metrics.radiance import STEP, RadianceSpread
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import DepthFormat, DoubleFrustum
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.hogel_image import Certainty, HogelImage

PERCENTS = (50, 95, 99)


class Compared:
    """A comparison of a small picture, some of whose pixels are ties, and its images."""

    def __init__(self) -> None:
        scene = view("asymmetric-recentered", (48, 36))
        aperture = scene.default_apertures()[-1]
        reference = Reference(scene)
        traced = reference.trace(aperture)
        assert traced.certainty is not None
        certainty = traced.certainty.copy()
        certainty[::5, ::3] = Certainty.TIE
        self.truth = replace(traced, certainty=certainty)
        near = 0.05 * scene.frustum.longest_reach
        with Rasterizer(scene) as rasterizer:
            self.drawn = rasterizer.render(aperture, DoubleFrustum(near=near, depth=DepthFormat.D16))
        self.found = compare_images(self.truth, self.drawn, reference)


@pytest.fixture(scope="module")
def compared() -> Compared:
    """Return the comparison."""
    return Compared()


def plain_displacement(image: HogelImage) -> Floats:
    """Return the displacement of every pixel by the formulas of CONVENTIONS.md, step by step."""
    camera = image.camera
    (width, height), (kx, ky), (tx, ty) = camera.resolution, camera.shear, camera.half_extent
    x, y, z = np.moveaxis(image.position.astype(np.float64), -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = ((x - camera.aperture.x) / -z - kx) / tx
        v = ((y - camera.aperture.y) / -z - ky) / ty
    shift = np.stack(
        (
            (u + 1) * width / 2 - 0.5 - np.arange(width),
            (1 - v) * height / 2 - 0.5 - np.arange(height)[:, None],
        ),
        axis=-1,
    )
    shift[~np.isfinite(x + y + z) | (z == 0)] = np.nan
    return shift


def test_displacement_is_that_of_whole_images(compared: Compared) -> None:
    shift = plain_displacement(compared.drawn)
    np.testing.assert_array_equal(compared.found.maps.displacement, shift)
    length = np.hypot(shift[..., 0], shift[..., 1])
    known = length[np.isfinite(length)]
    spread = compared.found.displacement_px
    assert spread is not None and 0 < len(known) < length.size
    expected = np.percentile(known, PERCENTS).tolist()
    assert [spread.p50, spread.p95, spread.p99, spread.max] == [*expected, known.max()]


def test_heights_and_triangles_are_those_of_whole_images(compared: Compared) -> None:
    truth, drawn, found = compared.truth, compared.drawn, compared.found
    judged = truth.certainty != Certainty.TIE
    same = judged & (truth.triangle == drawn.triangle) & (truth.triangle >= 0)
    expected = np.where(same, drawn.height - truth.height, np.nan)
    np.testing.assert_array_equal(found.maps.height, expected)
    np.testing.assert_array_equal(found.maps.triangle, judged & (truth.triangle != drawn.triangle))
    assert found.height is not None
    error = expected[same]
    # Sums of other orders: each addition of n squares is off by 2^-53 of the sum, and the root by half.
    assert found.height.rms == pytest.approx(float(np.sqrt(np.mean(error**2))), rel=len(error) * 2**-53)
    assert found.height.max == float(np.abs(error).max())


def test_colors_are_those_of_whole_images(compared: Compared) -> None:
    truth, drawn, found = compared.truth, compared.drawn, compared.found
    assert truth.color is not None and drawn.color is not None
    judged = truth.certainty != Certainty.TIE
    error = drawn.color.astype(np.float64) - truth.color
    error[~judged] = np.nan
    np.testing.assert_array_equal(found.maps.radiance, error)
    assert found.radiance is not None
    assert_plain(found.radiance, error[judged])
    same = judged & (truth.triangle == drawn.triangle) & (truth.triangle >= 0)
    assert found.radiance.away_from_edges is not None
    assert_plain(found.radiance.away_from_edges, error[same])


def assert_plain(found: RadianceSpread, error: Floats) -> None:
    """Compare a spread with that of NumPy's own functions over errors (N, 3)."""
    size = np.abs(error)
    worst = size.max(axis=1)
    squares = np.mean(error**2, axis=0)
    # Sums of other orders: as of heights.
    rounding = error.size * 2**-53
    assert found.pixels == len(error)
    assert found.rms == pytest.approx(float(np.sqrt(squares.mean())), rel=rounding)
    assert found.mean == pytest.approx(float(error.mean()), abs=rounding * float(size.mean()))
    assert (found.p99, found.max) == (np.percentile(worst, 99), worst.max())
    assert found.above_step == np.mean(worst > STEP)
    channels = found.channels
    assert channels.rms == pytest.approx(tuple(np.sqrt(squares)), rel=rounding)
    assert channels.mean == pytest.approx(tuple(error.mean(axis=0)), abs=rounding * float(size.mean()))
    assert channels.p99 == tuple(np.percentile(size, 99, axis=0))
    assert channels.max == tuple(size.max(axis=0))
