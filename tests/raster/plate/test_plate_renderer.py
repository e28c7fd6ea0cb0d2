"""Plates of hogels are bit-identical to single hogels, with culling, batches and shared work."""

from collections.abc import Sequence
from dataclasses import replace
from math import radians

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.images import assert_same
from tests.support.light import dressed_scene
from tests.support.long_tail import examples, thinned
from tests.support.views import reversed_d32f, soup, view
from xfrustum.raster import Rasterizer
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.scenes import (
    Aperture,
    Camera,
    Cull,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Frustum,
    InputError,
    Scene,
)
from xfrustum.scenes.appearance import Sampling
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect
from xfrustum.scenes.model.images import (
    DRAWN_CHANNELS,
    ColorType,
    FilmPart,
    PlateContent,
)
from xfrustum.scenes.plate import Fit, Offset, Pivot, Screen

EVERYTHING = PlateContent(color=ColorType.FLOAT32, channels=DRAWN_CHANNELS)
SLABS = DoubleFrustum(near=0.3, slabs=(20.0, 55.0))
CULLED = DoubleFrustum(near=0.3, slabs=(20.0,), cull=Cull.BACK)


def some_apertures(scene: Scene) -> list[Aperture]:
    """Return two neighbors, so that they share a submission, and a corner."""
    column, row = scene.plate.middle.index
    return [scene.plate.middle, scene.plate.aperture(column + 1, row), scene.plate.corners[0]]


def checked_one_by_one(
    scene: Scene,
    chosen: DoubleFrustum,
    apertures: Sequence[Aperture],
    effects: frozenset[Effect] | None = None,
) -> float:
    """Assert that every image equals the rasterizer's; return the share of covered pixels."""
    covered = []
    content = replace(EVERYTHING, effects=effects)
    with PlateRenderer(scene, chosen, content) as plate, Rasterizer(scene, effects) as rasterizer:
        hogels = list(plate.hogels(iter(apertures)))
        assert [hogel.aperture for hogel in hogels] == list(apertures)
        for hogel in hogels:
            image = rasterizer.render(hogel.aperture, chosen)
            for channel in DRAWN_CHANNELS:
                np.testing.assert_array_equal(hogel.image(channel), getattr(image, channel))
            covered.append(image.covered.mean())
    return float(np.mean(covered))


def depths(depth: DepthFormat, mapping: DepthMapping) -> DoubleFrustum:
    """Return settings whose near, 1e-4 of the reach, leaves ties, broken by the drawing order."""
    return DoubleFrustum(near=0.015, depth=depth, mapping=mapping)


@pytest.mark.parametrize(
    ("name", "chosen"),
    thinned(
        [
            ("asymmetric-recentered", depths(DepthFormat.D16, DepthMapping.STANDARD)),
            ("asymmetric-recentered", SLABS),
            ("asymmetric-recentered", depths(DepthFormat.D16, DepthMapping.LOGARITHMIC)),
            (
                "asymmetric",
                DoubleFrustum(near=0.3, slabs=(30.0,), fit=Fit.ANGLE, camera=Camera.C_STAR),
            ),
            ("asymmetric-recentered", depths(DepthFormat.D24, DepthMapping.GL)),
            ("asymmetric-recentered", DoubleFrustum(near=2.0, pivot=Pivot.CAMERA, fit=60.0)),
            ("asymmetric-recentered", depths(DepthFormat.D32F, DepthMapping.LINEAR)),
            ("asymmetric", DoubleFrustum(near=2.0, offset=Offset.NONE)),
            ("asymmetric", DoubleFrustum(near=1e-6, camera=Camera.C)),
            ("large-triangles", CULLED),
            ("car-studio", SLABS),
            ("empty", SLABS),
            ("mirror-sphere", SLABS),
        ],
        2,
        1,
    ),
)
def test_every_scene_and_setting_is_drawn_as_a_single_hogel_is(
    name: str, chosen: DoubleFrustum
) -> None:
    scene = replace(view(name, (48, 36)), sampling=Sampling())
    covered = checked_one_by_one(scene, chosen, some_apertures(scene))
    assert (covered > 0.02) == (name != "empty")


@pytest.mark.parametrize("chosen", [CULLED, DoubleFrustum(near=0.015)])
def test_every_kind_of_light_at_once_is_drawn_alike(chosen: DoubleFrustum) -> None:
    """The scene has smooth, flat, colored and textured parts, three lights and mirrors."""
    scene = dressed_scene("crossing", (64, 48))
    assert checked_one_by_one(scene, chosen, some_apertures(scene), ALL_EFFECTS) > 0.05


def test_surfaces_of_a_mean_are_those_that_the_middle_of_the_aperture_sees() -> None:
    scene = replace(view("asymmetric-recentered", (24, 18)), sampling=Sampling(aperture=3))
    assert checked_one_by_one(scene, SLABS, some_apertures(scene)) > 0.02


def test_undrawable_requests_are_refused() -> None:
    for request, near, record in (
        (view("asymmetric"), 1000.0, "near"),
        (view("asymmetric", (1 << 20, 4)), 0.1, r"smaller frustum\.resolution"),
    ):
        with pytest.raises(InputError, match=record):
            PlateRenderer(request, DoubleFrustum(near=near))
    scene = replace(view("asymmetric", (8, 6)), sampling=Sampling(supersample=2, aperture=4))
    with pytest.raises(InputError, match="--supersample 1"):
        PlateRenderer(scene, DoubleFrustum(near=0.1))


