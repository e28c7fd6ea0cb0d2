"""Polygons: Newell's normal, ear clipping in rational arithmetic, and a test of triangulations."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from tests.second_reader.model import Floats, Refused

Point = tuple[Fraction, Fraction]
Labels = NDArray[np.int64]


def newell(polygon: Floats) -> Floats:
    """Return twice the vector area: the sum of the cross products of consecutive corners."""
    shape = polygon - polygon[0]  # subtract first: coordinates may be far from the origin
    return np.asarray(np.cross(shape, np.roll(shape, -1, axis=0)).sum(axis=0))


def cut(polygon: Floats) -> list[Floats]:
    """Cut a polygon into n - 2 triangles: clip ears exactly, projected along one axis."""
    if len(polygon) == 3:
        return [polygon]
    left, normal = list(range(len(polygon))), newell(polygon)
    if np.linalg.matrix_rank(polygon - polygon[0]) < 2:  # collinear corners: no area to clip
        return [polygon[[0, k, k + 1]] for k in range(1, len(left) - 1)]
    if not normal.any():
        raise Refused("a polygon crosses itself")
    axis = int(np.abs(normal).argmax())
    axes = [(axis + 1) % 3, (axis + 2) % 3][:: 1 if normal[axis] > 0 else -1]
    flat = [(Fraction(row[axes[0]]), Fraction(row[axes[1]])) for row in polygon.tolist()]
    triangles = []
    while len(left) > 2:
        place = _ear(flat, left)
        triangles.append(polygon[[left[place - 1], left[place], left[(place + 1) % len(left)]]])
        del left[place]
    return triangles


def _ear(flat: list[Point], left: list[int]) -> int:
    """Return the index in `left` of a corner without area or, if there is none, of an ear."""
    for empty in (True, False):
        for place in range(len(left)):
            before, here, after = (flat[left[(place + k) % len(left)]] for k in (-1, 0, 1))
            turn = _turn(before, here, after)
            if empty and turn == 0:
                return place
            others = (flat[k] for k in left if flat[k] not in (before, here, after))
            if not empty and turn > 0 and not any(_inside(p, before, here, after) for p in others):
                return place
    raise Refused("a polygon crosses itself")


def _turn(a: Point, b: Point, c: Point) -> Fraction:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _inside(point: Point, a: Point, b: Point, c: Point) -> bool:
    return _turn(a, b, point) >= 0 and _turn(b, c, point) >= 0 and _turn(c, a, point) >= 0


def is_cut_of(triangles: Floats, corners: Labels, polygon: Floats, outline: Labels) -> bool:
    """Test whether triangles (T, 3, 3) triangulate a polygon (n, 3).

    Equal labels mark equal corners: (T, 3) of the triangles, (n,) of the outline. Three conditions
    hold. There are n - 2 triangles. Their directed edges, without edges shared by two triangles,
    are the polygon's. No triangle is turned against Newell's normal. Areas then add up without
    overlap.
    """
    if len(triangles) != len(polygon) - 2:
        return False
    edges = _edges(outline)
    for triangle in corners:
        edges.subtract(_edges(triangle))
    if any(count != edges[(b, a)] for (a, b), count in list(edges.items())):
        return False
    normal = newell(polygon)
    size = float(np.linalg.norm(normal))
    scale = max(size, float(np.ptp(polygon, axis=0).max()) ** 2)
    far = float(np.abs(polygon).max())  # rounding of coordinates far from the origin
    slack = 64 * np.spacing(max(scale, far * scale**0.5)) * max(size, 1e-300)
    return all(float(newell(triangle) @ normal) >= -slack for triangle in triangles)


def _edges(outline: Labels) -> Counter[tuple[int, int]]:
    labels = outline.tolist()
    return Counter(zip(labels, labels[1:] + labels[:1], strict=True))
