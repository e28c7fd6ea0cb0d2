"""Pixel against triangle in double precision, with a bound on every rounding error."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.cone import ROUNDING, Cones, Floats
from xfrustum.reference.lines import Pencil
from xfrustum.reference.spans import Spans

PAIRS_PER_CHUNK = 1 << 20
"""Bounds the memory of the narrow phase, about 200 bytes per pair."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pairs:
    """Pixels and triangles that their lines meet, or may meet.

    Attributes
    ----------
    pixel
        (N,) row * W + column.
    triangle
        (N,) triangle numbers.
    s, error
        (N,) where the line meets the triangle's plane: the true s lies in s +- error.
    sure
        (N,) the line surely meets the triangle, inside the pencil's range.
    """

    pixel: NDArray[np.int64]
    triangle: NDArray[np.int64]
    s: Floats
    error: Floats
    sure: NDArray[np.bool_]

    def __getitem__(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> Pairs:
        """Return some of the pairs."""
        return Pairs(
            pixel=self.pixel[chosen],
            triangle=self.triangle[chosen],
            s=self.s[chosen],
            error=self.error[chosen],
            sure=self.sure[chosen],
        )

    @property
    def nearest(self) -> Floats:
        """The smallest s that is possible."""
        return self.s - self.error

    @property
    def farthest(self) -> Floats:
        """The largest s that is possible."""
        return self.s + self.error

    @staticmethod
    def joined(parts: list[Pairs]) -> Pairs:
        """Concatenate."""
        return Pairs(
            pixel=np.concatenate([p.pixel for p in parts]),
            triangle=np.concatenate([p.triangle for p in parts]),
            s=np.concatenate([p.s for p in parts]),
            error=np.concatenate([p.error for p in parts]),
            sure=np.concatenate([p.sure for p in parts]),
        )


def pairs(spans: Spans, pencil: Pencil) -> Iterator[Pairs]:
    """Evaluate all pixels of some spans; pairs that surely miss are left out."""
    lengths = spans.last - spans.first + 1
    ends = np.cumsum(lengths)
    start = 0
    while start < len(lengths):
        before = ends[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, before + PAIRS_PER_CHUNK)))
        yield _evaluate(spans, slice(start, stop), lengths[start:stop], pencil)
        start = stop


def _evaluate(spans: Spans, part: slice, lengths: NDArray[np.int64], pencil: Pencil) -> Pairs:
    """Evaluate the pixels of consecutive spans."""
    c = spans.cones
    cone_of_span, dy_of_span = spans.cone[part], pencil.dy[spans.row[part]]
    span = np.repeat(np.arange(len(lengths)), lengths)
    offset = np.cumsum(lengths) - lengths
    column = np.arange(len(span)) + (spans.first[part] - offset)[span]
    dx = pencil.dx[column]
    cone = cone_of_span[span]

    # What depends on the row alone is computed once per span.
    normal, magnitude = c.normal[cone_of_span], c.normal_magnitude[cone_of_span]
    level = normal[:, 1] * dy_of_span - normal[:, 2]
    level_magnitude = np.abs(dy_of_span) * magnitude[:, 1] + magnitude[:, 2]
    slope = normal[:, 0][span] * dx + level[span]
    slope_bound = ROUNDING * (magnitude[:, 0][span] * np.abs(dx) + level_magnitude[span])
    s, error = divided(c.plane[cone], c.plane_bound[cone], slope, slope_bound)

    sure = (dx >= spans.surely_from[part][span]) & (dx <= spans.surely_to[part][span])
    inside = np.ones(len(dx), dtype=np.bool_)
    doubtful = np.flatnonzero(~sure)
    surely_in, surely_out = _covered(c, cone[doubtful], dx[doubtful], dy_of_span[span[doubtful]])
    through_center = c.holds_center[cone[doubtful]]
    sure[doubtful] = surely_in | through_center
    inside[doubtful] = ~surely_out | through_center

    first, last = pencil.s_range
    inside &= (s + error >= first) & (s - error <= last)
    # An infinite error also takes away certainty: the line may lie in the triangle's plane.
    sure &= (s - error >= first) & (s + error <= last)
    pixel = spans.row[part][span] * pencil.resolution[0] + column
    found = Pairs(pixel=pixel, triangle=c.number[cone], s=s, error=error, sure=sure)
    return found[inside] if not inside.all() else found


def divided(plane: Floats, plane_bound: Floats, slope: Floats, slope_bound: Floats) -> tuple[Floats, Floats]:
    """Return s = plane / slope and the bound of its error, infinite where the slope may be zero.

    |s - s_true| <= (plane_bound + |s| slope_bound) / (|slope| - slope_bound), and the division
    itself and this expression round: `ROUNDING` times |s| pays for both.
    """
    margin = np.abs(slope) - slope_bound
    certain = margin > slope_bound
    divisor = np.where(certain, slope, 1.0)
    s = np.where(certain, plane / divisor, 0.0)
    error = (plane_bound + np.abs(s) * slope_bound) / np.where(certain, margin, 1.0)
    error = np.where(certain, error * (1 + ROUNDING) + ROUNDING * np.abs(s), np.inf)
    return s, error


def _covered(
    c: Cones, cone: NDArray[np.int64], dx: Floats, dy: Floats
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which pairs are surely covered and which surely are not, by the edge functions."""
    d_magnitude = np.stack((np.abs(dx), np.abs(dy), np.ones_like(dx)), axis=1)
    lowest, highest = np.full(len(cone), np.inf), np.full(len(cone), -np.inf)
    surely_low, surely_high = lowest.copy(), highest.copy()
    for k in range(3):
        edge, magnitude = c.edge[cone, k], c.edge_magnitude[cone, k]
        value = edge[:, 0] * dx + edge[:, 1] * dy - edge[:, 2]
        bound = ROUNDING * np.einsum("ij,ij->i", d_magnitude, magnitude)
        lowest, highest = np.minimum(lowest, value - bound), np.maximum(highest, value + bound)
        surely_low, surely_high = (
            np.minimum(surely_low, value + bound),
            np.maximum(surely_high, value - bound),
        )
    surely_in = (lowest > 0) | (highest < 0)
    # Some edge function is surely positive and another surely negative.
    surely_out = (surely_high > 0) & (surely_low < 0)
    return surely_in, surely_out
