"""Polygons: Newell's normal, ear clipping in rational arithmetic, test of another reader's cut."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction

import numpy as np

from tests.second_reader.model import Floats, Refused

Point = tuple[Fraction, Fraction]


def newell(polygon: Floats) -> Floats:
    """Return the vector area: half the sum of the cross products of consecutive corners."""
    seen = polygon - polygon[0]  # differences first: coordinates may be far from the origin
    return np.asarray(np.cross(seen, np.roll(seen, -1, axis=0)).sum(axis=0) / 2)


def area(polygon: Floats) -> float:
    """Return the area of a flat polygon; of a warped one, of its projection along Newell's normal."""
    return float(np.linalg.norm(newell(polygon)))


def cut(polygon: Floats) -> list[Floats]:
    """Cut a polygon into n - 2 triangles: clip ears in the plane of Newell's normal."""
    left = list(range(len(polygon)))
    ears = _without_area(polygon, left)
    if len(left) > 3:
        normal = newell(polygon)
        if not normal.any():
            raise Refused("a polygon crosses itself")
        ears += _clipped(_flattened(polygon, normal), left)
    return [polygon[list(ear)] for ear in [*ears, tuple(left)]]


def _flattened(polygon: Floats, normal: Floats) -> list[Point]:
    """Project along the normal, exactly: onto u = e x n and n x u, that see its tip."""
    n = [Fraction(value) for value in (normal / np.abs(normal).max()).tolist()]
    e = [Fraction(int(k == np.argmin(np.abs(normal)))) for k in range(3)]
    u = _cross(e, n)
    v = _cross(n, u)
    space = [[Fraction(value) for value in corner] for corner in polygon.tolist()]
    return [(_dot(corner, u), _dot(corner, v)) for corner in space]


def _cross(a: list[Fraction], b: list[Fraction]) -> list[Fraction]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _dot(a: list[Fraction], b: list[Fraction]) -> Fraction:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _without_area(polygon: Floats, left: list[int]) -> list[tuple[int, int, int]]:
    """Clip corners that lie on a line with both neighbors, exactly and in space: spikes, repetitions."""
    ears = []
    space = (
        [[Fraction(value) for value in corner] for corner in polygon.tolist()]
        if len(left) > 3
        else []
    )
    place = 0
    while len(left) > 3 and place < len(left):
        ear = (left[place - 1], left[place], left[(place + 1) % len(left)])
        one, other = (
            [b - a for a, b in zip(space[ear[0]], space[k], strict=True)] for k in ear[1:]
        )
        if not any(_cross(one, other)):
            ears.append(ear)
            del left[place]
            place = 0
        else:
            place += 1
    return ears


def _clipped(flat: list[Point], left: list[int]) -> list[tuple[int, int, int]]:
    """Clip ears until three corners are left."""
    ears = []
    while len(left) > 3:
        place = _ear(flat, left)
        ears.append((left[place - 1], left[place], left[(place + 1) % len(left)]))
        del left[place]
    if _turn(flat[left[0]], flat[left[1]], flat[left[2]]) < 0:
        raise Refused("a polygon crosses itself")
    return ears


def _ear(flat: list[Point], left: list[int]) -> int:
    """Return the place of a corner that spans no area, else that of an ear."""
    for wanted in (0, 1):
        for place in range(len(left)):
            before, here, after = (flat[left[(place + k) % len(left)]] for k in (-1, 0, 1))
            turn = _turn(before, here, after)
            if wanted == 0 and turn == 0:
                return place
            if wanted == 1 and turn > 0:
                others = (flat[k] for k in left if flat[k] not in (before, here, after))
                if not any(_inside(other, before, here, after) for other in others):
                    return place
    raise Refused("a polygon crosses itself")


def _turn(a: Point, b: Point, c: Point) -> Fraction:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _inside(point: Point, a: Point, b: Point, c: Point) -> bool:
    return _turn(a, b, point) >= 0 and _turn(b, c, point) >= 0 and _turn(c, a, point) >= 0


def key(corner: Floats) -> tuple[float, ...]:
    """Return the coordinates of a corner as a key; minus zero equals zero."""
    return tuple((corner + 0.0).tolist())


def is_cut_of(triangles: Floats, polygon: Floats) -> bool:
    """Test whether triangles are a cut of a polygon.

    Three conditions: n - 2 triangles; their directed edges, less those that two triangles share,
    are the polygon's; none is turned against Newell's normal. Areas then add up to the polygon's,
    without overlap.
    """
    if len(triangles) != len(polygon) - 2:
        return False
    edges = _edges(polygon)
    edges.subtract(edge for triangle in triangles for edge in _edges(triangle).elements())
    if any(count != edges[(b, a)] for (a, b), count in list(edges.items())):
        return False
    normal = newell(polygon)
    size = float(np.linalg.norm(normal))
    # The signs of areas are exact in the cut, and rounded here.
    slack = (
        64 * np.spacing(max(size, float(np.ptp(polygon, axis=0).max()) ** 2)) * max(size, 1e-300)
    )
    return all(float(newell(triangle) @ normal) >= -slack for triangle in triangles)


def _edges(polygon: Floats) -> Counter[tuple[tuple[float, ...], tuple[float, ...]]]:
    corners = [key(corner) for corner in polygon]
    return Counter(zip(corners, corners[1:] + corners[:1], strict=True))
