"""The reference's means: over the boxes of pixels, over points of the aperture, and to convergence."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.support.lit import CENTERED, GLOW, PLATE, RECENTERED, SUN, ball, card, lit, quad, sky
from xfrustum.reference import Reference, averages
from xfrustum.reference.averages import BOX_SIDE
from xfrustum.scenes import Scene
from xfrustum.scenes.appearance.appearance import Material
from xfrustum.scenes.appearance.sampling import Sampling, sub_apertures
from xfrustum.scenes.arrays import Floats, Singles

MIDDLE = PLATE.middle
SMALL = replace(RECENTERED, resolution=(16, 12))
SHINY = Material(
    diffuse=(0.5, 0.3, 0.2), specular=(0.4, 0.5, 0.6), exponent=20.0, reflectivity=(0.2, 0.3, 0.1)
)

MEAN = 2.0**-23
"""Relative rounding of a mean: each averaged image is rounded to float32 once, and so is the mean."""


def scenery() -> Scene:
    """Return a scene of curved, flat and reflecting objects with edges, on both sides of the plate."""
    parts = (ball((5.0, 2.0, -45.0), 14.0, "shiny", 3), ball((-4.0, 1.0, 30.0), 5.0, "shiny", 3))
    return lit(*parts, card((0, 0, -70), (60, 40)), frustum=SMALL, environment=sky(), shiny=SHINY)


def color(scene: Scene, sampling: Sampling | None = None) -> Singles:
    return Reference(scene).trace(MIDDLE, sampling).color


@pytest.mark.parametrize("side", [2, 3, 5])
def test_supersampling_is_the_mean_of_a_finer_image(side: int) -> None:
    scene = scenery()
    width, height = SMALL.resolution
    finer = color(replace(scene, frustum=replace(SMALL, resolution=(width * side, height * side))))
    mean = finer.astype(np.float64).reshape(height, side, width, side, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(color(scene, Sampling(supersample=side)), mean, rtol=MEAN)


def test_an_aperture_is_the_mean_of_its_points() -> None:
    scene = scenery()
    points = sub_apertures(scene.plate, MIDDLE, 7)
    single = [Reference(scene).trace(point).color for point in points]
    mean = np.mean([image.astype(np.float64) for image in single if image is not None], axis=0)
    assert np.abs(mean - color(scene)).max() > 0.05
    np.testing.assert_allclose(color(scene, Sampling(aperture=7)), mean, rtol=MEAN)


def test_both_together_are_the_mean_of_means() -> None:
    scene = scenery()
    points = sub_apertures(scene.plate, MIDDLE, 3)
    images = [Reference(scene).trace(point, Sampling(supersample=2)).color for point in points]
    mean = np.mean([image.astype(np.float64) for image in images if image is not None], axis=0)
    np.testing.assert_allclose(color(scene, Sampling(supersample=2, aperture=3)), mean, rtol=MEAN)


def test_multisampling_is_answered_with_the_mean_over_the_same_box() -> None:
    scene = scenery()
    box = color(scene, Sampling(supersample=BOX_SIDE))
    np.testing.assert_array_equal(color(scene, Sampling(multisample=4)), box)
    np.testing.assert_array_equal(color(scene, Sampling(multisample=4, supersample=2)), box)


def test_the_scenes_own_sampling_is_meant_where_none_is_named() -> None:
    sampling = Sampling(supersample=2, aperture=3)
    scene = scenery()
    np.testing.assert_array_equal(color(replace(scene, sampling=sampling)), color(scene, sampling))


def test_only_color_is_averaged() -> None:
    plain, averaged = (
        Reference(scenery()).trace(MIDDLE, s) for s in (None, Sampling(supersample=3, aperture=2))
    )
    for name in ("triangle", "object", "position", "normal", "certainty", "companions", "overruled"):
        np.testing.assert_array_equal(getattr(averaged, name), getattr(plain, name))
    assert averaged.color.dtype == np.float32


def test_bands_change_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    sampling = Sampling(supersample=3, aperture=2)
    whole = color(scenery(), sampling)
    monkeypatch.setattr("xfrustum.reference.averages.BAND_PIXELS", 150)
    monkeypatch.setattr("xfrustum.reference.truth.AVERAGED_PIXELS", 60)
    np.testing.assert_array_equal(color(scenery(), sampling), whole)


def test_an_edge_across_a_pixel_shows_the_share_it_covers() -> None:
    """The right border of a glowing card runs through column 30 at three eighths of its width."""
    width = CENTERED.resolution[0]
    edge = MIDDLE.x + 50 * math.tan(CENTERED.fov[0] / 2) * (2 * 30.375 / width - 1)
    part = quad([(-99, -99, -50), (edge, -99, -50), (edge, 99, -50), (-99, 99, -50)], "glow")
    found = color(lit(part, glow=GLOW), Sampling(supersample=8))
    expected = np.where(np.arange(width) < 30, 1.0, 0.0)
    expected[30] = 3 / 8
    np.testing.assert_allclose(found, np.broadcast_to(expected[:, None], found.shape), rtol=MEAN)


PITCH = (PLATE.size[0] / PLATE.hogels[0], PLATE.size[1] / PLATE.hogels[1])
"""Width and height of an aperture."""


def grating(period: float, z: float, duty: float) -> Scene:
    """Return a scene of glowing bars parallel to y over the whole film."""
    count = math.ceil(70 / period)
    left = (np.arange(count) - count / 2) * period
    right = left + duty * period
    bars = [
        quad([(x, -99, z), (end, -99, z), (end, 99, z), (x, 99, z)], "glow")
        for x, end in zip(left, right, strict=True)
    ]
    return lit(*bars, frustum=replace(CENTERED, resolution=(24, 3)), glow=GLOW)


@pytest.mark.parametrize("z", [-37.0, 41.0])
def test_a_grating_finer_than_the_aperture_is_gray(z: float) -> None:
    """A centered frustum keeps its directions: the aperture's point moves the grating by as much.

    Over a width of two periods every pixel sees bars and gaps in the ratio of their widths, whatever z.
    """
    found = Reference(grating(PITCH[0] / 2, z, duty=0.3)).converged(MIDDLE, tolerance=8e-3)
    assert found.error <= 8e-3
    assert abs(found.color.mean() - 0.3) < 4e-3
    assert np.all(np.abs(found.color - 0.3) <= 6 * found.error)


class TestSmoothPicture:
    """A highlight on a card that fills a recentered film: a smooth function of the aperture's point."""

    COARSE = replace(PLATE, size=(60.0, 60.0), hogels=(3, 3))
    """Apertures so wide that their lines differ by some 0.3 in slope."""

    PAINT = Material(ambient=(0.0,) * 3, diffuse=(0.0,) * 3, specular=(1.0, 1.0, 1.0), exponent=40.0)

    def scene(self) -> Scene:
        scene = lit(card((0, 0, -50), (900, 900), "paint"), frustum=SMALL, lights=(SUN,), paint=self.PAINT)
        return replace(scene, plate=self.COARSE)

    def integral(self) -> Floats:
        """Return the mean over the middle aperture, by the 20-point rule of Gauss on each axis."""
        nodes, weights = np.polynomial.legendre.leggauss(20)
        screen = SMALL.screen
        width, height = SMALL.resolution
        u, v = (2 * np.arange(width) + 1) / width - 1, 1 - (2 * np.arange(height) + 1) / height
        total = np.zeros((height, width))
        for x, of_x in zip(nodes * 10.0, weights / 2, strict=True):
            for y, of_y in zip(nodes * 10.0, weights / 2, strict=True):
                dx = -(screen.center[0] - x) / screen.height + u * screen.size[0] / 2 / screen.height
                dy = -(screen.center[1] - y) / screen.height + v * screen.size[1] / 2 / screen.height
                # The eye vector's part along the card's normal stays; the rest of -d changes its sign.
                mirrored = np.stack(np.broadcast_arrays(dx, dy[:, None], 1.0), axis=-1)
                along = mirrored @ np.array(SUN.direction) / np.linalg.norm(mirrored, axis=-1)
                total += of_x * of_y * np.maximum(along, 0.0) ** self.PAINT.exponent
        return np.asarray(total[..., None] * SUN.color)

    def test_the_error_of_sub_apertures_falls_as_one_over_their_number(self) -> None:
        """An additive recurrence has slope -1 but for a logarithm; independent random points have -1/2."""
        exact, reference = self.integral(), Reference(self.scene())
        counts = [8, 32, 128, 512]
        errors = []
        for count in counts:
            image = reference.trace(self.COARSE.middle, Sampling(aperture=count)).color
            errors.append(float(np.sqrt(np.mean((image - exact) ** 2))))
        slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
        assert -1.4 < slope < -0.85
        assert errors[-1] < 2e-3 * np.abs(exact).max()

    @pytest.mark.slow
    def test_convergence_reaches_what_it_says(self) -> None:
        """The error of scrambled points falls as N^-1.5 for a picture as smooth as this."""
        exact, reference = self.integral(), Reference(self.scene())
        found = [reference.converged(self.COARSE.middle, tolerance) for tolerance in (1e-3, 3e-5)]
        errors = [float(np.sqrt(np.mean((one.color - exact) ** 2))) for one in found]
        for one, error, tolerance in zip(found, errors, (1e-3, 3e-5), strict=True):
            assert one.error <= tolerance
            # The error comes from 8 estimates that pixels share in part: Student's t, 7 degrees, at 1e-4.
            assert error <= 7.1 * one.error
        order = np.log(errors[1] / errors[0]) / np.log(found[1].points / found[0].points)
        assert order < -1.1

    def test_other_seeds_are_other_points_and_their_spread_is_the_error(self) -> None:
        exact, reference = self.integral(), Reference(self.scene())
        found = [reference.converged(self.COARSE.middle, 1.0, seed=seed) for seed in range(12)]
        actual = np.sqrt(np.mean([(one.color - exact) ** 2 for one in found]))
        claimed = np.sqrt(np.mean([one.error**2 for one in found]))
        # Twelve independent estimates know a spread to 1 / sqrt(24): four times that.
        assert 0.2 < actual / claimed < 1.8

    def test_what_does_not_converge_ends_and_says_so(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(averages, "MAX_SAMPLES", 64)
        found = Reference(self.scene()).converged(self.COARSE.middle, tolerance=0.0)
        assert found.points == 64
        assert found.error > 0
