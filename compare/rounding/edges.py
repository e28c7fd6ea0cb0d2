"""Edges that rounding may move across a pixel's center: mesh edges, cuts, and clipping seams.

A renderer that clips triangles at its film and at its near and far planes draws the remaining
polygon as several triangles. The specification leaves the triangulation undefined, but the sides
shared by two of these triangles are diagonals of the polygon. The mesh does not have these edges.
"""

from itertools import combinations
from typing import NamedTuple, assert_never

import numpy as np

from xfrustum.compare.rounding.triangles import (
    AFTER_NEXT,
    FLOAT32_ROUNDING,
    NEXT,
    FilmTriangles,
    PixelTriangles,
)
from xfrustum.reference.lines import RayBundle
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.plate import DepthMapping

FAR_ROUNDINGS = 4
"""Roundings of 2^-24 w in w - z: two in z, one in w, one in the difference.

The sign of w - z is the test at the far plane."""


def far_cuts(film: FilmTriangles) -> tuple[Floats, Floats]:
    """Return the smallest and largest 1 / w at which the far plane may cut triangles, (T,) each.

    Where clip depth equals w at the far plane, w - z is n (f - w) / (f - n), or twice this. Float32
    computes it at each corner with an error of at most `FAR_ROUNDINGS` times 2^-24 w. Between two
    corners the difference is linear, and so is its error: the cut lies where |w - z| is at most the
    larger of the two errors, that is, within (f - n) / n times this error of w = f. If this
    distance exceeds f, as with n below 2^-24 w, the cut may lie at any distance, even beside or
    behind the camera. Reversed clip depth is zero at the far plane, so that no difference is
    rounded. Parallel lines have w = 1 and depth linear in s: the error of the difference is at most
    `FAR_ROUNDINGS` times 2^-24 of the reach, and the function returns s in place of 1 / w.
    """
    n, f = film.planes
    if film.along is not None:
        moved = FAR_ROUNDINGS * FLOAT32_ROUNDING * (f - n)
        return f - moved, f + moved
    match film.precision.mapping:
        case DepthMapping.REVERSED:
            return 1 / f, 1 / f
        # Where fragments write depth, clip depth may be standard or reversed: the larger bound
        # holds for both.
        case (
            DepthMapping.STANDARD | DepthMapping.GL | DepthMapping.LOGARITHMIC | DepthMapping.LINEAR
        ):
            w = np.maximum(np.abs(film.vertices[..., 2]).max(axis=1, initial=0.0), f)
            moved = FAR_ROUNDINGS * FLOAT32_ROUNDING * w * (f - n) / n
            with np.errstate(divide="ignore"):
                return 1 / (f + moved), 1 / np.maximum(f - moved, 0.0)
        case _:
            assert_never(film.precision.mapping)


class Placement(NamedTuple):
    """Positions of pixel centers relative to the triangles drawn there, one triangle per pixel.

    If a center is `possible` but outside its triangle, it is also `near_edge`.
    """

    #: (N,) the center lies inside the triangle, or outside by no more than rounding can move an
    #: edge
    possible: Mask
    #: (N,) the center is possible, and rounding may have put it on the wrong side of an edge, or of
    #: a cut by the near plane or the reach
    near_edge: Mask
    #: (N,) the center is near an edge that rounding may move farther than snapping does: near a
    #: cut, or where coordinates are rounded coarsely, such as close to the camera's own plane
    near_moved: Mask
    #: (N,) the center is possible, and the far plane may cut the triangle there: see `far_cuts`
    near_cut: Mask


