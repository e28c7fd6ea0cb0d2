"""Error bounds of the depth that a buffer stores for a triangle at a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, assert_never

import numpy as np

from xfrustum.compare.rounding.planes import Planes
from xfrustum.compare.rounding.positions import FLOAT32_ROUNDING
from xfrustum.compare.rounding.triangles import (
    CLIPPED_VERTEX_ROUNDINGS,
    FilmTriangles,
    PixelTriangles,
    Precision,
)
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.plate import DepthFormat, DepthMapping

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
        """Return a mask of the places at which a depth test may pass either triangle."""
        return np.asarray(np.abs(self.depth - other.depth) <= self.tolerance + other.tolerance)

    def lost(self) -> Mask:
        """Return a mask of the places at which a surface may fail against the clear value."""
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
