"""The comparison of images: what counts as wrong and what does not, displacement, and what lies outside the
film.

What is computed at some pixels only is what plain formulas say of whole images, bit for bit.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from tests.support.long_tail import thinned
from tests.support.misplaced import misplaced
from tests.support.views import at, reversed_d32f, soup, view
from xfrustum.compare.attribution.budget import make_budget
from xfrustum.compare.metrics.comparison import Comparison, compare_images
from xfrustum.compare.metrics.error_maps import (
    ErrorMaps,
    Spread,
    differing_pixels,
    pixel_errors,
    surface_errors,
)
from xfrustum.compare.metrics.radiance import STEP, RadianceSpread
from xfrustum.compare.prediction.chain import make_chain
from xfrustum.compare.rounding.positions import POSITION_ROUNDINGS
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import (
    NOTHING,
    Certainty,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Frustum,
    HogelImage,
    InputError,
    Plate,
    Scene,
    SceneObject,
)
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.geometry.shapes import square

COLORS = {"rms": list, "mean": list, "p99": list, "max": list}
RADIANCE = {
    "pixels": int,
    "rms": float,
    "mean": float,
    "p99": float,
    "max": float,
    "above_step": float,
    "channels": COLORS,
}
CONTRACT = {
    "pixels": int,
    "judged": int,
    "covered": int,
    "at_plate": int,
    "surface": {"wrong": int, "fraction": float, "outside": int, "culled": type(None)},
    "triangle": {"wrong": int, "fraction": float},
    "displacement_px": {"rms": float, "p50": float, "p95": float, "p99": float, "max": float},
    "height": {"rms": float, "max": float},
    "radiance": {
        **RADIANCE,
        "away_from_edges": RADIANCE,
        "flip": type(None),
        "ssim": type(None),
        "pixels_per_degree": type(None),
        "noise": type(None),
    },
    "certainty": {"proven": int, "exact": int, "tie": int, "unexamined": int},
}
"""Design, section 7, and behind it the truth's pixels by class of certainty."""


@dataclass(frozen=True, kw_only=True)
class Case:
    reference: Reference
    truth: HogelImage
    drawn: HogelImage

    def wrong(self, image: HogelImage) -> Mask:
        return compare_images(self.truth, image, self.reference).maps.surface


@pytest.fixture(scope="module")
def asymmetric() -> Case:
    scene = view("asymmetric", (96, 64))
    reference = Reference(scene)
    with Rasterizer(scene) as raster:
        drawn = raster.render(scene.plate.middle, reversed_d32f(1.5))
    return Case(reference=reference, truth=reference.trace(scene.plate.middle), drawn=drawn)


def changed(image: HogelImage, where: Mask, **values: Any) -> HogelImage:
    """Return the image with other values in some pixels."""
    arrays: dict[str, Any] = {name: getattr(image, name).copy() for name in values}
    for name, value in values.items():
        arrays[name][where] = value
    return replace(image, **arrays)


def pixel(image: HogelImage, row: int, column: int) -> Mask:
    mask = np.zeros(image.triangle.shape, dtype=np.bool_)
    mask[row, column] = True
    return mask


