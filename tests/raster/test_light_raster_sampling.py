"""Antialiasing and band limiting by the rasterizer: means of pictures, and nothing but color."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.light import dressed_scene, moved_by_snapping
from tests.support.long_tail import thinned
from tests.support.views import reversed_d32f, view
from xfrustum.raster import Rasterizer, rasterizer
from xfrustum.scenes import Aperture, Frustum, HogelImage, InputError, Plate, Scene, SceneObject, Screen
from xfrustum.scenes.appearance.appearance import Appearance, Environment, Material
from xfrustum.scenes.appearance.sampling import Sampling, sub_apertures
from xfrustum.scenes.arrays import Floats, Mask, Singles

RESOLUTION = (96, 72)
SETTINGS = reversed_d32f(1e-3)
FOUR = 4
"""Number of coverage samples, which the software rasterizer and every graphics card have."""

SINGLE = 2.0**-23
"""Largest rounding of a mean radiance below two to float32."""
INTERPOLATED = 192 * 2.0**-23
"""Largest rounding of attributes, which are float32 plane equations over 192 pixels."""

WHITE = Material(ambient=(1, 1, 1), diffuse=(0, 0, 0))


def color(raster: Rasterizer, at: Aperture | None = None, /, **sampling: int) -> Singles:
    place = raster.scene.default_apertures()[-1] if at is None else at
    image = raster.render(place, SETTINGS, sampling=Sampling(**sampling))
    return image.color


def boxes(picture: NDArray[Any], n: int) -> Floats:
    height, width = picture.shape[0] // n, picture.shape[1] // n
    return np.asarray(picture.reshape(height, n, width, n, 3).mean(axis=(1, 3), dtype=np.float64))


@pytest.mark.parametrize("n", [2, 3])
def test_supersampling_is_the_mean_over_the_boxes_of_a_larger_picture(n: int) -> None:
    scene = dressed_scene("asymmetric-recentered", RESOLUTION)
    film = replace(scene.frustum, resolution=(n * RESOLUTION[0], n * RESOLUTION[1]))
    larger = replace(scene, frustum=film)
    with Rasterizer(scene) as raster, Rasterizer(larger) as fine:
        np.testing.assert_allclose(color(raster, supersample=n), boxes(color(fine), n), atol=SINGLE)


def test_tiles_change_nothing_but_roundings(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tiles do not divide the film: 96 x 72 pixels in tiles of 11 x 11."""
    scene = dressed_scene("asymmetric-recentered", RESOLUTION)
    larger = replace(scene, frustum=replace(scene.frustum, resolution=(3 * RESOLUTION[0], 3 * RESOLUTION[1])))
    with Rasterizer(scene) as raster, Rasterizer(larger) as fine:
        # Corners have other places on a tile, so that snapping may move attributes the other way.
        image = fine.render(scene.default_apertures()[-1], SETTINGS)
        moved = boxes(moved_by_snapping(larger, image, fine.model), 3).max(axis=-1)
        whole = color(raster, supersample=3)
        monkeypatch.setattr(rasterizer, "POINTS_AT_ONCE", 33 * 33)
        assert {tile.size for tile in rasterizer.tiles(RESOLUTION, 3, 33)} == {(33, 33)}
        monkeypatch.setattr("xfrustum.raster.rasterizer.largest_image", lambda: 33)
        parts = color(raster, supersample=3)
    # Where a corner is snapped to another subpixel an edge may take or leave one point of a pixel.
    different = np.abs(parts - whole).max(axis=-1) > 1e-4 + 2 * moved
    assert different.mean() < 0.01


