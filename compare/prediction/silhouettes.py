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
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter

from xfrustum.compare.metrics.error_maps import judged_pixels
from xfrustum.compare.prediction.contours import CONTOUR_SIGMA_PX, Contours, Kind, contours
from xfrustum.compare.prediction.displacement import (
    TruePoints,
    displacements,
    in_first_slab,
    is_drawn,
)
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum, Offset
from xfrustum.scenes.plate.frustum import Frustum

SNAP_PER_HALF_SUBPIXEL = 0.39
"""Mean distance by which a point of an edge moves along the edge's normal when both ends of the edge snap to
the nearest subpixel in each axis, as a part of half a subpixel. Both errors of each end are uniform; the mean
over points and directions is 0.390, by two million random edges."""


class Silhouettes:
    """The contours of a true image, and the wrong pixels that displacement makes along them.

    `points` are its surface points, where they are known already.
    """

    def __init__(self, truth: HogelImage, frustum: Frustum, points: TruePoints | None = None) -> None:
        self._truth, self._frustum = truth, frustum
        self._judged = judged_pixels(truth)
        self._points = points or TruePoints.of(truth)
        # Pixels that end in the aperture itself, on a surface that passes through the plate, where it hides
        # everything behind it. All of the picture that it fills is one point of it, and drawn are others,
        # closer than n. A surface that lies in the plate is another matter: both cameras draw it where it is,
        # and show the wrong surface only through apertures that are closer to its border than n t.
        self._in_aperture: Mask = truth.covered & (truth.height == 0)
        if truth.normal is not None and self._in_aperture.any():
            self._in_aperture &= (truth.normal[..., :2] != 0).any(axis=-1)
        self._contours: dict[tuple[float, ...], tuple[Contours, TruePoints, TruePoints]] = {}

    def charged_pixels(self, chain: Sequence[DoubleFrustum]) -> tuple[float, ...]:
        """Return the expected number of wrong pixels charged to each link of a chain of settings.

        A pixel is charged to the first link from which on it is wrong to the end of the chain. The last
        settings say where slabs are cut. Errors of depth are left out.
        """
        steps, *sides = self._contours_for(chain[-1])
        missing, between = self._not_shown(chain[-1]), steps.kind == Kind.OBJECTS
        # From the last link backward: the part of each step's wrong span that stays wrong to the end, px.
        low, high = np.full(len(steps.kind), -np.inf), np.full(len(steps.kind), np.inf)
        found: dict[DoubleFrustum, float] = {}
        for settings in dict.fromkeys(reversed(chain)):
            # Where the front ends in the picture, and where the visible back begins. Both sides of a step are
            # displaced at the contour, half a pixel from either center.
            moved = (displacements(side, self._frustum, settings) for side in sides)
            c, b = (-np.einsum("ij,ij->i", np.nan_to_num(side), steps.normal) for side in moved)
            # Between objects, 0 to c is wrong too. Elsewhere only c to b is, and only where c < b.
            low = np.maximum(low, np.where(between, np.minimum(c, 0), c))
            high = np.minimum(high, np.maximum(np.where(between, np.maximum(b, 0), b), c))
            found[settings] = expected_wrong(_swept(steps, low, high), missing, self._judged)
        # A link is charged with what is wrong to the end from it on, and was not from the one before.
        return tuple(np.diff([found[settings] for settings in chain], prepend=0.0).tolist())

    def snapped_pixels(self, settings: DoubleFrustum, subpixel_bits: int) -> float:
        """Return the expected number of judged pixels that show a wrong surface because edges snap.

        Between objects every moved point of the contour makes a wrong pixel. Inside one object only the half
        of the contour that recedes does. The number is an upper estimate: where displacement has moved a
        contour farther than snapping does, half of the pixels that change were wrong before.
        """
        (steps, *_), judged = self._contours_for(settings), self._judged.ravel()
        length = steps.length * np.where(steps.kind == Kind.OBJECTS, 1.0, 0.5)
        counted = (judged[steps.front].astype(np.float64) + judged[steps.back]) / 2
        return float(np.sum(length * counted)) * SNAP_PER_HALF_SUBPIXEL * 2.0 ** -(subpixel_bits + 1)

    def _contours_for(self, settings: DoubleFrustum) -> tuple[Contours, TruePoints, TruePoints]:
        """Return the contours, and the points in front of and behind each step, shown at the contour.

        They are found once for each height at which the first slab ends.
        """
        first = settings.slabs[:1]
        if first not in self._contours:
            slab = in_first_slab(self._points.height, self._frustum, settings) if first else None
            steps = contours(self._truth, slab)
            places = steps.places - (np.asarray(steps.resolution) - 1) / 2
            front, back = (
                replace(self._points.at(one), from_middle=places) for one in (steps.front, steps.back)
            )
            self._contours[first] = steps, front, back
        return self._contours[first]

    def _not_shown(self, settings: DoubleFrustum) -> Mask:
        """Return the pixels whose surface no camera shows, (H, W)."""
        if settings.camera is Camera.BOTH and settings.offset is Offset.PLATE:
            return self._in_aperture
        height = self._points.height
        return np.asarray(self._in_aperture | (np.isfinite(height) & ~is_drawn(height, settings)))


def expected_wrong(swept: Floats, missing: Mask, judged: Mask) -> float:
    """Return the expected number of wrong pixels, of maps (H, W).

    `swept` is the share of each pixel that spans sweep over; areas swept twice are counted twice, and nothing
    is smoothed. Pixels that are `missing` are wrong whatever sweeps over them; those that are `judged` count.
    """
    if swept.max(initial=0.0) <= 1 and not missing.any() and judged.all():
        # No area is swept twice, and smoothing preserves the sum.
        return float(swept.sum())
    wrong = np.minimum(gaussian_filter(swept, CONTOUR_SIGMA_PX), 1)
    wrong[missing] = 1.0
    return float(wrong.sum(where=judged))


def _swept(steps: Contours, low: Floats, high: Floats) -> Floats:
    """Return the share of each pixel that spans sweep over, (H, W); areas swept twice are counted twice.

    The spans of neighboring steps overlap and leave gaps. The caller smooths the result over
    `CONTOUR_SIGMA_PX`, the width over which steps form a contour, and then counts no pixel more than once.
    """
    width, height = steps.resolution
    # Spans are clipped to the film's diagonal, beyond which nothing is counted.
    farthest = float(np.hypot(width, height))
    low, high = (np.clip(side, -farthest, farthest) for side in (low, high))
    # They are cut into pieces no longer than a pixel; `step` is a piece's span, `number` its place there.
    count = np.ceil(np.maximum(high - low, 0)).astype(np.int64)
    step = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(step)) - np.repeat(np.cumsum(count) - count, count)
    # The pixel under the middle of each piece.
    size = (high - low) / np.maximum(count, 1)
    along = low[step] + (number + 0.5) * size[step]
    column, row = np.rint(steps.places[step] + along[:, None] * steps.normal[step]).astype(np.int64).T
    on_film = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    # The areas of the pieces, contour length times piece length, are added up in each pixel.
    area = (steps.length * size)[step[on_film]]
    swept = np.bincount((column + row * width)[on_film], area, width * height)
    return swept.astype(np.float64).reshape(height, width)
