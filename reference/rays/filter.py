"""Narrow phase: intersections of rays and triangles, in doubles with bounds and in integers.

**Doubles.** Let q_i = p_i - o and e_ij = p_j - p_i. The sign of d . (q_i x e_ij) is the side on
which the line o + t d passes the edge (i, j); the line meets the plane at t = (q_0 . n) / (d . n).
q_i and e_ij are differences of doubles with one rounding each, so the derivation for `cone`, whose
edge functions have q_j in place of e_ij, holds here too. The bounds are tighter, because edges are
shorter than the distance to a far origin.

**Integers.** Doubles times a power of two are integers. NumPy arrays of Python integers evaluate
the same formulas without rounding.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.backend import cross, difference, dot, product
from xfrustum.reference.certify.cone import (
    EDGES,
    ROUNDING,
    UNIT_ROUNDOFF,
    Planes,
    RowPlanes,
    in_range,
)
from xfrustum.scenes.arrays import Floats, Mask

#: Rounding bound of an edge function, relative to the sum of its absolute products: 7 u by the
#: derivation, and 1 u for the rounding of the bound itself
EDGE_ROUNDING = 8 * UNIT_ROUNDOFF

#: Underflow bound of a sum of products of three factors, for coordinates up to 2^42 and directions
#: up to 1: an error of about 2^-1074 in one factor, times the other two factors, is below 2^-980
UNDERFLOW_BOUND = 2.0**-900


def meetings(
    corners: Sequence[Sequence[Any]],
    origin: Sequence[Any],
    direction: Sequence[Any],
    ends: Sequence[Any],
) -> tuple[Any, Any, Any, Any]:
    """Return t, its error bound, and whether rays certainly and possibly meet triangles.

    Each lane is a pair of a ray and a triangle; `corners` are the corners of the triangle, and
    `ends` are the first and last t of the ray.
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


Integers = NDArray[np.object_]  # Python integers


@dataclass(frozen=True, kw_only=True, eq=False)
class Meetings:
    """Pairs (K,): hits within the range, and t = offset / slope 2^digits."""

    met: Mask
    offset: Integers
    slope: Integers
    digits: int

    def place(self, pair: int) -> Fraction:
        """Return t of a pair with a hit."""
        shift = self.digits
        return Fraction(self.offset[pair] << max(shift, 0), self.slope[pair] << max(-shift, 0))


def meet(corners: Floats, origins: Floats, directions: Floats, ends: Floats) -> Meetings:
    """Decide whether rays (K, 3) meet triangles (K, 3, 3) at a t within ends (K, 2)."""
    (points, start), digits = integers(corners, origins)
    (along,), direction_digits = integers(directions)
    p, o, d = (coordinates(values) for values in (points, start, along))
    q = [difference([axis[:, k] for axis in p], o) for k in range(3)]
    normal = cross(difference(q[1], q[0]), difference(q[2], q[0]))
    slope, offset = dot(normal, d), dot(normal, q[0])
    sides = [dot(d, cross(q[i], q[j])) for i, j in ((0, 1), (1, 2), (2, 0))]
    above, below = (np.logical_or.reduce([(side * sign > 0) for side in sides]) for sign in (1, -1))
    # For ranges from zero to infinity, which are the most frequent, signs decide.
    plain = (ends[:, 0] == 0) & (ends[:, 1] == np.inf)
    forward = (offset == 0) | ((offset > 0) == (slope > 0))
    met = (slope != 0) & ~(above & below) & (forward | ~plain)
    result = Meetings(
        met=met.astype(np.bool_),
        offset=offset,
        slope=slope,
        digits=direction_digits - digits,
    )
    for pair in np.flatnonzero(result.met & ~plain).tolist():
        first, last = ends[pair].tolist()
        result.met[pair] = first <= result.place(pair) <= last
    return result


def integers(*values: Floats) -> tuple[list[Integers], int]:
    """Return doubles times 2^digits as integers, and `digits`."""
    mantissas, exponents = zip(*(np.frexp(part) for part in values), strict=True)
    used = [e[m != 0] for m, e in zip(mantissas, exponents, strict=True)]
    lowest = min((int(e.min()) for e in used if e.size), default=0)
    whole = [np.ldexp(m, 53).astype(np.int64).astype(object) for m in mantissas]
    shifts = [
        np.where(m != 0, e - lowest, 0).astype(object)
        for m, e in zip(mantissas, exponents, strict=True)
    ]
    return [m << shift for m, shift in zip(whole, shifts, strict=True)], 53 - lowest


def coordinates(vectors: Integers) -> list[Integers]:
    """Return the coordinates of vectors (..., 3)."""
    return list(np.moveaxis(vectors, -1, 0))


def nearest_double(value: Fraction) -> float:
    """Return the double nearest to a rational number, infinity beyond the range."""
    try:
        return float(value)
    except OverflowError:
        return np.inf if value > 0 else -np.inf
