"""The comparison of images: what counts as wrong, what does not, and the words for it."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import pytest

from tests.support.views import at, reversed_d32f, soup, view
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.compare.metrics.error_maps import Spread
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import (
    NOTHING,
    Certainty,
    Frustum,
    HogelImage,
    InputError,
)
from xfrustum.scenes.arrays import Mask

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
        surface = compare_images(self.truth, image, self.reference).maps.surface
        assert surface is not None
        return surface


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
    assert asymmetric.truth.certainty is not None
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
    assert spread is not None
    assert (spread.p50, spread.p95, spread.p99, spread.max) == pytest.approx((50, 95, 99, 100))
    assert spread.rms == pytest.approx(math.sqrt(np.mean(np.arange(101.0) ** 2)))
    huge = Spread.of(np.array([1e300, 1e300]))
    assert huge is not None and huge.rms == pytest.approx(1e300)


def test_images_of_different_questions_are_not_compared(asymmetric: Case) -> None:
    truth, scene = asymmetric.truth, asymmetric.reference.scene
    smaller = Reference(view("asymmetric", (64, 64))).trace(scene.plate.middle)
    with pytest.raises(InputError, match=r"96 x 64.*64 x 64"):
        compare_images(truth, smaller, asymmetric.reference)
    moved = asymmetric.reference.trace(scene.plate.aperture(3, 4))
    with pytest.raises(InputError, match=r"aperture.*3,4"):
        compare_images(truth, moved, asymmetric.reference)
    other = replace(asymmetric.drawn, camera=replace(asymmetric.drawn.camera, scene_hash="0" * 64))
    with pytest.raises(InputError, match="different scenes"):
        compare_images(truth, other, asymmetric.reference)


class TestImagesOfOtherRenderers:
    """A quantity that an image does not have is unknown, and neither right nor wrong."""

    def test_without_objects_the_triangles_name_them(self, asymmetric: Case) -> None:
        whole = compare_images(asymmetric.truth, asymmetric.drawn, asymmetric.reference)
        nameless = replace(asymmetric.drawn, object=np.full_like(asymmetric.drawn.object, NOTHING))
        compared = compare_images(asymmetric.truth, nameless, asymmetric.reference)
        assert compared.summary() == whole.summary()

    def test_without_triangles_only_they_are_unknown(self, asymmetric: Case) -> None:
        whole = compare_images(asymmetric.truth, asymmetric.drawn, asymmetric.reference).summary()
        numberless = replace(asymmetric.drawn, triangle=np.full_like(asymmetric.drawn.triangle, NOTHING))
        compared = compare_images(asymmetric.truth, numberless, asymmetric.reference).summary()
        assert compared["triangle"] is None and compared["height"] is None
        assert compared["surface"] == whole["surface"]
        assert compared["displacement_px"] == whole["displacement_px"]

    def test_without_positions_displacement_is_unknown(self, asymmetric: Case) -> None:
        placeless = replace(asymmetric.drawn, position=np.full_like(asymmetric.drawn.position, np.nan))
        compared = compare_images(asymmetric.truth, placeless, asymmetric.reference).summary()
        assert compared["displacement_px"] is None
        assert compared["triangle"] is not None

    def test_a_drawn_image_is_no_truth(self, asymmetric: Case) -> None:
        with pytest.raises(InputError, match="traced image first"):
            compare_images(asymmetric.drawn, asymmetric.truth, asymmetric.reference)


def test_an_empty_scene_has_no_errors_and_no_spread() -> None:
    scene = view("empty", (16, 8))
    reference = Reference(scene)
    truth = reference.trace(scene.plate.middle)
    summary = compare_images(truth, truth, reference).summary()
    assert summary["covered"] == summary["surface"]["wrong"] == 0
    assert summary["displacement_px"] is None and summary["height"] is None
