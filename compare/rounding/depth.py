"""How exactly a depth buffer knows the depth of a triangle at a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, assert_never

import numpy as np

from xfrustum.compare.rounding.positions import FLOAT32_ROUNDING
from xfrustum.compare.rounding.triangles import (
    CLIPPED_VERTEX_ROUNDINGS,
    NEXT,
    FilmTriangles,
    PixelTriangles,
)
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping

DEPTH_ROUNDINGS = 8
"""Roundings of 2^-24 in a depth that a fragment computes, and in the plane of a triangle that a plane cuts.

Four in the clip coordinate, one each for the division by w, the viewport, and the two steps of
the plane equation along x and y; relative to the largest term.
"""

GRADIENT_ROUNDINGS = 5
"""Roundings of 2^-24 in the gradient of a plane through three corners, relative to the products in it.

Each product of an edge and a difference of depth has five: the edge, the difference, the quotient of edge
and area, the product, and the difference of two products. The area has three in each of its two products,
and two after that. Where the corners lie nearly on one line these products are large and cancel.
"""

PLANE_ROUNDINGS = 11
"""Roundings of 2^-24 in a plane's value at a pixel, relative to that and to its rise from the film's corner.

Four in a corner's place in pixels (quotient, two products, a sum), one each in the two products and the two
sums that carry the plane to the film's corner, one each in the two products and the sum that carry it to the
pixel. Renderers that begin at the triangle have fewer.
"""

LOG_ULPS, LOG_NEAR_ONE = 6, 2.0**-21
"""Errors that GLSL allows a logarithm: 3 units in the last place (6 half units), or 2^-21 near one."""

STEP = {DepthFormat.D16: 2.0**-16, DepthFormat.D24: 2.0**-24, DepthFormat.D32F: 0.0}
"""Distance of neighboring stored values of the fixed-point formats."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Depths:
    """Depth of one triangle at each of some pixels, and how exactly a buffer knows it."""

    depth: Floats  #: (...) stored value 0..1 before rounding, NaN where there is no triangle
    tolerance: Floats  #: (...) how far the stored value may lie from `depth`
    clear: Floats  #: (...) value of the buffer before anything is drawn, NaN where there is no triangle

    def at(self, slots: Indices, shape: tuple[int, int, int]) -> list[Depths]:
        """Return these depths at their slots of an array (cameras, images, N), for each image.

        Everywhere else there is no triangle.
        """
        found = []
        for values, nothing in ((self.depth, np.nan), (self.tolerance, 0.0), (self.clear, np.nan)):
            whole = np.full(shape, nothing)
            whole.reshape(-1)[slots] = values
            found.append(whole.swapaxes(0, 1))
        return [Depths(depth=a, tolerance=b, clear=c) for a, b, c in zip(*found, strict=True)]

    def indistinguishable_from(self, other: Depths) -> Mask:
        """Return where a buffer may order two triangles either way."""
        return np.asarray(np.abs(self.depth - other.depth) <= self.tolerance + other.tolerance)

    def lost(self) -> Mask:
        """Return where a surface may not beat the clear value."""
        return np.asarray(np.abs(self.depth - self.clear) <= self.tolerance)


