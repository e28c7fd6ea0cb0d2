"""Comparison of images: wrong and right pixels, displacement, and points outside the film."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from tests.support.lit import card, lit
from tests.support.long_tail import thinned
from tests.support.misplaced import misplaced
from tests.support.views import at, reversed_d32f, soup, view
from tests.support.worlds import World
from xfrustum.compare.metrics.comparison import Comparison, compare_images
from xfrustum.compare.metrics.error_maps import Spread
from xfrustum.compare.rounding.positions import POSITION_ROUNDINGS
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import (
    NOTHING,
    Certainty,
    DoubleFrustum,
    Frustum,
    HogelImage,
    InputError,
    Plate,
    Scene,
)
from xfrustum.scenes.arrays import Mask


@dataclass(frozen=True, kw_only=True)
class Case:
    """A true image, and a raster image whose near offset of 1.5 moves points by a few pixels."""

    reference: Reference
    truth: HogelImage
    drawn: HogelImage

    def compared(self, image: HogelImage, truth: HogelImage | None = None) -> Comparison:
        return compare_images(truth or self.truth, image, self.reference)


@pytest.fixture
def case(centered: World) -> Case:
    return Case(reference=centered.reference, truth=centered.truth(), drawn=centered.raster())


def changed(image: HogelImage, where: Mask, **values: Any) -> HogelImage:
    """Return the image with other values in some pixels."""
    arrays: dict[str, Any] = {name: getattr(image, name).copy() for name in values}
    for name, value in values.items():
        arrays[name][where] = value
    return replace(image, **arrays)


def without(image: HogelImage, *names: str) -> HogelImage:
    """Return the image without numbers (`NOTHING`) or positions (NaN)."""
    everywhere = np.ones(image.triangle.shape, dtype=np.bool_)
    empty = {name: np.nan if name == "position" else NOTHING for name in names}
    return changed(image, everywhere, **empty)


def some_pixel(mask: Mask) -> Mask:
    rows, columns = np.nonzero(mask)
    only = np.zeros_like(mask)
    only[rows[len(rows) // 2], columns[len(rows) // 2]] = True
    return only


EMPTY = {"triangle": NOTHING, "object": NOTHING, "position": np.nan}


def test_the_summary_is_the_contract_in_json(case: Case) -> None:
    summary = case.compared(case.drawn).summary()
    json.dumps(summary, allow_nan=False)
    assert summary["pixels"] == 64 * 48 == summary["judged"]
    assert summary["covered"] == case.truth.covered.sum()
    for name in ("surface", "triangle"):
        assert summary[name]["fraction"] == summary[name]["wrong"] / summary["judged"]
    spread = summary["displacement_px"]
    assert 0 < spread["p50"] < spread["p95"] < spread["p99"] < spread["max"]
    without_scene = compare_images(case.truth, case.drawn, None)
    assert without_scene.maps.surface is None and without_scene.maps.outside is None
    assert without_scene.summary() == summary | {"surface": None}
    itself = case.compared(case.truth)
    assert itself.surface_wrong == itself.triangle.wrong == itself.height.max == 0
    assert itself.displacement_px.max < 1e-9
    assert itself.certainty == {"proven": 64 * 48, "exact": 0, "tie": 0, "unexamined": 0}


def test_heights_are_raster_minus_truth_where_both_show_one_triangle(case: Case) -> None:
    truth, drawn, comparison = case.truth, case.drawn, case.compared(case.drawn)
    same = truth.covered & (truth.triangle == drawn.triangle)
    error = (drawn.height - truth.height)[same]
    np.testing.assert_array_equal(comparison.maps.height[same], error)
    assert same.any() and np.isnan(comparison.maps.height[~same]).all()
    assert comparison.height.rms == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-12)
    assert comparison.height.max == np.abs(error).max()


def test_a_missing_an_unexpected_and_another_objects_surface_are_wrong(case: Case) -> None:
    truth = case.truth
    for where, values in (
        (some_pixel(truth.covered), EMPTY),
        (
            some_pixel(~truth.covered),
            {"triangle": 0, "object": 0, "position": truth.position[truth.covered][0]},
        ),
        (some_pixel(truth.object == 2), {"object": 3}),
    ):
        wrong = case.compared(changed(truth, where, **values)).maps.surface
        np.testing.assert_array_equal(wrong, where)


def test_another_triangle_of_an_object_displaces_the_picture_and_is_no_wrong_surface(
    case: Case,
) -> None:
    truth, inside = case.truth, case.truth.object == 2
    other = truth.triangle != np.roll(truth.triangle, -1, 1)
    neighbor = some_pixel(inside & np.roll(inside, -1, 1) & other)
    row, column = np.argwhere(neighbor)[0]
    shown = {name: getattr(truth, name)[row, column + 1] for name in ("triangle", "position")}
    comparison = case.compared(changed(truth, neighbor, **shown))
    assert comparison.surface_wrong == 0
    np.testing.assert_array_equal(comparison.maps.triangle, neighbor)
    np.testing.assert_allclose(comparison.maps.displacement[row, column], [1, 0], atol=1e-9)


def test_a_hidden_point_is_wrong_on_either_side_of_the_plate(case: Case) -> None:
    """The object's far side in place of its near side is wrong, though object and pixel agree."""
    scene, truth = case.reference.scene, case.truth
    for number, sign in ((2, 1), (3, -1)):
        where = truth.object == number
        assert (np.sign(truth.height[where]) == sign).all() and where.sum() > 20
        mask = some_pixel(where)
        (height,), (point,) = truth.height[mask], truth.position[mask]
        d = point / -height
        # Largest s at which the pixel's line meets the object's triangles: the far side.
        leaves = []
        for triangle in np.flatnonzero(scene.object_of_triangle == number):
            a, b, c = scene.triangles[triangle]
            matrix = np.column_stack([b - a, c - a, -d])
            if abs(np.linalg.det(matrix)) > 1e-12:
                first, second, s = np.linalg.solve(matrix, -a)
                if min(first, second, 1 - first - second) >= 0:
                    leaves.append((s, triangle))
        s, triangle = max(leaves)
        assert s > 1 - height
        far_side = changed(truth, mask, triangle=triangle, position=s * d)
        np.testing.assert_array_equal(case.compared(far_side).maps.surface, mask)


