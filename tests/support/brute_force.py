"""Truth without any cleverness: every triangle against every line, twice, by textbook formulas.

In double precision by Moeller and Trumbore ("Fast, minimum storage ray-triangle intersection",
1997), from an origin at the viewer's end of each line; and in rational numbers by Cramer's rule.
Nothing here is imported from the code under test: lines are arrays of doubles.
"""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from xfrustum.scenes.arrays import Floats, Indices

Vector = tuple[Fraction, Fraction, Fraction]

TRIANGLES_AT_ONCE = 32


@dataclass(frozen=True, kw_only=True)
class Hits:
    """The first surface on each of N lines.

    Attributes
    ----------
    triangle
        (N,) number of the triangle met first, -1 where a line meets none.
    s, second
        (N,) where it meets the first, and where the next; infinite where there is none.
    """

    triangle: Indices
    s: Floats
    second: Floats


def first_hits(triangles: Floats, center: Floats, d: Floats, s_range: tuple[float, float]) -> Hits:
    """Test triangles (F, 3, 3) against the lines center + s d, d (N, 3), s within a range."""
    start, length = s_range[0], s_range[1] - s_range[0]
    origin = [(center[axis] + start * d[:, axis])[:, None] for axis in range(3)]
    ray = [d[:, axis][:, None] for axis in range(3)]
    first = np.full(len(d), np.inf)
    second = first.copy()
    triangle = np.full(len(d), -1)
    lines = np.arange(len(d))
    for chunk in range(0, len(triangles), TRIANGLES_AT_ONCE):
        v0, v1, v2 = np.moveaxis(triangles[chunk : chunk + TRIANGLES_AT_ONCE], 1, 0)
        t = _moeller_trumbore(origin, ray, (v0.T, (v1 - v0).T, (v2 - v0).T))
        t[~((t >= 0) & (t <= length))] = np.inf
        nearest = t.argmin(axis=1)
        here = t[lines, nearest]
        t[lines, nearest] = np.inf
        second = np.minimum(np.minimum(second, t.min(axis=1)), np.maximum(here, first))
        triangle = np.where(here < first, chunk + nearest, triangle)
        first = np.minimum(first, here)
    return Hits(triangle=triangle, s=start + first, second=start + second)


def _moeller_trumbore(
    origin: list[Floats], ray: list[Floats], corner_and_edges: tuple[Floats, ...]
) -> Floats:
    """Return t of N lines and T triangles, (N, T), infinite where they do not meet."""
    v0, e1, e2 = corner_and_edges
    p = _cross(ray, e2)
    to_origin = [origin[axis] - v0[axis] for axis in range(3)]
    q = _cross(to_origin, e1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inverse = 1 / _dot(e1, p)
        u = _dot(to_origin, p) * inverse
        v = _dot(ray, q) * inverse
        t = _dot(e2, q) * inverse
        return np.where((u >= 0) & (v >= 0) & (u + v <= 1), t, np.inf)


def _cross(a: list[Floats] | Floats, b: list[Floats] | Floats) -> list[Floats]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _dot(a: list[Floats] | Floats, b: list[Floats] | Floats) -> Floats:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def exact_s(corners: Floats, center: Floats, d: Floats) -> Fraction | None:
    """Return s where the line center + s d meets a closed triangle (3, 3), None where it does not.

    Cramer's rule for center + s d = p0 + b (p1 - p0) + c (p2 - p0), in rational numbers. A line in
    the triangle's plane does not meet it.
    """
    p0, p1, p2 = (_rational(p) for p in corners)
    a, ray = _rational(center), _rational(d)
    minus_d: Vector = (-ray[0], -ray[1], -ray[2])
    e1, e2, right = _minus(p1, p0), _minus(p2, p0), _minus(a, p0)
    volume = _determinant(e1, e2, minus_d)
    if volume == 0:
        return None
    b, c = _determinant(right, e2, minus_d) / volume, _determinant(e1, right, minus_d) / volume
    if b < 0 or c < 0 or b + c > 1:
        return None
    return _determinant(e1, e2, right) / volume


def exact_first(
    triangles: Floats, center: Floats, d: Floats, s_range: tuple[float, float]
) -> tuple[Fraction | None, list[int]]:
    """Return where a line meets its first surface, and all triangles that it meets there."""
    hits = {
        number: s
        for number, corners in enumerate(triangles)
        if (s := exact_s(corners, center, d)) is not None and s_range[0] <= s <= s_range[1]
    }
    if not hits:
        return None, []
    first = min(hits.values())
    return first, [number for number, s in hits.items() if s == first]


def _rational(v: Floats) -> Vector:
    return Fraction(float(v[0])), Fraction(float(v[1])), Fraction(float(v[2]))


def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _determinant(a: Vector, b: Vector, c: Vector) -> Fraction:
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        - b[0] * (a[1] * c[2] - a[2] * c[1])
        + c[0] * (a[1] * b[2] - a[2] * b[1])
    )
