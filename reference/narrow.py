"""Pixel against triangle in double precision, with a bound on every rounding error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.cone import ROUNDING, Floats
from xfrustum.reference.lines import Pencil
from xfrustum.reference.pairs import NO_PAIRS, Pairs
from xfrustum.reference.spans import Spans
from xfrustum.scenes.hogel_image import NOTHING

PAIRS_PER_CHUNK = 1 << 20
"""Bounds the memory of the narrow phase on NumPy, about 200 bytes per pair."""

PENDING_PAIRS = 1 << 22
"""Pairs kept on NumPy before those that cannot be first are dropped."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sifted:
    """Who may be first in some rows of an image.

    Attributes
    ----------
    triangle, s
        (pixels,) the only triangle that can be first, surely met, and where; `NOTHING` and NaN
        where no line meets any, and where `contested` has pairs.
    contested
        All pairs of the pixels for which several triangles may be first, or one in doubt.
    """

    triangle: NDArray[np.int32]
    s: Floats
    contested: Pairs


class NarrowPhase(Protocol):
    """Evaluates the pixels of spans, on whatever computes."""

    def __init__(self, pencil: Pencil, rows: range) -> None: ...

    def add(self, spans: Spans) -> None:
        """Take more spans into account."""
        ...

    def finish(self) -> Sifted:
        """Return who may be first among all that was added."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class SpanPlanes:
    """What the evaluation of a span's pixels needs of its triangle and row, (S,) each.

    Along a row d . n = normal_x dx + level; its rounding error is at most
    `ROUNDING` (magnitude_x |dx| + level_magnitude). Hits count from s = first to s = last: the
    pencil's range, or everything for triangles that lie in it as a whole.
    """

    plane: Floats
    plane_bound: Floats
    normal_x: Floats
    magnitude_x: Floats
    level: Floats
    level_magnitude: Floats
    first: Floats
    last: Floats

    @classmethod
    def of(cls, spans: Spans, pencil: Pencil) -> SpanPlanes:
        """Compute once for each span what depends on its row alone."""
        c, dy = spans.cones, pencil.dy[spans.row]
        normal, magnitude = c.normal[spans.cone], c.normal_magnitude[spans.cone]
        within, (first, last) = c.within[spans.cone], pencil.s_range
        return cls(
            plane=c.plane[spans.cone],
            plane_bound=c.plane_bound[spans.cone],
            normal_x=normal[:, 0],
            magnitude_x=magnitude[:, 0],
            level=normal[:, 1] * dy - normal[:, 2],
            level_magnitude=np.abs(dy) * magnitude[:, 1] + magnitude[:, 2],
            first=np.where(within, -np.finfo(np.float64).max, first),
            last=np.where(within, np.finfo(np.float64).max, last),
        )


def plane_meeting(dx: Any, planes: Sequence[Any], select: Callable[[Any, Any, Any], Any]) -> tuple[Any, Any]:
    """Return s where lines meet triangles' planes, and the bound of its error.

    Written once for NumPy and for Dr.Jit, which differ in what `select` is.

        |s - s_true| <= (plane_bound + |s| slope_bound) / (|slope| - slope_bound),

    and the division itself and this expression round: `ROUNDING` times |s| pays for both. The
    error is infinite where the slope may be zero.

    Parameters
    ----------
    dx
        Slopes of the lines.
    planes
        The first six fields of `SpanPlanes`, in order, for each line.
    select
        `numpy.where` or `drjit.select`.
    """
    plane, plane_bound, normal_x, magnitude_x, level, level_magnitude = planes
    slope = normal_x * dx + level
    slope_bound = ROUNDING * (magnitude_x * abs(dx) + level_magnitude)
    margin = abs(slope) - slope_bound
    certain = margin > slope_bound
    s = select(certain, plane / select(certain, slope, 1.0), 0.0)
    error = (plane_bound + abs(s) * slope_bound) / select(certain, margin, 1.0)
    error = select(certain, error * (1 + ROUNDING) + ROUNDING * abs(s), np.inf)
    return s, error


def settled(spans: Spans, planes: SpanPlanes, span: NDArray[np.int64], found: Pairs, pencil: Pencil) -> Pairs:
    """Decide coverage of the pairs that are not sure yet by their edge functions, with bounds.

    Parameters
    ----------
    spans, planes, span
        Where the pairs come from, and (N,) which span each belongs to.
    found
        Pairs whose s is possible; `sure` where the span was.
    """
    doubtful = np.flatnonzero(~found.sure)
    if not len(doubtful):
        return found
    c, cone = spans.cones, spans.cone[span[doubtful]]
    row, column = np.divmod(found.pixel[doubtful], pencil.resolution[0])
    dx, dy = pencil.dx[column], pencil.dy[row]
    d_magnitude = np.stack((np.abs(dx), np.abs(dy), np.ones_like(dx)), axis=1)
    low, high = np.full(len(cone), np.inf), np.full(len(cone), -np.inf)
    surely_low, surely_high = low.copy(), high.copy()
    for k in range(3):
        edge, magnitude = c.edge[cone, k], c.edge_magnitude[cone, k]
        value = edge[:, 0] * dx + edge[:, 1] * dy - edge[:, 2]
        bound = ROUNDING * np.einsum("ij,ij->i", d_magnitude, magnitude)
        low, high = np.minimum(low, value - bound), np.maximum(high, value + bound)
        surely_low, surely_high = (
            np.minimum(surely_low, value + bound),
            np.maximum(surely_high, value - bound),
        )
    inside = np.ones(len(found.pixel), dtype=np.bool_)
    # Outside: some edge function is surely positive and another surely negative.
    inside[doubtful] = ~((surely_high > 0) & (surely_low < 0))
    sure = found.sure.copy()
    sure[doubtful] = ((low > 0) | (high < 0)) & surely_in_range(found[doubtful], planes, span[doubtful])
    return Pairs(pixel=found.pixel, triangle=found.triangle, s=found.s, error=found.error, sure=sure)[inside]


def surely_in_range(found: Pairs, planes: SpanPlanes, span: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which pairs' s surely count; one with an infinite error never does."""
    return np.asarray((found.nearest >= planes.first[span]) & (found.farthest <= planes.last[span]))


