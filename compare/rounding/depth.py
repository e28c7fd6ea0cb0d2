"""Error bounds of depth: interpolated by a device over a triangle, and stored in a buffer.

A device interpolates depth, or 1 / w, over each triangle. It stores one depth for each pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, assert_never

import numpy as np

from xfrustum.compare.rounding.triangles import (
    CLIPPED_VERTEX_ROUNDINGS,
    FLOAT32_ROUNDING,
    NEXT,
    FilmTriangles,
    PixelTriangles,
    Precision,
)
from xfrustum.reference.lines import cross_products
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.plate import DepthFormat, DepthMapping

CUT_ROUNDINGS = 8
"""Roundings of 2^-24 in the plane of a clipped triangle, relative to the largest term.

There are four in the clip coordinate, and one each for the division by w, for the viewport, and for
the two steps of the plane equation along x and y.
"""

GRADIENT_ROUNDINGS = 5
"""Roundings of 2^-24 in the gradient of a plane through three corners, relative to its products.

Each product of an edge and a depth difference has five roundings: the edge, the depth difference,
the quotient of edge and area, the product, and the difference of two products. The area has three
roundings in each of its two products, and two more. If the corners lie nearly on one line, these
products are large and cancel.
"""

PLANE_ROUNDINGS = 11
"""Roundings of 2^-24 in the value of a plane at a pixel.

They are relative to the value and to its rise from the corner of the film.

