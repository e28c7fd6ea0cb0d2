"""Filter of the triangles that may be first at each pixel, in doubles with rounding bounds.

Broad phase: `boxes` computes the bounding boxes of triangles on the film. Narrow phase: there is
one lane for each pixel row of a box. The lane cuts the row at the triangle's edges, which gives a
first and last column, and an inner interval of columns in which the triangle certainly covers the
pixel's center. Lanes visit their columns:

1. Compute a limit for every pixel: the minimum, over all triangles that are certainly met, of the
   largest possible s. The first surface is not beyond this limit.
2. Count the triangles that may be met up to the limit. A pixel with a single such triangle,
   certainly met, is settled: no other triangle can be first, because none is left out.
3. Return all pairs of triangles and unsettled pixels, for integer arithmetic (`certify`).

The formulas are in `cone`; docs/truth.md derives the bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np

from xfrustum.reference.backend import (
    Bool,
    Float64,
    Int32,
    UInt32,
    dr,
    on_device,
    product,
    recording,
)
from xfrustum.reference.certify.boxes import Boxes, FilmAxis, bounding_boxes
from xfrustum.reference.certify.cone import (
    ROUNDING,
    UNIT_ROUNDOFF,
    Cones,
    RowPlanes,
    Triangles,
    Viewpoint,
    in_range,
)
from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.lines import RayBundle
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.images import NOTHING


@dataclass(frozen=True, kw_only=True, eq=False)
class Pairs:
    """Pixels (N,), row * W + column, and triangle numbers (N,), in NumPy.

    The line meets the triangle's plane within s +- error. `sure` is true if the line certainly
    meets the triangle, inside the range of s.
    """

    pixel: Indices
    triangle: Indices
    s: Floats
    error: Floats
    sure: Mask

    def __getitem__(self, chosen: Mask | Indices) -> Pairs:
        """Return the pairs at these indices."""
        return Pairs(**{name: values[chosen] for name, values in vars(self).items()})

    @property
    def nearest(self) -> Floats:
        """Smallest possible s."""
        return self.s - self.error

    @property
    def farthest(self) -> Floats:
        """Largest possible s."""
        return self.s + self.error

    @staticmethod
    def joined(parts: Sequence[Pairs]) -> Pairs:
        """Return the pairs of all parts, one part after the other."""
        return Pairs(
            **{
                name: np.concatenate([vars(part)[name] for part in parts])
                for name in vars(parts[0])
            }
        )


_NONE = np.zeros(0, dtype=np.int64)
NO_PAIRS = Pairs(
    pixel=_NONE, triangle=_NONE, s=np.zeros(0), error=np.zeros(0), sure=np.zeros(0, np.bool_)
)


#: Weight of an uncertain pair in the count: a single uncertain pair leaves its pixel open
DOUBTFUL_WEIGHT = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class ClassifiedPixels:
    """Triangles that may be first in some rows of an image.

    `triangle` and `s` (pixels,) belong to the triangle that is certainly first. They are `NOTHING`
    and NaN where the line meets no triangle, and at ambiguous pixels. A pixel is ambiguous if
    several triangles may be first, or if the only candidate is not certainly met. `ambiguous` has
    all pairs of ambiguous pixels. `device` has `triangle` and `s` as Dr.Jit arrays.
    """

    triangle: Numbers
    s: Floats
    ambiguous: Pairs
    device: tuple[Any, Any]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Lanes:
    """Pixel rows of boxes, one per lane, cut at the triangle's edges: columns `first` to `last`.

    Coverage is certain between the two slopes dx of `surely`. Rows that are not cut have `cones` in
    place of `surely`: edge functions determine coverage. `within` is true if a triangle certainly
    lies within the range.
    """

    number: Any
    row: Any
    planes: RowPlanes
    within: Any
    first: Any
    last: Any
    surely: tuple[Any, Any] | None
    cones: Cones | None
    holds: Any

    def walk(self, visit: Callable[[Any], None]) -> None:
        """Visit every column of every lane."""

        def step(column: Any) -> tuple[Any]:
            visit(column)
            return (column + 1,)

        dr.while_loop((UInt32(self.first),), lambda column: column <= self.last, step)


class Lines(Protocol):
    """Interface of the lines of an image, with one variable per column and one per row.

    The variables are the slopes dx and dy of lines through one point, or the positions x and y at
    which parallel lines meet the plate. Edge functions are linear in these variables.
    """

    resolution: tuple[int, int]  #: W, H in pixels
    film: FilmAxis  #: map from the columns' variable to columns
    across: Any  #: (W,) variable of each column
    down: Any  #: (H,) variable of each row
    ends: list[Any]  #: first and last s of the range

    def boxes(self, triangles: Triangles) -> list[Boxes]:
        """Return the boxes of all triangles that the film may show."""

    def cones(self, points: Sequence[Sequence[Any]], holds: Any) -> Cones:
        """Return edge functions and planes of triangles, given by corners, for these lines."""

    def covering(
        self, points: Sequence[Sequence[Any]], column: Any, row: Any
    ) -> tuple[Any, Any, Any]:
        """Return masks of lines that may pass through their triangles, and that certainly do.

        A third mask marks triangles that certainly lie in the range.
        """

    def along_rows(self, cones: Cones, row: Any) -> Any:
        """Return the planes of triangles along rows of the image, a dataclass of arrays."""

    def met(self, planes: Any, column: Any) -> tuple[Any, Any]:
        """Return s where the lines of columns meet planes, and a bound on its error."""


class PencilLines:
    """Lines through one point, for the filter; `exact` are the same lines in integers."""

    def __init__(self, bundle: RayBundle, exact: ExactPencil) -> None:
        self.resolution = bundle.resolution
        self._bundle, self._exact = bundle, exact
        self.film = FilmAxis.from_bundle(bundle, 0)
        self._seen_from = Viewpoint.from_bundle(bundle)
        self.ends = self._seen_from.ends
        self.across, self.down = on_device(bundle.dx), on_device(bundle.dy)

    def boxes(self, triangles: Triangles) -> list[Boxes]:
        """Return the boxes of all triangles that the film may show."""
        return bounding_boxes(triangles, self._bundle, self._exact)

    def cones(self, points: Sequence[Sequence[Any]], holds: Any) -> Cones:
        """Return triangles as cones about the common point."""
        return Cones.from_points(points, self._seen_from, holds)

    def covering(
        self, points: Sequence[Sequence[Any]], column: Any, row: Any
    ) -> tuple[Any, Any, Any]:
        """Return the masks of lines and triangles that `Lines.covering` describes."""
        cones = self.cones(points, False)
        dx, dy = dr.gather(Float64, self.across, column), dr.gather(Float64, self.down, row)
        return *cones.covering(dx, dy), cones.within

    def along_rows(self, cones: Cones, row: Any) -> RowPlanes:
        """Return the planes of triangles along rows of the image."""
        planes: RowPlanes = cones.planes.along_rows(dr.gather(Float64, self.down, row))
        return planes

    def met(self, planes: RowPlanes, column: Any) -> tuple[Any, Any]:
        """Return s where the lines of columns meet planes, and a bound on its error."""
        return planes.met(dr.gather(Float64, self.across, column))


class Filter:
    """Filter of the triangles along the lines of one image."""

    def __init__(self, triangles: Triangles, lines: Lines) -> None:
        self._triangles, self._lines = triangles, lines
        with recording():
            self._boxes = lines.boxes(triangles)
            self._width = dr.opaque(UInt32, lines.resolution[0])

    def classify_pixels(self, rows: range) -> ClassifiedPixels:
        """Return the triangles that may be first in some rows of the image."""
        pixels = len(rows) * self._lines.resolution[0]
        with recording():
            lanes = self._cut(rows)
            limit = self._limit(lanes, rows)
            count = dr.zeros(UInt32, pixels)
            number, place = dr.full(Int32, NOTHING, pixels), dr.full(Float64, np.nan, pixels)
            dr.make_opaque(count, number, place)
            for some in lanes:

                def note(column: Any, some: _Lanes = some) -> None:
                    s, _, sure, possible = self._may_be_first(some, column, rows, limit)
                    pixel = self._pixel(some, column, rows)
                    weight = dr.select(sure, UInt32(1), UInt32(DOUBTFUL_WEIGHT))
                    _reduce(dr.ReduceOp.Add, count, weight, pixel, possible)
                    dr.scatter(number, Int32(some.number), pixel, possible)
                    dr.scatter(place, s, pixel, possible)

                some.walk(note)
                dr.eval(count, number, place)
            ambiguous = NO_PAIRS
            unsettled = count > 1
            size = int(dr.sum(dr.select(unsettled, count, UInt32(0)))[0])
            if size:
                # Several triangles wrote to these pixels, in undefined order: reset their triangle
                # number.
                number = dr.select(unsettled, NOTHING, number)
                place = dr.select(unsettled, np.nan, place)
                parts = [self._pairs(some, rows, limit, unsettled, size) for some in lanes]
                ambiguous = Pairs.joined(parts)
            dr.eval(number, place)
            return ClassifiedPixels(
                triangle=number.numpy(),
                s=place.numpy(),
                ambiguous=ambiguous,
                device=(number, place),
            )

    def gaps(self, rows: range, numbers: Indices | None = None) -> Floats:
        """Return the gap from the first surface to the next one behind it on its side, (pixels,).

        The gap is the smallest s of all surfaces that are certainly behind, minus the largest
        possible s of the first surface; infinite if either is missing. With `numbers` (pixels,),
        only triangles with smaller numbers count.
        """
        with recording():
            lanes = self._cut(rows)
            first = self._limit(lanes, rows)
            second = dr.full(Float64, np.inf, dr.width(first))
            dr.make_opaque(second)
            below = None if numbers is None else on_device(numbers.astype(np.float64))
            for some in lanes:

                def lower(column: Any, some: _Lanes = some) -> None:
                    s, error, sure, _ = self._met(some, column)
                    pixel = self._pixel(some, column, rows)
                    limit = dr.gather(Float64, first, pixel)
                    behind = sure & (s - error > limit) & ((limit >= 0) | (s + error <= 0))
                    if below is not None:
                        behind &= Float64(some.number) < dr.gather(Float64, below, pixel)
                    _reduce(dr.ReduceOp.Min, second, s, pixel, behind)

                some.walk(lower)
                dr.eval(second)
            gaps: Floats = dr.select(dr.isfinite(second), second - first, np.inf).numpy()
            return gaps

    def _cut(self, rows: range) -> list[_Lanes]:
        """Return the rows of all boxes, cut by the edges of their triangles."""
        reaching = [(boxes, boxes.rows(rows)) for boxes in self._boxes]
        return [self._lanes(boxes, *place) for boxes, place in reaching if place]

    def _lanes(self, boxes: Boxes, box: Any, row: Any) -> _Lanes:
        number = dr.gather(UInt32, boxes.number, box)
        holds = False if boxes.holds is None else dr.gather(Bool, boxes.holds, box)
        cones = self._lines.cones(self._triangles.points(number), holds)
        dy = dr.gather(Float64, self._lines.down, UInt32(row))
        first, last = (dr.gather(Int32, boxes.box[k], box) for k in (0, 1))
        surely = None
        if boxes.turn is not None:
            turn = Float64(dr.gather(Int32, boxes.turn, box))
            low, high, *surely_between = _slopes_inside(cones, turn, dy, self._lines.film)
            low, high = self._lines.film.columns(low, high)
            first = dr.maximum(Int32(dr.ceil(low)), first)
            last = dr.minimum(Int32(dr.floor(high)), last)
            surely = surely_between[0], surely_between[1]
        empty = first > last
        lanes = _Lanes(
            number=number,
            row=UInt32(row),
            planes=self._lines.along_rows(cones, UInt32(row)),
            within=cones.within,
            first=UInt32(dr.select(empty, 1, first)),
            last=UInt32(dr.select(empty, 0, last)),
            surely=surely,
            cones=None if surely is not None else cones,
            holds=holds,
        )
        # Kernels are limited by memory bandwidth: values that take few operations are not stored.
        kept = [getattr(lanes.planes, field.name) for field in fields(lanes.planes)]
        whole = () if lanes.cones is None else (*lanes.cones.edges, *lanes.cones.magnitudes)
        dr.eval(number, lanes.row, lanes.within, lanes.first, lanes.last, surely, *kept, *whole)
        return lanes

    def _met(self, lanes: _Lanes, column: Any) -> tuple[Any, Any, Any, Any]:
        """Return s, its error, and masks of lines that certainly and possibly meet triangles."""
        dx = dr.gather(Float64, self._lines.across, column)
        s, error = self._lines.met(lanes.planes, column)
        possible, sure = in_range(s, error, lanes.within, self._lines.ends)
        if lanes.surely is not None:
            return s, error, sure & (dx >= lanes.surely[0]) & (dx <= lanes.surely[1]), possible
        assert lanes.cones is not None
        dy = dr.gather(Float64, self._lines.down, lanes.row)
        may_cover, covers = lanes.cones.covering(dx, dy)
        return s, error, sure & covers, possible & may_cover

    def _pixel(self, lanes: _Lanes, column: Any, rows: range) -> Any:
        return (lanes.row - dr.opaque(UInt32, rows.start)) * self._width + column

    def _limit(self, lanes: list[_Lanes], rows: range) -> Any:
        """Return the largest possible s of each pixel's first surface; infinite if it has none."""
        limit = dr.full(Float64, np.inf, len(rows) * self._lines.resolution[0])
        dr.make_opaque(limit)
        for some in lanes:

            def lower(column: Any, some: _Lanes = some) -> None:
                s, error, sure, _ = self._met(some, column)
                _reduce(dr.ReduceOp.Min, limit, s + error, self._pixel(some, column, rows), sure)

            some.walk(lower)
            dr.eval(limit)
        return limit

    def _may_be_first(
        self, lanes: _Lanes, column: Any, rows: range, limit: Any
    ) -> tuple[Any, Any, Any, Any]:
        s, error, sure, possible = self._met(lanes, column)
        nearest = dr.gather(Float64, limit, self._pixel(lanes, column, rows))
        return s, error, sure, possible & (s - error <= nearest)

    def _pairs(self, lanes: _Lanes, rows: range, limit: Any, unsettled: Any, size: int) -> Pairs:
        """Return the pairs of unsettled pixels; lanes write them in any order, at most `size`."""
        written = dr.opaque(UInt32, 0)
        out: tuple[Any, ...] = tuple(
            dr.empty(kind, size) for kind in (UInt32, UInt32, UInt32, Float64, Float64, Bool)
        )

        def write(column: Any) -> None:
            s, error, sure, possible = self._may_be_first(lanes, column, rows, limit)
            chosen = possible & dr.gather(Bool, unsettled, self._pixel(lanes, column, rows))
            slot = dr.scatter_inc(written, UInt32(0), chosen)
            for target, value in zip(
                out, (lanes.number, lanes.row, column, s, error, sure), strict=True
            ):
                dr.scatter(target, value, slot, chosen)

        lanes.walk(write)
        dr.eval(written, *out)
        count = int(written[0])
        if not count:
            return NO_PAIRS
        number, row, column, s, error, sure = (
            dr.gather(type(values), values, dr.arange(UInt32, count)) for values in out
        )
        # If boxes and cut rows leave coverage uncertain, the edge functions at the pixel's center
        # may settle it. Triangles that contain the aperture are met without error.
        points = self._triangles.points(number)
        may_cover, covers, within = self._lines.covering(points, column, row)
        _, counts = in_range(s, error, within, self._lines.ends)
        possible = sure | may_cover | (error == 0)
        sure = sure | (covers & counts)
        pixel = row * self._width + column
        dr.eval(pixel, possible, sure)
        kept = possible.numpy()
        return Pairs(
            pixel=pixel.numpy()[kept].astype(np.int64),
            triangle=number.numpy()[kept].astype(np.int64),
            s=s.numpy()[kept],
            error=error.numpy()[kept],
            sure=sure.numpy()[kept],
        )


