"""The plain truth: every triangle against every line, by two textbook formulas.

The formulas are those by Moeller and Trumbore ("Fast, minimum storage ray-triangle intersection",
1997), in double precision, and Cramer's rule, in rational numbers. The module imports nothing from
the code under test: lines are arrays of doubles.
"""

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from xfrustum.scenes.arrays import Floats


def meetings(triangles: Floats, center: Floats, d: Floats, s_range: tuple[float, float]) -> Floats:
    """Return s at which lines center + s d (N, 3) meet triangles (T, 3, 3).

    The result is (N, T), infinite where a line misses a triangle within the range.
    """
    e1, e2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    right = center - triangles[:, 0]
    p, q = np.cross(d[:, None], e2), np.cross(right, e1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inverse = 1 / np.einsum("tk,ntk->nt", e1, p)
        u, v = np.einsum("tk,ntk->nt", right, p) * inverse, d @ q.T * inverse
        s = np.einsum("tk,tk->t", e2, q) * inverse
        met = (u >= 0) & (v >= 0) & (u + v <= 1) & (s >= s_range[0]) & (s <= s_range[1])
    return np.where(met, s, np.inf)


def exact_s(corners: Floats, center: Floats, d: Floats) -> Fraction | None:
    """Return s where the line center + s d meets a closed triangle (3, 3), None if it misses.

    Cramer's rule for center + s d = p0 + b (p1 - p0) + c (p2 - p0). A line in the plane of
    the triangle counts as a miss.
    """
    ratios = [
        value.as_integer_ratio()
        for array in (corners, center, d)
        for value in array.ravel().tolist()
    ]
    # The rule is homogeneous: multiplied by their common denominator, coordinates are integers.
    scale = max(denominator for _, denominator in ratios)
    whole = [numerator * (scale // denominator) for numerator, denominator in ratios]
    p0, p1, p2, a, ray = (whole[start : start + 3] for start in range(0, 15, 3))
    minus_d = [-value for value in ray]
    e1, e2, right = _minus(p1, p0), _minus(p2, p0), _minus(a, p0)
    volume = _determinant(e1, e2, minus_d)
    if volume == 0:
        return None
    sign = 1 if volume > 0 else -1
    b = sign * _determinant(right, e2, minus_d)
    c = sign * _determinant(e1, right, minus_d)
    if b < 0 or c < 0 or b + c > abs(volume):
        return None
    return Fraction(_determinant(e1, e2, right), volume)


def exact_first(
    triangles: Floats, center: Floats, d: Floats, s_range: tuple[float, float]
) -> tuple[Fraction | None, list[int]]:
    """Return s of a line's first surface, and all triangles that the line meets there."""
    hits = {
        number: s
        for number, corners in enumerate(triangles)
        if (s := exact_s(corners, center, d)) is not None and s_range[0] <= s <= s_range[1]
    }
    first = min(hits.values(), default=None)
    return first, [number for number, s in hits.items() if s == first]


def _minus(a: Sequence[int], b: Sequence[int]) -> list[int]:
    return [x - y for x, y in zip(a, b, strict=True)]


def _determinant(a: Sequence[int], b: Sequence[int], c: Sequence[int]) -> int:
    # a . (b x c): negative indices count from the end, so that i - 2, i - 1 follow i cyclically.
    return sum(a[i] * (b[i - 2] * c[i - 1] - b[i - 1] * c[i - 2]) for i in range(3))
