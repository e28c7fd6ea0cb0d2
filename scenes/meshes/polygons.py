"""Triangulation of polygons, in their own plane.

Libraries (mapbox_earcut) drop corners on straight edges, which would cause cracks between
neighbors. Here a polygon of n corners always gives n - 2 triangles.

For any triangulation of a polygon, the signed areas of the triangles add up to the polygon's area
by Newell's formula. The triangulation of an outline that does not cross itself is therefore correct
if no triangle faces against Newell's normal: no area is covered twice or left out. A fan also needs
an outline with a total turn of 360 degrees. Wrong ears of an outline that crosses itself are not
always detected: its ends may overlap, like the ends of a split ring.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Floats, Indices, Mask

#: Largest number of corners of a polygon that the fan does not cut; time grows with its square.
MAX_CONCAVE_CORNERS = 4_000
#: Rounding error of a cross product of coordinates of at most one, in units of the coordinates'
#: rounding error.
_ROUNDINGS = 16
_SPIKE = 1e-6  # radians; if an outline goes back on itself, rounding decides the sign of the turn


def cut_polygons(
    points: Floats, corners: Indices, counts: Indices, refuse: Callable[[int, str], InputError]
) -> Indices:
    """Return (T, 3) indices into `corners` of the triangles of polygons, polygon by polygon.

    The fan from a polygon's first corner is used if it is correct; the second triangle of a
    quadrilateral then begins at its third corner, as in trimesh. Polygons that are not flat are
    projected along Newell's normal; their fan is used if all its triangles face along this normal.

    Parameters ---------- points : (V, 3) coordinates corners : (K,) indices into `points`, polygon
    after polygon counts : (P,) numbers of corners of each polygon, at least 3 refuse : returns the
    error for a polygon number and a reason
    """
    first = np.cumsum(counts) - counts
    before = np.cumsum(counts - 2) - (counts - 2)  # triangles of earlier polygons
    triangles = np.empty((int((counts - 2).sum()), 3), np.int64)
    # Polygons of equal size are processed together: most files have one or two sizes.
    for count in np.unique(counts).tolist():
        which = np.flatnonzero(counts == count)
        local = np.repeat(_fan(count)[None], len(which), axis=0)
        if count > 3:
            polygons = points[corners[first[which, None] + np.arange(count)]]
            _mend(polygons, local, which, refuse)
        triangles[before[which, None] + np.arange(count - 2)] = first[which, None, None] + local
    return triangles


def sizes_together(counts: Indices) -> Indices:
    """Return the indices, in polygon order, of triangles in trimesh's order.

    Triangles come first, then first halves of quadrilaterals, then their second halves, then fans.
    """
    size = np.repeat(np.minimum(counts, 5), counts - 2)
    within = np.arange(len(size)) - np.repeat(np.cumsum(counts - 2) - (counts - 2), counts - 2)
    return np.lexsort((np.where(size == 4, within, 0), size))


def _fan(count: int) -> Indices:
    if count == 4:
        return np.array([[0, 1, 2], [2, 3, 0]])
    second = np.arange(1, count - 1)
    return np.stack([np.zeros_like(second), second, second + 1], axis=1)


def _mend(
    polygons: Floats, local: Indices, numbers: Indices, refuse: Callable[[int, str], InputError]
) -> None:
    """Replace the triangles (P, n - 2, 3) of each polygon (P, n, 3) whose fan is wrong."""
    count = polygons.shape[1]
    size = np.ptp(polygons, axis=1).max(axis=1)
    doubt = np.abs(polygons).max(axis=(1, 2))  # coordinates are rounded in proportion to themselves
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        shape = (polygons - polygons[:, :1]) / size[:, None, None]
        doubt = _ROUNDINGS * np.finfo(np.float64).eps * (1 + doubt / size)
    crosses = np.cross(shape[:, 1:-1], shape[:, 2:])
    newell = crosses.sum(axis=1)
    area = np.linalg.norm(newell, axis=1)
    flat = (np.linalg.norm(crosses, axis=2) <= doubt[:, None]).all(axis=1)  # corners on one line
    # Skip sizes that are zero or not finite: the checks that all formats share refuse them.
    normals = newell / np.where(area > 0, area, 1.0)[:, None]
    wrong = np.isfinite(doubt) & ~flat & ((area <= doubt) | ~_all_face(crosses, normals, doubt))
    # A concave quadrilateral has exactly one correct diagonal.
    if count == 4:  # the other diagonal
        halves = np.stack(
            [
                np.cross(shape[:, b] - shape[:, a], shape[:, c] - shape[:, a])
                for a, b, c in ((1, 2, 3), (3, 0, 1))
            ],
            axis=1,
        )
        other = wrong & (area > doubt) & _all_face(halves, normals, doubt)
        local[other] = [[1, 2, 3], [3, 0, 1]]
        wrong &= ~other
    twice = np.zeros(len(local), np.bool_)
    if count > 4:  # a quadrilateral cannot go around twice
        twice = np.isfinite(doubt) & (area > doubt) & (_turning(shape, normals, doubt) > 3 * np.pi)
    for place in np.flatnonzero(wrong | twice).tolist():
        if count > MAX_CONCAVE_CORNERS and not twice[place]:
            limit = f"is concave and has {count:,} corners, more than {MAX_CONCAVE_CORNERS:,}"
            raise refuse(int(numbers[place]), f"{limit}; cut it into triangles")
        ears = None
        if area[place] > doubt[place] and not twice[place]:
            ears = _clip_ears(shape[place] @ _plane(normals[place]).T, float(doubt[place]))
        if ears is None:
            raise refuse(
                int(numbers[place]),
                "crosses or covers itself, and has no surface; mend the mesh",
            )
        local[place] = ears


def _all_face(crosses: Floats, normals: Floats, doubt: Floats) -> Mask:
    """Return a mask (P,): True if all triangles of a polygon face along its normal."""
    facing = np.einsum("ptx,px->pt", crosses, normals)
    return np.asarray((facing >= -doubt[:, None]).all(axis=1))


def _turning(shape: Floats, normals: Floats, doubt: Floats) -> Floats:
    """Return the total turns (P,) of outlines about the normals, radians; a spike counts as -pi.

    An outline that does not meet itself turns by 360 degrees, an outline that goes around twice by
    720.
    """
    count = shape.shape[1]
    edges = np.roll(shape, -1, axis=1) - shape
    edges -= np.einsum("ptx,px->pt", edges, normals)[..., None] * normals[:, None]
    edges = np.concatenate([edges, edges], axis=1)
    long = np.linalg.norm(edges, axis=2) > doubt[:, None]
    last = np.maximum.accumulate(
        np.where(long, np.arange(2 * count), 0), axis=1
    )  # skip edges between coincident corners
    edges = np.take_along_axis(edges, last[..., None], axis=1)[:, count - 1 :]
    sines = np.einsum("ptx,px->pt", np.cross(edges[:, :-1], edges[:, 1:]), normals)
    turns = np.arctan2(sines, np.einsum("ptx,ptx->pt", edges[:, :-1], edges[:, 1:]))
    return np.asarray(np.where(np.abs(turns) > np.pi - _SPIKE, -np.pi, turns).sum(axis=1))


def _plane(normal: Floats) -> Floats:
    """Return (2, 3) axes of the plane of a unit normal; the normal points to the viewer."""
    across = np.cross(np.eye(3)[np.argmin(np.abs(normal))], normal)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(normal, across)])


def _clip_ears(corners: Floats, doubt: float) -> list[tuple[int, int, int]] | None:
    """Return counterclockwise triangles of a polygon (n, 2); None if it crosses itself."""
    count = len(corners)
    left_over = corners.copy()  # NaN where a corner is cut off
    before, after = (np.roll(np.arange(count), step).tolist() for step in (1, -1))

    def triangle(tip: int) -> tuple[int, int, int]:
        return before[tip], tip, after[tip]

    def is_ear(tip: int) -> bool:
        a, b, c = three = corners[list(triangle(tip))]
        if _turn(a, b, c) <= doubt:
            return False
        inside = _turn(a, b, left_over) >= -doubt
        inside &= (_turn(b, c, left_over) >= -doubt) & (_turn(c, a, left_over) >= -doubt)
        # Bridges to holes pass through a corner twice: other corners in the same place are not
        # obstacles.
        return bool((corners[inside, None] == three).all(axis=2).any(axis=1).all())

    ears = np.array([is_ear(tip) for tip in range(count)])
    clipped: list[tuple[int, int, int]] = []
    while len(clipped) < count - 3:
        tips = np.flatnonzero(ears).tolist()
        if not tips:
            alone = np.flatnonzero(~np.isnan(left_over[:, 0])).tolist()
            tips = [
                tip
                for tip in alone
                if is_ear(tip) or abs(_turn(*corners[list(triangle(tip))])) <= doubt
            ]
            if not tips:
                return None
        tip = tips[0]
        clipped.append(triangle(tip))
        left_over[tip], ears[tip] = np.nan, False
        left, right = before[tip], after[tip]
        after[left], before[right] = right, left
        ears[left], ears[right] = is_ear(left), is_ear(right)
    last = triangle(int(np.nanargmax(left_over[:, 0])))
    return [*clipped, last] if _turn(*corners[list(last)]) >= -doubt else None


def _turn(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return twice the areas of triangles a b c, positive for left turns; c is (..., 2)."""
    c = np.asarray(c)
    return np.asarray((b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0]))