def test_ties_are_not_judged(case: Case) -> None:
    where = some_pixel(case.truth.covered)
    for kind in Certainty:
        truth = changed(case.truth, where, certainty=kind)
        comparison = case.compared(changed(truth, where, **EMPTY), truth)
        tie = kind is Certainty.TIE
        assert comparison.judged == comparison.pixels - tie
        np.testing.assert_array_equal(comparison.maps.judged, ~where | (not tie))
        assert comparison.surface_wrong == comparison.triangle.wrong == (0 if tie else 1)
        assert comparison.certainty["tie"] == tie


def test_points_in_the_plate_are_counted_and_not_displaced(case: Case) -> None:
    where = some_pixel(case.truth.covered)
    comparison = case.compared(changed(case.truth, where, position=[3.0, 2.0, 0.0]))
    assert comparison.at_plate == 1
    assert np.isnan(comparison.maps.displacement[where]).all()
    # A pixel shows a surface at z = 0 only if the surface passes through the aperture itself.
    assert comparison.surface_wrong == 1


def test_a_surface_through_the_aperture_is_right_when_both_show_it() -> None:
    tilted = np.array([[[-4.0, -4.0, -3.0], [4.0, -4.0, -3.0], [0.0, 8.0, 6.0]]])
    frustum = Frustum(resolution=(8, 8), reach=(9.0, 9.0), fov=(1.0, 1.0))
    reference = Reference(soup(tilted, frustum))
    truth = reference.trace(at(0.0, 0.0))
    comparison = compare_images(truth, truth, reference)
    assert comparison.at_plate == comparison.covered == 64
    assert comparison.surface_wrong == 0 and comparison.summary()["displacement_px"] is None