def some_pixel(mask: Mask) -> Mask:
    rows, columns = np.nonzero(mask)
    only = np.zeros_like(mask)
    only[rows[len(rows) // 2], columns[len(rows) // 2]] = True
    return only


def assert_form(found: Any, form: Any, name: str = "summary") -> None:
    if isinstance(form, dict):
        assert list(found) == list(form), name
        for key in form:
            assert_form(found[key], form[key], f"{name}.{key}")
    else:
        assert type(found) is form, name


def test_the_summary_is_the_contract_in_json(asymmetric: Case) -> None:
    summary = compare_images(asymmetric.truth, asymmetric.drawn, asymmetric.reference).summary()
    assert_form(json.loads(json.dumps(summary, allow_nan=False)), CONTRACT)
    assert summary["pixels"] == 96 * 64 == summary["judged"]
    assert summary["covered"] == asymmetric.truth.covered.sum()
    for name in ("surface", "triangle"):
        assert summary[name]["fraction"] == summary[name]["wrong"] / summary["judged"]
    spread = summary["displacement_px"]
    assert 0 < spread["p50"] < spread["p95"] < spread["p99"] < spread["max"]


def test_the_truth_is_right_by_itself(asymmetric: Case) -> None:
    found = compare_images(asymmetric.truth, asymmetric.truth, asymmetric.reference)
    assert found.surface_wrong == found.triangle_wrong == 0
    assert found.displacement_px is not None and found.displacement_px.max < 1e-9
    assert found.height is not None and found.height.max == 0
    assert found.certainty == {"proven": 96 * 64, "exact": 0, "tie": 0, "unexamined": 0}


def test_without_a_reference_surface_is_unknown_and_the_rest_is_not(asymmetric: Case) -> None:
    found = compare_images(asymmetric.truth, asymmetric.drawn, None)
    known = compare_images(asymmetric.truth, asymmetric.drawn, asymmetric.reference)
    assert found.surface_wrong is None and found.maps.surface is None and found.maps.outside is None
    assert found.summary() == known.summary() | {"surface": None}


def test_the_order_of_an_array_in_memory_means_nothing(asymmetric: Case) -> None:
    def by_columns(image: HogelImage) -> HogelImage:
        every = {item.name: getattr(image, item.name) for item in fields(image)}
        turned: dict[str, Any] = {
            name: np.asfortranarray(values)
            for name, values in every.items()
            if isinstance(values, np.ndarray)
        }
        return replace(image, **turned)

    known = compare_images(asymmetric.truth, asymmetric.drawn, asymmetric.reference)
    found = compare_images(by_columns(asymmetric.truth), by_columns(asymmetric.drawn), asymmetric.reference)
    assert known.surface_wrong and found.summary() == known.summary()
    np.testing.assert_array_equal(found.maps.surface, known.maps.surface)


def test_a_hit_against_a_miss_is_wrong_both_ways(asymmetric: Case) -> None:
    truth = asymmetric.truth
    nothing = {"triangle": NOTHING, "object": NOTHING, "position": np.nan}
    hole = some_pixel(truth.covered)
    np.testing.assert_array_equal(asymmetric.wrong(changed(truth, hole, **nothing)), hole)
    speck = some_pixel(~truth.covered)
    shown = {"triangle": 0, "object": 0, "position": truth.position[truth.covered][0]}
    np.testing.assert_array_equal(asymmetric.wrong(changed(truth, speck, **shown)), speck)


def test_an_image_that_names_objects_alone_is_judged_by_them(asymmetric: Case) -> None:
    truth = asymmetric.truth
    named = replace(
        truth,
        triangle=np.full_like(truth.triangle, NOTHING),
        position=np.full_like(truth.position, np.nan),
        certainty=None,
    )
    assert compare_images(truth, named, asymmetric.reference).surface_wrong == 0
    emptied = replace(named, object=np.full_like(truth.object, NOTHING))
    judged = truth.covered & (truth.certainty != Certainty.TIE)
    assert compare_images(truth, emptied, asymmetric.reference).surface_wrong == judged.sum()


def test_another_object_is_wrong_another_triangle_of_it_is_not(asymmetric: Case) -> None:
    truth = asymmetric.truth
    where = some_pixel(truth.object == 2)
    np.testing.assert_array_equal(asymmetric.wrong(changed(truth, where, object=3)), where)
    inside = truth.object == 2
    neighbor = some_pixel(
        inside & np.roll(inside, -1, 1) & (truth.triangle != np.roll(truth.triangle, -1, 1))
    )
    row, column = np.argwhere(neighbor)[0]
    displaced = changed(
        truth,
        neighbor,
        triangle=truth.triangle[row, column + 1],
        position=truth.position[row, column + 1],
    )
    found = compare_images(truth, displaced, asymmetric.reference)
    assert found.surface_wrong == 0, "a picture merely displaced is not a wrong surface"
    np.testing.assert_array_equal(found.maps.triangle, neighbor)
    np.testing.assert_allclose(found.maps.displacement[row, column], [1, 0], atol=1e-9)


def test_a_hidden_point_is_wrong_on_either_side_of_the_plate() -> None:
    """The far side of a closed surface is wrong: the same object and pixel, but the near side is in front."""
    scene = view("asymmetric", (96, 64))
    reference = Reference(scene)
    truth = reference.trace(scene.plate.middle)
    d = truth.position / -truth.height[..., None]
    for number, sign in ((2, 1), (3, -1)):
        where = truth.object == number
        assert (np.sign(truth.height[where]) == sign).all() and where.sum() > 20
        one = some_pixel(where)
        row, column = np.argwhere(one)[0]
        # Where the pixel's line leaves the object again: the largest s on its triangles.
        found = []
        for triangle in np.flatnonzero(scene.object_of_triangle == number):
            a, b, c = scene.triangles[triangle]
            matrix = np.column_stack([b - a, c - a, -d[row, column]])
            if abs(np.linalg.det(matrix)) > 1e-12:
                first, second, s = np.linalg.solve(matrix, -a)
                if first >= 0 and second >= 0 and first + second <= 1:
                    found.append((s, triangle))
        s, triangle = max(found)
        assert s > -truth.height[row, column] + 1
        far_side = changed(truth, one, triangle=triangle, position=s * d[row, column])
        surface = compare_images(truth, far_side, reference).maps.surface
        np.testing.assert_array_equal(surface, one)


def test_ties_are_not_judged(asymmetric: Case) -> None:
    assert asymmetric.truth.certainty is not None
    where = some_pixel(asymmetric.truth.covered)
    tied = changed(asymmetric.truth, where, certainty=Certainty.TIE)
    wrong = changed(tied, where, triangle=NOTHING, object=NOTHING, position=np.nan)
    found = compare_images(tied, wrong, asymmetric.reference)
    assert found.judged == found.pixels - 1
    np.testing.assert_array_equal(found.maps.judged, ~where)
    assert found.surface_wrong == found.triangle_wrong == 0
    assert found.certainty["tie"] == 1
    for kind in (Certainty.PROVEN, Certainty.EXACT, Certainty.UNEXAMINED):
        judged = changed(asymmetric.truth, where, certainty=kind)
        assert compare_images(judged, wrong, asymmetric.reference).surface_wrong == 1


def test_nothing_judged_is_no_division_by_zero(asymmetric: Case) -> None:
    all_tied = replace(asymmetric.truth, certainty=np.full_like(asymmetric.truth.certainty, Certainty.TIE))
    summary = compare_images(all_tied, asymmetric.drawn, asymmetric.reference).summary()
    assert summary["judged"] == 0
    assert summary["surface"] == {"wrong": 0, "fraction": 0.0, "outside": 0, "culled": None}
    assert summary["triangle"] == {"wrong": 0, "fraction": 0.0}
    assert summary["height"] is None


def test_points_in_the_plate_are_counted_and_not_displaced(asymmetric: Case) -> None:
    truth = asymmetric.truth
    where = some_pixel(truth.covered)
    flat = changed(truth, where, position=[3.0, 2.0, 0.0])
    found = compare_images(truth, flat, asymmetric.reference)
    assert found.at_plate == 1
    assert np.isnan(found.maps.displacement[where]).all()
    # The truth shows something else there: only a surface in the aperture itself is seen in the plate.
    assert found.surface_wrong == 1


def test_a_surface_through_the_aperture_is_right_when_both_show_it() -> None:
    tilted = np.array([[[-4.0, -4.0, -3.0], [4.0, -4.0, -3.0], [0.0, 8.0, 6.0]]])
    frustum = Frustum(resolution=(8, 8), reach=(9.0, 9.0), fov=(1.0, 1.0))
    reference = Reference(soup(tilted, frustum))
    truth = reference.trace(at(0.0, 0.0))
    assert (truth.height == 0).all()
    found = compare_images(truth, truth, reference)
    assert found.at_plate == found.covered == 64
    assert found.surface_wrong == 0
    assert found.displacement_px is None
    assert found.summary()["displacement_px"] is None


def test_a_spread_of_nothing_is_none_and_of_anything_its_order_statistics() -> None:
    assert Spread.of(np.zeros(0)) is None
    assert Spread.of(np.zeros((3, 3))) == Spread(rms=0, p50=0, p95=0, p99=0, max=0)
    spread = Spread.of(np.arange(101.0))
    assert (spread.p50, spread.p95, spread.p99, spread.max) == pytest.approx((50, 95, 99, 100))
    assert spread.rms == pytest.approx(math.sqrt(np.mean(np.arange(101.0) ** 2)))
    huge = Spread.of(np.array([1e300, 1e300]))
    assert huge is not None and huge.rms == pytest.approx(1e300)


def test_images_of_different_questions_are_not_compared(asymmetric: Case) -> None:
    truth, drawn, scene = asymmetric.truth, asymmetric.drawn, asymmetric.reference.scene
    smaller = Reference(view("asymmetric", (64, 64))).trace(scene.plate.middle)
    other = replace(drawn, camera=replace(drawn.camera, scene_hash="0" * 64))
    moved = asymmetric.reference.trace(scene.plate.aperture(3, 4))
    for one, image, said in (
        (truth, smaller, r"96 x 64.*64 x 64"),
        (truth, moved, r"aperture.*3,4"),
        (truth, other, "different scenes"),
        (drawn, truth, "traced image first"),
    ):
        with pytest.raises(InputError, match=said):
            compare_images(one, image, asymmetric.reference)


def test_a_quantity_that_an_image_does_not_have_is_unknown_and_neither_right_nor_wrong(
    asymmetric: Case,
) -> None:
    truth, drawn, reference = asymmetric.truth, asymmetric.drawn, asymmetric.reference
    whole = compare_images(truth, drawn, reference).summary()
    nameless = replace(drawn, object=np.full_like(drawn.object, NOTHING))
    assert compare_images(truth, nameless, reference).summary() == whole, "triangles name objects"
    numberless = replace(drawn, triangle=np.full_like(drawn.triangle, NOTHING))
    found = compare_images(truth, numberless, reference).summary()
    assert found["triangle"] is None and found["height"] is None
    assert found["surface"] == whole["surface"] and found["displacement_px"] == whole["displacement_px"]
    placeless = replace(drawn, position=np.full_like(drawn.position, np.nan))
    found = compare_images(truth, placeless, reference).summary()
    assert found["displacement_px"] is None and found["triangle"] is not None


def test_an_empty_scene_has_no_errors_and_no_spread() -> None:
    scene = view("empty", (16, 8))
    reference = Reference(scene)
    truth = reference.trace(scene.plate.middle)
    summary = compare_images(truth, truth, reference).summary()
    assert summary["covered"] == summary["surface"]["wrong"] == 0
    assert summary["displacement_px"] is None and summary["height"] is None


NEARS_PER_REACH = (1e-4, 1e-6, 1e-8)
"""Nears at which D16 swaps few surfaces, at which it loses many, and at which it loses all of them."""


class Drawn:
    """The chain of an aperture with a starved depth buffer, and the same cameras' exact one."""

    def __init__(self, near_per_reach: float) -> None:
        scene = view("car", (96, 96))
        near = near_per_reach * scene.frustum.longest_reach
        settings = DoubleFrustum(near=near, depth=DepthFormat.D16, mapping=DepthMapping.STANDARD)
        self.reference = Reference(scene)
        with Rasterizer(scene) as rasterizer:
            self.chain = make_chain(self.reference, rasterizer, scene.plate.middle, settings)
        self.truth, *_, self.exact, self.starved = self.chain.images


@pytest.fixture(scope="module", params=NEARS_PER_REACH)
def drawn(request: pytest.FixtureRequest) -> Drawn:
    return Drawn(request.param)


def test_a_picture_judged_beside_another_is_judged_as_alone(drawn: Drawn) -> None:
    alone = compare_images(drawn.truth, drawn.starved, drawn.reference, radiance=False)
    judged = pixel_errors(drawn.truth, drawn.exact, drawn.reference)
    beside = compare_images(drawn.truth, drawn.starved, drawn.reference, radiance=False, beside=judged)
    assert (drawn.starved.triangle != drawn.exact.triangle).any()
    assert beside.numbers == alone.numbers
    for item in fields(ErrorMaps):
        np.testing.assert_array_equal(getattr(beside.maps, item.name), getattr(alone.maps, item.name))


@pytest.mark.parametrize("axis", range(3))
def test_a_pixel_differs_if_one_coordinate_does(drawn: Drawn, axis: int) -> None:
    moved = np.array(drawn.exact.position)
    row, column = np.argwhere(drawn.exact.triangle >= 0)[0]
    moved[row, column, axis] += 1
    found = differing_pixels(drawn.exact, replace(drawn.exact, position=moved))
    assert found.tolist() == [row * moved.shape[1] + column]


def test_a_pixel_is_charged_to_the_last_link_that_changed_it(drawn: Drawn) -> None:
    budget = make_budget(drawn.reference, drawn.chain)
    images = drawn.chain.images
    wrong = np.argwhere(budget.charge >= 0)
    assert len(wrong)
    for row, column in wrong[:: max(1, len(wrong) // 200)]:
        numbers = [image.triangle[row, column] for image in images]
        last = max(link for link in range(len(numbers) - 1) if numbers[link] != numbers[link + 1])
        assert budget.charge[row, column] == last


def test_a_wrong_surface_is_charged_to_the_link_from_which_on_it_is_wrong(drawn: Drawn) -> None:
    budget = make_budget(drawn.reference, drawn.chain)
    images = drawn.chain.images
    right = np.stack([~surface_errors(drawn.truth, image, drawn.reference).wrong for image in images])
    last_right = len(images) - 1 - np.argmax(right[::-1], axis=0)
    wrong = ~right[-1] & budget.start.judged
    assert wrong.any()
    np.testing.assert_array_equal(budget.surface_charge, np.where(wrong, last_right, -1))


NEARS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)  #: near offsets as fractions of the reach
MOST_PX = 1e-3
"""Largest 99th percentile of the difference between measured and predicted displacement on meshes, px."""

MESHES = [
    ("car", (40, 30)),
    ("car", (12, 50)),
    ("car-recentered", (0, 0)),
    ("asymmetric", (25, 41)),
    ("asymmetric-recentered", (0, 0)),
    ("asymmetric-recentered", (80, 60)),
    ("beetle", (40, 30)),
    ("bunny-transfer", (150, 50)),
    ("bunny-transfer", (299, 99)),
    ("teapot-recentered", (119, 79)),
    ("teapot-recentered", (60, 40)),
    ("truck", (50, 30)),
]
OTHERS = [("crossing", (40, 30)), ("crossing", (31, 17)), ("large-triangles", (40, 30)), ("sheets", (40, 30))]


def closed_form(image: HogelImage, near: float) -> np.ndarray:
    """Return true minus drawn, (H, W, 2) columns and rows: +(W/2) u n/|z| and -(H/2) v n/|z|."""
    height, width = image.triangle.shape
    u = (2 * np.arange(width) + 1) / width - 1
    v = 1 - (2 * np.arange(height) + 1) / height
    per_film_unit = near / np.abs(image.height.astype(np.float64))
    return np.stack((width / 2 * u * per_film_unit, -height / 2 * v[:, None] * per_film_unit), axis=-1)


@pytest.mark.parametrize(("name", "index"), thinned(MESHES + OTHERS, 5))
def test_displacement_measured_pixel_by_pixel_is_the_closed_form(name: str, index: tuple[int, int]) -> None:
    assert POSITION_ROUNDINGS <= 16
    scene = view(name, (256, 192))
    aperture = scene.plate.aperture(*index)
    reference = Reference(scene)
    truth = reference.trace(aperture)
    largest_coordinate = np.abs(scene.triangles).max(axis=(1, 2))
    half_extent = np.array(truth.camera.half_extent)
    seen = 0
    with Rasterizer(scene) as raster:
        for near in np.array(NEARS) * scene.frustum.longest_reach:
            drawn = raster.render(aperture, reversed_d32f(float(near)), normals=False, color=False)
            measured = compare_images(truth, drawn, reference).maps.displacement
            shown = (drawn.triangle != NOTHING) & (drawn.height != 0)
            np.testing.assert_array_equal(np.isfinite(measured), np.repeat(shown[..., None], 2, axis=2))
            with np.errstate(divide="ignore", invalid="ignore"):
                off = np.abs(measured - closed_form(drawn, float(near)))[shown]
            z = np.abs(drawn.height[shown]).astype(np.float64)[:, None]
            # The points are computed on the drawn triangles: these must have been drawn there.
            assert not misplaced(scene, drawn, raster.model).any()
            known = POSITION_ROUNDINGS * 2.0**-24 * largest_coordinate[drawn.triangle[shown]][:, None]
            bound = known * np.array([256, 192]) / (2 * z * half_extent)
            assert (off <= bound).all()
            seen += len(off)
            if len(off) and (name, index) in MESHES:
                assert np.percentile(off.max(axis=1), 99) <= MOST_PX
    assert seen > 2000


@pytest.mark.parametrize("name", ["car", "asymmetric-recentered"])
def test_the_signs_a_small_near_moves_the_drawn_picture_toward_the_middle(name: str) -> None:
    scene = view(name, (128, 128))
    aperture = scene.plate.middle
    reference = Reference(scene)
    with Rasterizer(scene) as raster:
        drawn = raster.render(aperture, reversed_d32f(1.5))
    shift = compare_images(reference.trace(aperture), drawn, reference).maps.displacement
    right, below = slice(70, None), slice(70, None)
    for outward in (shift[:, right, 0], shift[below, :, 1], -shift[:, :58, 0], -shift[:58, :, 1]):
        assert np.isfinite(outward).any()
        assert (outward[np.isfinite(outward)] > 0).all()


WIDTH, HEIGHT = 64, 48
DEPTH = 40.0  #: distance of a wall from the plate, on either side


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


def compared_wall(side: int, settings: DoubleFrustum) -> Comparison:
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
    found = compared_wall(side, DoubleFrustum(near=near))
    assert found.surface.outside == found.surface.wrong == beyond(DEPTH / (DEPTH + near)) > 0
    # Everywhere the right wall, and nothing in front of it.
    assert found.triangle is not None
    np.testing.assert_array_equal(found.maps.outside, found.maps.surface)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_picture_displaced_by_less_than_half_a_pixel_shows_nothing_from_outside(side: int) -> None:
    """The outermost center lies at 1 - 1/W: n/|z| below 1/(W - 1) leaves it inside."""
    largest = DEPTH / (WIDTH - 1)
    inside, outside = (compared_wall(side, DoubleFrustum(near=largest * factor)) for factor in (0.99, 1.01))
    assert inside.surface.wrong == inside.surface.outside == 0
    assert outside.surface.outside == 2 * HEIGHT


@pytest.mark.parametrize("side", [-1, 1])
def test_what_is_fitted_to_the_wall_shows_nothing_from_outside(side: int) -> None:
    found = compared_wall(side, DoubleFrustum(near=20.0, fit=DEPTH))
    assert found.surface.outside == found.surface.wrong == 0


PERCENTS = (50, 95, 99)


class Compared:
    """A comparison of a small picture, some of whose pixels are ties, and its images."""

    def __init__(self) -> None:
        scene = view("asymmetric-recentered", (48, 36))
        aperture = scene.default_apertures()[-1]
        reference = Reference(scene)
        traced = reference.trace(aperture)
        certainty = traced.certainty.copy()
        certainty[::5, ::3] = Certainty.TIE
        self.truth = replace(traced, certainty=certainty)
        near = 0.05 * scene.frustum.longest_reach
        with Rasterizer(scene) as rasterizer:
            self.drawn = rasterizer.render(aperture, DoubleFrustum(near=near, depth=DepthFormat.D16))
        self.found = compare_images(self.truth, self.drawn, reference)


@pytest.fixture(scope="module")
def compared() -> Compared:
    return Compared()


def plain_displacement(image: HogelImage) -> Floats:
    """Return the displacement of every pixel by the formulas of CONVENTIONS.md, step by step."""
    camera = image.camera
    (width, height), (kx, ky), (tx, ty) = camera.resolution, camera.shear, camera.half_extent
    x, y, z = np.moveaxis(image.position.astype(np.float64), -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = ((x - camera.aperture.x) / -z - kx) / tx
        v = ((y - camera.aperture.y) / -z - ky) / ty
    shift = np.stack(
        (
            (u + 1) * width / 2 - 0.5 - np.arange(width),
            (1 - v) * height / 2 - 0.5 - np.arange(height)[:, None],
        ),
        axis=-1,
    )
    shift[~np.isfinite(x + y + z) | (z == 0)] = np.nan
    return shift


def test_displacement_is_that_of_whole_images(compared: Compared) -> None:
    shift = plain_displacement(compared.drawn)
    np.testing.assert_array_equal(compared.found.maps.displacement, shift)
    length = np.hypot(shift[..., 0], shift[..., 1])
    known = length[np.isfinite(length)]
    spread = compared.found.displacement_px
    assert spread is not None and 0 < len(known) < length.size
    expected = np.percentile(known, PERCENTS).tolist()
    assert [spread.p50, spread.p95, spread.p99, spread.max] == [*expected, known.max()]


def test_heights_and_triangles_are_those_of_whole_images(compared: Compared) -> None:
    truth, drawn, found = compared.truth, compared.drawn, compared.found
    judged = truth.certainty != Certainty.TIE
    same = judged & (truth.triangle == drawn.triangle) & (truth.triangle >= 0)
    expected = np.where(same, drawn.height - truth.height, np.nan)
    np.testing.assert_array_equal(found.maps.height, expected)
    np.testing.assert_array_equal(found.maps.triangle, judged & (truth.triangle != drawn.triangle))
    error = expected[same]
    # Sums of other orders: each addition of n squares is off by 2^-53 of the sum, and the root by half.
    assert found.height.rms == pytest.approx(float(np.sqrt(np.mean(error**2))), rel=len(error) * 2**-53)
    assert found.height.max == float(np.abs(error).max())


def test_colors_are_those_of_whole_images(compared: Compared) -> None:
    truth, drawn, found = compared.truth, compared.drawn, compared.found
    judged = truth.certainty != Certainty.TIE
    error = drawn.color.astype(np.float64) - truth.color
    error[~judged] = np.nan
    np.testing.assert_array_equal(found.maps.radiance, error)
    assert_plain(found.radiance, error[judged])
    same = judged & (truth.triangle == drawn.triangle) & (truth.triangle >= 0)
    assert_plain(found.radiance.away_from_edges, error[same])


def assert_plain(found: RadianceSpread, error: Floats) -> None:
    """Compare a spread with that of NumPy's own functions over errors (N, 3)."""
    size = np.abs(error)
    worst = size.max(axis=1)
    squares = np.mean(error**2, axis=0)
    # Sums of other orders: as of heights.
    rounding = error.size * 2**-53
    assert found.pixels == len(error)
    assert found.rms == pytest.approx(float(np.sqrt(squares.mean())), rel=rounding)
    assert found.mean == pytest.approx(float(error.mean()), abs=rounding * float(size.mean()))
    assert (found.p99, found.max) == (np.percentile(worst, 99), worst.max())
    assert found.above_step == np.mean(worst > STEP)
    channels = found.channels
    assert channels.rms == pytest.approx(tuple(np.sqrt(squares)), rel=rounding)
    assert channels.mean == pytest.approx(tuple(error.mean(axis=0)), abs=rounding * float(size.mean()))
    assert channels.p99 == tuple(np.percentile(size, 99, axis=0))
    assert channels.max == tuple(size.max(axis=0))
