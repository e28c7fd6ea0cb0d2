"""A rasterizer that was warmed up draws what one draws that was not, and compiles nothing more for it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.views import view
from xfrustum.raster import Rasterizer
from xfrustum.raster import drawing as passes_module
from xfrustum.raster.device.positions import Positions
from xfrustum.scenes import DepthFormat, DoubleFrustum

ARRAYS = ("triangle", "object", "position", "color")


@pytest.mark.parametrize("name", ["car", "crossing"])
@pytest.mark.parametrize("color", [True, False])
def test_a_picture_is_the_same_after_warming_up(name: str, color: bool) -> None:
    scene = view(name, (48, 32))
    aperture = scene.plate.middle
    settings = DoubleFrustum(near=1e-3 * scene.frustum.longest_reach, depth=DepthFormat.D24)
    with Rasterizer(scene) as cold, Rasterizer(scene) as warm:
        expected = cold.render(aperture, settings, color=color)
        warm.warm_up(aperture, settings, color=color)
        found = warm.render(aperture, settings, color=color)
    assert expected.covered.any()
    for array in ARRAYS:
        one, other = getattr(expected, array), getattr(found, array)
        assert (one is None and other is None) or np.array_equal(one, other, equal_nan=True), array


def test_what_a_first_picture_needs_is_there_after_warming_up(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = view("car", (48, 32))
    aperture = scene.plate.middle
    settings = DoubleFrustum(near=1e-3 * scene.frustum.longest_reach)
    with Rasterizer(scene) as rasterizer:
        rasterizer.warm_up(aperture, settings)

        def compiled(*_: object) -> None:
            raise AssertionError("a program is compiled for the picture itself")

        monkeypatch.setattr(passes_module, "program", compiled)
        monkeypatch.setattr(Positions, "_program", compiled)
        targets = dict(rasterizer._targets)
        assert rasterizer.render(aperture, settings, normals=False).covered.any()
        assert rasterizer._targets == targets
