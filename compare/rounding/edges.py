"""Edges that rounding may move across a pixel's center, with the far cut, which depends on the mapping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

import numpy as np

from xfrustum.compare.rounding.cameras import Precision
from xfrustum.compare.rounding.positions import FLOAT32_ROUNDING
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.lines.planes import cross_products
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.scenes.plate.double_frustum import DepthMapping

PixelIndex = tuple[Indices, Indices]
"""Columns and rows of some pixels, (N,) each."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PixelTriangles:
    """One triangle at each of some pixels.

    Most triangles are shown at many pixels, and what depends on a triangle alone is found once for each.

    Attributes
    ----------
    pixels
        Columns and rows, (N,) each.
    corners
        (T, 3, 3) corners of the triangles, scene units, each triangle once.
    which
        (N,) place of each pixel's triangle among these.
    """

    pixels: PixelIndex
    corners: Floats
    which: Indices

    @classmethod
    def of(cls, triangles: Floats, number: Numbers, pixels: PixelIndex) -> PixelTriangles:
        """Take the triangles of some numbers (N,), all of which exist, out of those of a scene (F, 3, 3)."""
        # Neighbors mostly show the same triangle: runs of one number are fewer to sort than pixels.
        starts = np.flatnonzero(np.diff(number, prepend=NOTHING) != 0)
        distinct, run = np.unique(number[starts], return_inverse=True)
        which = np.repeat(run, np.diff(starts, append=len(number)))
        return cls(pixels=pixels, corners=triangles[distinct], which=which)

    def each(self, values: Floats) -> Floats:
        """Return for each pixel the value (N,) that its triangle has in (T,)."""
        return values.take(self.which)

    def linear_at(self, functions: Floats, points: Floats) -> Floats:
        """Return the triangles' linear functions (T, 3) of (u, v, 1) at the pixels' points (N, 3), (N,)."""
        return np.asarray(np.einsum("ij,ij->i", functions.take(self.which, axis=0), points))


_NEXT, _AFTER_NEXT = (1, 2, 0), (2, 0, 1)
"""Number of the corner or coordinate after each of three, and of the one after that."""

CLIPPED_VERTEX_ROUNDINGS = 16
"""Bound of the error of a float32 clip coordinate, in roundings of 2^-24 of the sum of its absolute terms.

One in the stored vertex, one in the matrix entry, four in products and sums: 6. Clipping at up to
three planes (near and two sides) makes new vertices, each with three more: 9. One to spare.
"""


def film_vertices(corners: Floats, pencil: Pencil) -> tuple[Floats, Floats]:
    """Return homogeneous film coordinates (x, y, s) of corners, and their float32 error bounds.

    u = x / s and v = y / s on the film; s is the distance from the center along the axis, negative
    for C*. Both (N, 3, 3).
    """
    relative = corners - np.asarray(pencil.center)
    s = -relative[..., 2]
    shear, half = np.asarray(pencil.shear), np.asarray(pencil.half_extent)
    lateral = (relative[..., :2] - shear * s[..., None]) / half
    # The terms that the transform adds up, before they cancel.
    terms = np.abs(corners[..., :2]) + np.abs(pencil.center[:2]) + np.abs(shear * s[..., None])
    bound = np.concatenate(
        (terms / half, (np.abs(corners[..., 2]) + abs(pencil.center[2]))[..., None]), axis=-1
    )
    vertices = np.concatenate((lateral, s[..., None]), axis=-1)
    return vertices, CLIPPED_VERTEX_ROUNDINGS * FLOAT32_ROUNDING * bound


def film_points(pencil: Pencil, pixels: PixelIndex) -> Floats:
    """Return (u, v, 1) of pixel centers, (N, 3)."""
    width, height = pencil.resolution
    columns, rows = pixels
    u, v = (2 * columns + 1) / width - 1, 1 - (2 * rows + 1) / height
    return np.stack((u, v, np.ones(len(u))), axis=-1)


FAR_ROUNDINGS = 4
"""Roundings of 2^-24 w in w - z: two in z, one in w, one in the difference. Its sign is the test at the far
plane."""


def far_cut_rounding(w: Floats, pencil: Pencil, mapping: DepthMapping) -> Floats:
    """Return by how much 1 / w of the far cut of triangles may be off, given their largest w.

    Where clip depth runs up to w at the far plane, w - z = n (f - w) / (f - n), once or twice, is a
    small difference of large numbers, and the cut is interpolated between corners where it has an
    error relative to their w: for n below 2^-24 w it is nothing but rounding, and nothing is
    cut. Reversed clip depth is zero at the far plane and has no such difference.
    """
    match mapping:
        case DepthMapping.REVERSED:
            return np.zeros_like(w)
        # Where fragments write depth, clip depth may run either way: the larger bound holds for both.
        case DepthMapping.STANDARD | DepthMapping.GL | DepthMapping.LOGARITHMIC | DepthMapping.LINEAR:
            n, f = sorted(abs(s) for s in pencil.s_range)
            share = FAR_ROUNDINGS * FLOAT32_ROUNDING * np.maximum(w, f) / f * (f - n) / n
            return np.asarray(np.minimum(1.0, share) / f)
        case _:
            assert_never(mapping)