def half_plane(slope: float, resolution: tuple[int, int]) -> tuple[Scene, Floats]:
    """Return a scene white below a line across the film, and how much of each pixel lies below it."""
    width, height = resolution
    # In pixels, to the right and up from the film's middle; the corners lie outside the film.
    far = 3.0 * width
    line = np.array([[-far, -far * slope + 0.3], [far, far * slope + 0.3], [far, -2 * far], [-far, -2 * far]])
    tangent, depth = math.tan(math.radians(25)), 40.0
    points = line * (2 * tangent * depth / width)
    part = SceneObject(
        name="half",
        vertices=np.column_stack((points, np.full(4, -depth))),
        faces=np.array([[0, 1, 2], [0, 2, 3]]),
        material="white",
    )
    fov = (2 * math.atan(tangent), 2 * math.atan(tangent * height / width))
    scene = Scene(
        name="edge",
        plate=Plate(size=(1.0, 1.0), hogels=(1, 1)),
        frustum=Frustum(resolution=resolution, reach=(50.0, 50.0), fov=fov),
        objects=(part,),
        appearance=Appearance(materials={"white": WHITE}, lights=()),
    )
    # The midpoint rule over columns so thin that its error is far below a code.
    fine = (np.arange(width * 512) + 0.5) / 512 - width / 2
    bottom = height / 2 - 1 - np.arange(height)[:, None]
    covered = np.clip(fine * slope + 0.3 - bottom, 0, 1).reshape(height, width, 512).mean(axis=2)
    return scene, covered


class TestEdge:
    slope = 0.37
    scene, covered = half_plane(slope, (48, 36))
    crossed = (covered > 0) & (covered < 1)

    def error(self, **sampling: int) -> Floats:
        with Rasterizer(self.scene) as raster:
            return np.asarray(np.abs(color(raster, **sampling)[..., 0] - self.covered))

    def test_supersampling_converges_to_the_covered_area(self) -> None:
        """Each row of n points measures its length to 1/(2n), and n rows the area to less than another."""
        errors = {n: self.error(supersample=n) for n in (1, 2, 4, 8, 16)}
        snapped = 2.0**-8 * (1 + self.slope)  # corners lie on a grid of 1/256 pixel
        for n, error in errors.items():
            assert error.max() <= 1 / n + snapped
            assert (error[~self.crossed] == 0).all()
        rms = {n: math.sqrt((error[self.crossed] ** 2).mean()) for n, error in errors.items()}
        assert rms[16] < rms[4] / 3 < rms[1] / 9

    def test_multisampling_agrees_with_supersampling_to_its_own_steps(self) -> None:
        """Four points, one in each row and column of sixteen: area to a quarter, and better in the mean."""
        one, four = self.error(), self.error(multisample=FOUR)
        assert four.max() <= 1 / FOUR + 1 / 16
        assert (four[~self.crossed] == 0).all()
        assert math.sqrt((four**2).sum()) < math.sqrt((one**2).sum()) / 2
        with Rasterizer(self.scene) as raster:
            shares = np.unique(color(raster, multisample=FOUR))
        np.testing.assert_allclose(shares * FOUR, np.arange(FOUR + 1), atol=SINGLE)


def interior(image: HogelImage) -> Mask:
    """Return the pixels whose eight neighbors show the same triangle."""
    same = np.zeros(image.triangle.shape, dtype=np.bool_)
    inner = image.triangle[1:-1, 1:-1]
    height, width = image.triangle.shape
    shifted = [image.triangle[r : height - 2 + r, c : width - 2 + c] for r in range(3) for c in range(3)]
    same[1:-1, 1:-1] = np.all([inner == other for other in shifted], axis=0)
    return np.asarray(same & image.covered)


@pytest.mark.parametrize("samples", thinned([FOUR, 2, 3], 3))
def test_multisampling_shades_and_reflects_as_one_sample_does_away_from_edges(samples: int) -> None:
    """This holds however many more samples the device stores than are asked for."""
    scene = dressed_scene("asymmetric", (192, 144))
    with Rasterizer(scene) as raster:
        plain = raster.render(scene.plate.middle, SETTINGS)
        several = color(raster, multisample=samples)
    # A triangle that the plate cuts is drawn in parts, which meet within it.
    lowest, highest = scene.height_ranges[:, plain.triangle]
    inside = interior(plain) & (lowest * highest > 0)
    assert plain.color is not None and inside.sum() > 1000
    # Whether a covered pixel's attributes are those at its center, to the last bits, is the driver's choice.
    np.testing.assert_allclose(several[inside], plain.color[inside], atol=INTERPOLATED)
    assert several.min() >= 0
    assert (several != plain.color).any()


