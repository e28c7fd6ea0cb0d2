"""Two ways to draw a plate: when passes by directions overtake hogels."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from xfrustum.compare.planning.ways import WaySpeeds, measure_speeds, spread_pixels
from xfrustum.scenes import DoubleFrustum, InputError, Scene, open_scene
from xfrustum.scenes.model.plate_content import PlateContent

SECONDS = st.floats(1e-7, 1.0)


def small(name: str) -> Scene:
    scene = open_scene(name)
    return replace(scene, frustum=replace(scene.frustum, resolution=(9, 7)))


@given(pixels=st.integers(1, 10**6), pass_s=SECONDS, cell_s=SECONDS, hogel_s=SECONDS)
def test_both_ways_take_equally_long_at_the_crossover(
    pixels: int, pass_s: float, cell_s: float, hogel_s: float
) -> None:
    speeds = WaySpeeds(pixels=pixels, pass_s=pass_s, cell_s=cell_s, hogel_s=hogel_s)
    if math.isinf(speeds.crossover):
        # A cell costs more in all passes than a whole hogel: no number of hogels helps.
        assert all(speeds.directions_s(n) > speeds.hogels_s(n) for n in (1, 10**6, 10**12))
    elif speeds.crossover < 1e9:
        more, fewer = math.ceil(speeds.crossover * 1.01), math.floor(speeds.crossover * 0.99)
        assert speeds.directions_s(more) <= speeds.hogels_s(more) * (1 + 1e-9)
        assert speeds.directions_s(fewer) >= speeds.hogels_s(fewer) * (1 - 1e-9)
        assert speeds.directions_s(more, tiles=2) > speeds.directions_s(more)


@pytest.mark.parametrize("resolution", [(9, 7), (640, 3), (1, 400), (512, 512)])
def test_spread_pixels_reach_every_quarter_of_the_film(resolution: tuple[int, int]) -> None:
    pixels = spread_pixels(replace(small("car").frustum, resolution=resolution), 64)
    assert len(set(pixels)) == len(pixels) >= min(64, math.prod(resolution)) * 0.7
    for axis, size in enumerate(resolution):
        places = [pixel[axis] for pixel in pixels]
        assert min(places) >= 0 and max(places) < size
        assert len({4 * place // size for place in places}) == min(4, size)


def test_speeds_are_measured_and_scenes_around_the_screen_refused() -> None:
    content = PlateContent(ids=True)
    scene = small("asymmetric")
    speeds = measure_speeds(scene, DoubleFrustum(near=1.0), content)
    assert speeds.pixels == 63 and speeds.hogel_s > 0 and speeds.pass_s + speeds.cell_s > 0
    screen = small("asymmetric-recentered")
    assert screen.frustum.screen is not None
    inside = replace(screen.frustum.screen, height=(screen.bounds[0][2] + screen.bounds[1][2]) / 2)
    screen = replace(screen, frustum=replace(screen.frustum, screen=inside))
    with pytest.raises(InputError, match="draw the plate by hogels"):
        measure_speeds(screen, DoubleFrustum(near=1.0), content)
