"""Several images of an aperture are judged together as each is by itself."""

from __future__ import annotations

import numpy as np

from tests.support.views import view
from xfrustum.compare import compare_images
from xfrustum.compare.metrics.comparison import compare_each
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import DoubleFrustum


def test_images_that_are_judged_together_are_judged_as_each_alone() -> None:
    # The scene has different hidden points in each, so that an exchange of their points would be seen.
    scene = view("asymmetric", (96, 72))
    reference, reach = Reference(scene), scene.frustum.longest_reach
    truth = reference.trace(scene.plate.middle)
    with Rasterizer(scene) as rasterizer:
        images = [
            rasterizer.render(scene.plate.middle, DoubleFrustum(near=share * reach), normals=False)
            for share in (0.3, 1e-3, 0.05)
        ]
    together = compare_each(truth, images, reference)
    alone = [compare_images(truth, image, reference) for image in images]
    assert [one.numbers for one in together] == [one.numbers for one in alone]
    assert len({one.surface_wrong for one in alone}) == len(images)
    for one, other in zip(together, alone, strict=True):
        assert one.errors.surface is not None and other.errors.surface is not None
        np.testing.assert_array_equal(one.errors.surface, other.errors.surface)


def test_no_images_are_judged_without_an_error() -> None:
    scene = view("sheets", (16, 12))
    reference = Reference(scene)
    assert compare_each(reference.trace(scene.plate.middle), [], reference) == []
