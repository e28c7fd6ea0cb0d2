"""The contours of a true image, where one surface ends before another, with normals and lengths.

A contour is found step by step between neighboring pixels. A single step runs along an axis; the normal of
the contour there is averaged over the steps around it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any

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

MIN_OCCLUSION_SPACINGS = 2
"""Distance, in spacings of neighboring lines, by which neighboring points must lie off each other's tangent
planes to count as an occlusion. Two points of one surface lie at most one spacing off, with one crease
between them, measured from the face that the line meets less steeply; two spacings on a surface that bends
twice. An occlusion that is closer is not found. This makes no difference: both surfaces are displaced alike,
but for 4 t / W of their displacement."""


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

    Steps along both axes, weighted by their normals, add up to the contour's length, however it leans. At a
    seam front and back are interchangeable.
    """

    front: Indices  #: (N,) pixels of the flattened image: the surface nearer to the viewer
    back: Indices  #: (N,) and what lies behind it
    normal: Floats  #: (N, 2) unit vectors from front to back, columns to the right and rows down
    length: Floats  #: (N,) length of the contour that the step stands for, px
    kind: NDArray[np.int8]  #: (N,) `Kind`
    resolution: tuple[int, int]  #: W, H in pixels

    @cached_property
    def places(self) -> Floats:
        """(N, 2) column and row midway between the two pixels."""
        rows, columns = np.divmod(np.stack((self.front, self.back)), self.resolution[0])
        return np.stack((columns.mean(axis=0), rows.mean(axis=0)), axis=-1)


_NO_CONTOUR = -1
"""Kind of a pair of neighbors that no contour runs between."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Steps:
    """N steps along one axis.

    `oriented` is +1 where the normal points on along the axis, -1 where it points back. The rule must stay
    the same all along a contour. "From the front to the back" would not: where two objects meet, their
    heights are equal, and rounding decides which is in front.
    """

    before: Indices  #: pixels of the flattened image
    after: Indices
    kind: NDArray[np.int8]
    oriented: Floats


def contours(truth: HogelImage, slab: Mask | None = None) -> Contours:
    """Find the contours of a true image.

    Its objects, positions and normals count; how finely the objects are tessellated makes no difference.
    `slab` (H, W) has the pixels whose surface is drawn by other cameras than the other pixels'; the border of
    this region on a surface is a seam.
    """
    shape = truth.triangle.shape
    steps = _steps(truth, slab, 1), _steps(truth, slab, 0)
    gradients = _gradients(steps, shape)
    height, covered = truth.height.reshape(-1), truth.covered.reshape(-1)
    parts = []
    for axis, step in enumerate(steps):
        # Unit normals, oriented as the steps are.
        normal = gradients[axis]
        length = np.hypot(normal[:, 0], normal[:, 1])
        normal /= np.where(length > 0, length, 1.0)[:, None]
        # On both sides of a surface thinner than `CONTOUR_SIGMA_PX` the steps cancel. Where the rest points
        # against the step itself, the step's normal is the axis.
        against = normal[:, axis] * step.oriented <= 0
        normal[against] = 0.0
        normal[against, axis] = step.oriented[against]
        before, after = (np.where(covered[end], height[end], -np.inf) for end in (step.before, step.after))
        ahead = before >= after
        turned = np.where(ahead, 1.0, -1.0) * step.oriented
        front, back = np.where(ahead, [step.before, step.after], [step.after, step.before])
        parts.append((front, back, normal * turned[:, None], np.abs(normal[:, axis]), step.kind))
    front, back, normal, length, kind = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Contours(
        front=front, back=back, normal=normal, length=length, kind=kind, resolution=(shape[1], shape[0])
    )


def _neighbors(image: NDArray[Any], axis: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the first and the second of all neighbors along an axis of an image (H, W)."""
    return (image[:, :-1], image[:, 1:]) if axis else (image[:-1], image[1:])


