"""Error budget from truth to raster: each wrong pixel has one cause, and links add up."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from itertools import cycle, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import xfrustum
from tests.support.long_tail import thinned
from tests.support.views import SHARED_SCENES, reversed_d32f, view
from xfrustum.compare.attribution import (
    AVERAGING,
    BAND_LIMITING,
    CLIPPING,
    EYE_VECTOR,
    OUTPUT,
    SHADING,
    Budget,
    RadianceBudget,
    make_budget,
    make_radiance_budget,
)
from xfrustum.compare.error_maps import surface_errors
from xfrustum.compare.prediction.predict import LINKS, Chain, make_chain
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.budget import CHAIN, write_budget
from xfrustum.reports.common.outputs import json_ready
from xfrustum.reports.common.pictures import CAUSE_COLORS
from xfrustum.scenes import DepthFormat, DepthMapping, DoubleFrustum, Scene
from xfrustum.scenes.appearance import Appearance, DirectionalLight, Material, Sampling
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.library import builtin
from xfrustum.scenes.plate import Fit, Offset, Pivot
from xfrustum.scenes.representation import decoded, encoded

NEARS = (1e-1, 1e-3, 1e-5, 1e-8)  #: near offsets as fractions of the reach

FILM = (192, 144)
SMALL_FILM = (64, 48)
"""Film of the settings that run every time, pixels."""


def options(reach: float) -> list[dict[str, Any]]:
    """Return the paper's own settings and one example of each kind of option."""
    return [
        {},
        {"pivot": Pivot.CAMERA},
        {"fit": 0.3 * reach},
        {"slabs": (0.12 * reach, 0.4 * reach)},
        {"slabs": (0.12 * reach,), "pivot": Pivot.CAMERA, "fit": Fit.ANGLE},
        {"offset": Offset.NONE},
    ]


def budgets(
    name: str, settings: list[DoubleFrustum], film: tuple[int, int] = FILM
) -> list[tuple[Chain, Budget]]:
    scene = view(name, film)
    reference, aperture = Reference(scene), scene.default_apertures()[-1]
    with Rasterizer(scene) as rasterizer:
        chains = [make_chain(reference, rasterizer, aperture, setting) for setting in settings]
    return [(chain, make_budget(reference, chain)) for chain in chains]


def every_kind(name: str) -> list[DoubleFrustum]:
    """Return every kind of option at every near offset; depth buffers alternate."""
    reach = min(view(name, (8, 8)).frustum.reach)
    buffers = cycle(product(DepthFormat, DepthMapping))
    return [
        DoubleFrustum(near=near * reach, depth=depth, mapping=mapping, **option)
        for (near, option), (depth, mapping) in zip(
            product(NEARS, options(reach)), buffers, strict=False
        )
    ]


SCENES = (*builtin.names(), *SHARED_SCENES)


@pytest.mark.parametrize(
    ("name", "few"),
    [
        *thinned([(name, True) for name in SCENES], 7),
        *(pytest.param(name, False, marks=pytest.mark.slow) for name in SCENES),
    ],
)
def test_every_wrong_pixel_is_explained_with_all_settings(name: str, few: bool) -> None:
    """Vary all options and depth buffers, with n from 0.1 to 1e-8 of the reach."""
    kinds, first = every_kind(name), SCENES.index(name)
    assert len(kinds) == 24
    if few:
        kinds = [kinds[(first + 5 * number) % len(kinds)] for number in range(5)]
    for chain, budget in budgets(name, kinds, SMALL_FILM if few else FILM):
        assert not budget.explanation.unexplained.any(), (chain.settings, budget.numbers)
        charged = [int((budget.charge == link).sum()) for link in range(len(LINKS))]
        assert sum(charged) == budget.wrong
        assert sum(budget.explanation.counts().values()) == charged[-2] + charged[-1]


def assert_adds_up(part: RadianceBudget) -> None:
    """Check sums: each difference and each (partial) sum is rounded once, to 2^-53 of itself."""
    size = np.abs(part.steps).sum(axis=0) + np.abs(part.total)
    off = np.abs(part.steps.sum(axis=0) - part.total)
    assert (off <= 2.0**-53 * 2 * len(part.steps) * size).all()