def test_a_spread_has_the_order_statistics_and_no_overflow() -> None:
    assert Spread.from_values(np.zeros(0)) is None
    values = np.arange(101.0)
    spread = Spread.from_values(values)
    assert (spread.p50, spread.p95, spread.p99, spread.max) == pytest.approx((50, 95, 99, 100))
    assert spread.rms == pytest.approx(math.sqrt(np.mean(values**2)))
    assert Spread.from_values(np.full(2, 1e300)).rms == pytest.approx(1e300)


def test_images_of_different_requests_are_not_compared(case: Case) -> None:
    truth, drawn, scene = case.truth, case.drawn, case.reference.scene
    smaller = Reference(view("asymmetric", (48, 36))).trace(scene.plate.middle)
    other = replace(drawn, camera=replace(drawn.camera, scene_hash="0" * 64))
    moved = case.reference.trace(scene.plate.aperture(0, 3))
    for expected, image, message in (
        (truth, smaller, r"64 x 48.*48 x 36"),
        (truth, moved, r"aperture.*0,3"),
        (truth, other, "different scenes"),
        (drawn, truth, "traced image first"),
    ):
        with pytest.raises(InputError, match=message):
            case.compared(image, expected)


def test_a_channel_that_an_image_lacks_is_unknown_and_neither_right_nor_wrong(case: Case) -> None:
    truth, drawn = case.truth, case.drawn
    whole = case.compared(drawn).summary()
    assert case.compared(without(drawn, "object")).summary() == whole, "triangles name objects"
    summary = case.compared(without(drawn, "triangle")).summary()
    unknown = {"triangle": None, "height": None}
    assert summary == whole | unknown | {"radiance": summary["radiance"]}
    summary = case.compared(without(drawn, "position")).summary()
    assert summary["displacement_px"] is None and summary["triangle"] is not None
    named = replace(without(truth, "triangle", "position"), certainty=None)
    assert case.compared(named).surface_wrong == 0, "objects alone"
    assert case.compared(without(named, "object")).surface_wrong == truth.covered.sum()


NEARS = (1e-1, 1e-3, 1e-6, 1e-8)  #: near offsets as fractions of the reach
MOST_PX = 1e-3
"""Limit of the 99th percentile of measured minus predicted displacement on meshes, px."""

MESHES = [
    ("car", (40, 30)),
    ("car-recentered", (0, 0)),
    ("asymmetric", (25, 41)),
    ("asymmetric-recentered", (80, 60)),
    ("beetle", (40, 30)),
    ("bunny-transfer", (299, 99)),
    ("teapot-recentered", (119, 79)),
    ("truck", (50, 30)),
]
OTHERS = [("crossing", (31, 17)), ("large-triangles", (40, 30)), ("sheets", (40, 30))]


def closed_form(image: HogelImage, near: float) -> np.ndarray:
    """Return true minus drawn (H, W, 2): columns +(W/2) u n/|z|, rows -(H/2) v n/|z|."""
    height, width = image.triangle.shape
    u = (2 * np.arange(width) + 1) / width - 1
    v = 1 - (2 * np.arange(height) + 1) / height
    per_film_unit = near / np.abs(image.height.astype(np.float64))
    return np.stack(
        (width / 2 * u * per_film_unit, -height / 2 * v[:, None] * per_film_unit), axis=-1
    )


