"""A camera as a rasterizer draws with it: exact lines, and how exactly the device follows them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping


@dataclass(frozen=True, kw_only=True)
class Precision:
    """How exactly a device draws."""

    #: Binary digits of a pixel to which the device rounds the places of vertices (GL_SUBPIXEL_BITS)
    subpixel_bits: int
    #: depth, mapping: Format of its depth buffer, and what the buffer stores
    depth: DepthFormat
    mapping: DepthMapping

    @property
    def snap_px(self) -> float:
        """Largest distance by which the nearest subpixel lies from a vertex: half a step along each axis."""
        return math.sqrt(2) / 2 * 2.0**-self.subpixel_bits


@dataclass(frozen=True, kw_only=True)
class RoundingCamera:
    """One camera of a renderer that rounds."""

    #: Its exact lines, through the sampling points of the pixels. The ends of `s_range` are its near and far
    #: plane.
    pencil: Pencil
    precision: Precision  #: How exactly the renderer draws
    #: Lowest and highest z of the surfaces that the camera draws; None where images do not say at which
    #: height their surfaces lie, so that any surface may be this camera's
    heights: tuple[float, float] | None = None
    #: Distance of the sampling points from the centers of their pixels, columns and rows, for a camera that
    #: may clip triangles at the borders of its film; None for one that does not
    film_shift: tuple[float, float] | None = None

    def may_draw(self, height: NDArray[Any]) -> Mask:
        """Return which surface points, given their heights (N,), this camera may have drawn."""
        if self.heights is None:
            return np.ones(len(height), dtype=np.bool_)
        low, high = self.heights
        return np.asarray((height >= low) & (height <= high))
