"""Drawing a plate in two ways: the crossover at which passes by direction become faster."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from xfrustum.compare.planning.ways import (
    WaySpeeds,
    direction_errors,
    measure_plate,
    spread_pixels,
    tile_about,
)
from xfrustum.reference import Reference
from xfrustum.scenes import DoubleFrustum, InputError, Plate, Scene, open_scene
from xfrustum.scenes.model.images import PlateContent
from xfrustum.scenes.model.scene import SceneObject
from xfrustum.scenes.plate import DepthFormat, Frustum

SECONDS = st.floats(1e-7, 1.0)


def small(name: str) -> Scene:
    scene = open_scene(name)
    return replace(scene, frustum=replace(scene.frustum, resolution=(9, 7)))


@given(pixels=st.integers(1, 10**6), pass_s=SECONDS, cell_s=SECONDS, gain=st.floats(0.1, 100))
def test_both_ways_take_equally_long_at_the_crossover(
    pixels: int, pass_s: float, cell_s: float, gain: float
) -> None:
    # With a gain above 1, a hogel costs more than its cells in all passes.
    hogel_s = gain * pixels * cell_s
    speeds = WaySpeeds(pixels=pixels, pass_s=pass_s, cell_s=cell_s, hogel_s=hogel_s)
    if math.isinf(speeds.crossover):
        # A cell costs more in all passes than a whole hogel: more hogels do not help.
        assert all(speeds.directions_s(n) > speeds.hogels_s(n) for n in (1, 10**6, 10**12))
        return
    assert gain > 1
    if speeds.crossover < 1e9:
        more, fewer = math.ceil(speeds.crossover * 1.01), math.floor(speeds.crossover * 0.99)
        assert speeds.directions_s(more) <= speeds.hogels_s(more) * (1 + 1e-9)
        assert speeds.directions_s(fewer) >= speeds.hogels_s(fewer) * (1 - 1e-9)
        assert speeds.directions_s(more, tiles=2) > speeds.directions_s(more)


@pytest.mark.parametrize("resolution", [(9, 7), (640, 3), (1, 400), (512, 512)])
def test_spread_pixels_reach_every_quarter_of_the_film(resolution: tuple[int, int]) -> None:
    pixels = np.array(spread_pixels(replace(small("car").frustum, resolution=resolution), 64))
    assert len(np.unique(pixels, axis=0)) == len(pixels) >= min(64, math.prod(resolution)) * 0.7
    for size, places in zip(resolution, pixels.T, strict=True):
        assert places.min() >= 0 and places.max() < size
        assert len(np.unique(4 * places // size)) == min(4, size)


def test_speeds_are_measured_and_scenes_around_the_screen_are_refused() -> None:
    content = PlateContent(ids=True)
    settings = [DoubleFrustum(near=1.0), DoubleFrustum(near=0.1, slabs=(20.0,))]
    times = measure_plate(small("asymmetric"), settings, content)
    assert times.directions_s > 0 and min(times.hogels_s) > 0 and len(times.hogels_s) == 2
    speeds = times.speeds
    assert speeds.pixels == 63 and speeds.hogel_s > 0 and speeds.pass_s + speeds.cell_s > 0
    scene = small("asymmetric-recentered")
    assert scene.frustum.screen is not None
    inside = replace(scene.frustum.screen, height=scene.bounds[:, 2].mean())
    around = replace(scene, frustum=replace(scene.frustum, screen=inside))
    with pytest.raises(InputError, match="draw the plate by hogels"):
        measure_plate(around, settings, content)


def sheets(apart: float) -> Scene:
    """Return two leaning sheets over the whole plate; the hidden sheet reaches higher.

    Triangles are drawn in descending order of their highest point: where depths are equal, the
    hidden sheet, drawn first, remains.
    """

    def sheet(name: str, z: float, right: float) -> SceneObject:
        x = np.array([-100.0, right, right, -100.0])
        vertices = np.column_stack([x, [-100.0, -100.0, 100.0, 100.0], z + x / 20])
        return SceneObject(name=name, vertices=vertices, faces=np.array([(0, 1, 2), (0, 2, 3)]))

    objects = (sheet("lower", -40.0 - apart, 300.0), sheet("upper", -40.0, 100.0))
    plate = Plate(size=(40.0, 30.0), hogels=(24, 17))
    frustum = Frustum(resolution=(8, 6), reach=(100.0, 100.0), fov=(0.8, 0.7))
    return Scene(name="sheets", units="mm", plate=plate, frustum=frustum, objects=objects)


@pytest.mark.parametrize(
    ("depth", "apart", "wrong"),
    # Linear depth spans 200: a step is 200/65535 = 3e-3 in D16, and at most 6e-6 in D32F. A depth
    # step separates the leaning sheets in a share of 1e-4 / 3e-3 of the pixels.
    [(DepthFormat.D16, 1e-2, 0.0), (DepthFormat.D16, 1e-4, 1.0), (DepthFormat.D32F, 1e-4, 0.0)],
)
def test_linear_depth_orders_sheets_that_are_more_than_a_step_apart(
    depth: DepthFormat, apart: float, wrong: float
) -> None:
    """Judge a tile at the left border of the plate."""
    scene = sheets(apart)
    tile = tile_about(scene.plate, scene.plate.aperture(0, 9), 12)
    assert tile.size == (12, 12) and 0 in tile.columns and 9 in tile.rows
    errors = direction_errors(Reference(scene), tile, spread_pixels(scene.frustum, 5), depth)
    assert errors.judged == 5 * 12 * 12 and errors.fraction == pytest.approx(wrong, abs=0.05)
