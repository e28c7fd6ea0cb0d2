"""Which pixel centers can each triangle cover? Conservative intervals of columns, row by row.

Nothing here decides: every pixel that a triangle covers in exact arithmetic lies in one of its
spans, and the pixels that it surely covers are marked. The rest is for `narrow`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.cone import EDGES, ROUNDING, UNIT_ROUNDOFF, Cones, Floats, cones, s_bounds
from xfrustum.reference.exact import ExactPencil
from xfrustum.reference.lines import Pencil

TRIANGLES_PER_CHUNK = 1 << 18
"""Bounds the memory of the set-up, about 1 kB per triangle."""


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Footprints:
    """Where on the film triangles may show: once for an image, before its rows are looked at.

    Attributes
    ----------
    number
        (N,) triangle numbers.
    side
        (N,) +1 behind the center (s > 0), -1 before it; 0 for triangles whose boxes in space
        contain the center, the only ones that can be hit at s = 0.
    holds_center
        (N,) the center lies in the closed triangle, exactly.
    box
        (4, N) first and last column, first and last row, inclusive.
    """

    number: NDArray[np.int64]
    side: NDArray[np.int8]
    holds_center: NDArray[np.bool_]
    box: NDArray[np.int32]


def footprints(triangles: Floats, pencil: Pencil, exact: ExactPencil) -> Footprints:
    """Find all triangles (F, 3, 3) that may cover a pixel's center, and drop those that surely do not."""
    parts: list[Footprints] = []
    for start in range(0, len(triangles), TRIANGLES_PER_CHUNK):
        chunk = np.arange(start, min(start + TRIANGLES_PER_CHUNK, len(triangles)))
        # Coordinate first, corner second: minima over corners are then minima of whole arrays.
        x, y, z = np.ascontiguousarray((triangles[chunk] - np.asarray(pencil.center)).transpose(2, 1, 0))
        low, high = s_bounds(z, pencil)
        imaged = (low <= pencil.s_range[1]) & (high >= pencil.s_range[0])
        touching = imaged & _spans_zero(x) & _spans_zero(y) & _spans_zero(z)
        for side in (1, -1):
            if side * pencil.s_range[side > 0] > 0:
                box = _pixel_box(x, y, -z, pencil, side)
                hit = (box[0] <= box[1]) & (box[2] <= box[3]) & imaged & ~touching
                parts.append(_footprints(chunk[hit], side, box[:, hit]))
        if touching.any():
            width, height = pencil.resolution
            # Without area a triangle is met by no line, and here it would occupy the whole image.
            numbers = np.array([n for n in chunk[touching].tolist() if exact.has_area(n)], dtype=np.int64)
            holds = np.array([exact.contains_center(number) for number in numbers.tolist()], dtype=np.bool_)
            whole = np.tile([[0], [width - 1], [0], [height - 1]], len(numbers))
            parts.append(_footprints(numbers, 0, whole, holds))
    if not parts:
        return _footprints(np.zeros(0, dtype=np.int64), 0, np.zeros((4, 0)))
    return Footprints(
        number=np.concatenate([part.number for part in parts]),
        side=np.concatenate([part.side for part in parts]),
        holds_center=np.concatenate([part.holds_center for part in parts]),
        box=np.concatenate([part.box for part in parts], axis=1),
    )


def _footprints(
    number: NDArray[np.int64], side: int, box: NDArray[Any], holds: NDArray[np.bool_] | None = None
) -> Footprints:
    return Footprints(
        number=number,
        side=np.full(len(number), side, dtype=np.int8),
        holds_center=np.zeros(len(number), dtype=np.bool_) if holds is None else holds,
        box=box.astype(np.int32),
    )


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


def _spans_zero(x: Floats) -> NDArray[np.bool_]:
    return np.asarray((x.min(axis=0) <= 0) & (x.max(axis=0) >= 0))


def _pixel_box(x: Floats, y: Floats, s: Floats, pencil: Pencil, side: int) -> Floats:
    """Return first and last column, first and last row (4, T) of the part of triangles on one side."""
    width, height = pencil.resolution
    low, high = _slope_range(x, s, side)
    scale, slack = width / (2 * pencil.half_extent[0]), _pixel_slack(pencil, 0)
    first = (low - pencil.shear[0]) * scale + (width - 1) / 2 - slack
    last = (high - pencil.shear[0]) * scale + (width - 1) / 2 + slack
    low, high = _slope_range(y, s, side)
    scale, slack = height / (2 * pencil.half_extent[1]), _pixel_slack(pencil, 1)
    top = (height - 1) / 2 - (high - pencil.shear[1]) * scale - slack
    bottom = (height - 1) / 2 - (low - pencil.shear[1]) * scale + slack
    return np.stack(
        (
            np.ceil(np.clip(first, 0, width)),
            np.floor(np.clip(last, -1, width - 1)),
            np.ceil(np.clip(top, 0, height)),
            np.floor(np.clip(bottom, -1, height - 1)),
        )
    )


def _pixel_slack(pencil: Pencil, axis: int) -> float:
    """Bound in pixels the rounding of a projection near the film, and of the slopes themselves.

    A projected slope x / s carries 3 u of itself, k and t add as much again, and near the film
    no slope exceeds |k| + t; all of it times W / (2 t). Doubled.
    """
    ratio = abs(pencil.shear[axis]) / pencil.half_extent[axis]
    return 16 * UNIT_ROUNDOFF * pencil.resolution[axis] * (ratio + 2)


def _slope_range(x: Floats, s: Floats, side: int) -> tuple[Floats, Floats]:
    """Return the range of x / s over the part of each triangle (3, T) on one side of the center.

    A triangle that crosses s = 0 reaches to infinity there, in the direction of the points
    where its edges cross.
    """
    ahead = side * s > 0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        slope = x / s
    low = np.where(ahead, slope, np.inf).min(axis=0)
    high = np.where(ahead, slope, -np.inf).max(axis=0)
    mixed = np.flatnonzero(ahead.any(axis=0) & ~ahead.all(axis=0))
    x, s, ahead = x[:, mixed], s[:, mixed], ahead[:, mixed]
    for i, j in EDGES:
        # The edge meets s = 0 at x = (x_j s_i - x_i s_j) / (s_i - s_j).
        crosses = ahead[i] != ahead[j]
        here, there = x[j] * s[i], x[i] * s[j]
        toward = side * np.sign(s[i] - s[j]) * (here - there)
        doubt = ROUNDING * (np.abs(here) + np.abs(there))
        high[mixed[crosses & (toward >= -doubt)]] = np.inf
        low[mixed[crosses & (toward <= doubt)]] = -np.inf
    return low, high


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

    width, slack = pencil.resolution[0], _pixel_slack(pencil, 0)
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
