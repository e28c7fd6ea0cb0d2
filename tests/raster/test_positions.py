"""Surface points are the same in however many parts they are read, and lie where kernels read them."""

from __future__ import annotations

import numpy as np

from tests.support.views import view
from xfrustum.raster import Rasterizer
from xfrustum.raster.device.positions import BYTES_PER_POINT
from xfrustum.scenes import DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.model.hogel_image import HogelImage


def images(resolution: tuple[int, int], block: int | None = None) -> tuple[HogelImage, HogelImage]:
    """Return an image with a coarse depth buffer, and one with exact depth, whose points differ."""
    scene = view("crossing", resolution)
    aperture, near = scene.plate.middle, 1e-7 * scene.frustum.longest_reach
    with Rasterizer(scene) as rasterizer:
        if block is not None:
            assert rasterizer._positions is not None
            rasterizer._positions._largest_block = block
        coarse = DoubleFrustum(near=near, depth=DepthFormat.D16)
        exact = DoubleFrustum(near=near, depth=DepthFormat.D32F, mapping=DepthMapping.LINEAR)
        return rasterizer.render(aperture, coarse), rasterizer.render(aperture, exact)


def test_points_do_not_depend_on_the_number_of_parts() -> None:
    whole = images((37, 23))
    assert np.count_nonzero(whole[0].triangle != whole[1].triangle) > 2 * 37
    for expected, found in zip(whole, images((37, 23), block=2 * 37 * BYTES_PER_POINT), strict=True):
        np.testing.assert_array_equal(found.position, expected.position)