Four of them are in a corner's position in pixels (a quotient, two products, a sum). Extrapolating
the plane to the film's corner adds four (two products, two sums), and evaluating it at the pixel
adds three (two products, a sum). Renderers that evaluate the plane from a corner of the triangle
have fewer.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Planes:
    """A quantity Z / w over triangles (T,) in homogeneous film coordinates, linear on the film.

    A device interpolates between corners V' = V + d of the triangle, or of the polygon that
    clipping leaves. The polygon's corners are weighted means of the triangle's corners. At a pixel
    p the device computes sum(m_i Z'_i) with weights m_i >= 0 for which sum(m_i V'_i) = (p, 1). On
    the exact plane Z = G . V, so that

        found - exact = sum(m_i (dZ_i - G . d_i)),        sum(m_i w_i) = 1,

    for every triangulation of the polygon. Three errors contribute; the first two move corners, and
    the third moves the plane between the corners:

    * snapping, by half a subpixel step along each axis, if the device computes the plane from
      snapped vertices;
    * float32 rounding, within the bounds of each corner. A corner made by clipping has the largest
      bound of the triangle's corners;
    * setup of the plane from corners in pixels, `GRADIENT_ROUNDINGS` and `PLANE_ROUNDINGS`.
    """

    #: (T, 3, 3) corners V = (x, y, w); x / w and y / w lie between -1 and 1 on the film
    vertices: Floats
    value: Floats  #: (T, 3) Z of the corners
    moved: Floats  #: (T, 3, 3) bounds of the float32 errors of V
    moved_value: Floats  #: (T, 3) bounds of the float32 errors of Z
    uncut: Mask  #: (T,) triangles that neither near nor far plane cuts
    largest: Floats  #: (T,) largest term of the quantity on the clipped triangle
    resolution: tuple[int, int]  #: W, H of the film in pixels

    @cached_property
    def weights(self) -> Floats:
        """(3, T, 3) weight of each corner at a film point as linear functions of (u, v, 1)."""
        following, after = (
            self.vertices.take(order, axis=1).reshape(-1, 3) for order in (NEXT, (2, 0, 1))
        )
        lines = cross_products(following, after).reshape(-1, 3, 3)
        volume = np.einsum("tc,tc->t", self.vertices[:, 0], lines[:, 0])
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray((lines / volume[:, None, None]).transpose(1, 0, 2))

    @cached_property
    def gradient(self) -> Floats:
        """(T, 3) gradient G: the quantity is G . (u, v, 1) on the film."""
        return np.asarray(np.einsum("ktc,tk->tc", self.weights, self.value))

    def exact(self, which: Indices, points: Floats) -> Floats:
        """Return the exact quantity of triangles `which` (N,) at film points (u, v, 1), (N, 3)."""
        return np.asarray(np.einsum("nc,nc->n", self.gradient.take(which, axis=0), points))

    def tolerance(self, which: Indices, points: Floats, device: DeviceModel) -> Floats:
        """Return the error bounds (N,) of the quantity that a device interpolates."""
        gradient, size = np.abs(self.gradient), np.asarray(self.resolution, dtype=np.float64)
        slope_px = gradient[:, :2] * (2 / size)
        snapped = slope_px.sum(axis=1) * device.half_step if device.snaps_depth else 0.0
        moved = np.einsum("tc,tkc->tk", gradient, self.moved) + self.moved_value
        each = np.einsum("ktc,tk->tc", self.weights, moved).take(which, axis=0)
        # sum(m_i) is 1 / w at the pixel, except for the effect of these errors on 1 / w itself.
        over_w = self.weights.sum(axis=0)
        aside = np.einsum("tc,tkc->tk", np.abs(over_w), self.moved).max(axis=1, initial=0.0)
        all_alike = moved.max(axis=1, initial=0.0) / np.maximum(1 - aside, 0.0)
        by_corners = np.where(
            self.uncut.take(which),
            np.abs(np.einsum("nc,nc->n", each, points)),
            np.abs(np.einsum("nc,nc->n", over_w.take(which, axis=0), points))
            * all_alike.take(which),
        )
        cut = CUT_ROUNDINGS * (self.largest + slope_px @ size)
        whole = self._setup(slope_px, size) + PLANE_ROUNDINGS * self.largest
        setup = snapped + FLOAT32_ROUNDING * np.where(self.uncut, whole, cut)
        return np.asarray(by_corners + setup.take(which))

    def varying(
        self, values: Floats, which: Indices, points: Floats, device: DeviceModel
    ) -> tuple[Floats, Floats]:
        """Return the exact values of a smooth varying (T, 3) at film points, and error bounds.

        The varying is the quotient of two planes, a / w and 1 / w. Snapping shifts both planes by
        the same offset: the value drawn at p is the exact value at a point within half a subpixel
        step of p. With v the exact value at p, a / w - v / w changes by its own slope over this
        step. Float32 rounding affects the two planes independently. The bound is infinite where
        1 / w may vanish.
        """
        w, size = self.vertices[..., 2], np.asarray(self.resolution, dtype=np.float64)
        largest = [(np.abs(value) / w).max(axis=1) for value in (values, np.ones_like(w))]
        over = replace(
            self, value=values, moved_value=FLOAT32_ROUNDING * np.abs(values), largest=largest[0]
        )
        inverse = replace(
            self, value=np.ones_like(w), moved_value=np.zeros_like(w), largest=largest[1]
        )
        one_over_w = inverse.exact(which, points)
        exact = over.exact(which, points) / one_over_w
        flat = inverse.gradient.take(which, axis=0)
        rises = over.gradient.take(which, axis=0) - exact[:, None] * flat
        step_px = device.half_step if device.snaps_depth else 0.0
        moved, less = (np.abs(slope[:, :2]) @ (2 / size) * step_px for slope in (rises, flat))
        unsnapped = replace(device, snaps_depth=False)
        doubt, of_w = (plane.tolerance(which, points, unsnapped) for plane in (over, inverse))
        least = one_over_w - less - of_w
        with np.errstate(divide="ignore"):
            off = (moved + doubt + np.abs(exact) * of_w) / np.maximum(least, 0.0)
        return exact, np.asarray(off + FLOAT32_ROUNDING * np.abs(exact))

    def _setup(self, slope_px: Floats, size: Floats) -> Floats:
        """Return the roundings (T,) of planes through corners in pixels, for the worst corner."""
        w = self.vertices[:, :, 2:]
        places, value = (self.vertices[:, :, :2] / w + 1) / 2 * size, self.value / w[..., 0]
        worst = np.zeros(len(value))
        for i in range(3):
            edge, next_edge = places[:, i] - places[:, i - 2], places[:, i - 1] - places[:, i]
            rise, fall = (
                np.abs(value[:, i] - value[:, i - 2]),
                np.abs(value[:, i - 1] - value[:, i]),
            )
            # The components are swapped: the extent of an edge along y enters the slope along x.
            crosswise, otherwise = np.abs(edge[:, ::-1]), np.abs(next_edge[:, ::-1])
            area = np.abs(edge[:, 0] * next_edge[:, 1] - edge[:, 1] * next_edge[:, 0])
            gradient = rise[:, None] * otherwise + fall[:, None] * crosswise
            farthest = np.maximum(np.abs(edge), np.abs(next_edge))
            products = (np.abs(edge) * otherwise).sum(axis=1) * np.maximum(rise, fall)
            cancelled = ((gradient * farthest).sum(axis=1) + products) / area
            origin = (slope_px * (np.abs(places[:, i]) + size)).sum(axis=1)
            worst = np.maximum(worst, GRADIENT_ROUNDINGS * cancelled + PLANE_ROUNDINGS * origin)
        return worst


