"""Error bounds of quantities that a device interpolates over a triangle: depth, or 1 / w."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from xfrustum.compare.rounding.positions import FLOAT32_ROUNDING
from xfrustum.compare.rounding.triangles import NEXT
from xfrustum.reference.lines import cross_products
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.device_model import DeviceModel

CUT_ROUNDINGS = 8
"""Roundings of 2^-24 in the plane of a clipped triangle, relative to the largest term.

Four in the clip coordinate, one each for the division by w, the viewport, and the two steps of
the plane equation along x and y.
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

Four are in a corner's position in pixels (a quotient, two products, a sum). Extrapolating the plane
to the film's corner adds four (two products, two sums), and evaluating it at the pixel adds three
(two products, a sum). Renderers that evaluate the plane from a corner of the triangle have fewer.
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