@pytest.mark.parametrize("near_per_reach", [1e-4, 1e-8])
def test_pixels_are_charged_to_their_last_change_and_surfaces_to_the_first_wrong_link(
    near_per_reach: float,
) -> None:
    """D16 swaps few surfaces at the larger near offset, and loses all at the smaller one."""
    settings = DoubleFrustum(near=near_per_reach * 150, depth=DepthFormat.D16)
    [(chain, budget)] = budgets("car", [settings], SMALL_FILM)
    numbers = np.stack([image.triangle for image in chain.images])
    changed = numbers[:-1] != numbers[1:]
    last = len(changed) - 1 - np.argmax(changed[::-1], axis=0)
    charged = budget.charge >= 0
    assert charged.any()
    np.testing.assert_array_equal(budget.charge[charged], last[charged])
    reference = Reference(view("car", SMALL_FILM))
    right = np.stack(
        [~surface_errors(chain.images[0], image, reference).wrong for image in chain.images]
    )
    last_right = len(right) - 1 - np.argmax(right[::-1], axis=0)
    wrong = ~right[-1] & budget.start.judged
    assert wrong.any()
    np.testing.assert_array_equal(budget.surface_charge, np.where(wrong, last_right, -1))


@pytest.mark.parametrize("name", thinned(["asymmetric", "asymmetric-recentered", "car"], 3, 1))
@pytest.mark.parametrize(
    ("near", "option"),
    [
        (0.15, {"slabs": (45.0,), "pivot": Pivot.CAMERA, "fit": Fit.ANGLE}),
        (0.4, {"slabs": (70.0,)}),
        (0.4, {"fit": 40.0}),
    ],
)
def test_each_traced_link_is_as_predicted(name: str, near: float, option: dict[str, Any]) -> None:
    """Check displacement and wrong surfaces of the links near offset, pivot, fit and slabs."""
    [(_, budget)] = budgets(name, [replace(reversed_d32f(near), **option)])
    links = asdict(budget.numbers)["links"]
    for link in links[:4]:
        predicted, measured = link["predicted_displacement_rms_px"], link["displacement_rms_px"]
        # The closed form is of first order in n / |z|, averaged over the true image's pixels.
        assert measured == pytest.approx(predicted, rel=0.1, abs=1e-9)
        # Predictions hold to a factor of two; small counts also vary by chance.
        low, high = link["predicted_surface"] / 2, link["predicted_surface"] * 2
        assert low - 3 * low**0.5 - 1 <= link["surface"] <= high + 3 * high**0.5 + 1
    assert sum(link["surface"] for link in links[:4]) > 20
    for link in links[4:]:
        assert link["predicted_displacement_rms_px"] is None
        assert 0 <= link["predicted_surface"] < 10


def test_the_page_of_a_budget_has_the_numbers_of_its_json_and_a_legend(tmp_path: Path) -> None:
    report = xfrustum.budget(
        view("asymmetric", (48, 36)), DoubleFrustum(near=0.5, slabs=(4.0, 10.0))
    )
    written = {path.name for path in write_budget(report, tmp_path)}
    numbers = report.summary()
    assert {f"{name}.webp" for name in CHAIN if name != "T5"} < written
    assert sum(name.startswith("radiance-") for name in written) > len(LINKS)
    assert json.loads((tmp_path / "budget.json").read_text()) == json_ready(numbers)
    page = (tmp_path / "index.html").read_text()
    for link in numbers["links"]:
        row = next(row for row in page.split("<tr>") if f"<td>{link['name']}</td>" in row)
        assert f'fill="{CAUSE_COLORS[link["name"]]}"' in row
        assert f">{link['pixels']:,}</td>" in row and f">{link['surface']:,}</td>" in row


SHINY = Material(
    ambient=(0.05,) * 3, diffuse=(0.3, 0.2, 0.1), specular=(0.5, 0.6, 0.7), exponent=15.0
)
MATTE = replace(SHINY, specular=(0.0, 0.0, 0.0))


def painted(name: str, material: Material, resolution: tuple[int, int] = (80, 60)) -> Scene:
    scene = view(name, resolution)
    light = DirectionalLight(direction=(-1.0, 2.0, 1.5), color=(0.9, 0.8, 0.7))
    looks = Appearance(materials={"all": material}, lights=(light,))
    return replace(
        scene, appearance=looks, objects=tuple(replace(o, material="all") for o in scene.objects)
    )


