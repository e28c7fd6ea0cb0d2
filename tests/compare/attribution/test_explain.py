"""Drawn images and exact traces of their cameras nearly agree; every difference is explained."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, product
from math import radians
from typing import Any

import numpy as np
import pytest

from tests.compare.metrics.test_flips import pictured
from tests.support.long_tail import thinned
from tests.support.misplaced import misplaced
from tests.support.views import reversed_d32f, soup, view
from xfrustum.compare.attribution import explain
from xfrustum.compare.comparison import compare_images
from xfrustum.raster import Rasterizer, cameras
from xfrustum.raster.cameras import clip_from_scene
from xfrustum.raster.device import mesh
from xfrustum.reference import Reference
from xfrustum.reports.budget import budget_of
from xfrustum.scenes import (
    NOTHING,
    Certainty,
    Cull,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Frustum,
    HogelImage,
    Scene,
)
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.device_model import H100, safe_model

STAYS_UNEXPLAINED = 0.9
"""Smallest unexplained share of the wrong pixels in a raster image with a defect."""

RESOLUTION = (512, 384)


@pytest.mark.parametrize("depth", [DepthFormat.D16, DepthFormat.D24])
@pytest.mark.parametrize("name", thinned(["asymmetric", "asymmetric-recentered"], 2, 1))
def test_swaps_and_losses_of_fixed_point_depth_are_explained_by_depth(
    name: str, depth: DepthFormat
) -> None:
    scene = view(name, RESOLUTION)
    aperture = scene.plate.aperture(30, 40)
    near = {DepthFormat.D16: 5e-7, DepthFormat.D24: 3e-9}[depth] * scene.frustum.longest_reach
    settings = DoubleFrustum(near=near, depth=depth)
    model = Reference(scene).trace_model(aperture, settings)
    with Rasterizer(scene) as raster:
        drawn = raster.render(aperture, settings, normals=False, color=False)
        explanation = explain(scene, model, drawn, raster.model)
    counts = explanation.counts()
    assert counts["unexplained"] == 0
    assert counts["order"] > 100
    assert counts["lost"] > 10
    # Instead of a lost surface, the background or the surface behind it appears.
    assert (model.covered & ~drawn.covered & explanation.masks["lost"]).any()


class Case:
    """A scene, the exact image of the offset cameras, and the drawn image."""

    def __init__(self, name: str, near: float) -> None:
        self.scene = view(name, RESOLUTION)
        self.aperture = self.scene.plate.aperture(30, 40)
        self.settings = reversed_d32f(near * self.scene.frustum.longest_reach)
        self.model = Reference(self.scene).trace_model(self.aperture, self.settings)
        self.drawn = self.draw(self.settings)

    def draw(self, settings: DoubleFrustum) -> HogelImage:
        with Rasterizer(self.scene) as raster:
            self.device = raster.model
            return raster.render(self.aperture, settings, normals=False, color=False)

    def differences(self, drawn: HogelImage) -> Mask:
        certain = self.model.certainty != Certainty.TIE
        return np.asarray((self.model.triangle != drawn.triangle) & certain)

    def assert_unexplained(self, drawn: HogelImage) -> None:
        wrong = self.differences(drawn).sum()
        assert wrong > 500
        # Neither the model of a device nor the model of unknown devices may explain these pixels.
        for device in (self.device, H100, safe_model(8)):
            unexplained = explain(self.scene, self.model, drawn, device).counts()["unexplained"]
            assert unexplained >= STAYS_UNEXPLAINED * wrong, device.name


CASES = product(("car", "asymmetric", "asymmetric-recentered"), (1e-2, 1e-7))


@pytest.fixture(scope="module", params=thinned(((case,) for case in CASES), 5), ids=str)
def case(request: pytest.FixtureRequest) -> Case:
    return Case(*request.param)


class TestNegativeControls:
    """A bound that explains everything is worthless: defects must stay unexplained."""

    @pytest.mark.parametrize("axis", [0, 1])
    def test_an_image_shifted_by_one_pixel(self, case: Case, axis: int) -> None:
        case.assert_unexplained(pictured(case.drawn, lambda a: np.roll(a, 1, axis)))

    def test_with_four_subpixel_bits_only_pixels_beside_edges_are_explained(
        self, case: Case
    ) -> None:
        """With 4 subpixel bits, edges may move 2^-4.5 px: under 90 % of pixels stay unexplained.

        A picture shifted by a pixel is wrong where an edge passes within a pixel of the center,
        along the shift. Let n be the component of the edge's unit normal along the shift. The edge
        is nearer than d = 2^-4.5 px = 0.044 px to a share d / |n| of these centers, on average
        (pi / 2) d = 7 % over all directions. Some other centers lie beside other edges, more of
        them for smaller triangles. The test measures the whole share with a picture in which every
        pixel shows a triangle that does not exist.
        """
        shifted = pictured(case.drawn, lambda a: np.roll(a, 1, 0))
        wrong, device = case.differences(shifted), safe_model(4)
        nowhere = np.full_like(case.drawn.triangle, len(case.scene.faces))
        of_no_scene = replace(case.drawn, triangle=nowhere)
        by_chance = ~explain(case.scene, case.model, of_no_scene, device).unexplained[wrong]
        assert np.pi / 2 * 2**-4.5 < by_chance.mean() < 0.25
        left = explain(case.scene, case.model, shifted, device).unexplained[wrong]
        assert left.mean() >= 0.95 * (1 - by_chance.mean())

    @pytest.mark.parametrize("neighbors", [False, True], ids=["apart", "neighbors"])
    def test_two_triangles_swapped(self, case: Case, neighbors: bool) -> None:
        """Neighbors are the harder case: their planes nearly coincide, so their depths agree."""
        pairs = swappable(case.scene, case.drawn, neighbors=neighbors)
        swapped = np.arange(len(case.scene.faces) + 1)
        swapped[-1] = NOTHING
        for first, other in pairs:
            swapped[[first, other]] = other, first
        case.assert_unexplained(
            replace(case.drawn, triangle=swapped[case.drawn.triangle].astype(np.int32))
        )

    @pytest.mark.parametrize(("row", "column"), thinned([(0, 0), (1, 1), (0, 2), (1, 3)], 3))
    def test_one_matrix_entry_wrong_by_a_hundredth_of_the_film(
        self, case: Case, row: int, column: int, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def wrong(frustum: Frustum, *arguments: Any) -> Floats:
            matrix = np.array(clip_from_scene(frustum, *arguments))
            # Wrong shears and offsets displace points at half the reach by a hundredth of the film.
            size = 1.0 if column != 3 else frustum.longest_reach / 2
            matrix[row, column] += 0.01 * size * matrix[row, row]
            return matrix

        monkeypatch.setattr(cameras, "clip_from_scene", wrong)
        case.assert_unexplained(case.draw(case.settings))


@pytest.mark.parametrize(
    ("name", "near", "factor"),
    [("car", 1e-1, 1.01), ("asymmetric", 1e-1, 1.03), ("asymmetric-recentered", 1e-1, 1.03)],
)
def test_a_wrong_near_that_moves_edges_stays_unexplained(
    name: str, near: float, factor: float
) -> None:
    """At a much smaller near offset, the defect would move edges by less than rounding."""
    case = Case(name, near)
    wrong = case.draw(replace(case.settings, near=factor * case.settings.near))
    case.assert_unexplained(replace(wrong, camera=case.drawn.camera))


def swappable(scene: Scene, drawn: HogelImage, *, neighbors: bool) -> list[tuple[int, int]]:
    """Return disjoint pairs of the largest triangles, far apart or sharing an edge."""
    numbers, counts = np.unique(drawn.triangle[drawn.covered], return_counts=True)
    large = numbers[np.argsort(-counts, kind="stable")][:400].tolist()
    half = len(large) // 2
    pairs = list(zip(large[:half], large[half : 2 * half], strict=True))
    if neighbors:
        corners = {number: set(map(tuple, scene.triangles[number].tolist())) for number in large}
        pairs = [(a, b) for a, b in combinations(large, 2) if len(corners[a] & corners[b]) == 2]
    disjoint: dict[int, int] = {}
    for first, other in pairs:
        if not {first, other} & {*disjoint, *disjoint.values()}:
            disjoint[first] = other
    return list(disjoint.items())[:40]


def test_a_picture_shifted_from_its_camera_is_misplaced(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Surface points would not reveal the defect: they are computed on the drawn triangle."""
    scene = view("car", (256, 192))
    aperture, settings = scene.plate.middle, reversed_d32f(0.15)
    with Rasterizer(scene) as raster:
        device = raster.model
        assert not misplaced(scene, raster.render(aperture, settings), device).any()
    right_shader = mesh.shader

    def shifted(name: str) -> str:
        return right_shader(name).replace(
            "vec4(in_position, 1.0);",
            "vec4(in_position, 1.0); gl_Position.x += 0.002 * gl_Position.w;",
        )

    monkeypatch.setattr(mesh, "shader", shifted)
    with Rasterizer(scene) as raster:
        wrong = raster.render(aperture, settings)
    assert misplaced(scene, wrong, device).sum() > 0.02 * wrong.covered.sum()


