"""Edges that rounding may move across a pixel's center, with the far cut, which depends on the mapping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

import numpy as np

from xfrustum.compare.rounding.positions import FLOAT32_ROUNDING
from xfrustum.compare.rounding.triangles import AFTER_NEXT, NEXT, FilmTriangles, PixelTriangles
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.plate.double_frustum import DepthMapping

FAR_ROUNDINGS = 4
"""Roundings of 2^-24 w in w - z: two in z, one in w, one in the difference. Its sign is the test at the far
plane."""


def far_cut_rounding(film: FilmTriangles) -> Floats:
    """Return by how much 1 / w of the far cut of triangles may be off, (T,).

    Where clip depth runs up to w at the far plane, w - z = n (f - w) / (f - n), once or twice, is a
    small difference of large numbers, and the cut is interpolated between corners where it has an
    error relative to their w: for n below 2^-24 w it is nothing but rounding, and nothing is
    cut. Reversed clip depth is zero at the far plane and has no such difference.
    """
    n, f = film.planes
    match film.precision.mapping:
        case DepthMapping.REVERSED:
            return np.zeros_like(f)
        # Where fragments write depth, clip depth may run either way: the larger bound holds for both.
        case DepthMapping.STANDARD | DepthMapping.GL | DepthMapping.LOGARITHMIC | DepthMapping.LINEAR:
            w = np.abs(film.vertices[..., 2]).max(axis=1, initial=0.0)
            share = FAR_ROUNDINGS * FLOAT32_ROUNDING * np.maximum(w, f) / f * (f - n) / n
            return np.asarray(np.minimum(1.0, share) / f)
        case _:
            assert_never(film.precision.mapping)


@dataclass(frozen=True, kw_only=True)
class Placement:
    """Where pixel centers lie on the triangles that a camera drew there, one for each.

    A center outside its triangle that is `possible` is always `near_edge` as well.
    """

    #: (N,) the center lies inside the triangle, or outside by no more than rounding moves its edges
    possible: Mask
    #: (N,) the center is possible, and rounding may have put it on the wrong side of an edge, or of a cut by
    #: the near plane or the reach
    near_edge: Mask


def placement(shown: PixelTriangles) -> Placement:
    """Place pixel centers on triangles as a rasterizer's roundings may see them.

    Vertices are rounded to the subpixel grid, which moves an edge by up to sqrt(2)/2 of its step;
    before that their clip coordinates are rounded in float32, which moves the homogeneous edge
    function by up to a sum of products. The mapping of depth decides how exactly the far plane cuts.
    """
    film = shown.film
    functions = np.concatenate((film.lines, film.plane[None]))
    moved, volume_bound = _perturbation(film)
    values = shown.linear_at(functions, shown.points)
    shifts = shown.linear_at(moved, np.abs(shown.points))
    snapped = shown.each(film.precision.snap_px * _per_pixel(functions, film.resolution))

    # The center lies inside where all three edge functions have one sign; each is known within a margin.
    sides, margins = values[:3], snapped[:3] + shifts
    possible = (sides >= -margins).all(axis=0) | (sides <= margins).all(axis=0)
    near = (np.abs(sides) <= margins).any(axis=0)

    # Cuts by near and far plane are edges too. On the triangle, 1/s = plane . (u, v, 1) / volume.
    distances = np.abs(film.ends)
    is_far = distances == film.planes[1]
    far = np.where(is_far, np.abs(film.volume) * far_cut_rounding(film), 0.0)
    margins = snapped[3] + shifts.sum(axis=0) + shown.each(volume_bound / distances) + shown.each(far)
    near |= (np.abs(values[3] - shown.each(film.volume / film.ends)) <= margins).any(axis=0)
    return Placement(possible=np.asarray(possible), near_edge=np.asarray(possible & near))


def _per_pixel(functions: Floats, resolution: tuple[int, int]) -> Floats:
    """Return by how much linear functions (..., 3) of (u, v, 1) change per pixel."""
    return np.hypot(functions[..., 0] * 2 / resolution[0], functions[..., 1] * 2 / resolution[1])


def _perturbation(film: FilmTriangles) -> tuple[Floats, Floats]:
    """Return how far each coefficient of the lines (3, T, 3) and the volume (T,) move within the bounds."""
    size, bound = np.abs(film.vertices), film.bound
    # Sums of absolute products in a x b, for each corner a and the next one b.
    begins = [(one.take(NEXT, axis=-1), one.take(AFTER_NEXT, axis=-1)) for one in (size, bound)]
    ends = [tuple(side.take(NEXT, axis=1) for side in one) for one in begins]

    def magnitude(a: int, b: int) -> Floats:
        (next_a, after_a), (next_b, after_b) = begins[a], ends[b]
        return np.asarray(next_a * after_b + after_a * next_b)

    moved = magnitude(0, 1) + magnitude(1, 0) + magnitude(1, 1)
    # The volume is the product of the first corner with the line from the second corner to the third.
    volume_bound = np.einsum("ij,ij->i", size[:, 0] + bound[:, 0], moved[:, 1])
    volume_bound += np.einsum("ij,ij->i", bound[:, 0], magnitude(0, 0)[:, 1])
    return np.ascontiguousarray(moved.transpose(1, 0, 2)), volume_bound