def _steps(truth: HogelImage, slab: Mask | None, axis: int) -> _Steps:
    """Return the pairs of neighbors along an axis of an image (H, W) that a contour runs between."""
    before, after = _neighbors(truth.object, axis)
    kind = np.where(before != after, np.int8(Kind.OBJECTS), np.int8(_NO_CONTOUR))
    occludes = _occludes(truth, axis)
    kind[occludes & (kind == _NO_CONTOUR)] = Kind.OCCLUSION
    if slab is not None:
        here, there = _neighbors(slab, axis)
        kind[(here != there) & _neighbors(truth.covered, axis)[0] & (kind == _NO_CONTOUR)] = Kind.SEAM
    row, column = np.divmod(np.flatnonzero(kind != _NO_CONTOUR), kind.shape[1])
    kind = kind[row, column]
    places = row, column
    beyond = (row, column + 1) if axis else (row + 1, column)
    height, objects = truth.height, truth.object
    forward = np.select(
        [kind == Kind.OBJECTS, kind == Kind.OCCLUSION],
        [objects[places] > objects[beyond], height[places] > height[beyond]],
        default=False if slab is None else slab[places],
    )
    first, second = (down * truth.triangle.shape[1] + across for down, across in (places, beyond))
    return _Steps(before=first, after=second, kind=kind, oriented=np.where(forward, 1.0, -1.0))


def _occludes(truth: HogelImage, axis: int) -> Mask:
    """Return the pairs of neighbors along an axis whose points lie in neither tangent plane of the other."""
    height = np.ascontiguousarray(truth.height)
    near, far = _neighbors(height, axis)
    found = np.zeros(near.shape, dtype=np.bool_)
    if truth.normal is None:
        return found
    k, t = np.asarray(truth.camera.shear), np.asarray(truth.camera.half_extent)
    # Two points of equal height on neighboring lines are no farther off any plane than the lines are apart.
    longest = np.hypot(1, np.hypot(*(np.abs(k) + t)))
    per_height = 2 * np.max(t / truth.camera.resolution)
    spacing = per_height * np.maximum(*_neighbors(np.abs(height), axis))
    deep = np.abs(far - near) * longest > (MIN_OCCLUSION_SPACINGS - 1) * spacing
    some = np.flatnonzero(deep)
    spacing = spacing.ravel()[some]
    positions, normals = (one.reshape(-1, 3) for one in (truth.position, truth.normal))
    first, step = (some + some // near.shape[1], 1) if axis else (some, near.shape[1])
    chord = positions[first + step] - positions[first]
    # Few points lie off the first plane: only these are asked how far they lie off the second.
    for beyond in (0, step):
        off = np.abs(np.einsum("ij,ij->i", chord, normals[first + beyond]))
        kept = off > MIN_OCCLUSION_SPACINGS * spacing
        some, first, chord, spacing = (one[kept] for one in (some, first, chord, spacing))
    found.reshape(-1)[some] = True
    return found


def _gradients(steps: tuple[_Steps, _Steps], shape: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Return the oriented steps around each step along either axis, (N, 2).

    Steps of its kind are smoothed over `CONTOUR_SIGMA_PX`, and those around both of its pixels are added up.
    """
    size = int(np.prod(shape))
    across, down = (np.zeros((len(step.kind), 2)) for step in steps)
    for kind in Kind:
        for axis, step in enumerate(steps):
            weight = step.oriented * (step.kind == kind)
            if not weight.any():
                continue
            # Each of a step's two pixels takes half of it.
            both = np.concatenate((step.before, step.after))
            halves = np.bincount(both, np.tile(weight, 2), size).reshape(shape)
            smooth = gaussian_filter(halves, CONTOUR_SIGMA_PX, mode="constant").reshape(-1)
            for found, asked in zip((across, down), steps, strict=True):
                mine = asked.kind == kind
                found[mine, axis] = smooth[asked.before[mine]] + smooth[asked.after[mine]]
    return across, down
