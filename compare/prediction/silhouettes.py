"""Closed form of the surface error that displacement causes along silhouettes.

See docs/method.md, "What is compared".

A picture merely displaced shows no wrong surface, but where one surface ends before another the two
are displaced differently, and the contour is drawn elsewhere. Across a contour, with x in pixels
along its normal from the surface in front to what lies behind, everything is an interval: the truth
shows the front up to x = 0; it is drawn up to c = -d_front n; and from b = -d_back n on is drawn
what the true frustum sees of the surface behind.

 * Between 0 and c the picture shows another object, or a hit for a miss.
 * Between c and b, where c < b, it shows what the front hides from the true frustum.

Inside one object only the second is wrong. Where a surface is cut into slabs with cameras of their
own nothing is hidden, but between c and b, where c < b, there is a gap.

All that is of first order: exact while displacement is small against the distance from contour to
contour, and along a contour.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter

from xfrustum.compare.metrics.error_maps import judged_pixels
from xfrustum.compare.prediction.contours import SIGMA_PX, Contours, Kind, contours
from xfrustum.compare.prediction.displacement import TruePoints, displacements, in_first_slab, is_drawn
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum, Offset
from xfrustum.scenes.plate.frustum import Frustum

SNAPPED_BY = 0.39
"""Of half a subpixel: how far a point of an edge moves along the edge's normal, on average over points and
directions, when both ends snap to the nearest subpixel in each axis."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Spans:
    """From where to where the picture is wrong across each step of a contour, (N,) px; else high <= low."""

    low: Floats
    high: Floats

    @classmethod
    def of(cls, steps: Contours, front: Floats, back: Floats) -> _Spans:
        """Take them from the displacement, (N, 2) px, on both sides of each step."""
        c, b = (-np.einsum("ij,ij->i", np.nan_to_num(side), steps.normal) for side in (front, back))
        between = steps.kind == Kind.OBJECTS
        low, high = np.where(between, np.minimum(c, 0), c), np.where(between, np.maximum(b, 0), b)
        return cls(low=low, high=np.maximum(high, c))

    def within(self, other: _Spans) -> _Spans:
        return _Spans(low=np.maximum(self.low, other.low), high=np.minimum(self.high, other.high))


class Silhouettes:
    """The contours of a true image, and what displacement makes of them.

    Parameters
    ----------
    truth
        The true image of an aperture.
    frustum
        The scene's.
    """

    def __init__(self, truth: HogelImage, frustum: Frustum) -> None:
        self._truth, self._frustum = truth, frustum
        self._judged = judged_pixels(truth)
        self._points = TruePoints.of(truth)
        self._in_aperture = _in_aperture(truth)
        self._contours: dict[tuple[float, ...], Contours] = {}

    def wrong_pixels(self, settings: DoubleFrustum) -> float:
        """Return the expected number of judged pixels that show a wrong surface, depth apart."""
        return self.charged_pixels((settings,))[0]

    def charged_pixels(self, chain: Sequence[DoubleFrustum]) -> tuple[float, ...]:
        """Return the expected number of wrong pixels charged to each link of a chain.

        Parameters
        ----------
        chain
            Settings, as they are changed link by link: those pixels are charged to a link that are
            wrong from it on to the end. The last one says where slabs are cut.
        """
        steps = self._contours_for(chain[-1])
        missing = self._not_shown(chain[-1])
        # Where the contour is, half a pixel beside the centers of both.
        middle = (np.asarray(steps.resolution) - 1) / 2
        sides = [
            replace(self._points.at(pixels), from_middle=steps.places - middle)
            for pixels in (steps.front, steps.back)
        ]
        spans = [
            _Spans.of(steps, *(displacements(side, self._frustum, settings) for side in sides))
            for settings in chain
        ]
        wrong_to_the_end, common = [], spans[-1]
        for span in reversed(spans):
            common = common.within(span)
            wrong_to_the_end.append(expected_wrong(_swept(steps, common), missing, self._judged))
        return tuple(np.diff(wrong_to_the_end[::-1], prepend=0.0).tolist())

    def snapped_pixels(self, settings: DoubleFrustum, subpixel_bits: int) -> float:
        """Return the expected number of judged pixels that show a wrong surface because edges snap.

        Inside one object only where its contour recedes, which is half of it. Where displacement has
        moved a contour farther than that, half of what changes was wrong before, and there are fewer.
        """
        steps = self._contours_for(settings)
        length = steps.length * np.where(steps.kind == Kind.OBJECTS, 1.0, 0.5)
        judged = self._judged.ravel()
        counted = (judged[steps.front].astype(np.float64) + judged[steps.back]) / 2
        return float(np.sum(length * counted)) * SNAPPED_BY * 2.0 ** -(subpixel_bits + 1)

    def _contours_for(self, settings: DoubleFrustum) -> Contours:
        """Return the contours, found once for each height at which the first slab ends."""
        first = settings.slabs[:1]
        if first not in self._contours:
            slab = in_first_slab(self._points.height, self._frustum, settings) if first else None
            self._contours[first] = contours(self._truth, slab)
        return self._contours[first]

    def _not_shown(self, settings: DoubleFrustum) -> Mask:
        """Return the pixels whose surface the cameras do not show at all, (H, W)."""
        if settings.camera is Camera.BOTH and settings.offset is Offset.PLATE:
            return self._in_aperture
        height = self._points.height
        return np.asarray(self._in_aperture | (np.isfinite(height) & ~is_drawn(height, settings)))


