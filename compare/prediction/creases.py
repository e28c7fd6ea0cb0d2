"""Closed form of the surface error of subpixel snapping at concave creases (docs/method.md).

A crease is a side that two triangles share and that a line of the frustum sees from the front, with
one triangle on either side of it. A rasterizer snaps its ends, so that it shows one triangle beyond
the crease, where it evaluates the point on the plane of that triangle. At a convex crease this
plane passes in front of the other triangle, and the point is seen. At a concave one it passes
behind: the point is hidden, and the surface wrong, from the offset on at which the plane is farther
behind than the tolerance of drawn points.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from xfrustum.compare.metrics.error_maps import judged_pixels, true_lines
from xfrustum.compare.rounding.positions import POSITION_TOLERANCE
from xfrustum.scenes.arrays import Floats, Indices, Numbers
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene

_SAMPLES = 1 << 16  #: random edges whose mean is the mean shift: its standard error is 0.3 %
_OFFSETS = np.linspace(0, np.sqrt(2), 64)  #: offsets between which the mean shift is interpolated


@cache
def _mean_excess() -> Floats:
    """Return the mean of max(0, |d| - x) at each of `_OFFSETS`, all as parts of half a subpixel.

    d is the distance by which a point of an edge moves along the normal of the edge where both ends
    snap to the nearest subpixel in each axis: (1 - t) e . n + t e' . n, for points t, normals n,
    and errors e and e' of either end, all of them uniform.
    """
    random = np.random.default_rng(0)
    along, angle = random.uniform(0, 1, _SAMPLES), random.uniform(0, np.pi / 2, _SAMPLES)
    error = random.uniform(-1, 1, (2, 2, _SAMPLES))
    of_ends = error[:, 0] * np.cos(angle) + error[:, 1] * np.sin(angle)
    moved = np.abs((1 - along) * of_ends[0] + along * of_ends[1])
    return np.array([np.maximum(moved - offset, 0.0).mean() for offset in _OFFSETS])


def mean_shift(subpixel_bits: int, beyond: Floats) -> Floats:
    """Return the mean length by which snapping moves an edge beyond offsets (...), pixels."""
    half = 2.0 ** -(subpixel_bits + 1)
    return np.asarray(half * np.interp(beyond / half, _OFFSETS, _mean_excess()))


def crease_pixels(truth: HogelImage, scene: Scene, subpixel_bits: int) -> float:
    """Return the expected number of judged pixels with hidden points beyond snapped creases.

    Visible creases are as long as the creases of a visible triangle, times the share of its area
    that is visible: the pixels that show it over its area on the film. A pixel may show a triangle
    that is far smaller; on the average over the pixel grid the sum is right whatever the
    tessellation.
    """
    shown = truth.triangle[judged_pixels(truth) & truth.covered]
    number, pixels = np.unique(shown, return_counts=True)
    if not number.size:
        return 0.0
    own, side = np.nonzero(scene.twins[number] >= 0)
    length, area, offsets = _measured(truth, scene, number[own], side)
    shift = mean_shift(subpixel_bits, offsets).mean(axis=0)
    # Each triangle answers for half of its creases. The area beyond them is at most its own.
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(length > 0, np.minimum(length * shift / 2 / area, 1.0), 0.0)
    return float(np.sum(pixels[own] * share))


def _measured(
    truth: HogelImage, scene: Scene, number: Numbers, side: Indices
) -> tuple[Floats, Floats, Floats]:
    """Measure sides (N,) of triangles on the true film: lengths, areas, and offsets (2, N).

    Lengths are zero where no concave crease is seen. From the offsets on, either of the two planes
    is farther behind the other triangle than the tolerance of its points.
    """
    lines = true_lines(truth.camera)
    other, other_side = np.divmod(scene.twins[number, side], 3)
    start, end, third = (scene.triangles[number, (side + k) % 3] for k in range(3))
    beyond = scene.triangles[other, (other_side + 2) % 3]
    half, shear = np.asarray(lines.half_extent), np.asarray(lines.shear)
    per_unit = np.asarray(lines.resolution) / (2 * half) * [1, -1]

    def places(points: Floats) -> Floats:
        s = -points[:, 2:]
        return np.asarray(((points[:, :2] - lines.center[:2]) / s - shear) * per_unit)

    with np.errstate(divide="ignore", invalid="ignore"):
        a, b, mine, its = (places(corner) for corner in (start, end, third, beyond))
        along = b - a
        length = np.hypot(*along.T)
        normal = np.stack((-along[:, 1], along[:, 0]), axis=1) / length[:, None]
        inside, outside = (np.einsum("ij,ij->i", corner - a, normal) for corner in (mine, its))
        area = np.abs(inside) * length / 2
        middle = (start + end) / 2 - np.asarray(lines.center)
        s = -middle[:, 2]
        direction = middle / s[:, None]
        turned = np.zeros_like(direction)
        turned[:, :2] = normal / per_unit
        planes = [scene.normals[index] for index in (number, other)]
        # Normals toward the viewer, and how fast a point on one plane leaves the other one, per
        # pixel.
        onto = [np.einsum("ij,ij->i", plane, direction) for plane in planes]
        across = [np.einsum("ij,ij->i", plane, turned) for plane in planes]
        rates = [np.abs(s * (across[1 - k] - onto[1 - k] * across[k] / onto[k])) for k in range(2)]
        ahead = np.einsum("ij,ij->i", planes[0], beyond - start) * -np.sign(onto[0]) > 0
        heights = np.stack([corner[:, 2] for corner in (start, end, third, beyond)])
        one_side = (heights > 0).all(axis=0) | (heights < 0).all(axis=0)
        concave = one_side & (inside * outside < 0) & ahead & (area > 0)
        tolerance = [
            POSITION_TOLERANCE * scene.largest_coordinates[index] for index in (number, other)
        ]
        offsets = np.stack([bound / rate for bound, rate in zip(tolerance, rates, strict=True)])
    offsets[~np.isfinite(offsets)] = np.inf
    return np.where(concave, length, 0.0), area, offsets
