"""Which pixel centers can each triangle cover? Conservative intervals of columns, row by row.

Nothing here decides: every pixel that a triangle covers in exact arithmetic lies in one of its
spans, and the pixels that it surely covers are marked. The rest is for `narrow`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.cone import ROUNDING, UNIT_ROUNDOFF, Cones, Floats, cones
from xfrustum.reference.footprints import TRIANGLES_PER_CHUNK, Footprints, pixel_slack
from xfrustum.reference.lines import Pencil


@dataclass(frozen=True, kw_only=True, eq=False)
class Spans:
    """Rows of pixels that triangles may cover.

    Attributes
    ----------
    cones
        The triangles.
    cone
        (S,) index into `cones`.
    row, first, last
        (S,) row, and first and last column, inclusive.
    surely_from, surely_to
        (S,) slopes dx between which coverage is certain; empty where from > to.
    """

    cones: Cones
    cone: NDArray[np.int64]
    row: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    surely_from: Floats
    surely_to: Floats


def spans(triangles: Floats, pencil: Pencil, found: Footprints, rows: range) -> Iterator[Spans]:
    """Enumerate the spans of all triangles in some rows of the image."""
    top, bottom = np.maximum(found.box[2], rows.start), np.minimum(found.box[3], rows.stop - 1)
    here = np.flatnonzero(top <= bottom)
    for start in range(0, len(here), TRIANGLES_PER_CHUNK):
        some = here[start : start + TRIANGLES_PER_CHUNK]
        for sided in (True, False):
            chosen = some[(found.side[some] != 0) == sided]
            if not len(chosen):
                continue
            set_up = cones(triangles, found.number[chosen], pencil, found.holds_center[chosen])
            box = np.stack((found.box[0, chosen], found.box[1, chosen], top[chosen], bottom[chosen]))
            if sided:
                yield _spans_of_sides(set_up, pencil, found.side[chosen], box.astype(np.int64))
            else:
                yield _whole_rows(set_up, pencil, rows)


def _spans_of_sides(c: Cones, pencil: Pencil, side: NDArray[np.int8], box: NDArray[np.int64]) -> Spans:
    """Cut the rows of each triangle's box by its three edge functions."""
    # Both orientations where the plane passes so near the center that its side is in doubt.
    in_doubt = np.abs(c.plane) <= c.plane_bound
    entry = np.concatenate((np.arange(len(c.number)), np.flatnonzero(in_doubt)))
    orientation = side * np.where(c.plane < 0, -1.0, 1.0)
    orientation = np.concatenate((orientation, -orientation[in_doubt]))
    heights = (box[3] - box[2] + 1)[entry]
    cone = np.repeat(entry, heights)
    orientation = np.repeat(orientation, heights)
    row = np.arange(len(cone)) + np.repeat(box[2][entry] - (np.cumsum(heights) - heights), heights)
    dy = pencil.dy[row]
    steepest = np.abs(pencil.dx).max()

    low, high = np.full(len(cone), -np.inf), np.full(len(cone), np.inf)
    surely_low, surely_high = low.copy(), high.copy()
    for k in range(3):
        edge, magnitude = c.edge[cone, k], c.edge_magnitude[cone, k]
        slope = orientation * edge[:, 0]
        rest = orientation * (edge[:, 1] * dy - edge[:, 2])
        bound = ROUNDING * (steepest * magnitude[:, 0] + np.abs(dy) * magnitude[:, 1] + magnitude[:, 2])
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            zero = -rest / slope
            # Twice the bound also pays for rounding `zero` and the sums below.
            margin = 2 * bound / np.abs(slope) + 4 * UNIT_ROUNDOFF * np.abs(zero)
        # A slope so small that the quotient overflows changes nothing along the row.
        level = ~np.isfinite(margin)
        zero[level], margin[level] = 0.0, 0.0
        rising, falling = (slope > 0) & ~level, (slope < 0) & ~level
        low = np.where(rising, np.maximum(low, zero - margin), low)
        surely_low = np.where(rising, np.maximum(surely_low, zero + margin), surely_low)
        high = np.where(falling, np.minimum(high, zero + margin), high)
        surely_high = np.where(falling, np.minimum(surely_high, zero - margin), surely_high)
        low = np.where(level & (rest < -bound), np.inf, low)
        surely_low = np.where(level & (rest <= bound), np.inf, surely_low)

    width, slack = pencil.resolution[0], pixel_slack(pencil, 0)
    scale, middle = width / (2 * pencil.half_extent[0]), (width - 1) / 2
    first = np.clip((low - pencil.shear[0]) * scale + middle - slack, -1, width)
    last = np.clip((high - pencil.shear[0]) * scale + middle + slack, -1, width)
    first = np.maximum(np.ceil(first).astype(np.int64), box[0][cone])
    last = np.minimum(np.floor(last).astype(np.int64), box[1][cone])
    some = first <= last
    return Spans(
        cones=c,
        cone=cone[some],
        row=row[some],
        first=first[some],
        last=last[some],
        surely_from=surely_low[some],
        surely_to=surely_high[some],
    )


def _whole_rows(c: Cones, pencil: Pencil, rows: range) -> Spans:
    """Return spans of full width for triangles whose boxes in space contain the center.

    A triangle that does contain it is met by every line; of the others nothing is certain yet.
    """
    cone = np.repeat(np.arange(len(c.number)), len(rows))
    return Spans(
        cones=c,
        cone=cone,
        row=np.tile(np.arange(rows.start, rows.stop), len(c.number)),
        first=np.zeros(len(cone), dtype=np.int64),
        last=np.full(len(cone), pencil.resolution[0] - 1),
        surely_from=np.where(c.holds_center[cone], -np.inf, np.inf),
        surely_to=np.where(c.holds_center[cone], np.inf, -np.inf),
    )
