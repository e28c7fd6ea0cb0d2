"""The share of pixels that a depth buffer shows wrongly: predicted from heights and gaps, and measured."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.support.views import at, soup, view
from xfrustum.compare.metrics.error_maps import judged_pixels, wrong_surface
from xfrustum.compare.prediction.depth import (
    MAX_MISORDERED_FRACTION,
    MAX_ORDER_FACTOR,
    Stacks,
    chances,
    depth_wrong_share,
    slabs,
    smallest_separation,
)
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.lines.lines import model_cameras
from xfrustum.scenes import Camera, DepthFormat, DepthMapping, DoubleFrustum, Frustum, HogelImage
from xfrustum.scenes.plate.double_frustum import Offset

REACH = 100.0
FRUSTUM = Frustum(resolution=(32, 24), reach=(REACH, 80.0), fov=(math.radians(60), math.radians(50)))
EVERY = [(depth, mapping) for depth in DepthFormat for mapping in DepthMapping]


def level(height: float) -> HogelImage:
    """Return the true image of a square at one height that covers the film."""
    corners = np.array([(-200, -200, height), (200, -200, height), (200, 200, height), (-200, 200, height)])
    scene = soup(corners[[(0, 1, 2), (0, 2, 3)]].astype(np.float64), FRUSTUM)
    # The line does not go through the square's diagonal, which would be a tie.
    return Reference(scene).trace(at(0.3, 0.1))


def share(height: float, gap: float, settings: DoubleFrustum) -> float:
    truth = level(height)
    return depth_wrong_share(Stacks.of(truth, np.full(truth.covered.shape, gap)), FRUSTUM, settings)


def chance(height: float, gap: float, settings: DoubleFrustum) -> float:
    """Return the chance that one surface is shown wrongly, whether or not linear depth fails too."""
    camera = Camera.C if height < 0 else Camera.C_STAR
    own = [slab for slab in slabs(FRUSTUM, settings) if slab.camera is camera]
    return float(chances(own, np.array([abs(height)]), np.array([gap]), settings, 1.0)[0])


@pytest.mark.parametrize(("depth", "mapping"), EVERY)
@pytest.mark.parametrize("height", [-70.0, 90.0])
def test_equal_depths_are_wrong_half_the_time_and_distant_ones_never(
    height: float, depth: DepthFormat, mapping: DepthMapping
) -> None:
    """Near is a tenth of the reach, so that nothing is lost; the worst order doubles the share."""
    settings = DoubleFrustum(near=10.0, depth=depth, mapping=mapping)
    assert chance(height, 0.0, settings) == pytest.approx(1 / MAX_ORDER_FACTOR, abs=1e-3)
    assert chance(height, 5.0, settings) < 1e-9
    assert chance(height, math.inf, settings) < 1e-9


@pytest.mark.parametrize(("depth", "mapping"), EVERY)
@pytest.mark.parametrize("height", [-70.0, 90.0])
def test_at_the_smallest_separation_about_a_percent_is_wrong(
    height: float, depth: DepthFormat, mapping: DepthMapping
) -> None:
    """The closed form of the separation counts equal depths as wrong. There squares of step and error are
    added, here the two are averaged over each other, which makes the most of a difference, four percent,
    where they are alike."""
    settings = DoubleFrustum(near=10.0, depth=depth, mapping=mapping)
    reach = FRUSTUM.reach[0] if height > 0 else FRUSTUM.reach[1]
    w = np.array([abs(height) + 10.0])
    smallest = float(smallest_separation(w, 10.0, 10.0 + reach, depth, mapping)[0])
    assert MAX_ORDER_FACTOR * chance(height, smallest, settings) < 5 * MAX_MISORDERED_FRACTION
    assert MAX_ORDER_FACTOR * chance(height, smallest / 2, settings) > MAX_MISORDERED_FRACTION


def test_surfaces_in_different_slabs_are_never_misordered() -> None:
    """The surfaces are two thirds of a step of 50 / 2^16 apart."""
    settings = DoubleFrustum(
        near=1.0, depth=DepthFormat.D16, mapping=DepthMapping.LINEAR, slabs=(50.0,), offset=Offset.NONE
    )
    for inside, across in ((-49.99, -49.9996), (50.01, 50.0004)):
        assert share(inside, 0.0005, settings) > share(inside, math.inf, settings) + 0.1
        assert share(across, 0.0005, settings) == share(across, math.inf, settings) < 0.6


@pytest.mark.parametrize(("depth", "mapping"), EVERY)
def test_what_linear_depth_cannot_tell_apart_either_is_not_charged(
    depth: DepthFormat, mapping: DepthMapping
) -> None:
    settings = DoubleFrustum(near=10.0, depth=depth, mapping=mapping)
    assert share(-70.0, 0.0, settings) == pytest.approx(0.0, abs=1e-3)
    control = replace(settings, depth=DepthFormat.D32F, mapping=DepthMapping.LINEAR)
    assert share(-70.0, 1e-6, control) == 0.0


def test_no_more_than_all_pixels_are_wrong_however_unlucky_the_draw_order() -> None:
    truth = level(-70.0)
    close, starved = np.full(truth.covered.shape, 1e-3), DoubleFrustum(near=1e-5, depth=DepthFormat.D16)
    assert depth_wrong_share(Stacks.of(truth, close), FRUSTUM, starved, unlucky=True) == pytest.approx(
        1.0, abs=1e-6
    )
    settings = replace(starved, near=1.0, mapping=DepthMapping.LINEAR)
    likely, worst = (
        depth_wrong_share(Stacks.of(truth, close), FRUSTUM, settings, unlucky=u) for u in (False, True)
    )
    assert likely > 0.05 and worst == pytest.approx(MAX_ORDER_FACTOR * likely, rel=0.01)


@pytest.mark.parametrize("height", [-50.0, 50.0])
def test_a_sheet_at_a_cut_is_drawn_by_the_slab_that_does_not_lose_it(height: float) -> None:
    settings = DoubleFrustum(near=1.0, depth=DepthFormat.D16, slabs=(50.0,))
    assert share(height, math.inf, settings) < 1e-6


def test_what_is_lost_is_near_the_clear_value_of_its_camera() -> None:
    """C clears to far, where hyperbolic depth is dense; C* to near, where nothing that is seen lies."""
    starved = DoubleFrustum(near=1e-4, depth=DepthFormat.D16)
    for mapping in (DepthMapping.STANDARD, DepthMapping.GL, DepthMapping.REVERSED):
        settings = replace(starved, mapping=mapping)
        assert share(-70.0, math.inf, settings) > 0.999
        assert share(90.0, math.inf, settings) < 1e-9
    for mapping in (DepthMapping.LOGARITHMIC, DepthMapping.LINEAR):
        assert share(-70.0, math.inf, replace(starved, mapping=mapping)) < 1e-9
    # Half a step from the far value: 1 - d = n (f - w) / (w (f - n)) = 2^-17.
    far, near = 80.1, 0.1
    w = far / (1 + 2.0**-17 * (far - near) / near)
    settings = DoubleFrustum(near=near, depth=DepthFormat.D16)
    assert share(-(w - near) * 0.999, math.inf, settings) < 1e-3
    assert share(-(w - near) * 1.001, math.inf, settings) > 0.999


def test_only_what_is_drawn_and_judged_counts() -> None:
    starved = DoubleFrustum(near=1e-4, depth=DepthFormat.D16)
    truth = level(-70.0)
    nothing = np.full(truth.covered.shape, np.inf)
    assert depth_wrong_share(Stacks.of(truth, nothing), FRUSTUM, replace(starved, camera=Camera.C_STAR)) == 0
    assert depth_wrong_share(Stacks.of(truth, nothing), FRUSTUM, replace(starved, camera=Camera.C)) > 0.999
    assert truth.certainty is not None
    truth.certainty[:] = 2
    assert depth_wrong_share(Stacks.of(truth, nothing), FRUSTUM, starved) == 0


@pytest.mark.parametrize(
    "settings",
    [
        DoubleFrustum(near=0.5),
        DoubleFrustum(near=0.5, slabs=(7.0, 30.0, 90.0)),
        DoubleFrustum(near=0.5, slabs=(7.0,), offset=Offset.NONE),
        DoubleFrustum(near=0.5, slabs=(7.0,), camera=Camera.C_STAR),
    ],
)
def test_slabs_are_those_that_the_reference_traces(settings: DoubleFrustum) -> None:
    aperture = at(1.0, 2.0)
    cameras = model_cameras(FRUSTUM, aperture, settings)
    expected = sorted(
        (camera.orthoscopic, *sorted(abs(s) for s in camera.pencil.s_range), abs(camera.pencil.center[2]))
        for camera in cameras
    )
    found = sorted(
        (slab.camera is Camera.C, slab.near, slab.far, slab.step) for slab in slabs(FRUSTUM, settings)
    )
    assert found == expected
    for slab in slabs(FRUSTUM, settings):
        assert (slab.near, slab.far) == (slab.low + slab.step, slab.high + slab.step)


MEASURED = [
    (1e-4, DepthFormat.D16, DepthMapping.STANDARD),
    (1e-6, DepthFormat.D16, DepthMapping.REVERSED),
    (1e-6, DepthFormat.D24, DepthMapping.STANDARD),
    (1e-6, DepthFormat.D24, DepthMapping.REVERSED),
    (1e-7, DepthFormat.D32F, DepthMapping.GL),
]


@pytest.mark.parametrize(("near", "depth", "mapping"), MEASURED)
def test_the_share_on_a_car_is_as_predicted(near: float, depth: DepthFormat, mapping: DepthMapping) -> None:
    """Shares agree within a factor of two: the mesh's own draw order decides equal depths."""
    scene = view("car", (384, 384))
    reference, aperture = Reference(scene), scene.plate.middle
    truth, gaps = reference.trace(aperture), reference.gaps(aperture)
    settings = DoubleFrustum(near=near * scene.frustum.longest_reach, depth=depth, mapping=mapping)
    linear = replace(settings, depth=DepthFormat.D32F, mapping=DepthMapping.LINEAR)
    with Rasterizer(scene) as rasterizer:
        wrong, without = (
            wrong_surface(truth, rasterizer.render(aperture, one, normals=False, color=False), reference)
            for one in (settings, linear)
        )
    judged = judged_pixels(truth)
    measured = float((wrong & ~without & judged).sum() / judged.sum())
    predicted = depth_wrong_share(Stacks.of(truth, gaps), scene.frustum, settings)
    assert measured > 5e-4
    assert measured / 2 <= predicted <= measured * 2
