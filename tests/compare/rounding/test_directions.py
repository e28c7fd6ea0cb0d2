"""Images by direction: snapping and depth order explain all wrong pixels, but no defects."""

import itertools
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from tests.support.long_tail import kept, thinned
from tests.support.views import soup
from xfrustum.compare.rounding.causes import Causes, explain_direction
from xfrustum.raster.plate.directions import DirectionRenderer
from xfrustum.reference import Reference
from xfrustum.scenes import NOTHING, DepthFormat, Frustum, Plate, Scene, Screen, open_scene
from xfrustum.scenes.arrays import Floats, Numbers
from xfrustum.scenes.model.device_model import LLVMPIPE, DeviceModel, model_of
from xfrustum.scenes.model.images import Channel, DirectionImage, PlateContent
from xfrustum.scenes.plate import PlateTile

HOGELS, PIXELS = (40, 30), (12, 10)
SCENES = ["car", "asymmetric", "asymmetric-recentered", "crossing", "large-triangles"]
BEHIND = "asymmetric before a screen"
FEW = [(3, 2), (9, 7)]
D16, D24, D32F = DepthFormat

Pixels = list[tuple[int, int]]


def small(name: str) -> Scene:
    scene = open_scene("asymmetric-recentered" if name == BEHIND else name)
    if name == BEHIND:
        screen = Screen(height=-160.0, center=(9.0, -6.0), size=(200.0, 170.0))
        scene = replace(scene, frustum=replace(scene.frustum, screen=screen))
    frustum = replace(scene.frustum, resolution=PIXELS)
    return replace(scene, plate=Plate(size=scene.plate.size, hogels=HOGELS), frustum=frustum)


def whole(scene: Scene) -> PlateTile:
    columns, rows = map(range, scene.plate.hogels)
    return PlateTile(plate=scene.plate, columns=columns, rows=rows)


def true(scene: Scene, pixels: Pixels) -> list[DirectionImage]:
    images = Reference(scene).by_directions(whole(scene), pixels, normals=False, colored=False)
    return list(images)


def drawn(scene: Scene, pixels: Pixels, depth: DepthFormat) -> tuple[list[Numbers], DeviceModel]:
    content = PlateContent(channels=(Channel.TRIANGLE,))
    with DirectionRenderer(scene, whole(scene), content, depth) as renderer:
        images = [image.triangle for image in renderer.images(pixels)]
        return [image for image in images if image is not None], model_of(renderer.device)


def judged(scene: Scene, pixels: Pixels, depth: DepthFormat) -> Counter[str]:
    """Return numbers of shown pixels, wrong pixels, and wrong pixels by cause."""
    images, device = drawn(scene, pixels, depth)
    counts = Counter[str]()
    for truth, triangle in zip(true(scene, pixels), images, strict=True):
        causes = explain_direction(scene, truth, triangle, device, depth)
        counts.update(causes.counts())
        counts["shown"] += int(np.count_nonzero(truth.triangle != NOTHING))
        counts["wrong"] += len(causes.pixels)
    return counts


@pytest.mark.parametrize(
    ("name", "depth"),
    kept(
        itertools.product([*SCENES, BEHIND, "sheets", "mirror-sphere"], DepthFormat),
        [("car", D16), ("asymmetric-recentered", D24), (BEHIND, D32F), ("large-triangles", D24)],
    ),
)
def test_rounding_explains_every_wrong_pixel(name: str, depth: DepthFormat) -> None:
    counts = judged(small(name), [*FEW, (5, 8), (10, 1)], depth)
    assert counts["shown"] > 1000 and 0 < counts["wrong"] < 0.03 * counts["shown"]
    assert counts["unexplained"] == 0


def shifted(scene: Scene, pitches: float) -> Scene:
    """Return a scene moved to the right by a number of pitches."""
    aside = np.array([pitches * scene.plate.size[0] / scene.plate.hogels[0], 0.0, 0.0])
    parts = tuple(replace(part, vertices=part.vertices + aside) for part in scene.objects)
    return replace(scene, objects=parts)


