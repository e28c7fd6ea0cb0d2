"""Decisions of many ray-triangle pairs in integers.

Doubles times a power of two are integers. NumPy arrays of Python integers evaluate the formulas of
`filter` without rounding.
"""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.backend import cross, difference, dot
from xfrustum.scenes.arrays import Floats, Mask

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
    # For ranges from zero to infinity, the most frequent, signs decide.
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
