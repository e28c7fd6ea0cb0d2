"""Broad phase: the bounding box, on the film, of every triangle that may be visible.

A box bounds the projection of the part of a triangle that lies on one side of the center. The box
of a triangle that crosses the height of the center extends to infinity. Boxes are widened by the
bound on rounding errors (docs/truth.md, "Nothing is left out"), so that no pixel outside a
triangle's box shows the triangle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from xfrustum.reference.backend import (
    Bool,
    Int32,
    UInt32,
    constants,
    difference,
    dr,
    on_device,
    product,
)
from xfrustum.reference.certify.cone import (
    EDGES,
    ROUNDING,
    UNIT_ROUNDOFF,
    Planes,
    Triangles,
    Viewpoint,
)
from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.lines import RayBundle

#: Largest total number of rows of the boxes in one `Boxes`: rows are counted in 32 bits
MAX_ROWS = 1 << 31


@dataclass(frozen=True, kw_only=True, eq=False)
class Boxes:
    """Bounding boxes of triangles on a film, as Dr.Jit arrays with one lane per box."""

    number: Any  #: Triangle numbers; a triangle on both sides of the center's height has two boxes
    box: list[Any]  #: First and last column, first and last row, inclusive
    #: Sign of the edge functions inside each triangle. None if the sign is uncertain, or if the
    #: triangle's bounding box in space contains the center; the rows of such boxes are not cut at
    #: the triangle's edges
    turn: Any = None
    #: True if the center lies in the closed triangle, computed exactly; None for triangles with a
    #: known sign, which do not contain the center
    holds: Any = None

    def rows(self, within: range) -> tuple[Any, Any] | None:
        """Return the box number and row of each pixel row of all boxes in a range; None if empty.

        Lanes of one box are consecutive, from the top row down.
        """
        first, last = dr.opaque(Int32, within.start), dr.opaque(Int32, within.stop - 1)
        top = dr.maximum(self.box[2], first)
        heights = UInt32(dr.maximum(dr.minimum(self.box[3], last) - top + 1, 0))
        before = dr.prefix_sum(heights)
        dr.eval(top, heights, before)
        count = int(before[-1]) + int(heights[-1])
        if not count:
            return None
        # Count boxes at their first rows; a box without rows begins where the next box does.
        begins = dr.zeros(UInt32, count)
        unit = dr.opaque(UInt32, 1)
        inside = before < dr.opaque(UInt32, count)
        dr.scatter_reduce(dr.ReduceOp.Add, begins, unit, before, inside, mode=dr.ReduceMode.Direct)
        box = dr.cumsum(begins) - 1
        below = Int32(dr.arange(UInt32, count) - dr.gather(UInt32, before, box))
        row = dr.gather(Int32, top, box) + below
        dr.eval(box, row)
        return box, row


@dataclass(frozen=True, kw_only=True, eq=False)
class NearbyLines:
    """Lines that pass close to the center of a pencil, but not exactly through it."""

    apart: Sequence[Any]  #: bound on their distance from the center in x and in y, at its height
    ends: Sequence[Any]  #: first and last s, counted from the plate


def bounding_boxes(
    triangles: Triangles,
    bundle: RayBundle,
    exact: ExactPencil | NearbyLines,
    margin: float = 0.0,
) -> list[Boxes]:
    """Return the boxes of all triangles that the film of a ray bundle may show.

    Call this while `recording`. `exact` are the pencil's lines in integers, or a description of
    lines close to the pencil. `margin` makes boxes wider than rounding requires, in pixels.
    """
    all_boxes: list[Boxes] = []
    seen_from = Viewpoint.from_bundle(bundle)
    film = [FilmAxis.from_bundle(bundle, axis, margin) for axis in range(2)]
    sides = [side for side in (1, -1) if side * bundle.s_range[side > 0] > 0]
    height = bundle.resolution[1]
    most = max(1, MAX_ROWS // height)
    pencil = not isinstance(exact, NearbyLines)
    numbers = triangles.before(bundle) if pencil else np.arange(len(triangles))
    for start in range(0, len(numbers), most):
        lane = on_device(numbers[start : start + most].astype(np.uint32))
        points = triangles.points(lane)
        corners = [difference(point, seen_from.center) for point in points]
        x, y, z = ([corner[axis] for corner in corners] for axis in range(3))
        low, high = seen_from.depths(z)
        imaged = (low <= seen_from.ends[1]) & (high >= seen_from.ends[0])
        if isinstance(exact, NearbyLines):
            heights = [point[2] for point in points]
            imaged = (-greatest(heights) <= exact.ends[1]) & (-least(heights) >= exact.ends[0])
        touching = imaged & _spans_zero(x) & _spans_zero(y) & _spans_zero(z)
        planes = Planes.from_points(points, seen_from.center, False)
        bound = planes.bound
        if isinstance(exact, NearbyLines):
            for away, part in zip(exact.apart, planes.normal[:2], strict=True):
                bound = bound + product(away, abs(part))
        in_doubt = abs(planes.offset) <= bound
        boxed = []
        for side in sides:
            box = _box([x, y, z], film, side)
            here = imaged & ~touching & ((least(z) < 0) if side > 0 else (greatest(z) > 0))
            hit = here & (box[0] <= box[1]) & (box[2] <= box[3])
            turn = dr.select(planes.offset < 0, Int32(-side), Int32(side))
            boxed.append((box, turn, hit & ~in_doubt, hit & in_doubt))
        dr.eval(touching, *((*box, turn, *masks) for box, turn, *masks in boxed))
        for box, turn, known, doubtful in boxed:
            all_boxes += chosen_boxes(lane, box, known, turn)
            all_boxes += chosen_boxes(lane, box, doubtful, None)
        reached: Any = dr.compress(touching)
        around = numbers[start + reached.numpy()]
        # The remaining triangles may contain the center; every line meets such a triangle. If the
        # center lies in a triangle's plane but outside the triangle, no line meets the triangle. No
        # line meets a triangle without area.
        if isinstance(exact, NearbyLines):
            holds = dict.fromkeys(around.tolist(), False)
            whole = list(holds)
        else:
            holds = {n: exact.contains_center(n) for n in around.tolist()}
            whole = [n for n, held in holds.items() if held or exact.meets_beside_center(n)]
        if whole:
            ends = (0, bundle.resolution[0] - 1, 0, height - 1)
            all_boxes.append(
                Boxes(
                    number=on_device(np.array(whole, dtype=np.uint32)),
                    box=[on_device(np.full(len(whole), end, dtype=np.int32)) for end in ends],
                    holds=on_device(np.array([holds[n] for n in whole], dtype=np.bool_)),
                )
            )
    return all_boxes


def pixel_slack(bundle: RayBundle, axis: int) -> float:
    """Return a bound in pixels on the rounding of a projection near the film and of the slopes.

    A projected slope x / s has a relative rounding error of 3 u; k and t add another 3 u. Near the
    film no slope exceeds |k| + t, and W / (2 t) converts slopes to pixels. The returned bound is at
    least twice this error.
    """
    ratio = abs(bundle.shear[axis]) / bundle.half_extent[axis]
    return 16 * UNIT_ROUNDOFF * bundle.resolution[axis] * (ratio + 2)


class FilmAxis:
    """Map from slopes to columns or rows, (slope - shear) scale + middle, within `slack`.

    Parallel lines have positions on the plate in place of slopes. `steepest` is the largest
    magnitude of a slope.
    """

    def __init__(
        self,
        count: int,
        *,
        shear: float,
        scale: float,
        slack: float,
        steepest: float,
    ) -> None:
        self.shear, self.scale, self.middle, self.slack, self.steepest = constants(
            [shear, scale, (count - 1) / 2, slack, steepest]
        )
        self.count, self.last = constants([count, count - 1])

    @classmethod
    def from_bundle(cls, bundle: RayBundle, axis: int, margin: float = 0.0) -> FilmAxis:
        """Return the columns (axis 0) or rows (1) of a ray bundle's film.

        With a margin, `slack` is wider, see `bounding_boxes`.
        """
        count, slack = bundle.resolution[axis], pixel_slack(bundle, axis)
        return cls(
            count,
            shear=bundle.shear[axis],
            scale=count / (2 * bundle.half_extent[axis]),
            slack=margin + 2 * slack if margin else slack,
            steepest=float(np.abs((bundle.dx, bundle.dy)[axis]).max()),
        )

    def columns(self, low: Any, high: Any) -> tuple[Any, Any]:
        """Return the columns of two slopes, from -1 to W; the caller rounds them inward."""
        first = product(low - self.shear, self.scale) + self.middle - self.slack
        last = product(high - self.shear, self.scale) + self.middle + self.slack
        return tuple(dr.minimum(dr.maximum(end, -1.0), self.count) for end in (first, last))

    def pixels(self, low: Any, high: Any) -> list[Any]:
        """Return the first and the last pixel between two film positions."""
        first = dr.minimum(dr.maximum(low - self.slack, 0.0), self.count)
        last = dr.minimum(dr.maximum(high + self.slack, -1.0), self.last)
        return [Int32(dr.ceil(first)), Int32(dr.floor(last))]


def _box(corners: list[list[Any]], film: Sequence[FilmAxis], side: int) -> list[Any]:
    """Return first and last column, first and last row of the part of triangles on one side."""
    x, y, z = corners
    s = [-height for height in z]
    return pixels_between(film, _slope_range(x, s, side), _slope_range(y, s, side))


def pixels_between(
    film: Sequence[FilmAxis], wide: tuple[Any, Any], high: tuple[Any, Any]
) -> list[Any]:
    """Return first and last column, first and last row of ranges of slopes dx and dy."""
    across, down = film
    columns = across.pixels(
        product(wide[0] - across.shear, across.scale) + across.middle,
        product(wide[1] - across.shear, across.scale) + across.middle,
    )
    # Rows count down.
    rows = down.pixels(
        down.middle - product(high[1] - down.shear, down.scale),
        down.middle - product(high[0] - down.shear, down.scale),
    )
    return [*columns, *rows]


def _slope_range(x: list[Any], s: list[Any], side: int) -> tuple[Any, Any]:
    """Return the range of x / s over the part of each triangle on one side of the center.

    A triangle that crosses s = 0 reaches to infinity there, in the direction of the points where
    its edges cross.
    """
    ahead = [part > 0 if side > 0 else part < 0 for part in s]
    slopes = [part / depth for part, depth in zip(x, s, strict=True)]
    low = least([dr.select(mine, slope, np.inf) for mine, slope in zip(ahead, slopes, strict=True)])
    high = greatest(
        [dr.select(mine, slope, -np.inf) for mine, slope in zip(ahead, slopes, strict=True)]
    )
    for i, j in EDGES:
        # The edge meets s = 0 at x = (x_j s_i - x_i s_j) / (s_i - s_j). If the sign of x is
        # uncertain, the range reaches to infinity in both directions.
        crosses = ahead[i] ^ ahead[j]
        here, there = product(x[j], s[i]), product(x[i], s[j])
        toward = product(dr.select(s[i] - s[j] > 0, float(side), -float(side)), here - there)
        doubt = product(ROUNDING, abs(here) + abs(there))
        high = dr.select(crosses & (toward >= -doubt), np.inf, high)
        low = dr.select(crosses & (toward <= doubt), -np.inf, low)
    return low, high


def chosen_boxes(lane: Any, box: list[Any], chosen: Any, turn: Any) -> list[Boxes]:
    """Return the boxes of the chosen triangles, if any; `lane` are the numbers of triangles."""
    kept: Any = dr.compress(chosen)
    if not dr.width(kept):
        return []
    taken = [dr.gather(Int32, values, kept) for values in box]
    number = dr.gather(UInt32, lane, kept)
    turn = None if turn is None else dr.gather(Int32, turn, kept)
    dr.eval(number, *taken, turn)
    holds = None if turn is not None else dr.zeros(Bool, dr.width(kept))
    return [Boxes(number=number, box=taken, turn=turn, holds=holds)]


def least(values: list[Any]) -> Any:
    """Return the smallest of three values of each lane."""
    return dr.minimum(dr.minimum(values[0], values[1]), values[2])


def greatest(values: list[Any]) -> Any:
    """Return the largest of three values of each lane."""
    return dr.maximum(dr.maximum(values[0], values[1]), values[2])


def _spans_zero(values: list[Any]) -> Any:
    return (least(values) <= 0) & (greatest(values) >= 0)