def placement(shown: PixelTriangles) -> Placement:
    """Locate pixel centers relative to triangles, within the rounding errors of a rasterizer.

    Clip coordinates of vertices are rounded to float32, which changes the homogeneous edge function
    by up to a sum of products. Then vertices are rounded to the subpixel grid, which moves an edge
    by up to sqrt(2)/2 of the grid's step. The depth mapping determines the precision of the cut by
    the far plane.
    """
    film = shown.film
    functions = np.concatenate((film.lines, film.plane[None]))
    moved, volume_bound = _perturbation(film)
    values = shown.linear_at(functions, shown.points)
    shifts = shown.linear_at(moved, np.abs(shown.points))
    snapped = shown.each(film.precision.snap_px * per_pixel(functions, film.resolution))

    # The center lies inside if all three edge functions have the same sign; each has an error of at
    # most its margin.
    sides, margins = values[:3], snapped[:3] + shifts
    possible = (sides >= -margins).all(axis=0) | (sides <= margins).all(axis=0)
    near = np.abs(sides) <= margins
    moves = (near & (shifts > snapped[:3])).any(axis=0)

    # Cuts by the near and far plane are edges too. On the triangle, 1/s = plane . (u, v,
    # 1) / volume.
    volume = np.abs(film.volume)
    inverse = values[3] * shown.each(np.where(film.orthoscopic, 1.0, -1.0) * np.sign(film.volume))
    margin = snapped[3] + shifts.sum(axis=0)
    n, f = film.planes

    def may_be_cut(low: Floats, high: Floats) -> Mask:
        if film.along is not None:
            return _may_be_between(shown, film.along, (sides, shifts), (low, high))
        # A triangle seen edge-on has no volume, and no cut.
        with np.errstate(invalid="ignore"):
            begin, end = volume * low - volume_bound * low, volume * high + volume_bound * high
        return np.asarray(
            (inverse >= shown.each(begin) - margin) & (inverse <= shown.each(end) + margin)
        )

    first, last = (n, f) if film.along is not None else (1 / n, 1 / f)
    moves |= may_be_cut(first, first) | may_be_cut(last, last)
    edge: Mask = possible & (near.any(axis=0) | moves)
    return Placement(
        possible=np.asarray(possible),
        near_edge=edge,
        near_moved=possible & moves,
        near_cut=possible & may_be_cut(*far_cuts(film)),
    )


def _may_be_between(
    shown: PixelTriangles, along: Floats, edges: tuple[Floats, Floats], ends: tuple[Floats, Floats]
) -> Mask:
    """Return the pixels (N,) at which s of parallel lines may lie between two ends (T,) each.

    `along` holds s of the corners and its error bounds, and `edges` holds the edge functions (3, N)
    and their bounds. The weight of a corner is the function of the opposite edge divided by the
    volume, so that s - end has the sign of sum((s_k - end) E_k). Float32 changes each factor of
    this sum, and snapping changes the sum as a whole.
    """
    film, (sides, shifts) = shown.film, edges
    turn = shown.each(np.sign(film.volume))
    s, error = (part.T[list(AFTER_NEXT)] for part in along)

    def beyond(end: Floats) -> tuple[Floats, Floats]:
        rise = s - end
        plane = np.einsum("kt,ktc->tc", rise, film.lines)
        snapped = film.precision.snap_px * per_pixel(plane, film.resolution)
        at, unsure = shown.each(rise), shown.each(error)
        margin = np.abs(at) * shifts + unsure * (np.abs(sides) + shifts)
        return turn * (at * sides).sum(axis=0), shown.each(snapped) + margin.sum(axis=0)

    (over_first, first_margin), (over_last, last_margin) = map(beyond, ends)
    return np.asarray((over_first >= -first_margin) & (over_last <= last_margin))


def per_pixel(functions: Floats, resolution: tuple[int, int]) -> Floats:
    """Return the change per pixel of linear functions (..., 3) of (u, v, 1)."""
    return np.hypot(functions[..., 0] * 2 / resolution[0], functions[..., 1] * 2 / resolution[1])


def _perturbation(film: FilmTriangles) -> tuple[Floats, Floats]:
    """Return bounds of the float32 errors of the lines (3, T, 3) and of the volume (T,)."""
    size, bound = np.abs(film.vertices), film.bound
    # Sums of absolute products in a x b, for each corner a and the next one b.
    begins = [(part.take(NEXT, axis=-1), part.take(AFTER_NEXT, axis=-1)) for part in (size, bound)]
    ends = [tuple(side.take(NEXT, axis=1) for side in pair) for pair in begins]

    def magnitude(a: int, b: int) -> Floats:
        (next_a, after_a), (next_b, after_b) = begins[a], ends[b]
        return np.asarray(next_a * after_b + after_a * next_b)

    moved = magnitude(0, 1) + magnitude(1, 0) + magnitude(1, 1)
    # The volume is the product of the first corner with the line from the second corner to the
    # third.
    volume_bound = np.einsum("ij,ij->i", size[:, 0] + bound[:, 0], moved[:, 1])
    volume_bound += np.einsum("ij,ij->i", bound[:, 0], magnitude(0, 0)[:, 1])
    return np.ascontiguousarray(moved.transpose(1, 0, 2)), volume_bound


