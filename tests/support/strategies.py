"""Random small scenes for hypothesis, many of them with exact coincidences."""

import math

import numpy as np
from hypothesis import strategies as st

from tests.support.views import at
from xfrustum.scenes import Aperture, Frustum, Screen
from xfrustum.scenes.arrays import Floats

EIGHTHS = st.integers(-96, 96).map(lambda n: n / 8)
ANYTHING = st.floats(-12, 12).map(lambda x: x if abs(x) > 2.0**-100 else 0.0)
"""Coordinates without underflow in products, so that rounding bounds hold."""
REACH = 12.0


def apertures() -> st.SearchStrategy[Aperture]:
    """Return apertures on the plate of `views.soup`."""
    return st.builds(
        at, st.integers(-32, 32).map(lambda n: n / 4), st.integers(-32, 32).map(lambda n: n / 4)
    )


@st.composite
def frusta(draw: st.DrawFn, *, exact: bool = False) -> Frustum:
    """Return frusta, centered and recentered, with the screen on either side of the plate.

    `exact`: slopes are multiples of 1/64, so that lines have no rounding errors.
    """
    resolution = (draw(st.sampled_from([4, 8, 16])), draw(st.sampled_from([4, 8])))
    reach = (draw(st.sampled_from([REACH, 5.0])), draw(st.sampled_from([REACH, 7.0])))
    if not exact and draw(st.booleans()):
        angles = (draw(st.floats(20, 120)), draw(st.floats(20, 120)))
        return Frustum(
            resolution=resolution,
            reach=reach,
            fov=(math.radians(angles[0]), math.radians(angles[1])),
        )
    height = draw(
        st.sampled_from([-8.0, -4.0, 4.0, 8.0])
        if exact
        else st.sampled_from([-9.0, -3.5, 2.5, 11.0])
    )
    center = (draw(st.integers(-8, 8)) / 4, draw(st.integers(-8, 8)) / 4)
    size = (draw(st.sampled_from([8.0, 16.0])), draw(st.sampled_from([4.0, 16.0])))
    return Frustum(
        resolution=resolution, reach=reach, screen=Screen(height=height, center=center, size=size)
    )


@st.composite
def triangles(draw: st.DrawFn, *, coordinates: st.SearchStrategy[float] = EIGHTHS) -> Floats:
    """Return 1 to 8 triangles, (F, 3, 3)."""
    corner = st.tuples(coordinates, coordinates, coordinates)
    return np.array(draw(st.lists(st.tuples(corner, corner, corner), min_size=1, max_size=8)))


@st.composite
def near_misses(draw: st.DrawFn, center: Floats, lines: Floats) -> Floats:
    """Return triangles (F, 3, 3) whose corners lie on lines up to the last bit.

    Distances of lines from edges and corners, and of surfaces from each other, are about one
    rounding, on either side: plain floating point gets these cases wrong.
    """
    line, s = st.integers(0, len(lines) - 1), st.sampled_from([-7.3, -3.1, -1.7, 0.6, 2.3, 3.9])
    on_a_line = st.builds(lambda n, s: tuple((center + s * lines[n]).tolist()), line, s)
    points = draw(st.lists(on_a_line, min_size=3, max_size=9, unique=True))
    for _ in range(draw(st.integers(0, 4))):
        # A point on an edge or inside a triangle of an earlier round
        some = [points[draw(st.integers(0, len(points) - 1))] for _ in range(3)]
        share = draw(st.floats(0, 1))
        points.append(tuple((np.array(some[0]) * share + np.array(some[1]) * (1 - share)).tolist()))
        points.append(tuple((np.array(some).sum(axis=0) / 3).tolist()))
    corner = st.sampled_from(points)
    return np.array(draw(st.lists(st.tuples(corner, corner, corner), min_size=1, max_size=8)))


@st.composite
def coincidences(draw: st.DrawFn, center: Floats, lines: Floats) -> Floats:
    """Return triangles with corners that repeat, or lie on lines, in one plane, or in the center.

    Parameters
    ----------
    center, lines
        (3,) and (N, 3), with few digits, so that points on the lines are not rounded.
    """
    on_a_line = st.builds(
        lambda n, s: tuple((center + s * lines[n]).tolist()),
        st.integers(0, len(lines) - 1),
        st.sampled_from([-6.0, -3.0, -3.0, -1.0, 0.0, 0.5, 2.0, 2.0, 4.0]),
    )
    anywhere = st.tuples(EIGHTHS, EIGHTHS, EIGHTHS)
    level = st.tuples(EIGHTHS, EIGHTHS, st.just(-2.0))
    points = draw(
        st.lists(st.one_of(on_a_line, on_a_line, anywhere, level), min_size=3, max_size=9)
    )
    corner = st.sampled_from(points)
    drawn = draw(st.lists(st.tuples(corner, corner, corner), min_size=1, max_size=7))
    again = draw(st.lists(st.sampled_from(drawn), max_size=2))
    return np.array([*drawn, *((c, a, b) for a, b, c in again)])
