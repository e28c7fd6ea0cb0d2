"""Closed form of the surface error that displacement causes along silhouettes.

See docs/method.md, "What is compared".

A picture that is displaced as a whole shows no wrong surface. But where one surface ends before another, the
two are displaced differently, and the contour is drawn elsewhere. Let x run in pixels across the contour,
along its normal from the surface in front to the surface behind. The truth shows the front up to x = 0; the
picture shows the front up to c = -d_front n; and from b = -d_back n on it shows the part of the back that the
true frustum sees.

 * Between 0 and c the picture shows another object, or a surface instead of none, or none instead of one.
 * Between c and b, where c < b, the picture shows a part that the front hides from the true frustum.

Inside one object only the second interval is wrong. Where a surface is cut into slabs with cameras of their
own nothing is hidden, but between c and b, where c < b, there is a gap.

These are first-order statements: they are exact while displacement is small against the distance from one
contour to the next, and against the length of a contour.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter

from xfrustum.compare.metrics.error_maps import judged_pixels
from xfrustum.compare.prediction.chain import with_named_fit
from xfrustum.compare.prediction.contours import CONTOUR_SIGMA_PX, Contours, Kind, contours
from xfrustum.compare.prediction.displacement import (
    TruePoints,
    displacements,
    in_first_slab,
    is_drawn,
    pierced,
)
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum, Offset
from xfrustum.scenes.plate.frustum import Frustum

SNAP_PER_HALF_SUBPIXEL = 0.39
"""Mean distance by which a point of an edge moves along the edge's normal when both ends of the edge snap to
the nearest subpixel in each axis, as a part of half a subpixel. Both errors of each end are uniform; the mean
over points and directions is 0.390, by two million random edges."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Spans:
    """The interval across each step of a contour in which the picture is wrong.

    Attributes
    ----------
    low, high
        (N,) ends along the step's normal, px; high <= low where nothing is wrong.
    """

    low: Floats
    high: Floats

    @classmethod
    def of(cls, steps: Contours, front: Floats, back: Floats) -> _Spans:
        """Return the spans that follow from the displacement, (N, 2) px, on both sides of each step."""
        # Step 1: where the front ends in the picture, and where the visible back begins.
        c, b = (-np.einsum("ij,ij->i", np.nan_to_num(side), steps.normal) for side in (front, back))
        # Step 2: between objects, 0 to c is wrong too. Elsewhere only c to b is, and only where c < b.
        between = steps.kind == Kind.OBJECTS
        low, high = np.where(between, np.minimum(c, 0), c), np.where(between, np.maximum(b, 0), b)
        return cls(low=low, high=np.maximum(high, c))

    def within(self, other: _Spans) -> _Spans:
        """Return the intersection of each span with the other one of the same step."""
        return _Spans(low=np.maximum(self.low, other.low), high=np.minimum(self.high, other.high))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sided:
    """Contours, and the surface points in front of and behind each of their steps, shown at the contour."""

    steps: Contours
    front: TruePoints
    back: TruePoints

    @classmethod
    def of(cls, steps: Contours, points: TruePoints) -> _Sided:
        from_middle = steps.places - (np.asarray(steps.resolution) - 1) / 2
        front, back = (replace(points.at(one), from_middle=from_middle) for one in (steps.front, steps.back))
        return cls(steps=steps, front=front, back=back)