def _reduce(operation: Any, target: Any, value: Any, index: Any, active: Any) -> None:
    # Use mode Direct: other modes allocate memory and compile again for each image size.
    dr.scatter_reduce(operation, target, value, index, active, mode=dr.ReduceMode.Direct)


def _slopes_inside(cones: Cones, turn: Any, dy: Any, film: FilmAxis) -> tuple[Any, Any, Any, Any]:
    """Return bounds of dx of the lines of a row that may meet a triangle, or certainly meet it.

    Along a row, each edge function is E(dx) = slope dx + rest, with the sign that makes it positive
    inside. Each edge therefore bounds dx on one side, at the zero -rest / slope. No line with a
    slope outside [low, high] meets the triangle; every line with a slope inside [surely_low,
    surely_high] does.
    """
    low, high, surely_low, surely_high = -np.inf, np.inf, -np.inf, np.inf
    for edge, magnitude in zip(cones.edges, cones.magnitudes, strict=True):
        # The edge function along the row, positive inside, and its rounding bound.
        slope = product(turn, edge[0])
        rest = product(turn, product(edge[1], dy) - edge[2])
        size = product(film.steepest, magnitude[0]) + product(abs(dy), magnitude[1]) + magnitude[2]
        bound = product(ROUNDING, size)
        # The zero of E, and the margin of its rounding error. An error `bound` of E moves the zero
        # by bound / |slope|. Twice this, plus 4 u |zero|, also covers rounding of `zero` and of the
        # sums below.
        zero = -rest / slope
        margin = product(2.0, bound) / abs(slope) + product(4 * UNIT_ROUNDOFF, abs(zero))
        # If the slope is so small that the quotient overflows, E has the same sign along the whole
        # row.
        level = ~dr.isfinite(margin)
        # An increasing E bounds dx from below, and a decreasing E bounds it from above.
        rising, falling = (slope > 0) & ~level, (slope < 0) & ~level
        low = dr.maximum(low, dr.select(rising, zero - margin, -np.inf))
        surely_low = dr.maximum(surely_low, dr.select(rising, zero + margin, -np.inf))
        high = dr.minimum(high, dr.select(falling, zero + margin, np.inf))
        surely_high = dr.minimum(surely_high, dr.select(falling, zero - margin, np.inf))
        # A constant E makes the interval empty if it is certainly negative, and makes the certain
        # interval empty unless it is certainly positive.
        low = dr.select(level & (rest < -bound), np.inf, low)
        surely_low = dr.select(level & (rest <= bound), np.inf, surely_low)
    return low, high, surely_low, surely_high