@pytest.mark.parametrize(("name", "index"), thinned(MESHES + OTHERS, 4))
def test_displacement_measured_pixel_by_pixel_is_the_closed_form(
    name: str, index: tuple[int, int]
) -> None:
    """The tolerance is the rounding of stored points: 16 times 2^-24 of the largest coordinate."""
    assert POSITION_ROUNDINGS <= 16
    scene = view(name, (256, 192))
    aperture, reference = scene.plate.aperture(*index), Reference(scene)
    truth = reference.trace(aperture)
    rounding = POSITION_ROUNDINGS * 2.0**-24 * np.abs(scene.triangles).max(axis=(1, 2))
    half_extent, seen = np.array(truth.camera.half_extent), 0
    with Rasterizer(scene) as raster:
        for near in np.array(NEARS) * scene.frustum.longest_reach:
            drawn = raster.render(aperture, reversed_d32f(float(near)), normals=False, color=False)
            measured = compare_images(truth, drawn, reference).maps.displacement
            shown = (drawn.triangle != NOTHING) & (drawn.height != 0)
            assert (np.isfinite(measured) == shown[..., None]).all()
            # The points are computed on the drawn triangles: check that they were drawn at their
            # pixels.
            assert not misplaced(scene, drawn, raster.model).any()
            with np.errstate(divide="ignore", invalid="ignore"):
                off = np.abs(measured - closed_form(drawn, float(near)))[shown]
            z = np.abs(drawn.height[shown]).astype(np.float64)
            size = (rounding[drawn.triangle[shown]] / z)[:, None]
            assert (off <= size * np.array([256, 192]) / (2 * half_extent)).all()
            seen += len(off)
            if len(off) and (name, index) in MESHES:
                assert np.percentile(off.max(axis=1), 99) <= MOST_PX
    assert seen > 2000


WIDTH, HEIGHT = 64, 48
DEPTH = 40.0  #: distance of a wall from the plate, on either side


@cache
def wall(side: int) -> Scene:
    """Return a wall parallel to the plate, larger than every film; side -1 is behind the plate."""
    angles = (math.radians(50), math.radians(40))
    frustum = Frustum(resolution=(WIDTH, HEIGHT), fov=angles, reach=(100.0, 100.0))
    scene = lit(card((3.0, -7.0, side * DEPTH), (200.0, 200.0)), frustum=frustum)
    return replace(scene, plate=Plate(size=(10.0, 10.0), hogels=(5, 5)))


def compared_wall(side: int, settings: DoubleFrustum) -> Comparison:
    scene = wall(side)
    aperture, reference = scene.plate.aperture(3, 1), Reference(scene)
    with Rasterizer(scene) as rasterizer:
        return compare_images(
            reference.trace(aperture), rasterizer.render(aperture, settings), reference
        )


def beyond(factor: float) -> int:
    """Return the number of pixels with film coordinates beyond a bound."""
    u = np.abs((2 * np.arange(WIDTH) + 1) / WIDTH - 1)
    v = np.abs(1 - (2 * np.arange(HEIGHT) + 1) / HEIGHT)
    return int((np.maximum(u, v[:, None]) > factor).sum())


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("near", [1.0, 2.0, 20.0])
def test_a_displaced_wall_shows_points_from_outside_the_film(side: int, near: float) -> None:
    """u_r shows u_r (|z| + n)/|z|, which lies outside the film for |u_r| > |z|/(|z| + n)."""
    comparison = compared_wall(side, DoubleFrustum(near=near))
    assert (
        comparison.surface.outside == comparison.surface.wrong == beyond(DEPTH / (DEPTH + near)) > 0
    )
    # Every pixel shows the correct wall, with nothing in front of it.
    assert comparison.triangle is not None
    np.testing.assert_array_equal(comparison.maps.outside, comparison.maps.surface)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_picture_displaced_by_less_than_half_a_pixel_shows_nothing_from_outside(
    side: int,
) -> None:
    """The outermost center lies at 1 - 1/W: it stays inside the film if n/|z| < 1/(W - 1)."""
    largest = DEPTH / (WIDTH - 1)
    inside, outside = (
        compared_wall(side, DoubleFrustum(near=largest * factor)) for factor in (0.99, 1.01)
    )
    assert inside.surface.wrong == inside.surface.outside == 0
    assert outside.surface.outside == 2 * HEIGHT
