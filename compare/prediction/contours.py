"""The contours of a true image, where one surface ends before another, with normals and lengths.

A contour is found step by step between neighboring pixels. A single step runs along an axis; the normal of
the contour there is averaged over the steps around it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.hogel_image import HogelImage

CONTOUR_SIGMA_PX = 1.5
"""Standard deviation of the filter that turns a staircase of pixels into a contour with a normal. A line
that leans by one pixel in m repeats its stairs every m pixels: up to m = 4 a period lies within two sigma on
either side, and the normal is exact. On stairs that lean less the normal is too near to an axis, but by at
most 1/5 of a radian, and on average along the line by nothing. A wider filter would round corners off, and
mix contours that are as near to each other."""

MIN_OCCLUSION_FOOTPRINTS = 2
"""Distance, in footprints of a pixel, by which neighboring points must lie off each other's tangent planes
to count as an occlusion. Two points of one surface lie at most one footprint off, with one crease between
them, measured from the face that the line meets less steeply; two footprints on a surface that bends twice.
An occlusion that is closer is not found. This makes no difference: both surfaces are displaced alike, but
for 4 t / W of their displacement."""


class Kind(IntEnum):
    """The relation between the two sides of a contour."""

    OBJECTS = 0
    """The sides are different objects, or one shows no surface."""
    OCCLUSION = 1
    """One part of an object stands before another part."""
    SEAM = 2
    """One surface continues, but another camera draws it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Contours:
    """All contours of an image, as N steps between neighboring pixels.

    Attributes
    ----------
    front, back
        (N,) pixels on both sides, as indices of the flattened image: the surface nearer to the
        viewer, and what lies behind it. At a seam the two are interchangeable.
    normal
        (N, 2) unit vectors from front to back, columns to the right and rows down.
    length
        (N,) length of the contour that the step stands for, px. Steps along both axes, weighted by their
        normals, add up to the contour's length, however it leans.
    kind
        (N,) kind of the contour at each step, `Kind`.
    resolution
        W, H in pixels.
    """

    front: Indices
    back: Indices
    normal: Floats
    length: Floats
    kind: NDArray[np.int8]
    resolution: tuple[int, int]

    @cached_property
    def places(self) -> Floats:
        """(N, 2) column and row midway between the two pixels."""
        rows, columns = np.divmod(np.stack((self.front, self.back)), self.resolution[0])
        return np.stack((columns.mean(axis=0), rows.mean(axis=0)), axis=-1)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Steps:
    """Steps along one axis.

    Attributes
    ----------
    before, after
        (N,) pixels before and after each step, as indices of the flattened image.
    kind
        (N,) kind of the contour at each step, `Kind`.
    oriented
        (N,) +1 where the normal points on along the axis, -1 where it points back. The rule must stay the
        same all along a contour. "From the front to the back" would not: where two objects meet, their
        heights are equal, and rounding decides which is in front.
    """

    before: Indices
    after: Indices
    kind: NDArray[np.int8]
    oriented: Floats


def contours(truth: HogelImage, slab: Mask | None = None) -> Contours:
    """Find the contours of a true image.

    Parameters
    ----------
    truth
        The true image; its objects, positions and normals count. How finely the objects are tessellated
        makes no difference.
    slab
        (H, W) pixels whose surface is drawn by other cameras than the other pixels'; the border of this
        region on a surface is a seam.
    """
    shape = truth.triangle.shape
    index = np.arange(truth.triangle.size).reshape(shape)
    apart = np.zeros(shape, dtype=np.bool_) if slab is None else slab
    steps = (
        _steps(truth, apart, index[:, :-1].ravel(), index[:, 1:].ravel()),
        _steps(truth, apart, index[:-1].ravel(), index[1:].ravel()),
    )
    gradients = _gradients(steps, shape)
    height = np.where(truth.covered, truth.height, -np.inf).ravel()
    parts = []
    for axis, step in enumerate(steps):
        normal = _normals(gradients, step, axis)
        ahead = height[step.before] >= height[step.after]
        turned = np.where(ahead, 1.0, -1.0) * step.oriented
        front, back = np.where(ahead, [step.before, step.after], [step.after, step.before])
        parts.append((front, back, normal * turned[:, None], np.abs(normal[:, axis]), step.kind))
    front, back, normal, length, kind = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Contours(
        front=front, back=back, normal=normal, length=length, kind=kind, resolution=(shape[1], shape[0])
    )


