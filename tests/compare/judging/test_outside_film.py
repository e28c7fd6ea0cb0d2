"""Both judges count the pixels that show what belongs outside the film, by one rule."""

import numpy as np
import pytest

from tests.support.foreign_renderers import small
from xfrustum.compare.judging.judged import judge
from xfrustum.compare.metrics.error_maps import surface_errors
from xfrustum.compare.renderer_model.drawn_model import RendererModel
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import DepthFormat, DepthMapping, DoubleFrustum


@pytest.mark.parametrize("name", ["asymmetric", "asymmetric-recentered"])
def test_verify_counts_what_belongs_outside_the_film_as_a_comparison_does(name: str) -> None:
    scene = small(name, 48)
    reference, aperture = Reference(scene), scene.plate.aperture(1, 3)
    settings = DoubleFrustum(near=8.0, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED)
    with Rasterizer(scene) as rasterizer:
        image = rasterizer.render(aperture, settings)
    truth = reference.trace(aperture)
    compared = surface_errors(truth, image, reference)
    judged = judge(reference, RendererModel(), image, image.position.astype(np.float64))
    assert compared.outside.any()
    assert judged.numbers.surface is not None
    assert judged.numbers.surface.outside == compared.outside.sum()
    assert judged.numbers.surface.wrong == compared.wrong.sum()

    # Offset cameras have films of their own: by their model nothing lies outside.
    judged = judge(reference, RendererModel(near=8.0), image, image.position.astype(np.float64))
    assert judged.numbers.surface is not None and judged.numbers.surface.outside == 0
    assert judged.numbers.judged_fraction < 0.01
