"""True views and replayed views, compared with whole hogels and rational brute force."""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from tests.support.brute_force import exact_first
from tests.support.exact_brute_force import possible_pairs
from tests.support.long_tail import kept
from tests.support.views import view
from xfrustum.reference import Reference
from xfrustum.reference.eye import EyeReference
from xfrustum.scenes import InputError, Scene
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.eye import Eye

EYE = Eye(position=(7.0, -4.0, 500.0), resolution=(60, 45))


def coarse(scene: Scene) -> Scene:
    """Return the scene with a plate of 12 x 9 hogels: a view has many pixels of each hogel."""
    return replace(scene, plate=replace(scene.plate, hogels=(12, 9)))


@pytest.mark.parametrize(
    "name", kept(["asymmetric-recentered", "car-studio"], ["asymmetric-recentered"])
)
def test_a_replayed_view_has_the_pixels_of_whole_hogels_bit_for_bit(name: str) -> None:
    scene = coarse(view(name, (64, 48)))
    reference, eyes = Reference(scene), EyeReference(scene)
    pixels, replayed = eyes.replay(EYE).shown, eyes.replayed(EYE)
    hogels = {
        (int(i), int(j)) for i in pixels.hogel_column for j in pixels.hogel_row if min(i, j) >= 0
    }
    count = 0
    for column, row in sorted(hogels)[::19]:
        whole = reference.trace(scene.plate.aperture(column, row))
        rows, columns = pixels.hogel_row == row, pixels.hogel_column == column
        here, there = (
            np.ix_(rows, columns),
            np.ix_(pixels.film_row[rows], pixels.film_column[columns]),
        )
        for array in ("triangle", "position", "color"):
            np.testing.assert_array_equal(
                getattr(replayed, array)[here], getattr(whole, array)[there]
            )
        count += replayed.triangle[here].size
    assert count >= 100


def film(scene: Scene, column: int, row: int) -> tuple[Floats, Floats]:
    """Return shear and half-extent of a hogel's film by definition."""
    screen, aperture = scene.frustum.screen, scene.plate.aperture(column, row)
    if screen is None:
        return np.zeros(2), np.array([math.tan(angle / 2) for angle in scene.frustum.fov or ()])
    shear = (np.array(screen.center) - (aperture.x, aperture.y)) / -screen.height
    return shear, np.array(screen.size) / 2 / abs(screen.height)


def expected_pixel(
    scene: Scene, eye: Eye, column: int, row: int
) -> tuple[int, int, int, int] | None:
    """Return the hogel and the pixel that a ray meets, in rational numbers; None if none.

    Rays meet the plate at the centers of equal cells, at fractions (`right`, `down`) of its size.
    """
    right, down = (
        Fraction(2 * number + 1, 2 * count)
        for number, count in zip((column, row), eye.resolution, strict=True)
    )
    i, j = int(right * scene.plate.hogels[0]), int(down * scene.plate.hogels[1])
    width, height = map(Fraction, scene.plate.size)
    target = (right - Fraction(1, 2)) * width, (Fraction(1, 2) - down) * height
    x, y, z = map(Fraction, eye.position)
    slope = (target[0] - x) / z, (target[1] - y) / z
    shear, half_extent = film(scene, i, j)
    u, v = (
        (slope[axis] - Fraction(shear[axis])) / Fraction(half_extent[axis]) for axis in range(2)
    )
    if max(abs(u), abs(v)) > 1:
        return None
    count = scene.frustum.resolution
    return i, j, int((u + 1) * count[0] / 2), int((1 - v) * count[1] / 2)


@pytest.mark.parametrize("name", ["asymmetric", "asymmetric-recentered"])
def test_every_ray_takes_the_hogel_and_the_pixel_of_the_definition(name: str) -> None:
    scene = view(name, (64, 48))
    # The number of rays is prime, so that no ray meets a border between two hogels.
    eye = replace(EYE, resolution=(37, 29), position=(11.0, -6.0, 330.0))
    pixels = EyeReference(scene).replay(eye).shown
    for row in range(0, 29, 4):
        for column in range(0, 37, 4):
            result = (pixels.hogel_column[column], pixels.hogel_row[row])
            film = (pixels.film_column[column], pixels.film_row[row])
            expected = expected_pixel(scene, eye, column, row)
            assert ((*result, *film) if min(*result, *film) >= 0 else None) == expected


@pytest.mark.parametrize(
    "name", kept(["crossing", "asymmetric", "asymmetric-recentered"], ["asymmetric"])
)
def test_rays_of_the_true_view_agree_with_rational_brute_force(name: str) -> None:
    """Compare some rays with all triangles; pixels of the replayed view are compared above."""
    scene, eye = view(name, (64, 48)), replace(EYE, resolution=(120, 90))
    eyes = EyeReference(scene)
    true, bundle = eyes.true_view(eye, shaded=False), eyes.bundle(eye)
    covered, random = np.argwhere(true.covered), np.random.default_rng(18)
    center = np.array(bundle.center)
    for row, column in random.choice(covered, 20, replace=False).tolist():
        line = np.array([bundle.dx[column], bundle.dy[row], -1.0])
        # Omit triangles that the ray certainly misses.
        numbers = np.flatnonzero(possible_pairs(scene.triangles - center, line[None])[0])
        _, winners = exact_first(scene.triangles[numbers], center, line, bundle.s_range)
        assert true.triangle[row, column] == numbers[winners[0]]


def test_a_tent_is_a_mean_of_four_pixels_and_a_pupil_a_mean_of_its_points() -> None:
    scene = view("crossing", (64, 48))
    eyes = EyeReference(scene)
    tent = eyes.replay(replace(EYE, beam="tent"))  # type: ignore[arg-type]  # fields by name
    weights = np.zeros((45, 60))
    for part in tent.colors:
        weights += np.multiply.outer(part.row_weight, part.column_weight)
    inner = np.ix_(tent.shown.rows, tent.shown.columns)
    # Rounding of four products and three sums of numbers below 1
    assert np.abs(weights[inner] - 1).max() < 1e-15 * 8
    pupil = eyes.replay(replace(EYE, pupil=4.0))
    total = sum(
        np.multiply.outer(part.row_weight, part.column_weight).max() for part in pupil.colors
    )
    assert abs(total - 1) < 1e-12


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"position": (0.0, 0.0, -5.0)}, "before the plate"),
        ({"position": (0.0, 0.0)}, "before the plate"),
        ({"resolution": (0, 3)}, "resolution"),
        ({"pupil": -1.0}, "pupil"),
        ({"focus": 600.0}, "focus"),
        ({"beam": "disc"}, "beam"),
    ],
)
def test_an_eye_that_cannot_be_is_refused(wrong: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Eye(**{"position": (0.0, 0.0, 500.0), **wrong})  # type: ignore[arg-type]  # wrong
