"""The part of the film on which each triangle can show: conservative boxes of pixels."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.certify.sides import Sides, some
from xfrustum.reference.lines.cone import EDGES, ROUNDING, UNIT_ROUNDOFF
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers

if TYPE_CHECKING:
    from xfrustum.reference.lines.boxes_jit import Boxes
    from xfrustum.reference.lines.corners_jit import CornerTable


@dataclass(frozen=True, kw_only=True, eq=False)
class Footprints:
    """The boxes of pixels in which triangles may show, found once for an image.

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
    turned
        (N,) the sign of the edge functions inside each triangle, twice that where the sign is in doubt, and
        0 where `side` is; None where it was not found together with the boxes.
    """

    number: Indices
    side: NDArray[np.int8]
    holds_center: Mask
    box: Numbers
    turned: NDArray[np.int8] | None = None


def footprints(sorted_triangles: Iterable[Sides], pencil: Pencil, exact: ExactPencil) -> Footprints:
    """Find all triangles that may cover a pixel's center, and drop those that surely do not.

    Parameters
    ----------
    sorted_triangles
        Triangles sorted by `sorted_by_side` for this pencil, or for one of the same height and range.
    pencil
        Lines of the image.
    exact
        The same lines in integers.
    """
    parts: list[Footprints] = []
    center_x, center_y, _ = pencil.center
    for chunk in sorted_triangles:
        # Triangles whose boxes in space do not hold the center: their projection bounds them.
        touching = chunk.touching(center_x, center_y)
        for side in (every.without(touching) for every in chunk.sides):
            box = _pixel_box(side.x - center_x, side.y - center_y, side.s, pencil, side.sign)
            hit = (box[0] <= box[1]) & (box[2] <= box[3])
            parts.append(_footprints(side.number[hit], side.sign, box[:, hit]))
        # The others may contain the center, and may then show in every pixel.
        if len(touching):
            parts.append(footprints_around_center(touching, pencil, exact))
    return joined_footprints(parts)


def footprints_on_device(table: CornerTable, pencil: Pencil, exact: ExactPencil) -> Footprints:
    """Return what `footprints` returns of all triangles of a table, with the way that they are turned.

    Parameters
    ----------
    table
        Corners of the triangles.
    pencil
        Lines of the image.
    exact
        The same lines in integers.
    """
    sides = sides_of(pencil)
    # Imported only here, because Dr.Jit's arrays need the LLVM that `processors.compiled` has chosen.
    boxes_on = import_module("xfrustum.reference.lines.boxes_jit").boxes_on
    found: list[Boxes] = boxes_on(table, pencil, (pixel_slack(pencil, 0), pixel_slack(pencil, 1)), sides)
    parts = []
    for side, boxes in zip(sides, found, strict=False):
        part = _footprints(boxes.number, side, boxes.box)
        parts.append(replace(part, turned=boxes.turned.astype(np.int8)))
    if found and len(found[0].touching):
        parts.append(footprints_around_center(found[0].touching, pencil, exact))
    return joined_footprints(parts)


def footprints_around_center(touching: Indices, pencil: Pencil, exact: ExactPencil) -> Footprints:
    """Return the boxes of triangles whose boxes in space contain the center: they may show in every pixel."""
    width, height = pencil.resolution
    # No line meets a triangle without area, which would take the whole image here for nothing.
    numbers = np.array([n for n in touching.tolist() if exact.has_area(n)], dtype=np.int64)
    holds = np.array([exact.contains_center(number) for number in numbers.tolist()], dtype=np.bool_)
    whole = np.tile([[0], [width - 1], [0], [height - 1]], len(numbers))
    return _footprints(numbers, 0, whole, holds)


def joined_footprints(parts: Sequence[Footprints]) -> Footprints:
    """Return the boxes of all parts, one part after the other."""
    if not parts:
        return _footprints(np.zeros(0, dtype=np.int64), 0, np.zeros((4, 0)))
    if len(parts) == 1:
        return parts[0]
    turned = [np.zeros(len(part.number), np.int8) if part.turned is None else part.turned for part in parts]
    return Footprints(
        number=np.concatenate([part.number for part in parts]),
        side=np.concatenate([part.side for part in parts]),
        holds_center=np.concatenate([part.holds_center for part in parts]),
        box=np.concatenate([part.box for part in parts], axis=1),
        turned=None if all(part.turned is None for part in parts) else np.concatenate(turned),
    )


def sides_of(pencil: Pencil) -> tuple[int, ...]:
    """Return the sides of the center that a pencil's range reaches into: +1 behind it, -1 before it."""
    return tuple(sign for sign in (1, -1) if sign * pencil.s_range[sign > 0] > 0)


