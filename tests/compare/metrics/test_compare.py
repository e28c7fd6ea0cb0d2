"""Comparison of images: wrong and right pixels, displacement, and points outside the film."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.support.lit import card, lit
from tests.support.long_tail import thinned
from tests.support.misplaced import misplaced
from tests.support.views import at, reversed_d32f, soup, view
from tests.support.worlds import World
from xfrustum.compare.comparison import Comparison, compare_images
from xfrustum.compare.error_maps import Spread
from xfrustum.compare.rounding.triangles import POSITION_ROUNDINGS
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

Compared = Callable[..., Comparison]


@pytest.fixture
def truth(centered: World) -> HogelImage:
    return centered.truth()


@pytest.fixture
def drawn(centered: World) -> HogelImage:
    """Return a raster image whose near offset of 1.5 moves points by a few pixels."""
    return centered.raster()


@pytest.fixture
def compared(centered: World) -> Compared:
    """Return a function that compares an image with the truth, or with another image."""
    return lambda image, truth=None: compare_images(
        truth or centered.truth(), image, centered.reference
    )


def changed(image: HogelImage, where: Mask | None = None, **values: Any) -> HogelImage:
    """Return the image with other values in some pixels, by default in all."""
    arrays: dict[str, Any] = {name: getattr(image, name).copy() for name in values}
    for name, value in values.items():
        arrays[name][... if where is None else where] = value
    return replace(image, **arrays)


def some_pixel(mask: Mask) -> Mask:
    rows, columns = np.nonzero(mask)
    only = np.zeros_like(mask)
    only[rows[len(rows) // 2], columns[len(rows) // 2]] = True
    return only


EMPTY = {"triangle": NOTHING, "object": NOTHING, "position": np.nan}


def test_the_summary_is_the_contract_in_json(
    compared: Compared, truth: HogelImage, drawn: HogelImage
) -> None:
    summary = compared(drawn).summary()
    json.dumps(summary, allow_nan=False)
    assert summary["pixels"] == 64 * 48 == summary["judged"]
    assert summary["covered"] == truth.covered.sum()
    for name in ("surface", "triangle"):
        assert summary[name]["fraction"] == summary[name]["wrong"] / summary["judged"]
    spread = summary["displacement_px"]
    assert 0 < spread["p50"] < spread["p95"] < spread["p99"] < spread["max"]
    without_scene = compare_images(truth, drawn, None)
    assert without_scene.maps.surface is None and without_scene.maps.outside is None
    assert without_scene.summary() == summary | {"surface": None}
    itself = compared(truth)
    assert itself.surface_wrong == itself.triangle.wrong == itself.height.max == 0
    assert itself.displacement_px.max < 1e-9
    assert itself.certainty == {"proven": 64 * 48, "exact": 0, "tie": 0, "unexamined": 0}


def test_heights_are_raster_minus_truth_where_both_show_one_triangle(
    compared: Compared, truth: HogelImage, drawn: HogelImage
) -> None:
    comparison, same = compared(drawn), truth.covered & (truth.triangle == drawn.triangle)
    error = (drawn.height - truth.height)[same]
    np.testing.assert_array_equal(comparison.maps.height[same], error)
    assert same.any() and np.isnan(comparison.maps.height[~same]).all()
    assert comparison.height.rms == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-12)
    assert comparison.height.max == np.abs(error).max()


def test_a_missing_an_unexpected_and_another_objects_surface_are_wrong(
    compared: Compared, truth: HogelImage
) -> None:
    unexpected = {"triangle": 0, "object": 0, "position": truth.position[truth.covered][0]}
    for where, values in (
        (some_pixel(truth.covered), EMPTY),
        (some_pixel(~truth.covered), unexpected),
        (some_pixel(truth.object == 2), {"object": 3}),
    ):
        wrong = compared(changed(truth, where, **values)).maps.surface
        np.testing.assert_array_equal(wrong, where)


def test_another_triangle_of_an_object_displaces_the_picture_and_is_no_wrong_surface(
    compared: Compared, truth: HogelImage
) -> None:
    inside, other = truth.object == 2, truth.triangle != np.roll(truth.triangle, -1, 1)
    neighbor = some_pixel(inside & np.roll(inside, -1, 1) & other)
    row, column = np.argwhere(neighbor)[0]
    shown = {name: getattr(truth, name)[row, column + 1] for name in ("triangle", "position")}
    comparison = compared(changed(truth, neighbor, **shown))
    assert comparison.surface_wrong == 0
    np.testing.assert_array_equal(comparison.maps.triangle, neighbor)
    np.testing.assert_allclose(comparison.maps.displacement[row, column], [1, 0], atol=1e-9)


SMALL = Frustum(resolution=(8, 8), reach=(90.0, 90.0), fov=(1.0, 1.0))


@pytest.mark.parametrize(("first", "hidden"), [(-20.0, -30.0), (30.0, 20.0)])
def test_a_hidden_point_is_wrong_on_either_side_of_the_plate(first: float, hidden: float) -> None:
    """A sheet behind another sheet of the object is wrong, though object and pixel agree."""
    sheet = np.array([(-200.0, -200.0), (200.0, -200.0), (0.0, 300.0)])
    sheets = [np.column_stack((sheet, np.full(3, z))) for z in (first, hidden)]
    reference = Reference(soup(np.stack(sheets), SMALL))
    truth = reference.trace(at(0.0, 0.0))
    assert (truth.triangle == 0).all()
    where = some_pixel(truth.covered)
    point = truth.position[where] * hidden / first
    image = changed(truth, where, triangle=1, position=point)
    np.testing.assert_array_equal(compare_images(truth, image, reference).maps.surface, where)


def test_ties_are_not_judged(compared: Compared, truth: HogelImage) -> None:
    where = some_pixel(truth.covered)
    for kind in Certainty:
        marked = changed(truth, where, certainty=kind)
        comparison = compared(changed(marked, where, **EMPTY), marked)
        tie = kind is Certainty.TIE
        assert comparison.judged == comparison.pixels - tie
        np.testing.assert_array_equal(comparison.maps.judged, ~where | (not tie))
        assert comparison.surface_wrong == comparison.triangle.wrong == (0 if tie else 1)
        assert comparison.certainty["tie"] == tie


def test_points_in_the_plate_are_counted_and_not_displaced(
    compared: Compared, truth: HogelImage
) -> None:
    where = some_pixel(truth.covered)
    comparison = compared(changed(truth, where, position=[3.0, 2.0, 0.0]))
    assert comparison.at_plate == 1
    assert np.isnan(comparison.maps.displacement[where]).all()
    # A pixel shows a surface at z = 0 only if the surface passes through the aperture itself.
    assert comparison.surface_wrong == 1


def test_a_surface_through_the_aperture_is_right_when_both_show_it() -> None:
    tilted = np.array([[[-4.0, -4.0, -3.0], [4.0, -4.0, -3.0], [0.0, 8.0, 6.0]]])
    reference = Reference(soup(tilted, SMALL))
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


def test_images_of_different_requests_are_not_compared(
    compared: Compared, centered: World, truth: HogelImage, drawn: HogelImage
) -> None:
    smaller = Reference(view("asymmetric", (48, 36))).trace(centered.scene.plate.middle)
    other = replace(drawn, camera=replace(drawn.camera, scene_hash="0" * 64))
    for expected, image, message in (
        (truth, smaller, r"64 x 48.*48 x 36"),
        (truth, centered.truth((0, 3)), r"aperture.*0,3"),
        (truth, other, "different scenes"),
        (drawn, truth, "traced image first"),
    ):
        with pytest.raises(InputError, match=message):
            compared(image, expected)


def test_a_channel_that_an_image_lacks_is_unknown_and_neither_right_nor_wrong(
    compared: Compared, truth: HogelImage, drawn: HogelImage
) -> None:
    whole = compared(drawn).summary()
    assert compared(changed(drawn, object=NOTHING)).summary() == whole, "triangles name objects"
    summary = compared(changed(drawn, triangle=NOTHING)).summary()
    unknown = {"triangle": None, "height": None}
    assert summary == whole | unknown | {"radiance": summary["radiance"]}
    summary = compared(changed(drawn, position=np.nan)).summary()
    assert summary["displacement_px"] is None and summary["triangle"] is not None
    named = replace(changed(truth, triangle=NOTHING, position=np.nan), certainty=None)
    assert compared(named).surface_wrong == 0, "objects alone"
    assert compared(changed(named, object=NOTHING)).surface_wrong == truth.covered.sum()


NEARS = (1e-1, 1e-3, 1e-6, 1e-8)  #: near offsets as fractions of the reach
MOST_PX = 1e-3
"""Limit of the 99th percentile of measured minus predicted displacement on meshes, px."""

MESHES = [
    ("car", (40, 30)),
    ("asymmetric-recentered", (80, 60)),
    ("beetle", (40, 30)),
    ("bunny-transfer", (299, 99)),
    ("teapot-recentered", (119, 79)),
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


@pytest.mark.parametrize(("name", "index"), thinned(MESHES + OTHERS, 4, 1))
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

NOT_OUTSIDE = DEPTH / (WIDTH - 1)
"""Largest near offset that shows nothing outside the film: outermost centers are at 1 - 1/W."""


def wall(side: int) -> Scene:
    """Return a wall parallel to the plate, larger than every film; side -1 is behind the plate."""
    angles = (math.radians(50), math.radians(40))
    frustum = Frustum(resolution=(WIDTH, HEIGHT), fov=angles, reach=(100.0, 100.0))
    scene = lit(card((3.0, -7.0, side * DEPTH), (200.0, 200.0)), frustum=frustum)
    return replace(scene, plate=Plate(size=(10.0, 10.0), hogels=(5, 5)))


def beyond(factor: float) -> int:
    """Return the number of pixels with film coordinates beyond a bound."""
    u = np.abs((2 * np.arange(WIDTH) + 1) / WIDTH - 1)
    v = np.abs(1 - (2 * np.arange(HEIGHT) + 1) / HEIGHT)
    return int((np.maximum(u, v[:, None]) > factor).sum())


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("near", [0.99 * NOT_OUTSIDE, 1.01 * NOT_OUTSIDE, 2.0, 20.0])
def test_a_displaced_wall_shows_points_from_outside_the_film(side: int, near: float) -> None:
    """u_r shows u_r (|z| + n)/|z|, which lies outside the film for |u_r| > |z|/(|z| + n)."""
    scene = wall(side)
    aperture, reference = scene.plate.aperture(3, 1), Reference(scene)
    with Rasterizer(scene) as rasterizer:
        drawn = rasterizer.render(aperture, DoubleFrustum(near=near))
    comparison = compare_images(reference.trace(aperture), drawn, reference)
    expected = beyond(DEPTH / (DEPTH + near))
    assert comparison.surface.outside == comparison.surface.wrong == expected
    assert (expected > 0) == (near > NOT_OUTSIDE)
    np.testing.assert_array_equal(comparison.maps.outside, comparison.maps.surface)
