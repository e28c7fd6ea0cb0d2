"""Color averaged over the boxes of pixels and over apertures; every line of it is certified."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from xfrustum.reference.certify.certify import Certifier
from xfrustum.reference.certify.cone import Triangles
from xfrustum.reference.lines.lines import crossed_frustum
from xfrustum.reference.memory import BAND_PIXELS, bands
from xfrustum.reference.shading.shading import Shader
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture

BOX_SIDE = 8
"""Points along each side of a pixel with which the box of multisampling is integrated. A straight edge along
the rows or columns of points is off by at most half a row, 1/16 of the pixel; other edges are off by less."""

AVERAGED_PIXELS = 1 << 22
"""Pixels whose sums are held at once. This bounds the memory, 24 bytes a pixel."""


def averages(sampling: Sampling) -> bool:
    """Return whether the color of a pixel is a mean over several points."""
    return sampling != Sampling()


def points_per_side(sampling: Sampling) -> int:
    """Return the number of points along each side of a pixel over which its color is averaged.

    A rasterizer's multisampling places its points where the driver chooses and estimates the mean over
    the pixel's box. The reference computes that mean.
    """
    return sampling.supersample if sampling.multisample == 1 else max(sampling.supersample, BOX_SIDE)


def mean_color(
    scene: Scene, triangles: Triangles, shader: Shader, apertures: Sequence[Aperture], side: int, rows: range
) -> Floats:
    """Return linear RGB (rows, W, 3): the mean over some apertures and over side x side points per pixel.

    The points are the pixel centers of an image of `side` times the resolution.
    """
    width, height = scene.frustum.resolution
    total = np.zeros((len(rows), width, 3))
    for aperture in apertures:
        fine = replace(crossed_frustum(scene.frustum, aperture), resolution=(width * side, height * side))
        certifier = Certifier(triangles, fine)
        for some in bands(width, rows, BAND_PIXELS // side**2):
            lines = range(some.start * side, some.stop * side)
            decided, directions = certifier.decide(lines), fine.directions(slice(lines.start, lines.stop))
            position = np.asarray(fine.center) + decided.s[..., None] * directions
            color = shader.picture(decided.triangle, position, directions)
            # The sums are taken row by row, so that they do not depend on how the bands were cut.
            for row, line in zip(lines, color.reshape(len(lines), width, side, 3).sum(axis=2), strict=True):
                total[row // side - rows.start] += line
    return total / (len(apertures) * side * side)