@pytest.mark.parametrize("sampling", [{}, {"multisample": FOUR}, {"supersample": 2, "aperture": 4}])
def test_color_alone_is_the_color_of_the_whole_image(sampling: dict[str, int]) -> None:
    """Bit for bit, whatever was drawn before."""
    scene = dressed_scene("asymmetric-recentered", (48, 36))
    place = scene.plate.aperture(1, 2)
    with Rasterizer(scene) as raster:
        with pytest.raises(InputError, match=r"multisample 4096 .* at most \d+"):
            color(raster, multisample=4096)
        with pytest.raises(InputError, match=r"supersample 65536 .* at most \d+"):
            color(raster, supersample=1 << 16)
        expected = color(raster, place, **sampling)
        raster.render(scene.plate.middle, SETTINGS)
        np.testing.assert_array_equal(raster.render_color(place, SETTINGS, Sampling(**sampling)), expected)


@pytest.mark.parametrize("sampling", [{"multisample": FOUR}, {"supersample": 3}])
def test_what_is_hidden_reflects_nothing_in_any_sample(sampling: dict[str, int]) -> None:
    """Mirrors in a white surrounding look like a white surface: as much light, in the same samples."""
    scene = view("asymmetric", RESOLUTION)
    parts = tuple(replace(part, material="look") for part in scene.objects)
    surrounding = Environment(radiance=np.ones((2, 4, 3), np.float32))
    mirror = Material(ambient=(0, 0, 0), diffuse=(0, 0, 0), reflectivity=(1, 1, 1))
    pictures = []
    for material in (WHITE, mirror):
        look = Appearance(materials={"look": material}, lights=(), environment=surrounding)
        with Rasterizer(replace(scene, objects=parts, appearance=look)) as raster:
            pictures.append(color(raster, **sampling))
    np.testing.assert_allclose(pictures[1], pictures[0], atol=SINGLE)


@pytest.mark.parametrize("asked", [{"supersample": 2}, {"multisample": FOUR}, {"aperture": 3}])
def test_what_a_pixel_shows_is_that_at_its_center_however_finely_it_is_sampled(asked: dict[str, int]) -> None:
    scene = dressed_scene("asymmetric", RESOLUTION)
    sampled = replace(scene, sampling=Sampling(**asked))
    middle = scene.plate.middle
    with Rasterizer(scene) as raster, Rasterizer(sampled) as by_scene:
        plain = raster.render(middle, SETTINGS)
        fine = raster.render(middle, SETTINGS, sampling=Sampling(**asked))
        same = by_scene.render(middle, SETTINGS)
        once = by_scene.render(middle, SETTINGS, sampling=Sampling())
    for name in ("triangle", "object", "position", "normal"):
        assert getattr(fine, name).tobytes() == getattr(plain, name).tobytes()
    assert not np.array_equal(fine.color, plain.color)
    np.testing.assert_array_equal(same.color, fine.color)
    np.testing.assert_array_equal(once.color, plain.color)


@pytest.mark.parametrize("name", thinned(["asymmetric", "asymmetric-recentered"], 2, 1))
def test_band_limiting_is_the_mean_of_the_sub_apertures_own_images(name: str) -> None:
    scene = dressed_scene(name, RESOLUTION)
    aperture = scene.plate.aperture(20, 40)
    with Rasterizer(scene) as raster:
        places = sub_apertures(scene.plate, aperture, 7)
        mean = np.mean([color(raster, place) for place in places], axis=0, dtype=np.float64)
        np.testing.assert_allclose(color(raster, aperture, aperture=7), mean, atol=SINGLE)
        # The same holds for boxes of pixels.
        mean = np.mean([color(raster, place, supersample=2) for place in places], axis=0, dtype=np.float64)
        both = color(raster, aperture, aperture=7, supersample=2)
        np.testing.assert_allclose(both, mean, atol=2 * SINGLE)
        assert color(raster, aperture, aperture=1).tobytes() == color(raster, aperture).tobytes()


