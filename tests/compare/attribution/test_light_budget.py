"""The radiance error, link by link: the links add up, and each is charged with its own change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.views import reversed_d32f, view
from xfrustum.compare.attribution.radiance_budget import (
    AVERAGING,
    BAND_LIMITING,
    CLIPPING,
    EYE_VECTOR,
    LOCAL_LINKS,
    OUTPUT,
    SHADING,
    RadianceBudget,
    make_radiance_budget,
)
from xfrustum.compare.prediction.chain import LINKS, Chain, make_chain
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import DoubleFrustum, Scene
from xfrustum.scenes.appearance.appearance import Appearance, DirectionalLight, Material
from xfrustum.scenes.appearance.display import decoded, encoded
from xfrustum.scenes.appearance.sampling import Sampling

SHINY = Material(ambient=(0.05,) * 3, diffuse=(0.3, 0.2, 0.1), specular=(0.5, 0.6, 0.7), exponent=15.0)
MATTE = replace(SHINY, specular=(0.0, 0.0, 0.0))


def painted(name: str, material: Material, resolution: tuple[int, int] = (80, 60)) -> Scene:
    scene = view(name, resolution)
    light = DirectionalLight(direction=(-1.0, 2.0, 1.5), color=(0.9, 0.8, 0.7))
    looks = Appearance(materials={"all": material}, lights=(light,))
    return replace(scene, appearance=looks, objects=tuple(replace(o, material="all") for o in scene.objects))


def budget_of(scene: Scene, settings: DoubleFrustum) -> tuple[RadianceBudget, Chain]:
    once = replace(scene, sampling=Sampling())
    with Rasterizer(once) as rasterizer:
        chain = make_chain(Reference(once), rasterizer, scene.default_apertures()[-1], settings)
    return make_radiance_budget(scene, chain), chain


def rms(budget: RadianceBudget, link: str, *, same: bool = True) -> float:
    where = budget.same if same else budget.judged
    return float(np.sqrt(np.mean(budget.change.steps[budget.links.index(link)][where] ** 2)))


@pytest.mark.parametrize("name", ["asymmetric", "asymmetric-recentered"])
def test_the_links_add_up_from_the_truth_to_the_8_bit_picture(name: str) -> None:
    budget, chain = budget_of(painted(name, SHINY), DoubleFrustum(near=1.0))
    assert budget.links == (*LINKS, EYE_VECTOR, SHADING, CLIPPING, OUTPUT)
    size = np.abs(budget.change.steps).sum(axis=0) + np.abs(budget.change.total)
    off = np.abs(budget.change.steps.sum(axis=0) - budget.change.total)
    assert (off <= 2.0**-53 * 2 * len(budget.links) * size).all()
    drawn, truth = chain.images[-1].color, chain.images[0].color
    assert drawn is not None and truth is not None
    output = decoded(np.rint(255 * encoded(drawn)) / 255)
    # The truth's image stores in 32 bits the colors that were computed in double precision.
    np.testing.assert_allclose(budget.change.total, output - truth, rtol=0, atol=2.0**-24)


def test_a_large_near_costs_by_the_points_shown_and_by_the_bent_eye() -> None:
    budget, _ = budget_of(painted("asymmetric", SHINY), reversed_d32f(2.0))
    assert rms(budget, "near offset", same=False) > 10 * rms(budget, SHADING)
    assert rms(budget, EYE_VECTOR) > 100 * rms(budget, SHADING)
    for link in ("pivot", "fit", "slabs"):
        assert not budget.change.steps[budget.links.index(link)].any()


def test_matte_surfaces_do_not_know_the_eye() -> None:
    budget, _ = budget_of(painted("asymmetric", MATTE), reversed_d32f(2.0))
    assert not budget.change.steps[budget.links.index(EYE_VECTOR)][budget.same].any()


def test_outside_the_first_slab_no_eye_vector_bends() -> None:
    """Those cameras stand in the aperture: only 32-bit surface points differ from the truth."""
    settings = replace(reversed_d32f(2.0), slabs=(10.0,))
    budget, chain = budget_of(painted("asymmetric", SHINY), settings)
    outside = budget.same & (np.abs(chain.images[-1].height) > 10.1)
    assert outside.sum() > 100
    assert np.abs(budget.change.steps[budget.links.index(EYE_VECTOR)][outside]).max() < 1e-12


def test_the_bend_is_counted_once() -> None:
    """Truly shaded images and the bend together are the model's own color: the pixel's line, other points."""
    scene = painted("asymmetric", SHINY)
    budget, chain = budget_of(scene, reversed_d32f(2.0))
    truth, model = chain.images[0].color, chain.images[4].color
    assert truth is not None and model is not None
    local = [budget.links.index(link) for link in LOCAL_LINKS if link != SHADING]
    found = budget.change.steps[local].sum(axis=0)
    same = budget.same & (np.abs(chain.images[-1].height) > 1.0)
    np.testing.assert_allclose(found[same], (model - truth)[same], rtol=0, atol=1e-5)


def test_8_bit_output_costs_half_a_level_at_most() -> None:
    budget, _ = budget_of(painted("asymmetric", SHINY), reversed_d32f(0.01))
    steps = budget.change.steps
    before, after = steps[:-1].sum(axis=0), steps.sum(axis=0)
    # The decoding curve is steepest at one: 2.4 / 1.055.
    assert np.abs(after - before).max() <= 0.5 / 255 * 2.4 / 1.055
    assert budget.summary()["links"][-1]["rms"] > 0


def test_averages_are_taken_apart_like_single_samples() -> None:
    """Each link is the mean over the samples; what the device adds in averaging is rounding alone."""
    scene = replace(painted("asymmetric", SHINY, (40, 30)), sampling=Sampling(supersample=2, aperture=3))
    budget, _ = budget_of(scene, reversed_d32f(0.5))
    assert budget.links == (BAND_LIMITING, *LOCAL_LINKS, AVERAGING, CLIPPING, OUTPUT)
    assert rms(budget, BAND_LIMITING, same=False) > 1e-4
    averaging = budget.change.steps[budget.links.index(AVERAGING)]
    assert np.abs(averaging).max() < 1e-6
    size = np.abs(budget.change.steps).sum(axis=0) + np.abs(budget.change.total)
    off = np.abs(budget.change.steps.sum(axis=0) - budget.change.total)
    assert (off <= 2.0**-53 * 2 * len(budget.links) * size).all()
