"""What links add to displacement, at pixels where every image shows a surface."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.views import view
from xfrustum.compare.attribution.budget import make_budget
from xfrustum.compare.prediction.chain import make_chain
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import DepthFormat, DoubleFrustum


@pytest.mark.parametrize("near", [1.0, 1e-6], ids=["bent", "starved"])
def test_sizes_are_those_of_pixels_at_which_every_image_shows_a_surface(near: float) -> None:
    """The depth buffer of the one loses surfaces, so that other pixels count than in R0."""
    scene = view("asymmetric-recentered", (64, 48))
    reference, settings = Reference(scene), DoubleFrustum(near=near, depth=DepthFormat.D16)
    with Rasterizer(scene) as rasterizer:
        chain = make_chain(reference, rasterizer, scene.plate.corners[0], settings)
    budget = make_budget(reference, chain)
    steps = np.linalg.norm(budget.displacement.steps, axis=-1)
    known = np.isfinite(steps).all(axis=0)
    assert 0 < known.sum() < known.size
    for cause, lengths in zip(budget.causes, steps[:, known], strict=True):
        assert cause.displacement_rms_px == pytest.approx(np.sqrt(np.mean(lengths**2)), rel=1e-9)
        assert cause.displacement_p99_px == pytest.approx(np.percentile(lengths, 99), rel=1e-9)