def budget_of(scene: Scene, settings: DoubleFrustum) -> tuple[RadianceBudget, Chain]:
    once = replace(scene, sampling=Sampling())
    with Rasterizer(once) as rasterizer:
        chain = make_chain(Reference(once), rasterizer, scene.default_apertures()[-1], settings)
    return make_radiance_budget(scene, chain), chain


def step_of(budget: RadianceBudget, link: str) -> Floats:
    return np.asarray(budget.steps[budget.links.index(link)])


@pytest.mark.parametrize("name", ["asymmetric", "asymmetric-recentered"])
def test_the_links_add_up_from_the_truth_to_the_8_bit_picture(name: str) -> None:
    budget, chain = budget_of(painted(name, SHINY), DoubleFrustum(near=1.0))
    assert budget.links == (*LINKS, EYE_VECTOR, SHADING, CLIPPING, OUTPUT)
    assert_adds_up(budget)
    drawn, truth = chain.images[-1].color, chain.images[0].color
    output = decoded(np.rint(255 * encoded(drawn)) / 255)
    # The true image stores colors, computed in double precision, in 32 bits.
    np.testing.assert_allclose(budget.total, output - truth, rtol=0, atol=2.0**-24)


def test_no_eye_vector_bends_on_matte_surfaces_or_outside_the_first_slab() -> None:
    """The cameras of further slabs stand in the aperture, with only float32 errors."""
    budget, _ = budget_of(painted("asymmetric", MATTE), reversed_d32f(2.0))
    assert not step_of(budget, EYE_VECTOR)[budget.same].any()
    settings = replace(reversed_d32f(2.0), slabs=(10.0,))
    budget, chain = budget_of(painted("asymmetric", SHINY), settings)
    outside = budget.same & (np.abs(chain.images[-1].height) > 10.1)
    assert outside.sum() > 100
    assert np.abs(step_of(budget, EYE_VECTOR)[outside]).max() < 1e-12


def test_the_bend_is_counted_once() -> None:
    """True color plus the steps of all links and of the eye vector equals the model's color."""
    scene = painted("asymmetric", SHINY)
    budget, chain = budget_of(scene, reversed_d32f(2.0))
    truth, model = chain.images[0].color, chain.images[4].color
    bend = np.sum([step_of(budget, link) for link in (*LINKS, EYE_VECTOR)], axis=0)
    same = budget.same & (np.abs(chain.images[-1].height) > 1.0)
    np.testing.assert_allclose(bend[same], (model - truth)[same], rtol=0, atol=1e-5)


def test_averages_are_taken_apart_like_single_samples() -> None:
    """Each link is the mean over the samples; averaging on the device adds only rounding."""
    scene = replace(
        painted("asymmetric", SHINY, (40, 30)), sampling=Sampling(supersample=2, aperture=3)
    )
    budget, _ = budget_of(scene, reversed_d32f(0.5))
    assert budget.links == (BAND_LIMITING, *LINKS, EYE_VECTOR, SHADING, AVERAGING, CLIPPING, OUTPUT)
    assert np.sqrt(np.mean(step_of(budget, BAND_LIMITING)[budget.judged] ** 2)) > 1e-4
    assert np.abs(step_of(budget, AVERAGING)).max() < 1e-6
    assert_adds_up(budget)


@pytest.mark.parametrize("near", [1.0, 1e-6], ids=["bent", "starved"])
def test_sizes_are_those_of_pixels_at_which_every_image_shows_a_surface(near: float) -> None:
    """In `starved`, the depth buffer loses surfaces, so that fewer pixels count than in R0."""
    settings = DoubleFrustum(near=near, depth=DepthFormat.D16)
    [(_, budget)] = budgets("asymmetric-recentered", [settings], (64, 48))
    shifts = np.stack((*budget.start.shifts, budget.errors.shift))
    steps = np.linalg.norm(np.diff(shifts, axis=0), axis=1)
    known = np.isfinite(steps).all(axis=0)
    assert 0 < known.sum() < known.size
    for cause, lengths in zip(budget.causes, steps[:, known], strict=True):
        assert cause.displacement_rms_px == pytest.approx(np.sqrt(np.mean(lengths**2)), rel=1e-9)
        assert cause.displacement_p99_px == pytest.approx(np.percentile(lengths, 99), rel=1e-9)