@dataclass(frozen=True, kw_only=True)
class Placement:
    """Where pixel centers lie on the triangles that a camera drew there, one for each.

    A center outside its triangle that is `possible` is always `near_edge` as well.

    Attributes
    ----------
    possible
        (N,) the center lies inside the triangle, or outside by no more than rounding moves its edges.
    near_edge
        (N,) the center is possible, and rounding may have put it on the wrong side of an edge, or of
        a cut by the near plane or the reach.
    """

    possible: Mask
    near_edge: Mask


def placement(shown: PixelTriangles, pencil: Pencil, precision: Precision) -> Placement:
    """Place pixel centers on triangles as a rasterizer's roundings may see them.

    Vertices are rounded to the subpixel grid, which moves an edge by up to sqrt(2)/2 of its step;
    before that their clip coordinates are rounded in float32, which moves the homogeneous edge
    function by up to a sum of products.

    Parameters
    ----------
    shown
        One triangle for each pixel.
    pencil
        Lines of the camera that drew it.
    precision
        How exactly the camera draws; the mapping of depth decides how exactly the far plane cuts.
    """
    far = max(pencil.s_range, key=abs)
    vertices, bound = film_vertices(shown.corners, pencil)
    largest_w = np.abs(vertices[..., 2]).max(axis=1, initial=0.0)
    far_rounding = far_cut_rounding(largest_w, pencil, precision.mapping)
    points = film_points(pencil, shown.pixels)
    farthest = np.abs(points)

    # The center lies inside where all three edge functions have one sign; each is known within a margin.
    sides, margins = np.empty((3, len(points))), np.empty((3, len(points)))
    plane, plane_bound = np.zeros((len(vertices), 3)), np.zeros(len(points))
    # All three edges (T, 3, 3) at once, from each corner to the next one.
    following, next_bound = vertices.take(_NEXT, axis=1), bound.take(_NEXT, axis=1)
    lines = cross_products(vertices.reshape(-1, 3), following.reshape(-1, 3)).reshape(-1, 3, 3)
    moved = _perturbation(vertices, following, bound, next_bound)
    for k in range(3):
        line = lines[:, k]
        shift = shown.linear_at(moved[:, k], farthest)
        sides[k] = shown.linear_at(line, points)
        margins[k] = shown.each(precision.snap_px * _per_pixel(line, pencil.resolution)) + shift
        plane += line
        plane_bound += shift
    possible = (sides >= -margins).all(axis=0) | (sides <= margins).all(axis=0)
    near = (np.abs(sides) <= margins).any(axis=0)

    # Cuts by near and far plane are edges too. On the triangle, 1/s = plane . (u, v, 1) / volume.
    volume, volume_bound = _volume(vertices, bound)
    on_plane = shown.linear_at(plane, points)
    snapped = shown.each(precision.snap_px * _per_pixel(plane, pencil.resolution)) + plane_bound
    for cut in pencil.s_range:
        margin = snapped + shown.each(volume_bound / abs(cut))
        if cut == far:
            margin = margin + shown.each(np.abs(volume) * far_rounding)
        near |= np.abs(on_plane - shown.each(volume / cut)) <= margin
    return Placement(possible=np.asarray(possible), near_edge=np.asarray(possible & near))


def _per_pixel(line: Floats, resolution: tuple[int, int]) -> Floats:
    """Return by how much a linear function of (u, v) changes per pixel."""
    return np.hypot(line[:, 0] * 2 / resolution[0], line[:, 1] * 2 / resolution[1])


def _volume(vertices: Floats, bound: Floats) -> tuple[Floats, Floats]:
    """Return the determinants of the corners (N, 3, 3), and their bounds when corners move."""
    volume = np.einsum("ij,ij->i", vertices[:, 0], cross_products(vertices[:, 1], vertices[:, 2]))
    moved = _magnitude(vertices[:, 1], bound[:, 2]) + _magnitude(bound[:, 1], vertices[:, 2])
    moved += _magnitude(bound[:, 1], bound[:, 2])
    volume_bound = np.einsum("ij,ij->i", np.abs(vertices[:, 0]) + bound[:, 0], moved)
    volume_bound += np.einsum("ij,ij->i", bound[:, 0], _magnitude(vertices[:, 1], vertices[:, 2]))
    return volume, volume_bound


def _magnitude(a: Floats, b: Floats) -> Floats:
    """Return the sums of absolute products in a x b, of vectors (..., 3)."""
    a, b = np.abs(a), np.abs(b)
    found: Floats = a.take(_NEXT, axis=-1) * b.take(_AFTER_NEXT, axis=-1)
    found += a.take(_AFTER_NEXT, axis=-1) * b.take(_NEXT, axis=-1)
    return found


def _perturbation(a: Floats, b: Floats, a_bound: Floats, b_bound: Floats) -> Floats:
    """Return how far each coefficient of a x b moves when a and b move within their bounds."""
    return _magnitude(a, b_bound) + _magnitude(a_bound, b) + _magnitude(a_bound, b_bound)