def _footprints(number: Indices, side: int, box: NDArray[Any], holds: Mask | None = None) -> Footprints:
    return Footprints(
        number=number,
        side=np.full(len(number), side, dtype=np.int8),
        holds_center=np.zeros(len(number), dtype=np.bool_) if holds is None else holds,
        box=box.astype(np.int32, copy=False),
    )


def _pixel_box(x: Floats, y: Floats, s: Floats, pencil: Pencil, side: int) -> Floats:
    """Return first and last column, first and last row (4, T) of the part of triangles on one side."""
    width, height = pencil.resolution
    low, high = slope_range(x, s, side)
    scale, slack = width / (2 * pencil.half_extent[0]), pixel_slack(pencil, 0)
    first = (low - pencil.shear[0]) * scale + (width - 1) / 2 - slack
    last = (high - pencil.shear[0]) * scale + (width - 1) / 2 + slack
    low, high = slope_range(y, s, side)
    scale, slack = height / (2 * pencil.half_extent[1]), pixel_slack(pencil, 1)
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


def pixel_slack(pencil: Pencil, axis: int) -> float:
    """Return a bound in pixels on the rounding of a projection near the film, and of the slopes themselves.

    A projected slope x / s has a relative rounding error of 3 u, and k and t add as much again. Near the
    film no slope exceeds |k| + t, and W / (2 t) turns slopes into pixels. The bound is twice the result.
    """
    ratio = abs(pencil.shear[axis]) / pencil.half_extent[axis]
    return 16 * UNIT_ROUNDOFF * pencil.resolution[axis] * (ratio + 2)


def slope_range(x: Floats, s: Floats, side: int) -> tuple[Floats, Floats]:
    """Return the range of x / s over the part of each triangle (3, T) on one side of the center.

    A triangle that crosses s = 0 reaches to infinity there, in the direction of the points
    where its edges cross.
    """
    # Triangles that lie on this side as a whole: the extremes are those of the corners.
    ahead = side * s > 0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        slope = x / s
        low, high = slope.min(axis=0), slope.max(axis=0)
    # Triangles that cross s = 0: the corners on this side, and infinity where an edge crosses.
    mixed = np.flatnonzero(~ahead.all(axis=0))
    x, s, slope, ahead = some(x, mixed), some(s, mixed), some(slope, mixed), ahead[:, mixed]
    low[mixed] = np.where(ahead, slope, np.inf).min(axis=0)
    high[mixed] = np.where(ahead, slope, -np.inf).max(axis=0)
    for i, j in EDGES:
        # The edge meets s = 0 at x = (x_j s_i - x_i s_j) / (s_i - s_j). Where the sign of x is in doubt,
        # the range reaches to infinity both ways.
        crosses = ahead[i] != ahead[j]
        here, there = x[j] * s[i], x[i] * s[j]
        toward = side * np.sign(s[i] - s[j]) * (here - there)
        doubt = ROUNDING * (np.abs(here) + np.abs(there))
        high[mixed[crosses & (toward >= -doubt)]] = np.inf
        low[mixed[crosses & (toward <= doubt)]] = -np.inf
    return low, high
