"""Meshes and rays on which floating point fails, for hypothesis, with answers in rationals."""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from hypothesis import strategies as st

from tests.support.brute_force import exact_s
from xfrustum.reference.rays.rays import RayBatch
from xfrustum.scenes.arrays import Floats

GRID = st.integers(-4, 4).map(lambda n: n / 2)
SMALL = st.floats(-2, 2, allow_subnormal=False)
#: magnitudes of a mesh's lengths, and of a direction: subnormal to 1e300
LENGTHS = st.sampled_from([1.0, 1.0, 2.0**-100, 2.0**100, 1e-30, 1e30, 3e7])
SPEEDS = st.sampled_from([1.0, 1.0, 0.1, 1e-30, 1e30, 5e-324, 1e-310, 1e300])
MIXED = st.sampled_from([1.0, 1.0, 1.0, 0.0, 1e-30, 1e-9, 1e9, 1e30])


@dataclass(frozen=True)
class Problem:
    """Triangles (F, 3, 3), and rays with their closed ranges of t."""

    triangles: Floats
    rays: RayBatch

    def hits(self, ray: int) -> list[tuple[Fraction, int]]:
        """Return t and triangle of all hits of a ray, nearest first, by Cramer's rule."""
        first, last = self.rays.ends[ray].tolist()
        met = (
            (exact_s(corners, self.rays.origins[ray], self.rays.directions[ray]), number)
            for number, corners in enumerate(self.triangles)
        )
        return sorted((t, number) for t, number in met if t is not None and first <= t <= last)


def points(coordinate: st.SearchStrategy[float]) -> st.SearchStrategy[tuple[float, ...]]:
    return st.tuples(coordinate, coordinate, coordinate)


@st.composite
def meshes(draw: st.DrawFn) -> Floats:
    """Draw 1 to 9 triangles: touching, duplicate, without area, of one scale or of many."""
    corners = draw(st.lists(points(draw(st.sampled_from([GRID, SMALL]))), min_size=3, max_size=7))
    if draw(st.booleans()):
        # Different magnitudes in one mesh
        corners = [tuple(x * draw(MIXED) for x in corner) for corner in corners]
    corner = st.sampled_from(corners)
    triangles = draw(st.lists(st.tuples(corner, corner, corner), min_size=1, max_size=7))
    again = draw(st.lists(st.sampled_from(triangles), max_size=2))
    mesh = np.array([*triangles, *((c, a, b) for a, b, c in again)])
    return mesh * draw(LENGTHS) + draw(st.sampled_from([0.0, 0.0, 1e6]))


@st.composite
def problems(draw: st.DrawFn) -> Problem:
    """Draw a mesh with rays from, through and along its vertices, edges and faces."""
    mesh = draw(meshes())
    size = float(np.abs(mesh).max())
    places = []
    for _ in range(draw(st.integers(2, 5))):
        a, b, c = mesh[draw(st.integers(0, len(mesh) - 1))]
        share = draw(st.sampled_from([0.0, 0.5, 1 / 3, 0.1]))
        edge = a + share * (b - a)
        places += [a, edge, edge + draw(st.sampled_from([0.5, 0.3])) * (c - edge)]
    away = [size * np.array(draw(points(SMALL))) for _ in range(2)]
    starts = [*places, *away, away[0] * 2.0**30, away[1] * 1e20, np.nextafter(places[0], np.inf)]
    origins, directions = [], []
    for _ in range(draw(st.integers(1, 8))):
        start, end = (starts[draw(st.integers(0, len(starts) - 1))] for _ in range(2))
        along = end - start
        kind = draw(st.sampled_from(["toward", "toward", "axis", "edge"]))
        if kind == "axis":
            along = np.roll([1.0, 0.0, 0.0], draw(st.integers(0, 2)))
        elif kind == "edge":
            a, b, _ = mesh[draw(st.integers(0, len(mesh) - 1))]
            along = b - a
        extent = float(np.abs(along).max())
        if extent > 0:
            along = along / extent * draw(SPEEDS)
        if along.any():
            origins.append(start)
            directions.append(along)
    count = len(origins)
    first = draw(st.sampled_from([0.0, 0.0, 0.0, 0.5, -np.inf, -1.0]))
    last = draw(st.sampled_from([np.inf, np.inf, 1.0, 2.0]))
    rays = RayBatch(
        origins=np.array(origins).reshape(count, 3),
        directions=np.array(directions).reshape(count, 3),
        ends=np.tile([first, last], (count, 1)),
    )
    return Problem(triangles=mesh, rays=rays)
