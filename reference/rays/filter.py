"""Filter in doubles: intersections of rays and triangles, with bounds of all roundings.

Let q_i = p_i - o and e_ij = p_j - p_i. The sign of d . (q_i x e_ij) is the side on which the line
o + t d passes the edge (i, j); the line meets the plane at t = (q_0 . n) / (d . n). q_i and e_ij
are differences of doubles with one rounding each, so the derivation for `cone`, whose edge
functions have q_j in place of e_ij, holds here too. The bounds are tighter, because edges are
shorter than the distance to a far origin.
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

#: Rounding bound of an edge function, relative to the sum of its absolute products: 7 u by the
#: derivation, and 1 u for the rounding of the bound itself
EDGE_ROUNDING = 8 * UNIT_ROUNDOFF

#: Underflow bound of a sum of products of three factors, for coordinates up to 2^42 and directions
#: up to 1: some 2^-1074 in each factor times the two other factors, below 2^-980
UNDERFLOW_BOUND = 2.0**-900


def meetings(
    corners: Sequence[Sequence[Any]],
    origin: Sequence[Any],
    direction: Sequence[Any],
    ends: Sequence[Any],
) -> tuple[Any, Any, Any, Any]:
    """Return t, its error bound, and whether rays certainly and possibly meet triangles.

    Each lane is a pair of a ray and a triangle; `corners` are the corners of the triangle, `ends`
    the first and last t of the ray.
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
    """Return t of rays in the planes of triangles, and its error, as for lines of an image."""
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
