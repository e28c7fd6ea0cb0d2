"""How exactly a depth buffer knows the depth of a triangle at a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, assert_never

import numpy as np

from xfrustum.compare.rounding.positions import FLOAT32_ROUNDING
from xfrustum.compare.rounding.triangles import PixelTriangles
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping

DEPTH_ROUNDINGS = 8
"""Roundings of 2^-24 in a float32 depth, relative to its largest term.

Four in the clip coordinate, one each for the division by w, the viewport, and the two steps of
the plane equation along x and y.
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

    With w the distance along the axis, 1 / w is linear on the film. A shift by half a subpixel step
    along each axis changes depth by its slope; 1 / w, or the depth that is linear in it, is known
    within the float32 roundings of its plane equation, which starts at a corner of the image.
    """
    film, precision = shown.film, shown.film.precision
    n, f = film.planes
    side = np.where(film.orthoscopic, 1.0, -1.0)
    w = film.vertices[:, :, 2] * side[:, None]
    resolution = np.asarray(film.resolution, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        over_w = side[:, None] * film.plane / film.volume[:, None]
        inverse = shown.linear_at(over_w[None], shown.points)[0]
        slope_px = np.abs(over_w[:, :2]) * (2 / resolution)
        shift = shown.each(slope_px.sum(axis=1) * 2.0 ** -(precision.subpixel_bits + 1))
        ends = shown.each(1 / np.clip(np.stack((w.min(axis=1), w.max(axis=1))), n, f))
        extent = shown.each(slope_px @ resolution)
        depth, per_inverse, rounding = _mapped(
            precision.mapping, inverse, ends, extent, shown.each(n), shown.each(f)
        )
        # A corner that the far plane cuts off is made anew from one with errors relative to its own w.
        beyond = shown.each(np.maximum(w.max(axis=1, initial=0.0) / f, 1.0))
        tolerance = shift * per_inverse + rounding * beyond
    tolerance += STEP[precision.depth] / 2 + FLOAT32_ROUNDING * np.abs(depth)
    undefined = ~np.isfinite(depth)
    # C starts from its far value, C* from its near value.
    starts_at_one = film.orthoscopic == _one_at_far(precision.mapping)
    return Depths(
        depth=np.where(undefined, np.nan, depth),
        tolerance=np.where(undefined, 0.0, tolerance),
        clear=shown.each(np.where(starts_at_one, 1.0, 0.0)),
    )


def _one_at_far(mapping: DepthMapping) -> bool:
    """Return whether a buffer stores one at the far plane and zero at the near plane, not the reverse."""
    match mapping:
        case DepthMapping.STANDARD | DepthMapping.GL | DepthMapping.LOGARITHMIC | DepthMapping.LINEAR:
            return True
        case DepthMapping.REVERSED:
            return False
        case _:
            assert_never(mapping)


def _mapped(
    mapping: DepthMapping, inverse: Floats, ends: Floats, extent: Floats, n: Floats, f: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return depth, its derivative by 1 / w, and the bound of its float32 roundings.

    `inverse` (N,) is 1 / w at the pixel; `ends` (2, N) at the nearest and farthest corner, or where near
    plane and reach cut; `extent` (N,) by how much it changes over the image; `n` and `f` are distances of the
    planes.
    """
    match mapping:
        case DepthMapping.LINEAR | DepthMapping.LOGARITHMIC:
            return _written(mapping, inverse, ends.max(axis=0) + extent, n, f)
        case DepthMapping.STANDARD | DepthMapping.GL:
            a, b = f / (f - n), -n * f / (f - n)
        case DepthMapping.REVERSED:
            a, b = -n / (f - n), n * f / (f - n)
        case _:
            assert_never(mapping)
    largest = np.abs(a + b * ends).max(axis=0) + np.abs(b) * extent
    if mapping is DepthMapping.GL:
        # Clip depth -1..1 is halved and moved by a half: its roundings are relative to one.
        largest = np.maximum(largest, 1.0)
    rounding = DEPTH_ROUNDINGS * FLOAT32_ROUNDING * largest
    return a + b * inverse, np.abs(b), rounding


def _written(
    mapping: Literal[DepthMapping.LINEAR, DepthMapping.LOGARITHMIC],
    inverse: Floats,
    largest: Floats,
    n: Floats,
    f: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Return the same as `_mapped` where fragments write depth; `largest` (N,) bounds the terms of 1 / w."""
    # The fragment takes w from the interpolated 1 / w.
    w = 1 / inverse
    of_w = w * DEPTH_ROUNDINGS * FLOAT32_ROUNDING * largest * w
    match mapping:
        case DepthMapping.LINEAR:
            span = f - n
            rounding = (of_w + DEPTH_ROUNDINGS * FLOAT32_ROUNDING * w) / span
            return (w - n) / span, w**2 / span, rounding
        case DepthMapping.LOGARITHMIC:
            octaves = np.log(f / n)
            log = np.log(np.maximum(w, n) / n)
            rounding = (of_w / w + np.maximum(LOG_ULPS * FLOAT32_ROUNDING * log, LOG_NEAR_ONE)) / octaves
            return (
                np.log(w / n) / octaves,
                w / octaves,
                rounding + DEPTH_ROUNDINGS * FLOAT32_ROUNDING * log / octaves,
            )
        case _:
            assert_never(mapping)
