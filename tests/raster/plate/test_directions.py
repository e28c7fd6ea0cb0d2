"""Images by direction with OpenGL are true except for snapping; wrong directions are detected."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from xfrustum.raster.plate.directions import DirectionRenderer
from xfrustum.reference import Reference
from xfrustum.scenes import NOTHING, InputError, Plate, Scene, Screen, open_scene
from xfrustum.scenes.appearance import Sampling
from xfrustum.scenes.arrays import Numbers
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect
from xfrustum.scenes.model.images import DRAWN_CHANNELS, Channel, ColorType, PlateContent
from xfrustum.scenes.plate import DepthFormat, PlateTile

HOGELS, PIXELS = (40, 30), (12, 10)
BEHIND = "asymmetric before a screen"


def seen(name: str) -> tuple[Scene, PlateTile]:
    scene = open_scene("asymmetric-recentered" if name == BEHIND else name)
    if name == BEHIND:
        screen = Screen(height=-160.0, center=(9.0, -6.0), size=(200.0, 170.0))
        scene = replace(scene, frustum=replace(scene.frustum, screen=screen))
    scene = replace(
        scene,
        plate=Plate(size=scene.plate.size, hogels=HOGELS),
        frustum=replace(scene.frustum, resolution=PIXELS),
    )
    return scene, PlateTile(plate=scene.plate, columns=range(2, 38), rows=range(3, 30))


def drawn_and_true(
    scene: Scene, tile: PlateTile, pixels: list[tuple[int, int]], depth: DepthFormat
) -> Iterator[tuple[Numbers, Numbers]]:
    truths = Reference(scene).by_directions(tile, pixels, normals=False, colored=False)
    with DirectionRenderer(scene, tile, PlateContent(ids=True), depth) as renderer:
        for image, truth in zip(renderer.images(pixels), truths, strict=True):
            assert image.pixel == truth.pixel and image.triangle is not None
            yield image.triangle, truth.triangle


@pytest.mark.parametrize(
    ("name", "depth"),
    [
        ("car", DepthFormat.D24),
        ("asymmetric", DepthFormat.D16),
        ("asymmetric-recentered", DepthFormat.D32F),
        (BEHIND, DepthFormat.D24),
    ],
)
def test_all_but_few_pixels_show_the_true_triangle(name: str, depth: DepthFormat) -> None:
    scene, tile = seen(name)
    pixels = [(0, 0), (11, 2), (4, 9), (7, 5)]
    shown = wrong = turned = 0
    for drawn, true in drawn_and_true(scene, tile, pixels, depth):
        assert drawn.shape == true.shape
        shown += int(np.count_nonzero(true >= 0))
        wrong += int(np.count_nonzero(drawn != true))
        turned += int(np.count_nonzero(drawn[::-1] != true))
    # Snapping moves edges by 1/256 of a cell; small triangles of the car are a cell wide.
    assert shown > 300 and wrong < 0.03 * shown < turned


def test_negated_directions_show_other_triangles() -> None:
    scene, tile = seen("asymmetric")
    (drawn, _), (_, true) = drawn_and_true(scene, tile, [(2, 7), (9, 2)], DepthFormat.D32F)
    assert np.count_nonzero(drawn != true) > 0.1 * np.count_nonzero(true >= 0)


@pytest.mark.parametrize(
    ("name", "steepness"),
    [
        ("asymmetric", 1e-5),
        ("asymmetric-recentered", 1e-5),
        (BEHIND, 1e-5),
        # Reflections at smooth normals, interpolated in float32, amplify errors of the normal some
        # hundreds of times.
        ("mirror-sphere", 1e-3),
    ],
)
def test_every_channel_is_true_where_the_triangle_is(name: str, steepness: float) -> None:
    scene, tile = seen(name)
    pixels = [(5, 4), (1, 8)]
    content = PlateContent(color=ColorType.FLOAT32, channels=DRAWN_CHANNELS)
    truths = Reference(scene).by_directions(tile, pixels)
    with DirectionRenderer(scene, tile, content) as renderer:
        for image, truth in zip(renderer.images(pixels), truths, strict=True):
            assert image.height is not None and image.normal is not None
            same = (image.triangle == truth.triangle) & (truth.triangle >= 0)
            assert same.sum() > 100 and truth.color is not None and truth.normal is not None
            # Both shade the exact point of a pixel, in floats with relative errors of about 1e-6.
            np.testing.assert_allclose(image.color[same], truth.color[same], rtol=0, atol=steepness)
            # The point is computed in double precision and rounded once.
            np.testing.assert_allclose(
                image.height[same], truth.position[same][:, 2], rtol=2.0**-23, atol=1e-9
            )
            np.testing.assert_allclose(image.normal[same], truth.normal[same], rtol=0, atol=1e-7)
            assert np.isnan(image.height[image.triangle == NOTHING]).all()


def test_mirrors_reflect_by_an_effect_of_their_own() -> None:
    scene, tile = seen("mirror-sphere")
    colors = []
    for effects in (ALL_EFFECTS, ALL_EFFECTS - {Effect.REFLECTION}):
        content = PlateContent(color=ColorType.FLOAT32, effects=effects)
        with DirectionRenderer(scene, tile, content) as renderer:
            colors += [image.color for image in renderer.images([(5, 4)])]
    assert np.abs(colors[0] - colors[1]).max() > 0.1


@pytest.mark.parametrize("height", [None, -50.0, 50.0])
def test_nothing_is_drawn_of_an_empty_scene(height: float | None) -> None:
    scene, tile = seen("empty")
    if height is not None:
        screen = Screen(height=height, center=(0.0, 0.0), size=(50.0, 50.0))
        scene = replace(scene, frustum=replace(scene.frustum, fov=None, screen=screen))
    with DirectionRenderer(scene, tile, PlateContent(channels=DRAWN_CHANNELS)) as renderer:
        (image,) = renderer.images([(3, 4)])
    assert image.triangle is not None and (image.triangle == NOTHING).all()
    assert not image.color.any() and np.isnan(image.height).all()


def test_means_one_side_of_the_plate_and_a_screen_among_surfaces_are_refused() -> None:
    scene, tile = seen("asymmetric")
    sampled = replace(scene, sampling=Sampling(aperture=4))
    for request, effects, message in (
        (scene, ALL_EFFECTS - {Effect.C_STAR}, "c-star"),
        (sampled, None, "several samples"),
        (seen("car-transfer")[0], None, "reach the screen"),
    ):
        with pytest.raises(InputError, match=message):
            DirectionRenderer(request, tile, PlateContent(effects=effects))
    with DirectionRenderer(sampled, tile, PlateContent(channels=(Channel.TRIANGLE,))):
        pass
