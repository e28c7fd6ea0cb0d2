"""How exactly does a depth buffer know the depth of a triangle at a pixel?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.edge_rounding import PixelIndex, film_points, film_vertices
from xfrustum.compare.rounding import FLOAT32_ROUNDING
from xfrustum.reference.lines import Pencil
from xfrustum.scenes.double_frustum import DepthFormat, DepthMapping, DoubleFrustum

Floats = NDArray[np.float64]

DEPTH_ROUNDINGS = 8
"""Roundings of 2^-24 in a float32 depth, relative to its largest term.

Four in the clip coordinate, one each for the division by w, the viewport, and the two steps of
the plane equation along x and y.
"""

STEP = {DepthFormat.D16: 2.0**-16, DepthFormat.D24: 2.0**-24, DepthFormat.D32F: 0.0}
"""Distance of neighboring stored values of the fixed-point formats."""


@dataclass(kw_only=True, eq=False)
class Depths:
    """Depth of one triangle at each of some pixels, and how exactly a buffer knows it.

    Attributes
    ----------
    depth
        (N,) stored value 0..1 before rounding, NaN where there is no triangle.
    tolerance
        (N,) how far the stored value may lie from it.
    clear
        (N,) what the buffer holds before anything is drawn.
    """

    depth: Floats
    tolerance: Floats
    clear: Floats

    @classmethod
    def nothing(cls, count: int) -> Depths:
        """Return no depths at all."""
        return cls(depth=np.full(count, np.nan), tolerance=np.zeros(count), clear=np.full(count, np.nan))

    def put(self, where: NDArray[np.int64], other: Depths) -> None:
        """Fill in some pixels."""
        self.depth[where], self.tolerance[where] = other.depth, other.tolerance
        self.clear[where] = other.clear

    def indistinguishable_from(self, other: Depths) -> NDArray[np.bool_]:
        """Return where a buffer may order two triangles either way."""
        return np.asarray(np.abs(self.depth - other.depth) <= self.tolerance + other.tolerance)

    def lost(self) -> NDArray[np.bool_]:
        """Return where a surface may not beat the clear value."""
        return np.asarray(np.abs(self.depth - self.clear) <= self.tolerance)


def depths(
    corners: Floats, pencil: Pencil, pixels: PixelIndex, settings: DoubleFrustum, subpixel_bits: int
) -> Depths:
    """Return the depths of one triangle (N, 3, 3) at each pixel, as a camera's buffer stores them.

    With w the distance along the axis, depth is a + b / w, and 1 / w is linear on the film: so is
    depth, and a shift by half a subpixel step along each axis changes it by its slope.
    """
    n, f = sorted(abs(s) for s in pencil.s_range)
    orthoscopic = pencil.s_range[0] > 0
    standard = settings.mapping is DepthMapping.STANDARD
    a, b = (f / (f - n), -n * f / (f - n)) if standard else (-n / (f - n), n * f / (f - n))

    vertices, _ = film_vertices(corners, pencil)
    w = vertices[:, :, 2] if orthoscopic else -vertices[:, :, 2]
    plane = sum(np.cross(vertices[:, i], vertices[:, (i + 1) % 3]) for i in range(3))
    volume = np.einsum("ij,ij->i", vertices[:, 0], np.cross(vertices[:, 1], vertices[:, 2]))
    resolution = np.asarray(pencil.resolution, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        over_w = (1.0 if orthoscopic else -1.0) * plane / volume[:, None]
        depth = a + b * np.einsum("ij,ij->i", over_w, film_points(pencil, pixels))
        slope_px = np.abs(b * over_w[:, :2]) * (2 / resolution)
        subpixel = slope_px.sum(axis=1) * 2.0 ** -(subpixel_bits + 1)
        # A triangle's depths are rounded relative to its largest one, at a corner or where the
        # near plane or the reach cuts it; its plane equation starts at a corner of the image.
        at_ends = np.abs(a + b / np.clip(np.stack((w.min(axis=1), w.max(axis=1))), n, f))
        largest = at_ends.max(axis=0) + slope_px @ resolution
    tolerance = subpixel + DEPTH_ROUNDINGS * FLOAT32_ROUNDING * largest
    tolerance += STEP[settings.depth] / 2 + FLOAT32_ROUNDING * np.abs(depth)
    undefined = ~np.isfinite(depth)
    return Depths(
        depth=np.where(undefined, np.nan, depth),
        tolerance=np.where(undefined, 0.0, tolerance),
        # C starts from its far value, C* from its near value.
        clear=np.full(len(corners), 1.0 if orthoscopic == standard else 0.0),
    )