DEPTH_ROUNDINGS = 8
"""Roundings of 2^-24 in a depth that a shader computes from w, relative to the largest term."""

LOG_ULPS, LOG_NEAR_ONE = 6, 2.0**-21
"""Errors that GLSL allows for a logarithm: 3 ULP (6 half units), or 2^-21 near one."""

STEP = {DepthFormat.D16: 2.0**-16, DepthFormat.D24: 2.0**-24, DepthFormat.D32F: 0.0}
"""Distance of neighboring stored values of the fixed-point formats."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Depths:
    """Depth of one triangle at each of some pixels, with error bounds."""

    depth: Floats  #: (...) stored value 0..1 before rounding, NaN where there is no triangle
    tolerance: Floats  #: (...) largest distance of the stored value from `depth`
    #: (...) value of the buffer before anything is drawn, NaN where there is no triangle
    clear: Floats

    def at(self, slots: Indices, shape: tuple[int, int, int]) -> list[Depths]:
        """Return depths (cameras, N) for each image, from slots of an array (cameras, images, N).

        All other slots have no triangle.
        """
        arrays = []
        for values, nothing in ((self.depth, np.nan), (self.tolerance, 0.0), (self.clear, np.nan)):
            whole = np.full(shape, nothing)
            whole.reshape(-1)[slots] = values
            arrays.append(whole.swapaxes(0, 1))
        return [Depths(depth=a, tolerance=b, clear=c) for a, b, c in zip(*arrays, strict=True)]

    def indistinguishable_from(self, other: Depths) -> Mask:
        """Return a mask of the pixels at which a depth test may pass either triangle."""
        return np.asarray(np.abs(self.depth - other.depth) <= self.tolerance + other.tolerance)

    def lost(self) -> Mask:
        """Return a mask of the pixels at which a surface may fail against the clear value."""
        return np.asarray(np.abs(self.depth - self.clear) <= self.tolerance)


def depths(shown: PixelTriangles) -> Depths:
    """Return the depth of one triangle at each pixel, as its camera's buffer stores it.

    Let w be the distance along the axis. 1 / w is linear on the film, and so is the quantity that
    the hardware interpolates: 1 / w itself if a fragment writes its depth, else depth, a + b / w.
    On parallel lines s is linear, and so is depth.
    """
    film, precision = shown.film, shown.film.precision
    if film.along is not None:
        return _linear_in_s(shown)
    (n, f), mapping = film.planes, precision.mapping
    a, b = _linear_in_inverse(mapping, n, f)
    over_w = np.where(film.orthoscopic, 1.0, -1.0)[:, None] * film.plane
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inverse = shown.linear_at((over_w / film.volume[:, None])[None], shown.points)[0]
        known = _planes(film, a, b).tolerance(shown.which, shown.points, precision.device)
        if mapping in (DepthMapping.LINEAR, DepthMapping.LOGARITHMIC):
            depth, tolerance = _written(mapping, inverse, known, shown.each(n), shown.each(f))
        else:
            depth, tolerance = shown.each(a) + shown.each(b) * inverse, known
    # A camera draws nothing behind itself, so these points have no depth.
    undefined = ~np.isfinite(depth) | (inverse <= 0)
    # The depth buffer of C is cleared to the far value, and the buffer of C* to the near value.
    starts_at_one = film.orthoscopic == (mapping is not DepthMapping.REVERSED)
    return _stored(
        np.where(undefined, np.nan, depth),
        np.where(undefined, 0.0, tolerance),
        shown.each(np.where(starts_at_one, 1.0, 0.0)),
        precision,
    )


def _stored(depth: Floats, tolerance: Floats, clear: Floats, precision: Precision) -> Depths:
    """Return computed depths as a buffer stores them: with an error between two bounds."""
    (low, high), step = precision.device.stored(precision.depth), STEP[precision.depth]
    tolerance = tolerance + step * (high - low) / 2 + FLOAT32_ROUNDING * np.abs(depth)
    return Depths(
        depth=depth + step * (high + low) / 2,
        tolerance=np.where(np.isnan(depth), 0.0, tolerance),
        clear=clear,
    )


def _linear_in_s(shown: PixelTriangles) -> Depths:
    """Return the depth (s - first) / (last - first) of parallel lines, as a buffer stores it."""
    film, precision = shown.film, shown.film.precision
    assert film.along is not None and precision.mapping is DepthMapping.STANDARD
    first, last = film.planes
    reach = (last - first)[:, None]
    s, error = film.along
    value = (s - first[:, None]) / reach
    uncut = ((value >= 0) & (value <= 1)).all(axis=1)
    planes = Planes(
        vertices=film.vertices,
        value=value,
        moved=film.bound,
        moved_value=error / reach,
        uncut=np.asarray(uncut),
        largest=np.clip(value.max(axis=1, initial=0.0), 0.0, 1.0),
        resolution=film.resolution,
    )
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        depth = planes.exact(shown.which, shown.points)
        tolerance = planes.tolerance(shown.which, shown.points, precision.device)
    # A triangle seen edge-on has no depth.
    depth = np.where(np.isfinite(depth), depth, np.nan)
    return _stored(depth, tolerance, np.ones_like(depth), precision)


def _planes(film: FilmTriangles, a: Floats, b: Floats) -> Planes:
    """Return the planes of the interpolated quantity a + b / w over triangles."""
    n, f = film.planes
    vertices = film.vertices * np.where(film.orthoscopic, 1.0, -1.0)[:, None, None]
    w, error = vertices[..., 2], film.bound[..., 2]
    ends = 1 / np.clip(np.stack((w.min(axis=1), w.max(axis=1))), n, f)
    largest = np.abs(a + b * ends).max(axis=0)
    if film.precision.mapping is DepthMapping.GL:
        # Clip depth -1..1 is halved and shifted by 1/2, so its roundings are relative to one.
        largest = np.maximum(largest, 1.0)
    constant = CLIPPED_VERTEX_ROUNDINGS * FLOAT32_ROUNDING * np.abs(b)
    return Planes(
        vertices=vertices,
        value=a[:, None] * w + b[:, None],
        moved=film.bound,
        moved_value=np.abs(a)[:, None] * error + constant[:, None],
        uncut=np.asarray((w >= n[:, None]).all(axis=1) & (w <= f[:, None]).all(axis=1)),
        largest=largest,
        resolution=film.resolution,
    )


def _linear_in_inverse(mapping: DepthMapping, n: Floats, f: Floats) -> tuple[Floats, Floats]:
    """Return a and b (T,) of the interpolated quantity a + b / w, with near n and far f."""
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
    """Return the depth written by fragments, with error bounds; `known` bounds errors of 1 / w."""
    # The fragment shader computes w from the interpolated 1 / w.
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
            return np.log(w / n) / octaves, (
                rounding + DEPTH_ROUNDINGS * FLOAT32_ROUNDING * log
            ) / octaves
        case _:
            assert_never(mapping)
