"""Antialiasing and band limiting in reference and rasterizer: only colors are averaged."""

import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace

import numpy as np
import pytest

from tests.support.images import assert_same
from tests.support.light import dressed_scene
from tests.support.lit import GLOW, lit, quad
from tests.support.views import reversed_d32f
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import Aperture, Frustum, HogelImage, InputError, Plate, Scene, Screen
from xfrustum.scenes.appearance import Sampling, sub_apertures
from xfrustum.scenes.arrays import Floats, Singles

RESOLUTION = (48, 36)
SETTINGS = reversed_d32f(1e-3)
#: Number of coverage samples that the software rasterizer and every graphics card support
FOUR = 4

#: Relative rounding of a mean: each averaged image, and the mean, is rounded to float32 once
SINGLE = 2.0**-23

Ask = Callable[..., HogelImage]
Answer = Callable[[Scene], AbstractContextManager[Ask]]


@contextmanager
def traced(scene: Scene) -> Iterator[Ask]:
    """Yield a function that traces an aperture, with given sampling or the scene's own."""
    yield Reference(scene).trace


@contextmanager
def drawn(scene: Scene) -> Iterator[Ask]:
    """Yield a function that draws an aperture with a negligible near offset."""
    with Rasterizer(scene) as raster:
        yield lambda aperture, sampling=None: raster.render(aperture, SETTINGS, sampling=sampling)


BOTH = pytest.mark.parametrize("answer", [traced, drawn])


def mean(pictures: list[Singles]) -> Floats:
    return np.asarray(np.mean([picture.astype(np.float64) for picture in pictures], axis=0))


@BOTH
@pytest.mark.parametrize("n", [2, 3])
def test_supersampling_is_the_mean_over_the_boxes_of_a_larger_picture(
    answer: Answer, n: int
) -> None:
    scene = dressed_scene("asymmetric-recentered", RESOLUTION)
    width, height = RESOLUTION
    larger = replace(scene, frustum=replace(scene.frustum, resolution=(n * width, n * height)))
    place = scene.plate.corners[0]
    with answer(scene) as ask, answer(larger) as fine:
        boxes = (
            fine(place).color.reshape(height, n, width, n, 3).mean(axis=(1, 3), dtype=np.float64)
        )
        result = ask(place, Sampling(supersample=n)).color
    np.testing.assert_allclose(result, boxes, rtol=SINGLE, atol=SINGLE)


@BOTH
@pytest.mark.parametrize("boxes", [1, 2])
def test_an_aperture_is_the_mean_of_its_points(answer: Answer, boxes: int) -> None:
    """With supersampling in addition, the result is the mean of means."""
    scene = dressed_scene("asymmetric-recentered", RESOLUTION)
    aperture = scene.plate.aperture(20, 40)
    with answer(scene) as ask:
        points = sub_apertures(scene.plate, aperture, 5)
        expected = mean([ask(point, Sampling(supersample=boxes)).color for point in points])
        result = ask(aperture, Sampling(supersample=boxes, aperture=5)).color
        assert np.abs(result - ask(aperture).color).max() > 0.05
    np.testing.assert_allclose(result, expected, rtol=2 * SINGLE, atol=2 * SINGLE)


@pytest.mark.parametrize(
    ("answer", "options"),
    [
        (traced, {"supersample": 2}),
        (traced, {"aperture": 3}),
        (drawn, {"supersample": 2, "aperture": 3}),
        (drawn, {"multisample": FOUR}),
    ],
)
def test_only_color_is_averaged_by_default_as_the_scene_states(
    answer: Answer, options: dict[str, int]
) -> None:
    scene, sampling = dressed_scene("asymmetric", RESOLUTION), Sampling(**options)
    middle = scene.plate.middle
    with answer(scene) as ask, answer(replace(scene, sampling=sampling)) as by_scene:
        plain, fine = ask(middle), ask(middle, sampling)
        assert_same(fine, plain, "triangle", "object", "position", "normal")
        assert not np.array_equal(fine.color, plain.color)
        assert_same(by_scene(middle), fine, "color")
        assert_same(by_scene(middle, Sampling()), plain, "color")


def half_plane(slope: float, resolution: tuple[int, int]) -> tuple[Scene, Floats]:
    """Return a scene, white below a line across the film, and the white share of each pixel."""
    width, height = resolution
    # In pixels, to the right and up from the film's middle; the corners lie outside the film.
    far = 3.0 * width
    line = np.array(
        [[-far, -far * slope + 0.3], [far, far * slope + 0.3], [far, -2 * far], [-far, -2 * far]]
    )
    tangent, depth = math.tan(math.radians(25)), 40.0
    corners = np.column_stack((line * (2 * tangent * depth / width), np.full(4, -depth)))
    fov = (2 * math.atan(tangent), 2 * math.atan(tangent * height / width))
    frustum = Frustum(resolution=resolution, reach=(50.0, 50.0), fov=fov)
    scene = replace(
        lit(quad(corners, "glow"), frustum=frustum, glow=GLOW),
        plate=Plate(size=(1, 1), hogels=(1, 1)),
    )
    # Midpoint rule over such thin columns that its error is far below a code value
    fine = (np.arange(width * 512) + 0.5) / 512 - width / 2
    bottom = height / 2 - 1 - np.arange(height)[:, None]
    covered = np.clip(fine * slope + 0.3 - bottom, 0, 1).reshape(height, width, 512).mean(axis=2)
    return scene, covered