def expected_wrong(swept: Floats, missing: Mask, judged: Mask) -> float:
    """Return the expected number of wrong pixels.

    Parameters
    ----------
    swept
        (H, W) share of each pixel that spans sweep over, not evened out, what is swept over twice twice.
    missing, judged
        (H, W) pixels that are wrong whatever sweeps over them, and pixels that count.
    """
    if swept.max(initial=0.0) <= 1 and not missing.any() and judged.all():
        # Nothing is swept over twice, and evening out leaves the sum as it is.
        return float(swept.sum())
    wrong = np.minimum(gaussian_filter(swept, SIGMA_PX), 1)
    wrong[missing] = 1.0
    return float(wrong.sum(where=judged))


def _in_aperture(truth: HogelImage) -> Mask:
    """Return the pixels that show a surface through the aperture itself, (H, W).

    Every true line meets it there, and it hides all that is behind. But in the plate, the near
    plane of both cameras, each of them sees one point of it at most: it is not shown. A surface that
    lies in the plate is.
    """
    found = truth.covered & (truth.height == 0)
    if truth.normal is not None:
        found &= (truth.normal[..., 0] != 0) | (truth.normal[..., 1] != 0)
    return np.asarray(found)


def _swept(steps: Contours, spans: _Spans) -> Floats:
    """Return how much of each pixel spans sweep over, (H, W), more than one where they do so twice.

    The spans of neighboring steps overlap and leave gaps, which are to be evened out over the `SIGMA_PX` over
    which a contour is one. What is swept over twice is then wrong once.
    """
    width, height = steps.resolution
    # Beyond the film nothing is counted.
    farthest = float(np.hypot(width, height))
    low, high = (np.clip(side, -farthest, farthest) for side in (spans.low, spans.high))
    count = np.ceil(np.maximum(high - low, 0)).astype(np.int64)
    step = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(step)) - np.repeat(np.cumsum(count) - count, count)
    along = low[step] + (number + 0.5) * ((high - low) / np.maximum(count, 1))[step]
    at = np.rint(steps.places[step] + along[:, None] * steps.normal[step]).astype(np.int64)
    on_film = np.all((at >= 0) & (at < (width, height)), axis=1)
    area = (steps.length * (high - low) / np.maximum(count, 1))[step[on_film]]
    swept: Floats = np.bincount(at[on_film] @ (1, width), area, width * height).astype(np.float64)
    return swept.reshape(height, width)