def test_without_layers_hogels_are_drawn_one_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """No version of OpenGL requires support for vertex shaders that choose a layer."""
    for module in ("renderer", "picture"):
        name = f"xfrustum.raster.plate.{module}.lets_vertices_choose_layers"
        monkeypatch.setattr(name, lambda _: False)
    scene = view("asymmetric-recentered", (48, 36))
    with PlateRenderer(scene, DoubleFrustum(near=0.1), EVERYTHING) as plate:
        assert plate.batching.hogels == 1
    assert checked_one_by_one(scene, DoubleFrustum(near=0.1), some_apertures(scene)) > 0.1


def test_other_renderers_may_draw_while_a_stream_is_open() -> None:
    scene = view("asymmetric", (24, 18))
    row = [scene.plate.aperture(column, 20) for column in range(24)]
    with (
        PlateRenderer(scene, DoubleFrustum(near=0.1), EVERYTHING) as plate,
        Rasterizer(view("crossing", (24, 18))) as other,
    ):
        next(plate.hogels(row[::-1]))  # a stream may be abandoned, and another begun
        alone = list(plate.hogels(row))
        for hogel, expected in zip(plate.hogels(row), alone, strict=True):
            other.render(hogel.aperture, reversed_d32f(0.5))
            assert_same(hogel, expected, "aperture", "triangle", "color")


def test_compact_colors_are_the_full_ones_rounded() -> None:
    scene = view("asymmetric", (48, 36))
    result = {}
    for color in ColorType:
        with PlateRenderer(scene, DoubleFrustum(near=0.1), PlateContent(color=color)) as plate:
            (hogel,) = plate.hogels([scene.plate.middle])
            assert hogel.triangle is None and hogel.color.dtype == color.dtype
            result[color] = hogel.color
    full = result[ColorType.FLOAT32]
    assert full.shape == (36, 48, 3) and 0 < full.max() <= 1
    # A device may round either way, by one unit in the last place of the type.
    assert np.abs(result[ColorType.FLOAT16].astype(np.float64) - full).max() <= 2.0**-11
    assert np.abs(result[ColorType.UINT8] - 255 * full.astype(np.float64)).max() <= 1.0


CENTERED = Frustum(resolution=(24, 18), reach=(30.0, 20.0), fov=(radians(70), radians(50)))
RECENTERED = Frustum(
    resolution=(24, 18),
    reach=(30.0, 20.0),
    screen=Screen(height=-12.0, center=(3.0, -2.0), size=(18.0, 14.0)),
)


def scattered(seed: int, count: int, size: float) -> Floats:
    """Return triangles (F, 3, 3) of one size, with their middles around the plate."""
    random = np.random.default_rng(seed)
    middle = random.uniform(-1, 1, (count, 1, 3)) * (12, 12, 25)
    return np.asarray(middle + random.normal(scale=size, size=(count, 3, 3)))


@examples(20)
@given(
    st.integers(0, 1 << 20),
    st.sampled_from([0.3, 3.0, 40.0, 1e4, 1e7]),
    st.sampled_from([CENTERED, RECENTERED]),
    st.sampled_from([0.5, 1e-3, 1e-7]),
)
def test_culling_loses_no_pixel_of_triangles_of_any_size(
    seed: int, size: float, frustum: Frustum, near: float
) -> None:
    """Huge triangles, across the plate and behind the camera, are tested too."""
    scene = soup(scattered(seed, 60, size), frustum)
    apertures = [
        scene.plate.aperture(column, row) for column, row in ((0, 0), (7, 8), (8, 8), (15, 3))
    ]
    # Small triangles may cover no pixel of an image; empty images must agree too.
    checked_one_by_one(scene, reversed_d32f(near), apertures)


def test_a_part_has_the_pixels_of_the_whole_film_bit_for_bit() -> None:
    width, height = 96, 80
    scene = dressed_scene("asymmetric-recentered", (width, height))
    random = np.random.default_rng(7)
    parts = {}
    for column, row in ((40, 30), (3, 58), (77, 12), (41, 30), (42, 31)):
        left, right = np.sort(random.integers(0, width, 2)).tolist()
        top, bottom = np.sort(random.integers(0, height, 2)).tolist()
        parts[column, row] = FilmPart(columns=(left, right), rows=(top, bottom))
    # A single pixel, in a corner of the film
    parts[60, 44] = FilmPart(columns=(95, 95), rows=(0, 0))
    apertures = [scene.plate.aperture(*index) for index in parts]
    with PlateRenderer(scene, DoubleFrustum(near=1.0), EVERYTHING) as renderer:
        some, whole = list(renderer.hogels(apertures, parts)), list(renderer.hogels(apertures))
    shown = 0
    for item, other in zip(some, whole, strict=True):
        part = parts[item.aperture.index]
        here = tuple(slice(first, last + 1) for first, last in (part.rows, part.columns))
        np.testing.assert_array_equal(item.triangle[here], other.triangle[here])
        np.testing.assert_array_equal(item.color[here], other.color[here])
        shown += int((item.triangle[here] >= 0).sum())
    assert shown > 100
