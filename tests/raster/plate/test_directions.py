"""Images by direction on OpenGL: true but for snapping in the plate, and controls that fail."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from xfrustum.raster.plate.directions import DirectionRenderer
from xfrustum.reference import Reference
from xfrustum.scenes import InputError, Plate, Scene, open_scene
from xfrustum.scenes.arrays import Numbers
from xfrustum.scenes.model.plate_content import ColorType, PlateContent
from xfrustum.scenes.plate.double_frustum import DepthFormat
from xfrustum.scenes.plate.plate import PlateTile

HOGELS, PIXELS = (40, 30), (12, 10)


def seen(name: str) -> tuple[Scene, PlateTile]:
    scene = open_scene(name)
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


@pytest.mark.parametrize("depth", [DepthFormat.D24, DepthFormat.D32F])
@pytest.mark.parametrize("name", ["car", "asymmetric", "asymmetric-recentered"])
def test_all_but_few_pixels_show_the_true_triangle(name: str, depth: DepthFormat) -> None:
    scene, tile = seen(name)
    pixels = [(0, 0), (11, 2), (4, 9), (7, 5)]
    shown = wrong = turned = 0
    for drawn, true in drawn_and_true(scene, tile, pixels, depth):
        assert drawn.shape == true.shape
        shown += np.count_nonzero(true >= 0)
        wrong += np.count_nonzero(drawn != true)
        turned += np.count_nonzero(drawn[::-1] != true)
    # Snapping moves edges by 1/256 of a cell, and small triangles of the car are a cell wide.
    assert shown > 300 and wrong < 0.03 * shown < turned


def test_negated_directions_show_other_triangles() -> None:
    scene, tile = seen("asymmetric")
    (column, row), (width, height) = (2, 7), PIXELS
    opposite = (width - 1 - column, height - 1 - row)
    (drawn, _), (_, true) = drawn_and_true(scene, tile, [(column, row), opposite], DepthFormat.D32F)
    assert np.count_nonzero(drawn != true) > 0.1 * np.count_nonzero(true >= 0)


@pytest.mark.parametrize("name", ["car", "asymmetric", "asymmetric-recentered"])
def test_colors_are_the_true_colors_where_the_triangle_is(name: str) -> None:
    scene, tile = seen(name)
    pixels = [(5, 4), (1, 8)]
    content = PlateContent(color=ColorType.FLOAT32, ids=True)
    truths = Reference(scene).by_directions(tile, pixels, normals=False)
    with DirectionRenderer(scene, tile, content) as renderer:
        for image, truth in zip(renderer.images(pixels), truths, strict=True):
            same = (image.triangle == truth.triangle) & (truth.triangle >= 0)
            assert same.sum() > 100 and truth.color is not None
            # Both shade the exact point of a pixel, in floats whose roundings are some 1e-6.
            np.testing.assert_allclose(image.color[same], truth.color[same], rtol=0, atol=1e-5)


def test_a_screen_among_the_surfaces_is_refused() -> None:
    scene, tile = seen("car-transfer")
    with pytest.raises(InputError, match="reach the screen"):
        DirectionRenderer(scene, tile, PlateContent())