class NumpyNarrowPhase:
    """The narrow phase on NumPy, where there is no LLVM for Dr.Jit.

    Parameters
    ----------
    pencil
        The lines.
    rows
        Rows of the image that all spans lie in.
    """

    def __init__(self, pencil: Pencil, rows: range) -> None:
        self._pencil = pencil
        self._base = rows.start * pencil.resolution[0]
        self._limit = np.full(len(rows) * pencil.resolution[0], np.inf)
        self._kept: list[Pairs] = []

    def add(self, spans: Spans) -> None:
        """Take more spans into account."""
        planes = SpanPlanes.of(spans, self._pencil)
        lengths = spans.last - spans.first + 1
        ends = np.cumsum(lengths)
        start = 0
        while start < len(lengths):
            before = ends[start - 1] if start else 0
            stop = max(start + 1, int(np.searchsorted(ends, before + PAIRS_PER_CHUNK)))
            found = self._evaluated(spans, planes, np.repeat(np.arange(start, stop), lengths[start:stop]))
            np.minimum.at(self._limit, found.pixel[found.sure] - self._base, found.farthest[found.sure])
            self._kept.append(self._not_behind(found))
            if sum(len(kept.pixel) for kept in self._kept) > PENDING_PAIRS:
                self._kept = [self._not_behind(Pairs.joined(self._kept))]
            start = stop

    def finish(self) -> Sifted:
        """Return who may be first among all that was added."""
        found = self._not_behind(Pairs.joined([NO_PAIRS, *self._kept]))
        pixel = found.pixel - self._base
        rivals = np.bincount(pixel, minlength=len(self._limit))
        alone = (rivals[pixel] == 1) & found.sure
        triangle = np.full(len(self._limit), NOTHING, dtype=np.int32)
        s = np.full(len(self._limit), np.nan)
        triangle[pixel[alone]], s[pixel[alone]] = found.triangle[alone], found.s[alone]
        return Sifted(triangle=triangle, s=s, contested=found[~alone])

    def _not_behind(self, found: Pairs) -> Pairs:
        return found[found.nearest <= self._limit[found.pixel - self._base]]

    def _evaluated(self, spans: Spans, planes: SpanPlanes, span: NDArray[np.int64]) -> Pairs:
        """Evaluate all pixels of consecutive spans, each named once for each of its pixels."""
        run = np.flatnonzero(np.diff(span, prepend=-1))
        column = spans.first[span] + np.arange(len(span)) - np.repeat(run, np.diff(run, append=len(span)))
        dx = self._pencil.dx[column]
        p = planes
        s, error = plane_meeting(
            dx,
            (
                p.plane[span],
                p.plane_bound[span],
                p.normal_x[span],
                p.magnitude_x[span],
                p.level[span],
                p.level_magnitude[span],
            ),
            np.where,
        )
        found = Pairs(
            pixel=spans.row[span] * self._pencil.resolution[0] + column,
            triangle=spans.cones.number[spans.cone[span]],
            s=s,
            error=error,
            sure=(dx >= spans.surely_from[span]) & (dx <= spans.surely_to[span]),
        )
        found = replace(found, sure=found.sure & surely_in_range(found, planes, span))
        possible = (found.farthest >= planes.first[span]) & (found.nearest <= planes.last[span])
        return settled(spans, planes, span[possible], found[possible], self._pencil)
