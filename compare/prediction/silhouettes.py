"""Closed form of surface errors that displacement and snapping cause along contours and creases.

A contour is the border at which one surface ends in front of another. It consists of steps between
neighboring pixels, and its normal is averaged over nearby steps. Let x be the distance from the
contour in pixels, along the normal from the front surface to the back surface. The truth shows the
front up to x = 0. With displacements d and the normal n, the picture shows the front up to
c = -d_front n, and from b = -d_back n on it shows the part of the back that is visible in the true
frustum.

 * Between 0 and c the picture shows another object, an extra surface, or no surface in place of a
   surface.
 * Between c and b, if c < b, the picture shows a part that the front hides in the true frustum.

Inside one object only the second interval is wrong. At a seam between two slabs of one surface
nothing is hidden, but the interval from c to b, if c < b, is a gap. These statements hold to first
order, for displacements that are small compared with the distance and the length of contours.

A crease is an edge shared by two visible triangles that lie on either side of it on the film. A
rasterizer snaps the ends of the edge, and therefore draws one triangle a little beyond the crease,
with points on the plane of this triangle. At a convex crease this plane is in front of the other
triangle, and the drawn point is visible. At a concave crease it is behind, and the drawn point is
hidden. The surface is wrong if the plane is farther behind than the tolerance of drawn points.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cache, cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from xfrustum.compare.error_maps import judged_pixels, true_lines
from xfrustum.compare.prediction.displacement import (
    TruePoints,
    displacements,
    in_first_slab,
    is_drawn,
)
from xfrustum.compare.rounding.triangles import POSITION_TOLERANCE
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.images import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Camera, DoubleFrustum, Frustum, Offset

Pair = tuple[float, float]  #: values for edges along rows, and for edges along columns

#: Standard deviation of the filter that turns a staircase of pixels into a contour with a normal.
#: The staircase of a line with a slope of 1/m repeats every m pixels. Up to m = 4 a period lies
#: within two sigma on either side, and the normal is exact. For smaller slopes the normal deviates
#: toward an axis by at most 1/5 of a radian, and the mean error along the line is zero. A wider
#: filter would round off corners and mix close contours.
CONTOUR_SIGMA_PX = 1.5

#: Two neighboring points form an occlusion if their distances from each other's tangent planes are
#: at least this many spacings of neighboring lines. Two points of a surface with one crease between
#: them are at most one spacing off the plane of the face that their lines meet less steeply; if the
#: surface bends twice, they are at most two spacings off. A closer occlusion is missed, with
#: negligible effect: the displacements of the two surfaces differ by at most 4 t / W of their size.
MIN_OCCLUSION_SPACINGS = 2


class Kind(IntEnum):
    """Relation between the two sides of a contour."""

    OBJECTS = 0  #: the sides are different objects, or one side has no surface
    OCCLUSION = 1  #: one part of an object is in front of another part
    SEAM = 2  #: one surface continues, but another camera draws it


@dataclass(frozen=True, kw_only=True, eq=False)
class Contours:
    """Contours of an image, as N steps between neighboring pixels."""

    front: Indices  #: (N,) pixels of the flattened image: the surface nearer to the viewer
    back: Indices  #: (N,) pixels of the surface behind it
    normal: Floats  #: (N, 2) unit vectors from front to back, columns to the right and rows down
    length: Floats  #: (N,) length of the part of the contour that the step represents, px
    kind: NDArray[np.int8]  #: (N,) `Kind`
    resolution: tuple[int, int]  #: W, H in pixels

    @cached_property
    def places(self) -> Floats:
        """(N, 2) column and row midway between the two pixels."""
        rows, columns = np.divmod(np.stack((self.front, self.back)), self.resolution[0])
        return np.stack((columns.mean(axis=0), rows.mean(axis=0)), axis=-1)


_NO_CONTOUR = -1  #: kind of a pair of neighbors without a contour between them


@dataclass(frozen=True, kw_only=True, eq=False)
class _Steps:
    """N steps along one axis.

    `oriented` is +1 if the normal points in the direction of the axis. Between two objects it does
    not depend on heights: where objects meet, their heights are equal, and rounding would reverse
    the normal along a contour.
    """

    before: Indices  #: pixels of the flattened image
    after: Indices
    kind: NDArray[np.int8]
    oriented: Floats


def contours(truth: HogelImage, slab: Mask | None = None) -> Contours:
    """Find the contours of a true image from its objects, positions and normals.

    `slab` (H, W) marks the pixels whose surface is drawn by the cameras of the first slab. The
    border of this region on a surface is a seam.
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
        # The steps on the two sides of a surface thinner than `CONTOUR_SIGMA_PX` cancel. If their
        # sum is opposite to a step, the step's normal is the direction of the axis instead.
        against = normal[:, axis] * step.oriented <= 0
        normal[against] = 0.0
        normal[against, axis] = step.oriented[against]
        before, after = (
            np.where(covered[end], height[end], -np.inf) for end in (step.before, step.after)
        )
        ahead = before >= after
        turned = np.where(ahead, 1.0, -1.0) * step.oriented
        front, back = np.where(ahead, [step.before, step.after], [step.after, step.before])
        parts.append((front, back, normal * turned[:, None], np.abs(normal[:, axis]), step.kind))
    front, back, normal, length, kind = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Contours(
        front=front,
        back=back,
        normal=normal,
        length=length,
        kind=kind,
        resolution=(shape[1], shape[0]),
    )