def depths(shown: PixelTriangles) -> Depths:
    """Return the depth of one triangle at each pixel, as its camera's buffer stores it.

    With w the distance along the axis, 1 / w is linear on the film, and so is what the hardware interpolates:
    1 / w itself where a fragment writes its depth, else depth, a + b / w; see `_plane_tolerance`.
    """
    film, precision = shown.film, shown.film.precision
    n, f = film.planes
    side = np.where(film.orthoscopic, 1.0, -1.0)
    mapping = precision.mapping
    low, high = precision.device.stored(precision.depth)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        over_w = side[:, None] * film.plane / film.volume[:, None]
        inverse = shown.linear_at(over_w[None], shown.points)[0]
        a, b = _linear_in_inverse(mapping, n, f)
        tolerance = _plane_tolerance(shown, over_w, inverse, (a, b))
        if mapping in (DepthMapping.LINEAR, DepthMapping.LOGARITHMIC):
            depth, tolerance = _written(mapping, inverse, tolerance, shown.each(n), shown.each(f))
        else:
            depth = shown.each(a) + shown.each(b) * inverse
    step = STEP[precision.depth]
    # What is stored lies between two bounds beside what was computed.
    tolerance += step * (high - low) / 2 + FLOAT32_ROUNDING * np.abs(depth)
    undefined = ~np.isfinite(depth)
    # C starts from its far value, C* from its near value.
    starts_at_one = film.orthoscopic == _one_at_far(mapping)
    return Depths(
        depth=np.where(undefined, np.nan, depth + step * (high + low) / 2),
        tolerance=np.where(undefined, 0.0, tolerance),
        clear=shown.each(np.where(starts_at_one, 1.0, 0.0)),
    )


def _plane_tolerance(
    shown: PixelTriangles, over_w: Floats, inverse: Floats, linear: tuple[Floats, Floats]
) -> Floats:
    """Return how far a + b / w at pixels (N,) may lie from that of the exact triangle; a and b are (T,).

    A device interpolates between corners V' = V + d in homogeneous coordinates: the triangle's, or those of
    a polygon that clipping makes of it, each a mean of the triangle's. At a pixel p the depth is
    sum(m_i Z'_i) with weights m_i >= 0 for which sum(m_i V'_i) = (p, 1). On the exact plane Z = G . V, so that

        depth' - depth = sum(m_i (dZ_i - G . d_i)),        sum(m_i w_i) = 1,

    whatever triangles the polygon is drawn as. Three things move corners, and one the plane between them:

    * snapping, by half a subpixel step along each axis, where the plane is taken from snapped vertices;
    * the float32 transform, by the bounds of each corner. A corner that clipping made has the bounds of the
      largest, and sum(m_i) is 1 / w of the pixel, but for what the same bounds do to 1 / w;
    * the setup of the plane from corners in pixels, `GRADIENT_ROUNDINGS` and `PLANE_ROUNDINGS`.
    """
    film, (a, b) = shown.film, (np.abs(one) for one in linear)
    (n, f), device = film.planes, film.precision.device
    resolution = np.asarray(film.resolution, dtype=np.float64)
    w = film.vertices[:, :, 2] * np.where(film.orthoscopic, 1.0, -1.0)[:, None]
    slope_px = np.abs(over_w[:, :2]) * (2 / resolution) * b[:, None]
    snapped = slope_px.sum(axis=1) * device.half_step if device.snaps_depth else np.zeros(len(b))
    aside = np.einsum("tc,tkc->tk", np.abs(over_w), film.bound)
    moved = b[:, None] * aside + 2 * a[:, None] * film.bound[:, :, 2]
    moved += CLIPPED_VERTEX_ROUNDINGS * FLOAT32_ROUNDING * b[:, None]
    weights = np.einsum("ktc,tk->tc", film.lines[NEXT, :], moved) / film.volume[:, None]
    whole = (w >= n[:, None]).all(axis=1) & (w <= f[:, None]).all(axis=1)
    of_corners = np.where(
        whole.take(shown.which),
        np.abs(shown.linear_at(weights[None], shown.points)[0]),
        np.abs(inverse) * shown.each(moved.max(axis=1) / np.maximum(1 - aside.max(axis=1), 0.0)),
    )
    ends = 1 / np.clip(np.stack((w.min(axis=1), w.max(axis=1))), n, f)
    signed_a, signed_b = linear
    largest = np.abs(signed_a + signed_b * ends).max(axis=0)
    if film.precision.mapping is DepthMapping.GL:
        # Clip depth -1..1 is halved and moved by a half: its roundings are relative to one.
        largest = np.maximum(largest, 1.0)
    cut = DEPTH_ROUNDINGS * (largest + slope_px @ resolution)
    places = film.vertices[:, :, :2] / film.vertices[:, :, 2:]
    setup = _setup_roundings(
        (places + 1) / 2 * resolution, signed_a[:, None] + signed_b[:, None] / w, slope_px, film
    )
    setup = np.where(whole, setup + PLANE_ROUNDINGS * largest, cut)
    return np.asarray(shown.each(snapped + FLOAT32_ROUNDING * setup) + of_corners)


