"""Band limiting: blur by a hogel's area, in closed form, and points that sample the area."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.commands import Command
from tests.support.lit import ball, lit
from tests.support.long_tail import thinned
from tests.support.scene_file import film, named, part
from tests.support.views import view
from xfrustum.compare.prediction.band_limiting import (
    DISCREPANCY,
    LEVEL,
    blur_px,
    contrast_of,
    error_bound,
    needed_sub_apertures,
    sub_apertures_for,
)
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reference.lines import crossed_frustum
from xfrustum.scenes import DoubleFrustum, Frustum, Plate, Scene, open_scene
from xfrustum.scenes.appearance import Material, additive_recurrence, sub_apertures
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.images import ColorType, PlateContent

SHARP = DoubleFrustum(near=0.01, depth="d32f", mapping="reversed")  # type: ignore[arg-type]


def discrepancy(points: Floats, angle: float) -> float:
    """Return the largest discrepancy between points and the unit box below parallel lines."""
    c, s = math.cos(angle), math.sin(angle)
    along = np.sort((points - 0.5) @ [c, s])
    # The share of the box below a line is the integral of a trapezoid, the convolution of two boxes
    # |c| and |s| wide.
    a, b = max(abs(c), abs(s), 1e-9) / 2, max(min(abs(c), abs(s)), 1e-9) / 2
    ramps = [np.maximum(along + x, 0) ** 2 / 2 for x in (a + b, b - a, a - b, -a - b)]
    share = (ramps[0] - ramps[1] - ramps[2] + ramps[3]) / (4 * a * b)
    steps = np.arange(len(points) + 1) / len(points)
    return float(max((share - steps[:-1]).max(), (steps[1:] - share).max()))


@pytest.mark.parametrize("count", thinned((n for n in DISCREPANCY if 4 <= n <= 4096), 3))
def test_the_discrepancy_is_that_of_the_sub_apertures(count: int) -> None:
    """No direction exceeds the tabulated discrepancy, and some direction nearly attains it."""
    points = additive_recurrence(count)
    largest = max(
        discrepancy(points, angle) for angle in np.linspace(0, np.pi, 1440, endpoint=False)
    )
    assert 0.9 * DISCREPANCY[count] < largest <= DISCREPANCY[count]


@pytest.mark.parametrize("name", ["asymmetric", "asymmetric-recentered"])
@pytest.mark.parametrize("z", [-70.0, 25.0])
def test_the_blur_is_how_far_a_point_moves_between_the_ends_of_a_pitch(name: str, z: float) -> None:
    scene = view(name, (64, 48))
    pitch, middle = np.divide(scene.plate.size, scene.plate.hogels), scene.plate.middle
    places = []
    for side in (-0.5, 0.5):
        x, y = (middle.x, middle.y) + side * pitch
        lines = crossed_frustum(scene.frustum, replace(middle, x=x, y=y))
        slope = np.array(lines.center[:2]) / z - lines.shear
        places.append(slope / lines.half_extent * scene.frustum.resolution / 2)
    np.testing.assert_allclose(np.abs(places[1] - places[0]), blur_px(scene, z), rtol=1e-9)


def test_nothing_is_blurred_at_the_screen_and_everything_at_the_plate() -> None:
    scene = view("asymmetric-recentered", (64, 48))
    assert blur_px(scene, scene.frustum.screen.height) == (0.0, 0.0)
    assert sub_apertures_for((0.0, 0.0), 1.0) == 1
    assert blur_px(scene, 0.0) == (math.inf, math.inf)
    assert sub_apertures_for((math.inf, math.inf), 1.0) == 16384


def test_the_count_is_the_least_whose_bound_is_a_level() -> None:
    for blur in (0.01, 0.1, 1.0, 30.0):
        for contrast in (0.05, 0.3, 1.0):
            count = sub_apertures_for((blur, blur), contrast)
            assert count is not None and error_bound(count, (blur, blur), contrast) <= LEVEL
            fewer = [number for number in DISCREPANCY if number < count]
            assert all(error_bound(number, (blur, blur), contrast) > LEVEL for number in fewer)


def white_ball(contrast: float) -> Scene:
    """Return a uniformly bright ball before black, with edges in all directions."""
    scene = lit(
        ball((0.5, 0.3, -10.0), 3.0, "white"),
        frustum=Frustum(resolution=(48, 48), reach=(20.0, 20.0), fov=(0.8, 0.8)),
        lights=(),
        white=Material(ambient=(contrast,) * 3, diffuse=(0.0,) * 3),
    )
    return replace(scene, plate=Plate(size=(4.0, 4.0), hogels=(4, 4)))


@pytest.mark.slow
def test_the_count_is_enough_and_half_of_it_is_not() -> None:
    """Compare means at the ball's outline with a mean over eight times as many points."""
    scene = white_ball(0.1)
    assert contrast_of(scene) == pytest.approx(0.1)
    count = needed_sub_apertures(scene)
    # A hundredth of the radiance is 2.5 levels.
    coarse = needed_sub_apertures(scene, error=0.01)
    assert (count, coarse) == (256, 64)
    means, total = {}, np.zeros((48, 48, 3))
    content = PlateContent(color=ColorType.FLOAT32)
    with PlateRenderer(scene, SHARP, content) as plate:
        points = sub_apertures(scene.plate, scene.plate.middle, 8 * count)
        for number, hogel in enumerate(plate.hogels(points), 1):
            total += hogel.color
            # A prefix of the sequence of points is the sequence for fewer points.
            if number in (coarse, count // 2, count, 8 * count):
                means[number] = total / number
    error = {n: np.abs(mean - means[8 * count]).max() for n, mean in means.items()}
    assert error[count] <= LEVEL < error[count // 2]
    assert LEVEL < error[coarse] <= 0.01


def test_auto_is_the_number_that_check_recommends(tmp_path: Path, command: Command) -> None:
    """Check a dim ball far behind the plate; its image moves by 1/5 of a pixel over the pitch."""
    file, out = tmp_path / "ball.toml", tmp_path / "x.zarr"
    file.write_text(
        named("dim")
        + film(
            (2.0, 2.0), hogels=(8, 8), resolution=(16, 16), fov_deg=(40.0, 40.0), reach=(50.0, 90.0)
        )
        + "[material.dim]\nambient = 0.2\ndiffuse = 0.0\n[[light]]\ndirection = [0.0, 0.0, 1.0]\n"
        + part("sphere", 20.0, (0.0, 0.0, -70.0), material="dim")
    )
    count = command(f"check {file} --json").record["depths"]["sub_apertures"]
    assert 1 < count <= 256
    plate = f"plate {file} --near 0.02 --apertures 4,4 --quiet --out {out} --aperture-samples auto"
    assert f"auto: {count} points" in command(plate).err
    # A tolerance relative to the radiance needs fewer points.
    trace = f"trace {file} --out {out}.exr --aperture-samples"
    fewer = needed_sub_apertures(open_scene(file), error=0.05)
    assert f"5%: {fewer} points" in command(f"{trace} 5%").err
    for share in ("0%", "100%", "-1%"):
        command(f"{trace} {share}", status=2)