def _neighbors(image: NDArray[Any], axis: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the first and second pixels of all pairs of neighbors along an axis of an image."""
    return (image[:, :-1], image[:, 1:]) if axis else (image[:-1], image[1:])


def _steps(truth: HogelImage, slab: Mask | None, axis: int) -> _Steps:
    """Return the neighboring pixels along an axis of an image that have a contour between them."""
    before, after = _neighbors(truth.object, axis)
    kind = np.where(before != after, np.int8(Kind.OBJECTS), np.int8(_NO_CONTOUR))
    occludes = _occludes(truth, axis)
    kind[occludes & (kind == _NO_CONTOUR)] = Kind.OCCLUSION
    if slab is not None:
        here, there = _neighbors(slab, axis)
        kind[(here != there) & _neighbors(truth.covered, axis)[0] & (kind == _NO_CONTOUR)] = (
            Kind.SEAM
        )
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
    """Return a mask of the neighbors whose points lie off each other's tangent planes."""
    near, far = _neighbors(truth.height, axis)
    if truth.normal is None:
        return np.zeros(near.shape, dtype=np.bool_)
    spacing = 2 * np.max(np.asarray(truth.camera.half_extent) / truth.camera.resolution)
    allowed = MIN_OCCLUSION_SPACINGS * spacing * np.maximum(np.abs(near), np.abs(far))
    here, there = _neighbors(truth.position, axis)
    chord = there - here
    with np.errstate(invalid="ignore"):
        off = [
            np.abs(np.einsum("...i,...i", chord, normal))
            for normal in _neighbors(truth.normal, axis)
        ]
        return np.asarray((off[0] > allowed) & (off[1] > allowed))


def _gradients(steps: tuple[_Steps, _Steps], shape: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Return gradients (N, 2) at the steps along each axis, from smoothed steps of equal kind."""
    size = int(np.prod(shape))
    across, down = (np.zeros((len(step.kind), 2)) for step in steps)
    for kind in Kind:
        for axis, step in enumerate(steps):
            weight = step.oriented * (step.kind == kind)
            if not weight.any():
                continue
            # Each of the two pixels of a step gets half of its weight.
            both = np.concatenate((step.before, step.after))
            halves = np.bincount(both, np.tile(weight, 2), size).reshape(shape)
            smooth = gaussian_filter(halves, CONTOUR_SIGMA_PX, mode="constant").reshape(-1)
            for gradient, target in zip((across, down), steps, strict=True):
                mine = target.kind == kind
                gradient[mine, axis] = smooth[target.before[mine]] + smooth[target.after[mine]]
    return across, down


class Silhouettes:
    """The contours of a true image, and the wrong pixels that displacement makes along them."""

    def __init__(
        self, truth: HogelImage, frustum: Frustum, points: TruePoints | None = None
    ) -> None:
        self._truth, self._frustum = truth, frustum
        self._judged = judged_pixels(truth)
        self._points = points or TruePoints.from_image(truth)
        # Pixels whose lines end at the aperture itself, on a surface that crosses the plate and
        # hides everything behind it. In the truth all these pixels show a single point of the
        # surface; the cameras draw other points of it, closer than n. A surface in the plate is an
        # exception: both cameras draw it in its place, and show a wrong surface only for apertures
        # closer to its border than n t.
        self._in_aperture: Mask = truth.covered & (truth.height == 0)
        if truth.normal is not None and self._in_aperture.any():
            self._in_aperture &= (truth.normal[..., :2] != 0).any(axis=-1)
        self._contours: dict[tuple[float, ...], tuple[Contours, TruePoints, TruePoints]] = {}

    def charged_pixels(self, chain: Sequence[DoubleFrustum]) -> tuple[float, ...]:
        """Return the expected number of wrong pixels charged to each link of a chain."""
        missing = self._in_aperture
        if chain[-1].camera is not Camera.BOTH or chain[-1].offset is not Offset.PLATE:
            height = self._points.height
            missing = missing | (np.isfinite(height) & ~is_drawn(height, chain[-1]))
        steps = self._contours_for(chain[-1])[0]
        wrong = {
            settings: expected_wrong(_swept(steps, low, high), missing, self._judged)
            for settings, low, high in self._spans(chain)
        }
        # A pixel is charged to the first link whose image, like all later images, is wrong there.
        return tuple(np.diff([wrong[settings] for settings in chain], prepend=0.0).tolist())

    def _spans(
        self, chain: Sequence[DoubleFrustum]
    ) -> Iterator[tuple[DoubleFrustum, Floats, Floats]]:
        """Yield settings from the last link backward, with the ends (N,) of wrong spans, px."""
        steps, *_ = sides = self._contours_for(chain[-1])
        between = steps.kind == Kind.OBJECTS
        low, high = np.full(len(steps.kind), -np.inf), np.full(len(steps.kind), np.inf)
        for settings in dict.fromkeys(reversed(chain)):
            c, b = self._ends(settings, sides)
            # Between objects, the interval from 0 to c is wrong too. Elsewhere only c to b is
            # wrong, if c < b.
            low = np.maximum(low, np.where(between, np.minimum(c, 0), c))
            high = np.minimum(high, np.maximum(np.where(between, np.maximum(b, 0), b), c))
            yield settings, low, high

    def flip_deviations(self, chain: Sequence[DoubleFrustum], subpixel_bits: int) -> list[Pair]:
        """Return standard deviations of the wrong pixels along rows, and along columns.

        There is one pair for each link of a chain, and one for rasterization. Along a straight edge
        of l steps, a wrong span consists of whole pixels, which are certainly wrong, and a fraction
        f of a pixel: one more row of l pixels is wrong with probability f. The variance of the
        number of wrong pixels is l^2 f (1 - f). The variance of independent pixels, l f (1 - f), is
        subtracted.
        """
        steps = self._contours_for(chain[-1])[0]
        length = _lone_runs(self._truth.object.reshape(-1), steps)
        row = np.abs(steps.back - steps.front) != 1

        def variances(span: Floats) -> Floats:
            rest = np.mod(np.maximum(span, 0.0), 1.0)
            # Each of the l steps contributes 1 / l of the variance of the edge.
            own = (length - 1) * rest * (1 - rest)
            return np.array([own[row].sum(), own[~row].sum()])

        of_link = {link: variances(high - low) for link, low, high in self._spans(chain)}
        # The number of pixels charged to a link is a difference of two numbers: variances add.
        later = [
            np.zeros(2) if two == link else of_link[link] + of_link[two]
            for link, two in pairwise(chain)
        ]
        every = [of_link[chain[0]], *later, variances(self._snapped(chain[-1], subpixel_bits))]
        return [(math.sqrt(rows), math.sqrt(columns)) for rows, columns in every]

    def snapped_pixels(self, settings: DoubleFrustum, subpixel_bits: int) -> float:
        """Return the expected number of judged pixels that only snapping makes wrong.

        With c and b of the module's docstring, the front ends at c + d after its edge snaps; both
        signs of d are equally likely. Pixels that are already wrong do not count. Between objects,
        a growing front (d > 0) makes the pixels beyond c, 0, and b wrong, and a receding front
        makes the pixels before c and 0 wrong. Elsewhere only a receding front makes pixels wrong,
        before c and b.
        """
        steps, judged = self._contours_for(settings)[0], self._judged.ravel()
        counted = (judged[steps.front].astype(np.float64) + judged[steps.back]) / 2
        return float(np.sum(steps.length * self._snapped(settings, subpixel_bits) * counted))

    def _snapped(self, settings: DoubleFrustum, subpixel_bits: int) -> Floats:
        """Return the mean width (N,), px, of each step's span that only snapping makes wrong."""
        steps, *_ = sides = self._contours_for(settings)
        c, b = self._ends(settings, sides)
        between = steps.kind == Kind.OBJECTS
        grown = np.where(between, np.maximum(np.maximum(b, 0), c) - c, np.inf)
        receded = c - np.where(between, np.minimum(c, 0), np.minimum(c, b))
        return (mean_shift(subpixel_bits, grown) + mean_shift(subpixel_bits, receded)) / 2

    def _ends(
        self, settings: DoubleFrustum, contours: tuple[Contours, TruePoints, TruePoints]
    ) -> tuple[Floats, Floats]:
        """Return the end c of each front in the picture, and the beginning b of its back, (N,) px.

        The displacements of both sides are evaluated at the contour, half a pixel from either
        center.
        """
        steps, *sides = contours
        moved = (displacements(side, self._frustum, settings) for side in sides)
        front, back = (-np.einsum("ij,ij->i", np.nan_to_num(side), steps.normal) for side in moved)
        return front, back

    def thin_share(self, settings: DoubleFrustum) -> float:
        """Return the share of contour length along surfaces that are a single pixel wide."""
        steps = self._contours_for(settings)[0]
        step, front = steps.back - steps.front, steps.front * (4 * steps.resolution[0])
        # The front of a thin surface ends on both sides along an axis.
        thin = np.isin(front + step, front - step)
        return float(steps.length[thin].sum() / max(steps.length.sum(), 1.0))

    def _contours_for(self, settings: DoubleFrustum) -> tuple[Contours, TruePoints, TruePoints]:
        """Return contours, and the front and back points of each step, moved to the contour."""
        first = settings.slabs[:1]
        if first not in self._contours:
            slab = in_first_slab(self._points.height, self._frustum, settings) if first else None
            steps = contours(self._truth, slab)
            places = steps.places - (np.asarray(steps.resolution) - 1) / 2
            ends = self._points.at(steps.front), self._points.at(steps.back)
            front, back = (replace(points, from_middle=places) for points in ends)
            self._contours[first] = steps, front, back
        return self._contours[first]


def _lone_runs(objects: Numbers, steps: Contours) -> Floats:
    """Return the length (N,), in px, of the straight run of each step; 1 for steps of a staircase.

    A run is a sequence of steps between the same two columns or rows of pixels, and between the
    same two `objects` (of all pixels). If the contour continues in the next column or row, the run
    is part of a slanted line or a curve, whose distances from pixel centers are uniformly
    distributed.
    """
    width, height = steps.resolution
    step = steps.back - steps.front
    row, column = np.divmod(np.minimum(steps.front, steps.back), width)
    down = np.abs(step) != 1
    line, along = np.where(down, (row, column), (column, row))
    # Keys of consecutive steps of a run differ by 1. Both coordinates have a margin of one.
    sides = np.stack((down, np.sign(step), objects[steps.front], objects[steps.back]), axis=1)
    kind = np.unique(sides, axis=0, return_inverse=True)[1].reshape(-1)
    size = max(width, height) + 2
    keys = (kind * size + line + 1) * size + along + 1
    order = np.argsort(keys)
    first = np.append(True, np.diff(keys[order]) != 1)[: len(keys)]
    run = np.cumsum(first) - 1
    count = np.bincount(run)
    begin = keys[order][first]
    end = begin + count - 1
    beyond = [place + off for place in (begin - 1, end + 1) for off in (-size, size)]
    goes_on = np.isin(beyond, keys).any(axis=0)
    lengths = np.empty(len(keys))
    lengths[order] = np.where(goes_on, 1, count)[run]
    return lengths


def expected_wrong(swept: Floats, missing: Mask, judged: Mask) -> float:
    """Return the expected number of wrong pixels, from maps (H, W).

    `swept` is the share of each pixel that wrong spans cover; overlaps count twice. `missing`
    pixels are always wrong. Only `judged` pixels count.
    """
    if swept.max(initial=0.0) <= 1 and not missing.any() and judged.all():
        # No area is covered twice, and smoothing preserves the sum.
        return float(swept.sum())
    wrong = np.minimum(gaussian_filter(swept, CONTOUR_SIGMA_PX), 1)
    wrong[missing] = 1.0
    return float(wrong.sum(where=judged))


def _swept(steps: Contours, low: Floats, high: Floats) -> Floats:
    """Return the share of each pixel that spans cover, (H, W); overlaps count twice."""
    width, height = steps.resolution
    # Neighboring spans overlap and leave gaps, which smoothing over `CONTOUR_SIGMA_PX` evens out.
    # Spans are clipped to the film's diagonal, beyond which nothing is counted.
    farthest = float(np.hypot(width, height))
    low, high = (np.clip(side, -farthest, farthest) for side in (low, high))
    # Spans are cut into pieces no longer than a pixel; `step` is the span of a piece, and `number`
    # is the position of the piece in its span.
    count = np.ceil(np.maximum(high - low, 0)).astype(np.int64)
    step = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(step)) - np.repeat(np.cumsum(count) - count, count)
    # Locate the pixel under the middle of each piece.
    size = (high - low) / np.maximum(count, 1)
    along = low[step] + (number + 0.5) * size[step]
    column, row = (
        np.rint(steps.places[step] + along[:, None] * steps.normal[step]).astype(np.int64).T
    )
    on_film = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    # The areas of the pieces, contour length times piece length, are added up in each pixel.
    area = (steps.length * size)[step[on_film]]
    swept = np.bincount((column + row * width)[on_film], area, width * height)
    return swept.astype(np.float64).reshape(height, width)


# Snapping
# -------------------------------------------------------------------------------------------------


_SAMPLES = 1 << 16  #: number of random edges in the mean shift, for a standard error of 0.3 %
_OFFSETS = np.linspace(0, np.sqrt(2), 64)  #: offsets between which the mean shift is interpolated


@cache
def _mean_excess() -> Floats:
    """Return the mean of max(0, |d| - x) at each x of `_OFFSETS`, in halves of a subpixel.

    d is the displacement of a point of an edge along the edge's normal if both ends snap to the
    nearest subpixel: d = (1 - t) e . n + t e' . n, for points t, normals n, and errors e and e' of
    the two ends, all uniformly distributed.
    """
    random = np.random.default_rng(0)
    along, angle = random.uniform(0, 1, _SAMPLES), random.uniform(0, np.pi / 2, _SAMPLES)
    error = random.uniform(-1, 1, (2, 2, _SAMPLES))
    of_ends = error[:, 0] * np.cos(angle) + error[:, 1] * np.sin(angle)
    moved = np.abs((1 - along) * of_ends[0] + along * of_ends[1])
    return np.array([np.maximum(moved - offset, 0.0).mean() for offset in _OFFSETS])


def mean_shift(subpixel_bits: int, beyond: Floats) -> Floats:
    """Return the mean distance by which snapping moves an edge beyond offsets (...), pixels."""
    half = 2.0 ** -(subpixel_bits + 1)
    return np.asarray(half * np.interp(beyond / half, _OFFSETS, _mean_excess()))


def crease_pixels(truth: HogelImage, scene: Scene, subpixel_bits: int) -> float:
    """Return the expected number of judged pixels with hidden points beyond snapped creases.

    The visible length of a triangle's creases is estimated as their length times the visible share
    of the triangle's area: the number of pixels that show it, divided by its area on the film. The
    share exceeds 1 if a pixel shows a far smaller triangle, but the sum is right on average over
    the pixel grid, for any tessellation.
    """
    shown = truth.triangle[judged_pixels(truth) & truth.covered]
    number, pixels = np.unique(shown, return_counts=True)
    if not number.size:
        return 0.0
    own, side = np.nonzero(scene.twins[number] >= 0)
    length, area, offsets = _measured(truth, scene, number[own], side)
    shift = mean_shift(subpixel_bits, offsets).mean(axis=0)
    # Each crease counts half for each of its two triangles. The area beyond a crease is at most the
    # area of the triangle.
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(length > 0, np.minimum(length * shift / 2 / area, 1.0), 0.0)
    return float(np.sum(pixels[own] * share))


def _measured(
    truth: HogelImage, scene: Scene, number: Numbers, side: Indices
) -> tuple[Floats, Floats, Floats]:
    """Measure sides (N,) of triangles on the true film: lengths, areas, and offsets (2, N).

    Lengths are zero without a visible concave crease. Beyond its offset, each of the two planes is
    farther behind the other triangle than the tolerance of drawn points.
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
        # Normals toward the viewer, and the distance per pixel at which one plane diverges from the
        # other.
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