def test_multisampling_agrees_with_the_covered_area_to_its_own_steps() -> None:
    """Four points in different rows and columns of a 16 x 16 grid measure areas to about 1/4."""
    scene, covered = half_plane(0.37, RESOLUTION)
    with drawn(scene) as ask:
        plain, shares = (
            ask(scene.plate.middle, Sampling(multisample=n)).color[..., 0] for n in (1, FOUR)
        )
    item, four = np.abs(plain - covered), np.abs(shares - covered)
    assert four.max() <= 1 / FOUR + 1 / 16
    assert (four[(covered == 0) | (covered == 1)] == 0).all()
    assert math.sqrt((four**2).sum()) < math.sqrt((item**2).sum()) / 2
    np.testing.assert_allclose(np.unique(shares) * FOUR, np.arange(FOUR + 1), atol=SINGLE)


PITCH = 2.0
SCREEN_HEIGHT = 30.0


def grating(height: float, period: float, *, recentered: bool) -> Scene:
    """Return glowing bars along y, half a period wide, over a plate of pitch 2."""
    bars = [
        quad([(x, -60, height), (end, -60, height), (end, 60, height), (x, 60, height)], "glow")
        for x, end in ((x, x + period / 2) for x in np.arange(-60.0, 60.0, period))
    ]
    screen = (
        Screen(height=SCREEN_HEIGHT, center=(0.5, 0.0), size=(20.0, 20.0)) if recentered else None
    )
    fov = None if recentered else (math.radians(30), math.radians(30))
    frustum = Frustum(resolution=(101, 3), reach=(50.0, 50.0), screen=screen, fov=fov)
    plate = Plate(size=(10 * PITCH, 10 * PITCH), hogels=(10, 10))
    return replace(lit(*bars, frustum=frustum, lights=(), glow=GLOW), plate=plate)


def discrepancy(count: int) -> float:
    """Return the largest error of `sub_apertures` for an interval from an end of the pitch."""
    plate = Plate(size=(1.0, 1.0), hogels=(1, 1))
    x = np.sort([place.x + 0.5 for place in sub_apertures(plate, plate.middle, count)])
    steps = np.arange(count + 1) / count
    return float(max(np.abs(x - steps[1:]).max(), np.abs(x - steps[:-1]).max()))


@BOTH
@pytest.mark.parametrize(
    ("height", "recentered"),
    [(-25.0, False), (12.0, True)],
)
def test_a_grating_as_fine_as_the_aperture_is_gray(
    answer: Answer, height: float, recentered: bool
) -> None:
    """Each pixel sweeps one period, half of it bright: the pitch or, near the screen, less."""
    count = 89
    period = PITCH * abs(1 - height / SCREEN_HEIGHT) if recentered else PITCH
    scene = grating(height, period, recentered=recentered)
    with answer(scene) as ask:
        sharp, gray = (ask(scene.plate.middle, Sampling(aperture=n)).color for n in (1, count))
    assert set(np.unique(sharp)) == {0, 1}
    assert 0.3 < sharp.mean() < 0.7
    # A bar covers an interval of the pitch, or all but an interval: both its ends contribute
    # errors.
    assert np.abs(gray - 0.5).max() <= 2 * discrepancy(count) + SINGLE
    assert 2 * discrepancy(count) < 0.1


# Features of the rasterizer alone: coverage samples, colors without other channels


def color(raster: Rasterizer, at: Aperture | None = None, /, **sampling: int) -> Singles:
    place = raster.scene.default_apertures()[-1] if at is None else at
    return raster.render(place, SETTINGS, sampling=Sampling(**sampling)).color


@pytest.mark.parametrize("sampling", [{}, {"multisample": FOUR}, {"supersample": 2, "aperture": 4}])
def test_color_alone_is_the_color_of_the_whole_image(sampling: dict[str, int]) -> None:
    """Images agree bit for bit, whatever was drawn before."""
    scene = dressed_scene("asymmetric-recentered", RESOLUTION)
    place = scene.plate.aperture(1, 2)
    with Rasterizer(scene) as raster:
        with pytest.raises(InputError, match=r"multisample 4096 .* at most \d+"):
            color(raster, multisample=4096)
        with pytest.raises(InputError, match=r"supersample 65536 .* at most \d+"):
            color(raster, supersample=1 << 16)
        expected = color(raster, place, **sampling)
        raster.render(scene.plate.middle, SETTINGS)
        np.testing.assert_array_equal(
            raster.render_color(place, SETTINGS, Sampling(**sampling)), expected
        )
