"""Drawn points whose true place lies outside the film: no pixel of the true frustum shows them."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from xfrustum.compare.metrics.comparison import Comparison, compare_images
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import DoubleFrustum, Frustum, Plate, Scene, SceneObject
from xfrustum.scenes.geometry.shapes import square

WIDTH, HEIGHT = 64, 48
DEPTH = 40.0
"""Distance of a wall from the plate, on either side."""


@cache
def wall(side: int) -> Scene:
    """A wall parallel to the plate that is larger than every film; side -1 is behind the plate."""
    corners, faces = square()
    frustum = Frustum(
        resolution=(WIDTH, HEIGHT), fov=(math.radians(50), math.radians(40)), reach=(100.0, 100.0)
    )
    plate = Plate(size=(10.0, 10.0), hogels=(5, 5))
    vertices = 200.0 * corners + [3.0, -7.0, side * DEPTH]
    return Scene(
        name="wall",
        plate=plate,
        frustum=frustum,
        objects=(SceneObject(name="wall", vertices=vertices, faces=faces),),
    )


def drawn(side: int, settings: DoubleFrustum) -> Comparison:
    scene = wall(side)
    aperture, reference = scene.plate.aperture(3, 1), Reference(scene)
    with Rasterizer(scene) as rasterizer:
        return compare_images(reference.trace(aperture), rasterizer.render(aperture, settings), reference)


def beyond(factor: float) -> int:
    """Return the number of pixels whose film coordinates are larger than a factor."""
    u = np.abs((2 * np.arange(WIDTH) + 1) / WIDTH - 1)
    v = np.abs(1 - (2 * np.arange(HEIGHT) + 1) / HEIGHT)
    return int((np.maximum(u, v[:, None]) > factor).sum())


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("near", [1.0, 2.0, 20.0])
def test_a_wall_shows_from_beside_the_film_what_lies_beyond_its_border(side: int, near: float) -> None:
    """Drawn at u_r is what belongs at u_r (|z| + n)/|z|: outside from |u_r| = |z|/(|z| + n) on."""
    found = drawn(side, DoubleFrustum(near=near))
    assert found.surface is not None and found.maps.outside is not None
    assert found.surface.outside == found.surface.wrong == beyond(DEPTH / (DEPTH + near)) > 0
    # Everywhere the right wall, and nothing in front of it.
    assert found.triangle is not None
    np.testing.assert_array_equal(found.maps.outside, found.maps.surface)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_picture_displaced_by_less_than_half_a_pixel_shows_nothing_from_outside(side: int) -> None:
    """The outermost center lies at 1 - 1/W: n/|z| below 1/(W - 1) leaves it inside."""
    largest = DEPTH / (WIDTH - 1)
    inside, outside = (drawn(side, DoubleFrustum(near=largest * factor)) for factor in (0.99, 1.01))
    assert inside.surface is not None and outside.surface is not None
    assert inside.surface.wrong == inside.surface.outside == 0
    assert outside.surface.outside == 2 * HEIGHT


@pytest.mark.parametrize("side", [-1, 1])
def test_what_is_fitted_to_the_wall_shows_nothing_from_outside(side: int) -> None:
    found = drawn(side, DoubleFrustum(near=20.0, fit=DEPTH))
    assert found.surface is not None
    assert found.surface.outside == found.surface.wrong == 0
