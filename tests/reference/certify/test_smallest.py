"""The truth is exact for the smallest and largest coordinates; smaller ones raise InputError."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.exact_brute_force import hold_to_fractions
from tests.support.long_tail import examples
from tests.support.views import at, lines_by_definition, soup
from xfrustum.reference.certify.certify import first_surfaces
from xfrustum.reference.lines import crossed_frustum
from xfrustum.scenes import Frustum, InputError, Screen
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import LONGEST, SHORTEST, SMALLEST_COORDINATE
from xfrustum.scenes.plate import SMALLEST_SLOPE

FRUSTUM = Frustum(resolution=(5, 4), reach=(1e30, 1e30), fov=(math.radians(60), math.radians(50)))


def magnitudes(low: float, high: float) -> st.SearchStrategy[float]:
    """Return numbers of any magnitude between limits: either sign, few or many digits; and zero."""
    size = st.floats(math.log2(low), math.log2(high)).map(lambda e: 2.0**e)
    short = st.integers(math.ceil(math.log2(low)), math.floor(math.log2(high))).map(
        lambda e: 2.0**e
    )
    value = st.one_of(size, short, st.sampled_from([low, high]))
    return st.one_of(st.just(0.0), value, value.map(lambda v: -v))


@st.composite
def extreme_triangles(draw: st.DrawFn) -> Floats:
    """Return triangles with coordinates of one or many magnitudes, some a rounding step apart."""
    result: list[Floats] = []
    for _ in range(draw(st.integers(1, 4))):
        kind = draw(st.sampled_from(["any", "one size", "beside"]))
        if kind == "beside" and result:
            moved = result[-1].copy()
            corner = (draw(st.integers(0, 2)), draw(st.integers(0, 2)))
            moved[corner] = np.nextafter(moved[corner], np.inf) if moved[corner] else 0.0
            result.append(moved)
        elif kind == "one size":
            unit = draw(
                st.sampled_from([SMALLEST_COORDINATE, SMALLEST_COORDINATE, 2.0**-200, 1.0, 1e29])
            )
            coordinate = st.one_of(st.integers(-9, 9), st.floats(1, 9), st.floats(-9, -1))
            numbers = draw(st.lists(coordinate, min_size=9, max_size=9))
            result.append(unit * np.array(numbers, dtype=np.float64).reshape(3, 3))
        else:
            any_size = magnitudes(SMALLEST_COORDINATE, draw(st.sampled_from([1e-70, LONGEST])))
            result.append(np.array(draw(st.lists(any_size, min_size=9, max_size=9))).reshape(3, 3))
    triangles = np.array(result)
    # A rounding step may lead out of the range.
    triangles[np.abs(triangles) > LONGEST] = LONGEST
    triangles[np.abs(triangles) < SMALLEST_COORDINATE] = 0.0
    return triangles


def extreme_frusta() -> st.SearchStrategy[Frustum]:
    def screen(height: float, center: tuple[float, float], size: tuple[float, float]) -> Screen:
        # Rounded up, so that the number stays within the allowed range.
        least = 2 * abs(height) * SMALLEST_SLOPE * 1.001
        return Screen(height=height, center=center, size=(max(size[0], least), max(size[1], least)))

    screens = st.builds(
        screen,
        height=st.sampled_from([-1.0, 1e-9, 1e30, -1e18]),
        center=st.sampled_from([(0.0, 0.0), (SHORTEST, -SHORTEST), (3.0, 1e-20)]),
        size=st.sampled_from([(SHORTEST, SHORTEST), (8.0, 6.0), (1e-3, 7.0)]),
    ).map(lambda screen: replace(FRUSTUM, fov=None, screen=screen))
    flat = replace(FRUSTUM, fov=(2 * SMALLEST_SLOPE, math.radians(170)))
    return st.one_of(st.just(FRUSTUM), st.just(flat), screens)


@examples(60)
@given(
    extreme_triangles(),
    extreme_frusta(),
    st.sampled_from([(0.0, 0.0), (0.0, 0.0), (0.5, -1.5), (2.0**-60, 0.0)]),
)
def test_the_truth_is_that_of_fractions_whatever_the_sizes(
    triangles: Floats, frustum: Frustum, place: tuple[float, float]
) -> None:
    aperture = at(*place)
    scene = soup(triangles, frustum)
    image = first_surfaces(scene.triangles, crossed_frustum(frustum, aperture))
    cameras = [(np.array([*place, 0.0]), (-frustum.reach[0], frustum.reach[1]))]
    hold_to_fractions(image, scene.triangles, lines_by_definition(scene, aperture), cameras)


@pytest.mark.parametrize("size", [1e-76, 1e-106, 5e-324])
def test_smaller_coordinates_are_refused_even_among_larger_ones(size: float) -> None:
    """Cubes underflow at 1e-106: 522 of 16,384 pixels and 1,752 ties were once wrong."""
    near = np.array([[(-1.0, -1.0, -1.0), (2.0, -1.0, -1.0), (0.0, 2.0, -1.0)]])
    for triangles in (size * near, np.concatenate([size * near, near])):
        with pytest.raises(
            InputError, match=r"soup has a coordinate of .*, which is not zero but below 1e-75"
        ):
            soup(triangles, FRUSTUM)
    item = near.copy()
    item[0, 1, 1] = -size
    with pytest.raises(InputError, match="below 1e-75"):
        soup(item, FRUSTUM)