def seams(corners: Floats, bundle: RayBundle, shift: tuple[float, float]) -> Floats:
    """Return the diagonals (K, 2, 2) of the polygon that clipping leaves of a triangle (3, 3).

    The ends of each diagonal are in pixels from the film's left and upper border. K is 0 if the
    triangle is not cut, or if the polygon has at most three corners. The camera's lines run through
    the sampling points, which are shifted from the pixel centers by `shift` (columns, rows); the
    film's borders are not shifted.
    """
    polygon, bounds = _clip_places(corners, bundle, shift), _clip_bounds(bundle)
    for bound in bounds:
        polygon = _cut(polygon, polygon @ bound)
    count = len(polygon)
    diagonals = [(i, j) for i, j in combinations(range(count), 2) if j - i not in (1, count - 1)]
    places: Floats = polygon[:, :2] / polygon[:, 2:3]
    return places[np.array(diagonals, dtype=np.int64).reshape(-1, 2)]


def clipped(corners: Floats, bundle: RayBundle, shift: tuple[float, float]) -> Mask:
    """Return the triangles (T, 3, 3) that clipping cuts and keeps; only these have seams."""
    beyond = np.less(_clip_places(corners, bundle, shift) @ _clip_bounds(bundle).T, 0.0)
    nothing_left = np.any(np.all(beyond, axis=1), axis=1)
    return np.asarray(np.any(beyond, axis=(1, 2)) & ~nothing_left)


def _clip_places(corners: Floats, bundle: RayBundle, shift: tuple[float, float]) -> Floats:
    """Return homogeneous positions (.., 4) of corners (.., 3): from left, from top, w, and 1."""
    width, height = bundle.resolution
    q = corners - np.asarray(bundle.center)
    # In front of the camera s is positive for C and negative for C*; w, the distance along the
    # axis, is positive for both cameras.
    side = 1.0 if sum(bundle.s_range) > 0 else -1.0
    w = -side * q[..., 2]
    film = (side * q[..., :2] - w[..., None] * bundle.shear) / bundle.half_extent
    left = (film[..., 0] + w) * width / 2 + shift[0] * w
    top = (w - film[..., 1]) * height / 2 + shift[1] * w
    return np.stack((left, top, w, np.ones_like(w)), axis=-1)


def _clip_bounds(bundle: RayBundle) -> Floats:
    """Return the linear functions (6, 4) of the clip planes, at least zero inside."""
    (width, height), (begin, end) = bundle.resolution, sorted(abs(s) for s in bundle.s_range)
    bounds = (
        (0, 0, 1, -begin),
        (0, 0, -1, end),
        (1, 0, 0, 0),
        (-1, 0, width, 0),
        (0, 1, 0, 0),
        (0, -1, height, 0),
    )
    return np.array(bounds, dtype=np.float64)


def distance_to_segments(points: Floats, segments: Floats) -> Floats:
    """Return distances (N,) of points (N, 2) from the nearest of some segments (K, 2, 2)."""
    nearest = np.full(len(points), np.inf)
    for start, end in segments:
        along = end - start
        squared = float(along @ along)
        share = (
            np.clip((points - start) @ along / squared, 0.0, 1.0)
            if squared > 0
            else np.zeros(len(points))
        )
        nearest = np.minimum(
            nearest, np.linalg.norm(points - start - share[:, None] * along, axis=1)
        )
    return nearest


def distance_to_border(points: Floats, resolution: tuple[int, int]) -> Floats:
    """Return distances (N,) of points from the nearest border line of a film, in pixels."""
    off = np.full(len(points), np.inf)
    for place, extent in zip(points.T, resolution, strict=True):
        off = np.minimum(off, np.minimum(np.abs(place), np.abs(place - extent)))
    return off


def _cut(polygon: Floats, bound: Floats) -> Floats:
    """Return the part of a convex polygon (N, 4) where a linear function is not negative."""
    kept = []
    for i, here in enumerate(polygon):
        following, next_bound = polygon[i - len(polygon) + 1], bound[i - len(polygon) + 1]
        if bound[i] >= 0:
            kept.append(here)
        if (bound[i] >= 0) != (next_bound >= 0):
            kept.append(here + (following - here) * (bound[i] / (bound[i] - next_bound)))
    return np.array(kept).reshape(-1, 4)