class Silhouettes:
    """The contours of a true image, and the wrong pixels that displacement makes along them.

    Parameters
    ----------
    points
        Surface points of the true image, where they are known already.
    """

    def __init__(self, truth: HogelImage, frustum: Frustum, points: TruePoints | None = None) -> None:
        self._truth, self._frustum = truth, frustum
        self._judged = judged_pixels(truth)
        self._points = points or TruePoints.of(truth)
        self._in_aperture = pierced(truth)
        self._contours: dict[tuple[float, ...], _Sided] = {}

    def wrong_pixels(self, settings: DoubleFrustum) -> float:
        """Return the expected number of judged pixels with a wrong surface, errors of depth left out."""
        return self.charged_pixels((with_named_fit(settings, self._frustum),))[0]

    def charged_pixels(self, chain: Sequence[DoubleFrustum]) -> tuple[float, ...]:
        """Return the expected number of wrong pixels charged to each link of a chain.

        Parameters
        ----------
        chain
            Settings of each link. A pixel is charged to the first link from which on it is wrong to the
            end of the chain. The last settings say where slabs are cut.
        """
        last = chain[-1]
        steps, missing = self._contours_for(last).steps, self._not_shown(last)
        # Step 1: from the last link backward, the part of each step's wrong span that stays wrong to the end.
        common = self._spans(last, last)
        wrong_to_the_end = [expected_wrong(_swept(steps, common), missing, self._judged)]
        for after, before in pairwise(reversed(chain)):
            if before == after:
                wrong_to_the_end.append(wrong_to_the_end[-1])
                continue
            common = common.within(self._spans(before, last))
            wrong_to_the_end.append(expected_wrong(_swept(steps, common), missing, self._judged))
        # Step 2: a link is charged with what is wrong to the end from it on, and was not from the one before.
        return tuple(np.diff(wrong_to_the_end[::-1], prepend=0.0).tolist())

    def _spans(self, settings: DoubleFrustum, last: DoubleFrustum) -> _Spans:
        """Return the wrong spans of some settings, across the contours of the last settings of a chain."""
        found = self._contours_for(last)
        # Both sides of a step are displaced at the contour, half a pixel from either center.
        moved = (displacements(side, self._frustum, settings) for side in (found.front, found.back))
        return _Spans.of(found.steps, *moved)

    def snapped_pixels(self, settings: DoubleFrustum, subpixel_bits: int) -> float:
        """Return the expected number of judged pixels that show a wrong surface because edges snap.

        Between objects every moved point of the contour makes a wrong pixel. Inside one object only the half
        of the contour that recedes does. The number is an upper estimate: where displacement has moved a
        contour farther than snapping does, half of the pixels that change were wrong before.
        """
        steps, judged = self._contours_for(settings).steps, self._judged.ravel()
        length = steps.length * np.where(steps.kind == Kind.OBJECTS, 1.0, 0.5)
        counted = (judged[steps.front].astype(np.float64) + judged[steps.back]) / 2
        return float(np.sum(length * counted)) * SNAP_PER_HALF_SUBPIXEL * 2.0 ** -(subpixel_bits + 1)

    def _contours_for(self, settings: DoubleFrustum) -> _Sided:
        """Return the contours, found once for each height at which the first slab ends."""
        first = settings.slabs[:1]
        if first not in self._contours:
            slab = in_first_slab(self._points.height, self._frustum, settings) if first else None
            self._contours[first] = _Sided.of(contours(self._truth, slab), self._points)
        return self._contours[first]

    def _not_shown(self, settings: DoubleFrustum) -> Mask:
        """Return the pixels whose surface no camera shows, (H, W)."""
        if settings.camera is Camera.BOTH and settings.offset is Offset.PLATE:
            return self._in_aperture
        height = self._points.height
        return np.asarray(self._in_aperture | (np.isfinite(height) & ~is_drawn(height, settings)))


def expected_wrong(swept: Floats, missing: Mask, judged: Mask) -> float:
    """Return the expected number of wrong pixels.

    Parameters
    ----------
    swept
        (H, W) share of each pixel that spans sweep over; areas swept twice are counted twice, and nothing
        is smoothed.
    missing
        (H, W) pixels that are wrong whatever sweeps over them.
    judged
        (H, W) pixels that count.
    """
    if swept.max(initial=0.0) <= 1 and not missing.any() and judged.all():
        # No area is swept twice, and smoothing preserves the sum.
        return float(swept.sum())
    wrong = np.minimum(gaussian_filter(swept, CONTOUR_SIGMA_PX), 1)
    wrong[missing] = 1.0
    return float(wrong.sum(where=judged))


def _swept(steps: Contours, spans: _Spans) -> Floats:
    """Return the share of each pixel that spans sweep over, (H, W); areas swept twice are counted twice.

    The spans of neighboring steps overlap and leave gaps. The caller smooths the result over
    `CONTOUR_SIGMA_PX`, the width over which steps form a contour, and then counts no pixel more than once.
    """
    width, height = steps.resolution
    # Step 1: clip spans to the film's diagonal, beyond which nothing is counted.
    farthest = float(np.hypot(width, height))
    low, high = (np.clip(side, -farthest, farthest) for side in (spans.low, spans.high))
    # Step 2: cut each span into pieces no longer than a pixel; `step` is the span of a piece, `number` its
    # place within the span.
    count = np.ceil(np.maximum(high - low, 0)).astype(np.int64)
    step = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(step)) - np.repeat(np.cumsum(count) - count, count)
    # Step 3: the pixel under the middle of each piece.
    size = (high - low) / np.maximum(count, 1)
    along = low[step] + (number + 0.5) * size[step]
    column, row = np.rint(steps.places[step] + along[:, None] * steps.normal[step]).astype(np.int64).T
    on_film = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    # Step 4: add up the areas of the pieces, contour length times piece length, in each pixel.
    area = (steps.length * size)[step[on_film]]
    swept = np.bincount((column + row * width)[on_film], area, width * height)
    return swept.astype(np.float64).reshape(height, width)