def _steps(truth: HogelImage, slab: Mask, before: Indices, after: Indices) -> _Steps:
    """Return the pairs of neighboring pixels that a contour runs between."""
    objects, apart = truth.object.ravel(), slab.ravel()
    kind = np.full(len(before), -1, dtype=np.int8)
    kind[(apart[before] != apart[after]) & truth.covered.ravel()[before]] = Kind.SEAM
    kind[_occludes(truth, before, after)] = Kind.OCCLUSION
    kind[objects[before] != objects[after]] = Kind.OBJECTS
    found = np.flatnonzero(kind >= 0)
    before, after, kind = before[found], after[found], kind[found]
    height = truth.height.ravel()
    forward = np.select(
        [kind == Kind.OBJECTS, kind == Kind.OCCLUSION],
        [objects[before] > objects[after], height[before] > height[after]],
        default=apart[before],
    )
    return _Steps(before=before, after=after, kind=kind, oriented=np.where(forward, 1.0, -1.0))


def _occludes(truth: HogelImage, before: Indices, after: Indices) -> Mask:
    """Return the pairs whose points lie in neither tangent plane of the other."""
    found = np.zeros(len(before), dtype=np.bool_)
    if truth.normal is None:
        return found
    k, t = np.asarray(truth.camera.shear), np.asarray(truth.camera.half_extent)
    z = truth.height.ravel()
    footprint = 2 * np.max(t / truth.camera.resolution) * np.maximum(np.abs(z[before]), np.abs(z[after]))
    # Neighboring lines are a footprint apart: two points of equal height are no farther off any plane.
    longest = np.hypot(1, np.hypot(*(np.abs(k) + t)))
    deep = np.abs(z[after] - z[before]) * longest > (MIN_OCCLUSION_FOOTPRINTS - 1) * footprint
    pairs = np.flatnonzero(deep)
    points, normals = truth.position.reshape(-1, 3), truth.normal.reshape(-1, 3)
    chord = points[after[pairs]] - points[before[pairs]]
    off = [np.abs(np.einsum("ij,ij->i", chord, normals[ends[pairs]])) for ends in (before, after)]
    found[pairs] = np.minimum(*off) > MIN_OCCLUSION_FOOTPRINTS * footprint[pairs]
    return found


def _gradients(steps: tuple[_Steps, _Steps], shape: tuple[int, ...]) -> Floats:
    """Return the oriented steps around each pixel, (kinds, pixels, 2), smoothed over `CONTOUR_SIGMA_PX`."""
    size = int(np.prod(shape))
    gradients = np.zeros((len(Kind), size, 2))
    for kind in Kind:
        for axis, step in enumerate(steps):
            weight = step.oriented * (step.kind == kind)
            if not weight.any():
                continue
            # Each of a step's two pixels takes half of it.
            halves = np.bincount(step.before, weight, size) + np.bincount(step.after, weight, size)
            smooth = gaussian_filter(halves.reshape(shape), CONTOUR_SIGMA_PX, mode="constant")
            gradients[kind, :, axis] = smooth.ravel()
    return gradients


def _normals(gradients: Floats, step: _Steps, axis: int) -> Floats:
    """Return the unit normals of steps along an axis, oriented as the steps are.

    On both sides of a surface thinner than `CONTOUR_SIGMA_PX` the steps cancel. Where the rest points against
    the step itself, the step's normal is the axis.
    """
    normal = gradients[step.kind, step.before] + gradients[step.kind, step.after]
    length = np.hypot(normal[:, 0], normal[:, 1])
    normal /= np.where(length > 0, length, 1.0)[:, None]
    against = normal[:, axis] * step.oriented <= 0
    normal[against] = 0.0
    normal[against, axis] = step.oriented[against]
    return normal
