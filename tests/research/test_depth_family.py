"""Scenes that differ only in depth show one picture; the others differ in one property each."""

import numpy as np
import pytest

from xfrustum import Camera, InputError, Reference
from xfrustum.research import depth_family
from xfrustum.research.depth_family import CAR_RATIO, FARTHEST, SeenScene, cars

SIZE = (32, 32)


@pytest.mark.slow
def test_neither_scale_nor_shift_nor_shear_of_scene_and_frustum_changes_the_picture() -> None:
    """Up to rounding at edges, all scenes show the picture of the shallowest cars."""
    seen = [depth_family.cars_off_the_middle(100.0, SIZE, in_middle=False)]
    seen.append(depth_family.recentered_cars(10.0, SIZE))
    for ratio in (CAR_RATIO, 30.0):
        scene = cars(ratio, Camera.C, SIZE)
        heights = -scene.vertices[:, 2]
        assert heights.max() == pytest.approx(FARTHEST, rel=1e-12)
        assert heights.max() / heights.min() == pytest.approx(ratio, rel=1e-12)
        seen.append(SeenScene(scene=scene, aperture=scene.plate.middle))
    first, *others = [Reference(item.scene).trace(item.aperture) for item in seen]
    assert (first.triangle >= 0).mean() > 0.3
    for other in others:
        assert (other.triangle != first.triangle).mean() < 1e-2
    # From the middle, the nearest cars lie outside the film.
    off, middle = seen[0].scene, seen[0].scene.plate.middle
    nearest, farther = (float(-np.nanmax(i.height)) for i in (first, Reference(off).trace(middle)))
    assert nearest == pytest.approx(0.01 * depth_family.REACH, rel=0.1)
    assert farther > 5 * nearest


@pytest.mark.parametrize("distance", [1e-1, 1e-4])
def test_a_shear_keeps_the_picture_of_a_car_through_the_plate(distance: float) -> None:
    seen = [
        depth_family.car_through_plate(distance, SIZE, recentered=sheared)
        for sheared in (False, True)
    ]
    centered, recentered = (Reference(item.scene).trace(item.aperture) for item in seen)
    assert seen[1].scene.frustum.screen is not None and centered.covered.any()
    assert np.mean(recentered.triangle != centered.triangle) < 1e-2
    same = recentered.triangle == centered.triangle
    np.testing.assert_allclose(recentered.height[same], centered.height[same], rtol=1e-9)


def test_a_scene_shallower_than_one_car_is_refused() -> None:
    with pytest.raises(InputError, match=r"at least 1\.5"):
        cars(1.2, Camera.C, (8, 8))