PITCH = 2.0
SCREEN_HEIGHT = 30.0


def grating(height: float, period: float, *, recentered: bool) -> Scene:
    """Return white bars along y in a plane, half a period wide, on a plate of pitch 2."""
    left = np.arange(-60.0, 60.0, period)
    right = left + period / 2
    bars = np.zeros((len(left), 4, 3))
    bars[:, :, 0] = np.stack((left, right, right, left), axis=1)
    bars[:, :, 1] = (-60, -60, 60, 60)
    bars[:, :, 2] = height
    quads = np.arange(4 * len(left)).reshape(-1, 4)
    part = SceneObject(
        name="grating",
        vertices=bars.reshape(-1, 3),
        faces=quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3),
        material="white",
    )
    screen = Screen(height=SCREEN_HEIGHT, center=(0.5, 0.0), size=(20.0, 20.0)) if recentered else None
    fov = None if recentered else (math.radians(30), math.radians(30))
    return Scene(
        name="grating",
        plate=Plate(size=(10 * PITCH, 10 * PITCH), hogels=(10, 10)),
        frustum=Frustum(resolution=(101, 3), reach=(50.0, 50.0), screen=screen, fov=fov),
        objects=(part,),
        appearance=Appearance(materials={"white": WHITE}, lights=()),
    )


def blur(height: float, *, recentered: bool) -> float:
    """Return the width over which an aperture of one pitch spreads in a plane: zero in the screen's."""
    return PITCH * abs(1 - height / SCREEN_HEIGHT) if recentered else PITCH


def discrepancy(count: int) -> float:
    """Return the largest share by which `sub_apertures` misjudge an interval from an end of the pitch."""
    plate = Plate(size=(1.0, 1.0), hogels=(1, 1))
    x = np.sort([place.x + 0.5 for place in sub_apertures(plate, plate.middle, count)])
    steps = np.arange(count + 1) / count
    return float(max(np.abs(x - steps[1:]).max(), np.abs(x - steps[:-1]).max()))


@pytest.mark.parametrize("recentered", [False, True])
@pytest.mark.parametrize("height", thinned([-25.0, 12.0], 2))
def test_a_grating_as_fine_as_the_aperture_is_gray(height: float, recentered: bool) -> None:
    """Every line sweeps one whole period, half of it white."""
    count = 89
    scene = grating(height, blur(height, recentered=recentered), recentered=recentered)
    with Rasterizer(scene) as raster:
        sharp = color(raster, scene.plate.middle)
        gray = color(raster, scene.plate.middle, aperture=count)
    assert set(np.unique(sharp)) == {0, 1}
    assert 0.3 < sharp.mean() < 0.7
    # A bar is an interval of the pitch, or all but one: each of its two ends is misjudged once.
    assert np.abs(gray - 0.5).max() <= 2 * discrepancy(count) + SINGLE
    assert 2 * discrepancy(count) < 0.1


def test_a_grating_in_the_plane_of_the_screen_stays_sharp() -> None:
    """The projection screen is fixed while the aperture moves (paper, section 6)."""
    scene = grating(SCREEN_HEIGHT, 0.77, recentered=True)
    with Rasterizer(scene) as raster:
        middle = scene.plate.middle
        exact = replace(SETTINGS, fit=SCREEN_HEIGHT)
        sharp = raster.render(middle, exact)
        averaged = raster.render(middle, exact, sampling=Sampling(aperture=16))
    # Bars are left out whose edges meet a pixel's center to within the rasterizer's roundings.
    assert (np.abs(averaged.color - sharp.color) > SINGLE).mean() < 0.02


def test_multisampling_mixes_reflections_as_supersampling_does() -> None:
    scene = dressed_scene("car", RESOLUTION)
    with Rasterizer(scene) as raster:
        exact = color(raster, supersample=8).astype(np.float64)
        four, one = (np.abs(color(raster, multisample=n) - exact).mean() for n in (FOUR, 1))
    assert four < one
