"""A picture drawn beside another of the same cameras is what it is alone, bit by bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.views import view
from xfrustum.raster import Rasterizer
from xfrustum.scenes import Camera, DepthFormat, DepthMapping, DoubleFrustum, HogelImage

NEARS_PER_REACH = (1e-2, 1e-4, 1e-6, 1e-8)
"""Nears from one at which D16 orders nearly all surfaces to one at which it loses all of them."""


def exactly(settings: DoubleFrustum) -> DoubleFrustum:
    return replace(settings, depth=DepthFormat.D32F, mapping=DepthMapping.LINEAR)


@pytest.mark.parametrize("slabs", [(), (20.0,)])
@pytest.mark.parametrize("name", ["car", "crossing"])
def test_a_picture_drawn_beside_another_has_the_bits_that_it_has_alone(
    name: str, slabs: tuple[float, ...]
) -> None:
    scene = view(name, (64, 48))
    aperture, changed = scene.plate.middle, []
    with Rasterizer(scene) as rasterizer:
        for share in NEARS_PER_REACH:
            near = share * scene.frustum.longest_reach
            starved = DoubleFrustum(near=near, depth=DepthFormat.D16, slabs=slabs)
            drawn = rasterizer.draw(aperture, starved)
            beside = rasterizer.draw_beside(aperture, exactly(starved), drawn)
            alone = rasterizer.render(aperture, exactly(starved), normals=False, color=False)
            assert beside.camera == alone.camera and beside.normal is None and beside.color is None
            for array in ("triangle", "object", "position"):
                assert getattr(beside, array).tobytes() == getattr(alone, array).tobytes(), array
            changed.append(_differing(beside, drawn.image))
    assert changed[0] < changed[-1]


def test_so_has_one_beside_a_picture_of_other_cameras() -> None:
    scene = view("crossing", (64, 48))
    settings = DoubleFrustum(near=1.0)
    with Rasterizer(scene) as rasterizer:
        other = rasterizer.draw(scene.plate.middle, replace(settings, near=10.0))
        beside = rasterizer.draw_beside(scene.plate.middle, exactly(settings), other)
        alone = rasterizer.render(scene.plate.middle, exactly(settings))
    assert _differing(alone, other.image)
    assert beside.position.tobytes() == alone.position.tobytes()


@pytest.mark.parametrize("name", ["large-triangles", "crossing"])
@pytest.mark.parametrize("slabs", [(), (20.0,)])
def test_a_picture_without_color_shows_the_triangles_of_one_with_color(
    name: str, slabs: tuple[float, ...]
) -> None:
    """It is drawn from another mesh, by cameras that leave out what lies on the other side of the plate."""
    scene = view(name, (64, 48))
    with Rasterizer(scene) as rasterizer:
        for share in NEARS_PER_REACH:
            near = share * scene.frustum.longest_reach
            for camera in Camera:
                settings = DoubleFrustum(near=near, camera=camera, slabs=slabs)
                plain, colored = (
                    rasterizer.draw(scene.plate.middle, settings, color=color) for color in (False, True)
                )
                np.testing.assert_array_equal(plain.identity, colored.identity)
                assert plain.image.position.tobytes() == colored.image.position.tobytes()


def _differing(one: HogelImage, other: HogelImage) -> int:
    return int(np.count_nonzero(one.triangle != other.triangle))
