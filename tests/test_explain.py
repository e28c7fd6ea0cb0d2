"""Raster against its own cameras, traced exactly: almost the same, and every difference has a reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.test_flips import pictured
from tests.views import SHARED_SCENES, reversed_d32f, view
from xfrustum.compare.explain import explain
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import NOTHING, Aperture, Certainty, HogelImage, Scene, builtin

OTHER_TRIANGLES = 1e-3
"""Share of pixels where float32 and subpixel snapping may show another triangle than exact lines do."""
STAYS_UNEXPLAINED = 0.9
"""Of wrong pixels, when the raster is made wrong on purpose."""

RESOLUTION = (256, 192)
FULL_RESOLUTION = (512, 384)
SCENES = (*builtin.names(), *SHARED_SCENES)
QUICK_NEARS = (1e-1, 1e-3, 1e-5, 1e-8)
ALL_NEARS = tuple(10.0**-e for e in np.linspace(1, 8, 15))


def differences(model: HogelImage, drawn: HogelImage) -> NDArray[np.bool_]:
    return np.asarray((model.triangle != drawn.triangle) & (model.certainty != Certainty.TIE))


def assert_explained(name: str, resolution: tuple[int, int], nears: tuple[float, ...]) -> None:
    scene = view(name, resolution)
    reference = Reference(scene)
    report = []
    with Rasterizer(scene) as raster:
        bits = int(raster.device["subpixel_bits"])
        for near in nears:
            settings = reversed_d32f(near * scene.frustum.longest_reach)
            for aperture in scene.default_apertures():
                model = reference.trace_model(aperture, settings)
                drawn = raster.render(aperture, settings, normals=False, color=False)
                wrong = differences(model, drawn)
                counts = explain(scene, model, drawn, bits).counts()
                assert sum(counts.values()) == wrong.sum()
                report.append((near, aperture.index, int(wrong.sum()), counts))
    pixels = resolution[0] * resolution[1]
    print(f"\n{name}: at most {max(wrong for *_, wrong, _ in report)} of {pixels} pixels differ")
    assert [row for row in report if row[2] >= OTHER_TRIANGLES * pixels] == []
    assert [row for row in report if row[3]["unexplained"]] == []


@pytest.mark.parametrize("name", SCENES)
def test_the_rasterizer_draws_its_model_and_nothing_is_unexplained(name: str) -> None:
    assert_explained(name, RESOLUTION, QUICK_NEARS)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_so_it_does_at_every_near_and_full_resolution(name: str) -> None:
    assert_explained(name, FULL_RESOLUTION, ALL_NEARS)


class TestNegativeControls:
    """A bound that explains everything explains nothing: pictures made wrong must stay unexplained."""

    @pytest.fixture(scope="class", params=["car", "asymmetric", "asymmetric-recentered"])
    def scene(self, request: pytest.FixtureRequest) -> Scene:
        return view(request.param, FULL_RESOLUTION)

    @pytest.fixture(scope="class")
    def aperture(self, scene: Scene) -> Aperture:
        return scene.plate.aperture(30, 40)

    @pytest.fixture(scope="class", params=[1e-2, 1e-4, 1e-7])
    def near(self, request: pytest.FixtureRequest, scene: Scene) -> float:
        return float(request.param) * scene.frustum.longest_reach

    @pytest.fixture(scope="class")
    def images(self, scene: Scene, aperture: Aperture, near: float) -> tuple[HogelImage, HogelImage, int]:
        model = Reference(scene).trace_model(aperture, reversed_d32f(near))
        with Rasterizer(scene) as raster:
            return model, raster.render(aperture, reversed_d32f(near)), int(raster.device["subpixel_bits"])

    def check(self, scene: Scene, model: HogelImage, drawn: HogelImage, bits: int) -> None:
        wrong = differences(model, drawn).sum()
        unexplained = explain(scene, model, drawn, bits).counts()["unexplained"]
        print(f"\n{scene.name}: {unexplained} of {wrong} wrong pixels unexplained")
        assert wrong > 50
        assert unexplained >= STAYS_UNEXPLAINED * wrong

    @pytest.mark.parametrize("axis", [0, 1])
    def test_an_image_shifted_by_one_pixel(
        self, scene: Scene, images: tuple[HogelImage, HogelImage, int], axis: int
    ) -> None:
        model, drawn, bits = images
        self.check(scene, model, pictured(drawn, lambda a: np.roll(a, 1, axis)), bits)

    @pytest.mark.parametrize("how", ["apart", "neighbors"])
    def test_two_triangles_swapped(
        self, scene: Scene, images: tuple[HogelImage, HogelImage, int], how: str
    ) -> None:
        """Neighbors are the harder case: their planes are nearly one, so their depths agree."""
        model, drawn, bits = images
        pairs = swappable(scene, drawn, neighbors=how == "neighbors")
        swapped = np.arange(len(scene.faces) + 1)  # the last one is NOTHING
        swapped[-1] = NOTHING
        for one, other in pairs:
            swapped[[one, other]] = other, one
        triangle = swapped[drawn.triangle].astype(np.int32)
        self.check(scene, model, replace(drawn, triangle=triangle), bits)

    def test_near_wrong_by_a_hundredth(
        self,
        scene: Scene,
        aperture: Aperture,
        near: float,
        images: tuple[HogelImage, HogelImage, int],
    ) -> None:
        """Drawn at another near than it says: told apart as long as near moves anything at all."""
        model, drawn, bits = images
        with Rasterizer(scene) as raster:
            wrong = raster.render(aperture, reversed_d32f(1.01 * near))
        claimed = replace(wrong, camera=drawn.camera)
        made_wrong = differences(model, claimed).sum() - differences(model, drawn).sum()
        if near < 1e-3 * scene.frustum.longest_reach:
            assert made_wrong < 50, "moved by less than rounding does"
            return
        self.check(scene, model, claimed, bits)


def swappable(scene: Scene, drawn: HogelImage, *, neighbors: bool) -> list[tuple[int, int]]:
    """Return disjoint pairs of the triangles that fill most pixels, far apart or with a common edge."""
    numbers, counts = np.unique(drawn.triangle[drawn.covered], return_counts=True)
    large = numbers[np.argsort(-counts, kind="stable")][:400].tolist()
    if not neighbors:
        half = len(large) // 2
        return list(zip(large[:half], large[half : 2 * half], strict=True))[:40]
    pairs: list[tuple[int, int]] = []
    used: set[int] = set()
    corners = {number: {tuple(corner) for corner in scene.triangles[number].tolist()} for number in large}
    for one in large:
        for other in large:
            if one < other and not used & {one, other} and len(corners[one] & corners[other]) == 2:
                pairs.append((one, other))
                used |= {one, other}
    return pairs[:40]
