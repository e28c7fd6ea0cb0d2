"""Gaps: distance from each pixel's surface to the next surface that the same camera draws."""

import math

import numpy as np
import pytest

from tests.support.brute_force import meetings
from tests.support.views import at, lines_by_definition, soup
from xfrustum.reference import Reference
from xfrustum.scenes import Certainty, Frustum, Scene, Screen
from xfrustum.scenes.arrays import Floats

#: Largest difference of equal gaps relative to the reach: far above rounding, far below all gaps
ALIKE = 1e-9

#: Rounding of two surfaces' heights relative to |z|: a dozen roundings of 2^-53, in sums several
#: times as large
ROUNDED = 1e-13

#: Distance 3 from the plate, increased by a relative 1e-11
CLOSE = 3 * (1 + 1e-11)


def level_squares(heights: list[float], half_size: float = 100.0) -> Floats:
    """Return two triangles for each height: squares parallel to the plate."""
    corners = half_size * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    squares = [[[*corners[k], z] for k in ks] for z in heights for ks in ((0, 1, 2), (0, 2, 3))]
    return np.array(squares, dtype=np.float64)


def on_film(random: np.random.Generator, count: int) -> Floats:
    """Return triangles behind the plate at the left of the film, and before it at the right."""
    slopes = random.uniform(-0.7, 0.7, (count, 3, 2))
    side = np.where(np.arange(count) % 2, 1.0, -1.0)[:, None]
    slopes[..., 0] = -side * np.abs(slopes[..., 0])
    s = side * random.uniform(1, 8, (count, 3))
    return np.concatenate((slopes * s[..., None], -s[..., None]), axis=-1)


def by_brute_force(scene: Scene) -> Floats:
    """Return the gaps of all pixels, computed by textbook formulas from all triangles."""
    aperture, reach = scene.plate.middle, scene.frustum.reach
    center = np.array([aperture.x, aperture.y, 0.0])
    lines = lines_by_definition(scene, aperture).reshape(-1, 3)
    first, second = np.sort(meetings(scene.triangles, center, lines, (-reach[0], reach[1])))[
        :, :2
    ].T
    met_twice = np.isfinite(second) & ~((first < 0) & (second > 0))
    gaps = np.full(len(first), np.inf)
    np.subtract(second, first, out=gaps, where=met_twice)
    return gaps


FRUSTA = [
    Frustum(resolution=(24, 16), reach=(12.0, 9.0), fov=(math.radians(70), math.radians(50))),
    Frustum(
        resolution=(16, 24),
        reach=(9.0, 12.0),
        screen=Screen(height=5.0, center=(2, -1), size=(9, 7)),
    ),
]


@pytest.mark.parametrize("frustum", FRUSTA, ids=["centered", "recentered"])
@pytest.mark.parametrize("seed", range(3))
def test_gaps_are_those_of_brute_force(frustum: Frustum, seed: int) -> None:
    """Loose triangles lie on both sides of the plate, across it, and around the aperture."""
    random = np.random.default_rng(seed)
    scene = soup(np.concatenate((on_film(random, 16), random.uniform(-10, 10, (2, 3, 3)))), frustum)
    reference = Reference(scene)
    truth = reference.trace(scene.plate.middle)
    gaps = reference.gaps(scene.plate.middle)
    expected = by_brute_force(scene).reshape(gaps.shape)
    assert truth.certainty is not None and not (truth.certainty == Certainty.TIE).any()
    np.testing.assert_array_equal(np.isfinite(gaps), np.isfinite(expected))
    result = np.isfinite(gaps)
    assert (truth.height[result] < 0).any() and (truth.height[result] > 0).any()
    np.testing.assert_allclose(
        gaps[result], expected[result], rtol=0, atol=ALIKE * max(frustum.reach)
    )


@pytest.mark.parametrize(
    ("heights", "drawn", "gap"),
    [
        # C sorts away from the plate, and C* sorts toward it; their surfaces never mix.
        ([5.0, -3.0, -8.0], False, math.inf),
        ([5.0, 0.0], False, 5.0),
        ([0.0, -4.0, -5.0], False, 4.0),
        ([-3.0, -9.5], False, math.inf),  # beyond the reach
        # The next surface has a smaller number, hence is drawn earlier.
        ([-8.0, -3.0, -5.0], True, 5.0),
        ([3.0, -5.0, 8.0], True, 5.0),
        ([8.0, 3.0, 5.0], True, math.inf),
        # Surfaces a few roundings apart, and coincident surfaces
        ([-3.0, -CLOSE], False, CLOSE - 3),
        ([-3.0, -3.0], False, math.inf),
        ([-3.0, -3.0, -4.0], False, 1.0),
    ],
)
def test_gaps_of_level_squares_are_differences_of_heights(
    heights: list[float], drawn: bool, gap: float
) -> None:
    reference, aperture = Reference(soup(level_squares(heights), FRUSTA[0])), at(0.3, -0.2)
    gaps = reference.gaps(aperture, *([reference.trace(aperture)] if drawn else []))
    np.testing.assert_allclose(gaps, gap, rtol=0, atol=max(map(abs, heights)) * ROUNDED)