@pytest.mark.parametrize("name", thinned(SCENES, 5, 1))
def test_no_rounding_explains_defects(name: str) -> None:
    scene, (width, height) = small(name), PIXELS
    opposite = [(width - 1 - column, height - 1 - row) for column, row in FEW]
    truths, (images, device) = true(scene, FEW), drawn(scene, FEW, D24)
    # A hundredth of a pitch is three times the distance by which a vertex snaps.
    for others, least in (
        (drawn(scene, opposite, D24)[0], 100),
        ([image[::-1] for image in images], 100),
        (drawn(shifted(scene, 0.5), FEW, D24)[0], 100),
        (drawn(shifted(scene, 0.01), FEW, D24)[0], 2),
    ):
        unexplained = sum(
            explain_direction(scene, truth, other, device, D24).counts()["unexplained"]
            for truth, other in zip(truths, others, strict=True)
        )
        assert unexplained > least


SIDE = Frustum(resolution=(16, 1), reach=(80.0, 48.0), fov=(1.0, 1.0))


def sheet(left: float, right: float, z: float) -> Floats:
    """Return a sheet parallel to the plate, as two triangles (2, 3, 3)."""
    a, b, c, d = [(x, y, z) for y in (-30.0, 30.0) for x in (left, right)]
    return np.array([(a, b, d), (a, d, c)])


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("screened", [False, True])
def test_the_reach_cuts_surfaces_on_both_sides(side: float, screened: bool) -> None:
    """A ramp crosses both ends of the reach; a screen lies beyond either end."""
    ramp = np.array([[(-9.0, -30.0, -70.0), (9.0, -30.0, 85.0), (0.0, 60.0, 7.5)]])
    screen = Screen(height=side * 90.0, center=(3.0, 0.0), size=(60.0, 40.0))
    frustum = replace(SIDE, fov=None, screen=screen) if screened else SIDE
    counts = judged(soup(ramp * [side, 1.0, 1.0], frustum), [(c, 0) for c in range(16)], D24)
    assert counts["unexplained"] == 0
    assert counts["shown"] > 500 and counts["wrong"] < 20


def causes_of(scene: Scene, drawn_in: DepthFormat, explained_in: DepthFormat) -> Causes:
    (truth,), ((triangle,), _) = true(scene, [(8, 0)]), drawn(scene, [(8, 0)], drawn_in)
    return explain_direction(scene, truth, triangle, LLVMPIPE, explained_in)


def test_depth_order_is_known_to_a_step_of_the_reach() -> None:
    step = 128.0 / 2**16  # of D16, over the whole reach
    for gap, wrong in ((0.2, True), (2.0, False)):
        # The farther sheet is drawn first and remains where depths are equal.
        z = 80.0 - 2000 * step
        scene = soup(np.concatenate((sheet(-4.0, 4.0, z - gap * step), sheet(-4, 4, z))), SIDE)
        causes = causes_of(scene, D16, D16)
        assert causes.counts()["unexplained"] == 0
        assert (causes.counts()["order"] > 50) == wrong
        # D24 has steps fine enough for both pairs of sheets.
        assert causes_of(scene, D24, D24).counts()["order"] == 0
        finer = causes_of(scene, D16, D24).counts()
        assert finer["unexplained"] == causes.counts()["order"]


def test_a_surface_at_the_end_of_the_reach_is_lost_within_half_a_step() -> None:
    step = 128.0 / 2**16
    for height, count in ((0.25, True), (1.5, False)):
        scene = soup(sheet(-4.0, 4.0, -48.0 + height * step), SIDE)
        counts = causes_of(scene, D16, D16).counts()
        assert (counts["lost"] > 50) == count and counts["unexplained"] == 0
