"""Where in a true image does one surface end before another? Contours, with normals and lengths.

A contour is found step by step between neighboring pixels, and a step knows no direction but along
the axes. Its normal is that of the steps about it together.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.hogel_image import HogelImage

SIGMA_PX = 1.5
"""Over which a staircase of pixels becomes a contour with a normal. A line that leans by one pixel in m
repeats its stairs every m pixels: up to m = 4 that lies within two sigma on either side, and the normal is
exact. Less inclined stairs have a normal too near to an axis, but at most 1/5 of a radian beside it, and
on average along the line none. More would round corners off, and mix up contours that are as near."""

OCCLUSION_FOOTPRINTS = 2
"""Of a pixel, that neighboring points of one surface may lie off each other's tangent planes. With one
crease between them it is one at most, on whichever of the two the line meets less steeply, and
two on a surface bent twice. Where a surface hides another so close to itself, both are displaced
alike, but for 4 t / W of their displacement: that none is found there makes no difference."""


class Kind(IntEnum):
    """What the two sides of a contour have to do with each other."""

    OBJECTS = 0
    """They are different objects, or one is none."""
    OCCLUSION = 1
    """One part of an object stands before another."""
    SEAM = 2
    """One surface runs on, but another camera draws it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Contours:
    """All contours of an image, as N steps between neighboring pixels.

    Attributes
    ----------
    front, back
        (N,) pixels on both sides, as indices of the flattened image: the surface nearer to the
        viewer, and what lies behind. Of a seam it does not matter which is which.
    normal
        (N, 2) unit vectors from front to back, columns to the right and rows down.
    length
        (N,) px of contour that the step stands for. Steps along both axes, weighted by their
        normals, add up to the contour's length, however it leans.
    kind
        (N,) `Kind`.
    resolution
        W, H in pixels.
    """

    front: Indices
    back: Indices
    normal: Floats
    length: Floats
    kind: NDArray[np.int8]
    resolution: tuple[int, int]

    @property
    def places(self) -> Floats:
        """(N, 2) column and row midway between the two pixels."""
        rows, columns = np.divmod(np.stack((self.front, self.back)), self.resolution[0])
        return np.stack((columns.mean(axis=0), rows.mean(axis=0)), axis=-1)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Steps:
    """Steps along one axis: the pixel before and after, their kind, and whether the normal points on.

    `oriented` is +1 or -1 by a rule that stays the same all along a contour. Which side is in
    front is none: where two objects meet, their heights are equal and rounding decides.
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
        Its objects, positions and normals; how finely they are tessellated makes no difference.
    slab
        (H, W) pixels whose surface is drawn by other cameras than the rest; its border on a
        surface is a seam.
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
    """Find the pairs of pixels that a contour runs between."""
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
    # Neighboring lines are a footprint apart: points of equal height are not off any plane by more.
    longest = np.hypot(1, np.hypot(*(np.abs(k) + t)))
    deep = np.abs(z[after] - z[before]) * longest > (OCCLUSION_FOOTPRINTS - 1) * footprint
    pairs = np.flatnonzero(deep)
    points, normals = truth.position.reshape(-1, 3), truth.normal.reshape(-1, 3)
    chord = points[after[pairs]] - points[before[pairs]]
    off = [np.abs(np.einsum("ij,ij->i", chord, normals[ends[pairs]])) for ends in (before, after)]
    found[pairs] = np.minimum(*off) > OCCLUSION_FOOTPRINTS * footprint[pairs]
    return found


def _gradients(steps: tuple[_Steps, _Steps], shape: tuple[int, ...]) -> Floats:
    """Return the oriented steps about each pixel, (kinds, pixels, 2), smoothed over `SIGMA_PX`."""
    size = int(np.prod(shape))
    gradients = np.zeros((len(Kind), size, 2))
    for kind in Kind:
        for axis, step in enumerate(steps):
            weight = step.oriented * (step.kind == kind)
            if not weight.any():
                continue
            # Half a step at each of its two pixels.
            spread = np.bincount(step.before, weight, size) + np.bincount(step.after, weight, size)
            smooth = gaussian_filter(spread.reshape(shape), SIGMA_PX, mode="constant")
            gradients[kind, :, axis] = smooth.ravel()
    return gradients


def _normals(gradients: Floats, step: _Steps, axis: int) -> Floats:
    """Return the unit normals of steps along an axis, oriented as the steps are.

    On both sides of a surface thinner than `SIGMA_PX` the steps cancel: where what is left points
    against the step itself, that has the axis for a normal.
    """
    normal = gradients[step.kind, step.before] + gradients[step.kind, step.after]
    length = np.hypot(normal[:, 0], normal[:, 1])
    normal /= np.where(length > 0, length, 1.0)[:, None]
    against = normal[:, axis] * step.oriented <= 0
    normal[against] = 0.0
    normal[against, axis] = step.oriented[against]
    return normal
