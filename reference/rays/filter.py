"""Filter in doubles: whether rays meet triangles and where, with every rounding bounded.

For q_i = p_i - o and the edges e_ij = p_j - p_i, the line o + t d passes the edge (i, j) on the
side that the sign of d . (q_i x e_ij) states, and meets the plane at t = (q_0 . n) / (d . n). Both
factors are differences of doubles, each with one rounding: the derivation for `cone`, whose edge
functions have q_j for e_ij, holds here too. Bounds are tighter, because edges are shorter than the
way from a distant origin.
"""

from collections.abc import Sequence
from typing import Any

from xfrustum.reference.backend import difference, product
from xfrustum.reference.certify.cone import (
    EDGES,
    ROUNDING,
    UNIT_ROUNDOFF,
    Planes,
    RowPlanes,
    in_range,
)

#: Bound of the rounding of an edge function, relative to the sum of its absolute products: 7 u by
#: the derivation, and the rounding of the bound itself
EDGE_ROUNDING = 8 * UNIT_ROUNDOFF

#: Bound of the errors that underflow causes in a sum of products of three, where coordinates are at
#: most 2^42 and directions 1: some 2^-1074 of each factor times the two others, below 2^-980
UNDERFLOW_BOUND = 2.0**-900


def meetings(
    corners: Sequence[Sequence[Any]],
    origin: Sequence[Any],
    direction: Sequence[Any],
    ends: Sequence[Any],
) -> tuple[Any, Any, Any, Any]:
    """Return t, the bound of its error, whether rays surely meet triangles, and whether they may.

    One lane for each pair of a ray and a triangle, given by its three corners. `ends` are the
    first and last t of each ray.
    """
    positive, negative = [], []
    for i, j in EDGES:
        offset, edge = difference(corners[i], origin), difference(corners[j], corners[i])
        value, magnitude = triple_product(direction, offset, edge)
        bound = product(EDGE_ROUNDING, magnitude) + UNDERFLOW_BOUND
        positive.append(value > bound)
        negative.append(value < -bound)
    inside = (positive[0] & positive[1] & positive[2]) | (negative[0] & negative[1] & negative[2])
    outside = (positive[0] | positive[1] | positive[2]) & (negative[0] | negative[1] | negative[2])
    t, error = _planes_met(corners, origin, direction)
    possible, sure = in_range(t, error, False, ends)
    return t, error, sure & inside, possible & ~outside


def _planes_met(
    corners: Sequence[Sequence[Any]], origin: Sequence[Any], direction: Sequence[Any]
) -> tuple[Any, Any]:
    """Return t where rays meet triangles' planes, and its error, as for the lines of an image."""
    planes = Planes.from_points(corners, origin, False)
    (nx, ny, nz), (mx, my, mz) = planes.normal, planes.magnitude
    dx, dy, dz = direction
    along_row = RowPlanes(
        offset=planes.offset,
        bound=planes.bound + UNDERFLOW_BOUND,
        normal_x=nx,
        magnitude_x=mx,
        level=product(ny, dy) + product(nz, dz),
        # `RowPlanes` takes the magnitude times `ROUNDING`.
        level_magnitude=product(abs(dy), my) + product(abs(dz), mz) + UNDERFLOW_BOUND / ROUNDING,
    )
    return along_row.met(dx)


def triple_product(a: Sequence[Any], b: Sequence[Any], c: Sequence[Any]) -> tuple[Any, Any]:
    """Return a . (b x c), and the sum of its absolute products."""
    value, magnitude = 0.0, 0.0
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        first, second = product(b[j], c[k]), product(b[k], c[j])
        value = value + product(a[i], first - second)
        magnitude = magnitude + product(abs(a[i]), abs(first) + abs(second))
    return value, magnitude
