"""Depth buffers: order, wrong surfaces, and the U-shaped curve of error against near offset."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm

from tests.support.long_tail import thinned
from tests.support.views import at, reversed_d32f, soup, view
from xfrustum.compare.error_maps import judged_pixels, surface_errors
from xfrustum.compare.planning.views import SheetFilm, SheetPair
from xfrustum.compare.prediction.depth import (
    MAX_MISORDERED_FRACTION,
    MAX_ORDER_FACTOR,
    DepthLayers,
    Surfaces,
    chances,
    depth_wrong_shares,
    slabs,
    smallest_separation,
)
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.lines import model_cameras
from xfrustum.scenes import (
    Camera,
    Certainty,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Frustum,
    HogelImage,
    Plate,
    Scene,
)
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.device_model import safe_model
from xfrustum.scenes.plate import Offset

REACH, FOV = 1000.0, math.radians(60)
SHEETS = Scene(
    name="sheets",
    plate=Plate(size=(1, 1), hogels=(1, 1)),
    frustum=Frustum(resolution=(64, 64), reach=(REACH, REACH), fov=(FOV, FOV)),
    objects=(),
)
CELLS, CELL_PIXELS = 16, 4

SETTINGS = [(depth, mapping) for depth in DepthFormat for mapping in DepthMapping]
PLACES = [(1.0, 3.0), (1.0, 400.0), (0.01, 3.0), (0.01, 50.0)]
"""Near offset, down to 1e-5 of the reach, and height |z| of the sheets."""
FACTOR = 2.0


def heights_about(height: float) -> Floats:
    """Return heights of cells within 5 % of a height, so that depths round differently."""
    return height * (1 + np.random.default_rng(4).uniform(-0.05, 0.05, CELLS**2))


def predicted(settings: DoubleFrustum, height: float) -> float:
    """Return the separation along z at which the allowed fraction of pixels is misordered.

    Errors are close to normal. A cell's chance of a wrong order therefore follows from the
    separation at which that chance is `MAX_MISORDERED_FRACTION`.
    """
    near, w = settings.near, heights_about(height) + settings.near
    there = smallest_separation(w, near, near + REACH, settings.depth, settings.mapping)
    certain = norm.isf(MAX_MISORDERED_FRACTION)

    def excess(distance: float) -> float:
        return float(norm.sf(certain * distance / there).mean()) - MAX_MISORDERED_FRACTION

    return float(brentq(excess, 0.5 * there.min(), 2 * there.max()))


def misordered(settings: DoubleFrustum, height: float, separation: float) -> list[float]:
    """Draw two sheets with C and with C*; return the shares of pixels with the wrong sheet."""
    shares: list[float] = []
    middle = SHEETS.plate.middle
    for camera in model_cameras(SHEETS.frustum, middle, settings):
        farther = heights_about(height) + separation
        pair = SheetPair(camera=camera, heights=farther, separation=separation, loser_first=True)
        owner = np.zeros((CELLS, CELLS), dtype=np.int64)
        film = SheetFilm.from_scene(SHEETS, middle, [pair], owner, CELL_PIXELS)
        alone = replace(settings, camera=Camera.C if camera.orthoscopic else Camera.C_STAR)
        with Rasterizer(film.scene) as rasterizer:
            shares += film.wrong_shares(rasterizer, alone)
    return shares


@pytest.mark.parametrize(
    ("depth", "mapping", "near", "height"),
    thinned(((*setting, *two) for setting in SETTINGS for two in PLACES), 7),
)
def test_smallest_ordered_separation_is_as_predicted(
    near: float, height: float, depth: DepthFormat, mapping: DepthMapping
) -> None:
    """At most 1 % of the pixels are misordered at twice the predicted separation, more at half."""
    settings = DoubleFrustum(near=near, depth=depth, mapping=mapping)
    distance = predicted(settings, height)
    assert max(misordered(settings, height, FACTOR * distance)) <= MAX_MISORDERED_FRACTION
    assert min(misordered(settings, height, distance / FACTOR)) > MAX_MISORDERED_FRACTION


BEFORE = 100.0
FRUSTUM = Frustum(
    resolution=(32, 24), reach=(BEFORE, 80.0), fov=(math.radians(60), math.radians(50))
)


def level(height: float) -> HogelImage:
    """Return the true image of a square at one height, larger than the film."""
    square = np.array([(-200.0, -200.0), (200.0, -200.0), (200.0, 200.0), (-200.0, 200.0)])
    corners = np.column_stack((square, np.full(4, height)))
    # No line passes through the square's diagonal, which would be a tie.
    return Reference(soup(corners[[(0, 1, 2), (0, 2, 3)]], FRUSTUM)).trace(at(0.3, 0.1))


def share(height: float, gap: float, settings: DoubleFrustum, *, unlucky: bool = False) -> float:
    truth = level(height)
    stacks = DepthLayers.from_truth(truth, np.full(truth.covered.shape, gap))
    return depth_wrong_shares(stacks, FRUSTUM, [settings], unlucky=unlucky)[0]


def chance(height: float, gap: float, settings: DoubleFrustum) -> float:
    """Return the chance of one wrong surface, without regard to linear depth."""
    camera = Camera.C if height < 0 else Camera.C_STAR
    own = [slab for slab in slabs(FRUSTUM, settings) if slab.camera is camera]
    surface = Surfaces(distance=np.array([abs(height)]), gap=np.array([gap]))
    return float(chances(own, surface, [settings])[0, 0])


@pytest.mark.parametrize(("depth", "mapping"), SETTINGS)
@pytest.mark.parametrize("height", [-70.0, 90.0])
def test_the_chance_of_a_wrong_order_falls_from_a_half_to_a_percent_to_nothing(
    height: float, depth: DepthFormat, mapping: DepthMapping
) -> None:
    """Near is a tenth of the reach, so that no surface is lost; the worst order doubles the share.

    At the smallest separation about 1 % of the pixels are wrong. The closed form of this separation
    counts equal depths as wrong, and adds the squares of step and error. `chance` averages over
    step and error, which gives at most 4 % where both have equal size.
    """
    settings = DoubleFrustum(near=10.0, depth=depth, mapping=mapping)
    assert chance(height, 0.0, settings) == pytest.approx(1 / MAX_ORDER_FACTOR, abs=1e-3)
    assert chance(height, 5.0, settings) < 1e-9 > chance(height, math.inf, settings)
    far = 10.0 + (FRUSTUM.reach[0] if height > 0 else FRUSTUM.reach[1])
    w = np.array([abs(height) + 10.0])
    smallest = float(smallest_separation(w, 10.0, far, depth, mapping)[0])
    assert MAX_ORDER_FACTOR * chance(height, smallest, settings) < 5 * MAX_MISORDERED_FRACTION
    assert MAX_ORDER_FACTOR * chance(height, smallest / 2, settings) > MAX_MISORDERED_FRACTION
    # Pixels in which linear depth fails too are not charged.
    assert share(height, 0.0, settings) == pytest.approx(0.0, abs=1e-3)


def test_a_device_that_rounds_to_either_step_orders_surfaces_two_steps_apart() -> None:
    w, buffer = np.array([20.0]), (10.0, 60.0, DepthFormat.D16, DepthMapping.LINEAR)
    nearest = float(smallest_separation(w, *buffer)[0])
    assert nearest == pytest.approx(50 / 2**16, rel=0.01)  # a step; float32 rounds to 2^-8 of it
    assert float(smallest_separation(w, *buffer, safe_model())[0]) == pytest.approx(
        2 * nearest, rel=0.01
    )


def test_surfaces_in_different_slabs_are_never_misordered() -> None:
    """The surfaces are two thirds of a depth step (50 / 2^16) apart."""
    settings = DoubleFrustum(
        near=1.0,
        depth=DepthFormat.D16,
        mapping=DepthMapping.LINEAR,
        slabs=(50.0,),
        offset=Offset.NONE,
    )
    for inside, across in ((-49.99, -49.9996), (50.01, 50.0004)):
        assert share(inside, 0.0005, settings) > share(inside, math.inf, settings) + 0.1
        assert share(across, 0.0005, settings) == share(across, math.inf, settings) < 0.6


def test_no_more_than_all_pixels_are_wrong_however_unlucky_the_draw_order() -> None:
    starved = DoubleFrustum(near=1e-5, depth=DepthFormat.D16)
    assert share(-70.0, 1e-3, starved, unlucky=True) == pytest.approx(1.0, abs=1e-6)
    settings = replace(starved, near=1.0, mapping=DepthMapping.LINEAR)
    likely, worst = (share(-70.0, 1e-3, settings, unlucky=unlucky) for unlucky in (False, True))
    assert likely > 0.05 and worst == pytest.approx(MAX_ORDER_FACTOR * likely, rel=0.01)


@pytest.mark.parametrize("height", [-50.0, 50.0])
def test_a_sheet_at_a_cut_is_drawn_by_the_slab_that_does_not_lose_it(height: float) -> None:
    settings = DoubleFrustum(near=1.0, depth=DepthFormat.D16, slabs=(50.0,))
    assert share(height, math.inf, settings) < 1e-6


def test_lost_surfaces_are_near_the_clear_value_of_their_camera() -> None:
    """C clears to far, where depths are dense; C* clears to near, where no surface is visible."""
    starved = DoubleFrustum(near=1e-4, depth=DepthFormat.D16)
    for mapping in (DepthMapping.STANDARD, DepthMapping.GL, DepthMapping.REVERSED):
        settings = replace(starved, mapping=mapping)
        assert share(-70.0, math.inf, settings) > 0.999
        assert share(90.0, math.inf, settings) < 1e-9
    for mapping in (DepthMapping.LOGARITHMIC, DepthMapping.LINEAR):
        assert share(-70.0, math.inf, replace(starved, mapping=mapping)) < 1e-9
    # Distance at which a surface is half a step from the far value: 1 - d = n (f - w) / (w (f - n))
    # = 2^-17
    far, near = 80.1, 0.1
    w = far / (1 + 2.0**-17 * (far - near) / near)
    settings = DoubleFrustum(near=near, depth=DepthFormat.D16)
    assert share(-(w - near) * 0.999, math.inf, settings) < 1e-3
    assert share(-(w - near) * 1.001, math.inf, settings) > 0.999


def test_only_drawn_and_judged_surfaces_count() -> None:
    starved, truth = DoubleFrustum(near=1e-4, depth=DepthFormat.D16), level(-70.0)
    assert share(-70.0, np.inf, replace(starved, camera=Camera.C_STAR)) == 0
    assert share(-70.0, np.inf, replace(starved, camera=Camera.C)) > 0.999
    truth.certainty[:] = Certainty.TIE
    nothing = DepthLayers.from_truth(truth, np.full(truth.covered.shape, np.inf))
    assert depth_wrong_shares(nothing, FRUSTUM, [starved]) == [0]


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"slabs": (7.0, 30.0, 90.0)},
        {"slabs": (7.0,), "offset": Offset.NONE},
        {"slabs": (7.0,), "camera": Camera.C_STAR},
    ],
)
def test_slabs_are_those_that_the_reference_traces(options: dict[str, Any]) -> None:
    settings = DoubleFrustum(near=0.5, **options)
    own = slabs(FRUSTUM, settings)
    assert sorted((slab.camera is Camera.C, slab.near, slab.far, slab.step) for slab in own) == (
        sorted(
            (camera.orthoscopic, *np.sort(np.abs(camera.bundle.s_range)), abs(z))
            for camera in model_cameras(FRUSTUM, at(1.0, 2.0), settings)
            for z in camera.bundle.center[2:]
        )
    )
    assert all(slab.near - slab.low == slab.far - slab.high == slab.step for slab in own)


def misordered_pixels(name: str, settings: DoubleFrustum, width: int) -> tuple[int, float, float]:
    """Return pixels wrong by depth: measured, predicted for the draw order, and for any order."""
    scene = view(name, (width, width))
    reference, aperture = Reference(scene), scene.plate.middle
    truth = reference.trace(aperture)
    gaps, earlier = reference.gaps(aperture), reference.gaps(aperture, truth)
    settings = replace(settings, near=settings.near * scene.frustum.longest_reach)
    linear = replace(settings, depth=DepthFormat.D32F, mapping=DepthMapping.LINEAR)
    with Rasterizer(scene) as rasterizer:
        wrong, without = (
            surface_errors(truth, rasterizer.render(aperture, option, color=False), reference).wrong
            for option in (settings, linear)
        )
    judged = judged_pixels(truth)
    ordered, unordered = (
        depth_wrong_shares(layers, scene.frustum, [settings])[0] * judged.sum()
        for layers in (
            DepthLayers.from_truth(truth, gaps, earlier),
            DepthLayers.from_truth(truth, gaps),
        )
    )
    return int((wrong & ~without & judged).sum()), float(ordered), float(unordered)


@pytest.mark.parametrize(
    "settings",
    thinned(
        [
            DoubleFrustum(near=1e-4, depth=DepthFormat.D16),
            DoubleFrustum(near=1e-6, depth=DepthFormat.D24),
            DoubleFrustum(near=1e-6, depth=DepthFormat.D16, mapping=DepthMapping.REVERSED),
            DoubleFrustum(near=1e-7, depth=DepthFormat.D32F, mapping=DepthMapping.GL),
        ],
        3,
    ),
)
def test_the_share_on_a_car_is_as_predicted(settings: DoubleFrustum) -> None:
    """Predictions, for the draw order or a random order, agree within a factor of two.

    `near` is a fraction of the reach.
    """
    measured, *predicted = misordered_pixels("car", settings, 256)
    assert measured > 5e-4 * 256**2
    for prediction in predicted:
        assert measured / 2 <= prediction <= measured * 2


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("sheets", DoubleFrustum(near=1e-7, depth=DepthFormat.D16)),
        ("mirror-sphere", DoubleFrustum(near=1.6e-5, depth=DepthFormat.D16)),
    ],
)
def test_the_draw_order_decides_equal_depths(name: str, settings: DoubleFrustum) -> None:
    """With steps far coarser than float32 rounding, chance decides hardly any pixel."""
    measured, predicted, coin = misordered_pixels(name, settings, 96)
    assert measured > 50
    assert predicted == pytest.approx(measured, rel=0.05)
    assert abs(coin - measured) > 0.2 * measured


NEARS = tuple(10.0**-e for e in (2, 2.5, 3, 3.5, 4, 5, 6, 7, 8))
"""Near offsets relative to the reach."""

SNAPPED_SURFACE = 1e-4
"""Share of pixels that snapping makes wrong. Vertices snap to 2^-8 px: along silhouettes, sqrt(2)/2
* 2^-8 px on either side are uncertain, a share of 0.0055 l / W for silhouettes of l image widths.
Half of these pixels flip; the car's silhouettes are about 7 image widths long.
"""


@pytest.fixture(scope="module")
def curves() -> dict[str, dict[float, float]]:
    """Return shares of wrong surfaces inside the film by near offset, for some depth buffers."""
    scene = view("car", (256, 256))
    reference, middle = Reference(scene), scene.plate.middle
    truth = reference.trace(middle)
    judged = judged_pixels(truth)
    buffers = {
        "d16": DoubleFrustum(near=1.0, depth=DepthFormat.D16),
        "d24": DoubleFrustum(near=1.0, depth=DepthFormat.D24),
        "float reversed": reversed_d32f(1.0),
    }
    curves: dict[str, dict[float, float]] = {name: {} for name in buffers}
    with Rasterizer(scene) as raster:
        for (name, buffer), near in product(buffers.items(), NEARS):
            settings = replace(buffer, near=near * scene.frustum.longest_reach)
            drawn = raster.render(middle, settings, normals=False, color=False)
            errors = surface_errors(truth, drawn, reference)
            # Surfaces from outside the film count as wrong from half a pixel of displacement.
            curves[name][near] = float((errors.wrong & ~errors.outside)[judged].mean())
    return curves


@pytest.mark.parametrize("depth", ["d24", "float reversed"])
def test_near_plane_error_is_proportional_to_near(
    curves: dict[str, dict[float, float]], depth: str
) -> None:
    nears = [near for near in NEARS if near > 0.9e-4]
    errors = [curves[depth][near] for near in nears]
    slope = np.polyfit(np.log(nears), np.log(errors), 1)[0]
    assert slope == pytest.approx(1, abs=0.1)


def test_fixed_point_depth_rises_again_and_reversed_float_stays_flat(
    curves: dict[str, dict[float, float]],
) -> None:
    for depth, bottom, top in (("d16", 1e-4, 0.5), ("d24", 1e-5, 0.05)):
        surface = curves[depth]
        best = min(surface, key=surface.__getitem__)
        assert bottom / 4 < best < bottom * 4
        rising = [surface[near] for near in sorted(surface) if near <= best]
        assert rising[0] > top
        assert all(smaller >= larger for smaller, larger in pairwise(rising))
    # The resolution in w is n 2^b: a tenth of the near loses or swaps ten times as many pixels.
    assert 5 < curves["d24"][1e-7] / curves["d24"][1e-6] < 20
    assert curves["d16"][1e-6] > 20 * curves["d24"][1e-6]
    assert all(curves["float reversed"][near] < SNAPPED_SURFACE for near in (1e-6, 1e-7, 1e-8))