CULLED_LINKS = ["near offset", "pivot", "fit", "slabs", "culling", "rasterization", "depth"]


def test_backs_of_open_meshes_are_charged_to_culling_and_counted_by_a_comparison() -> None:
    """Culling loses exactly the pixels that show a back; the near offset changes no others."""
    scene = view("large-triangles", (96, 72))
    settings = replace(reversed_d32f(1e-5 * scene.frustum.longest_reach), cull=Cull.BACK)
    budget, chain = budget_of(scene, scene.plate.middle, settings)
    numbers = budget.numbers
    assert [link.name for link in numbers.links] == CULLED_LINKS
    counts = {link.name: link for link in numbers.links}
    assert counts["culling"].predicted_surface == pytest.approx(counts["culling"].surface, abs=2)
    assert counts["culling"].surface > 500
    assert counts["culling"].predicted_displacement_rms_px is None
    assert sum(link.triangle for link in numbers.links) == numbers.wrong
    assert numbers.unexplained == 0
    reference, truth = Reference(scene), chain.images[0]
    with Rasterizer(scene) as rasterizer:
        whole = rasterizer.render(scene.plate.middle, replace(settings, cull=Cull.NONE))
    culled, without = (
        compare_images(truth, image, reference).surface for image in (chain.images[-1], whole)
    )
    assert culled.wrong - 2 <= culled.culled <= culled.wrong and without.culled is None


@pytest.mark.parametrize(
    ("depth", "mapping"),
    [(DepthFormat.D16, DepthMapping.STANDARD), (DepthFormat.D24, DepthMapping.GL)],
)
def test_rounding_explains_all_differences_of_culled_cameras(
    depth: DepthFormat, mapping: DepthMapping
) -> None:
    """Use loose triangles in all orientations around the plate, many of them nearly edge-on."""
    rng = np.random.default_rng(1997)
    places, sides = rng.uniform(-10, 10, (400, 1, 3)), rng.normal(0, 3.0, (400, 3, 3))
    frustum = Frustum(resolution=(64, 48), reach=(12.0, 12.0), fov=(radians(70), radians(60)))
    scene = soup(places + sides, frustum)
    for slabs in ((), (3.0,)):
        settings = DoubleFrustum(
            near=1e-2, depth=depth, mapping=mapping, slabs=slabs, cull=Cull.BACK
        )
        budget, _ = budget_of(scene, scene.plate.middle, settings)
        assert budget.explanation.unexplained.sum() == 0
        assert (budget.charge == CULLED_LINKS.index("culling")).sum() > 100