def _setup_roundings(places: Floats, depth: Floats, slope_px: Floats, film: FilmTriangles) -> Floats:
    """Return the roundings of planes (T,) through corners at `places` (T, 3, 2), pixels, with depths (T, 3).

    Which corner a device starts from is not known: the worst of the three counts.
    """
    worst = np.zeros(len(depth))
    for i in range(3):
        one, other = places[:, i] - places[:, i - 2], places[:, i - 1] - places[:, i]
        rise, fall = np.abs(depth[:, i] - depth[:, i - 2]), np.abs(depth[:, i - 1] - depth[:, i])
        products = np.abs(one * other[:, ::-1])
        area = np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
        farthest = np.maximum(np.abs(one), np.abs(other))
        gradient = rise[:, None] * np.abs(other[:, ::-1]) + fall[:, None] * np.abs(one[:, ::-1])
        cancelled = (gradient * farthest).sum(axis=1) + products.sum(axis=1) * np.maximum(rise, fall)
        origin = (slope_px * (np.abs(places[:, i]) + np.asarray(film.resolution))).sum(axis=1)
        worst = np.maximum(worst, GRADIENT_ROUNDINGS * cancelled / area + PLANE_ROUNDINGS * origin)
    return worst


def _one_at_far(mapping: DepthMapping) -> bool:
    """Return whether a buffer stores one at the far plane and zero at the near plane, not the reverse."""
    match mapping:
        case DepthMapping.STANDARD | DepthMapping.GL | DepthMapping.LOGARITHMIC | DepthMapping.LINEAR:
            return True
        case DepthMapping.REVERSED:
            return False
        case _:
            assert_never(mapping)


def _linear_in_inverse(mapping: DepthMapping, n: Floats, f: Floats) -> tuple[Floats, Floats]:
    """Return a and b (T,) of what a device interpolates, a + b / w, between planes at n and f."""
    match mapping:
        case DepthMapping.LINEAR | DepthMapping.LOGARITHMIC:
            return np.zeros_like(n), np.ones_like(n)
        case DepthMapping.STANDARD | DepthMapping.GL:
            return f / (f - n), -n * f / (f - n)
        case DepthMapping.REVERSED:
            return -n / (f - n), n * f / (f - n)
        case _:
            assert_never(mapping)


def _written(
    mapping: Literal[DepthMapping.LINEAR, DepthMapping.LOGARITHMIC],
    inverse: Floats,
    known: Floats,
    n: Floats,
    f: Floats,
) -> tuple[Floats, Floats]:
    """Return the depth that fragments write, and how exactly, given how exactly 1 / w is `known`."""
    # The fragment takes w from the interpolated 1 / w.
    w = 1 / inverse
    of_w = w * known * w
    match mapping:
        case DepthMapping.LINEAR:
            span = f - n
            return (w - n) / span, (of_w + DEPTH_ROUNDINGS * FLOAT32_ROUNDING * w) / span
        case DepthMapping.LOGARITHMIC:
            octaves = np.log(f / n)
            log = np.log(np.maximum(w, n) / n)
            rounding = of_w / w + np.maximum(LOG_ULPS * FLOAT32_ROUNDING * log, LOG_NEAR_ONE)
            return np.log(w / n) / octaves, (rounding + DEPTH_ROUNDINGS * FLOAT32_ROUNDING * log) / octaves
        case _:
            assert_never(mapping)
