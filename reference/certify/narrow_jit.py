"""The narrow phase compiled by Dr.Jit for all processors: one lane for each row of a triangle.

Each lane cuts its row by the triangle's edges (`spans.slopes_inside`) and walks the columns that
are left, in double precision and with the arithmetic of `narrow.plane_meeting`. It walks up to three
times: to lower, pixel by pixel, the largest s at which the first surface can lie; to count the triangles
that may lie before this limit, and write one of them down; and, only if some pixel has more than one,
to return the pairs of such pixels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from xfrustum.reference.certify.narrow import (
    RowPlanes,
    Sifted,
    plane_meeting,
    row_planes,
    settled,
    surely_counts,
)
from xfrustum.reference.certify.rows import Rows
from xfrustum.reference.certify.spans import FilmRow, columns_between, slopes_inside
from xfrustum.reference.devices.arithmetic_jit import (
    JIT,
    Bool,
    Float64,
    Int32,
    UInt32,
    on_device,
    on_lanes,
)
from xfrustum.reference.devices.strict_jit import strict_arithmetic
from xfrustum.reference.lines.cone import Cones, Viewpoint
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.lines.pairs import NO_PAIRS, Pairs
from xfrustum.scenes.model.hogel_image import NOTHING

_DOUBTFUL_WEIGHT = 2
"""Count of a pair that is not surely met, so that it leaves its pixel open even if it is alone."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Lanes:
    """Rows cut by edges, one lane each, as Dr.Jit arrays.

    Attributes
    ----------
    rows
        The rows before they were cut.
    planes
        Planes of the triangles along these rows.
    surely_from, surely_to
        Slopes dx between which coverage is certain.
    first, last
        First and last column; first > last where no column is left.
    base
        Number of the pixel in column 0, counted from the first of all rows.
    number
        Triangle numbers.
    """

    rows: Rows
    planes: RowPlanes
    surely_from: Any
    surely_to: Any
    first: Any
    last: Any
    base: Any
    number: Any


class JitNarrowPhase:
    """The narrow phase of some rows of an image on Dr.Jit; see `NarrowPhase`."""

    def __init__(self, pencil: Pencil, rows: range) -> None:
        self._pencil = pencil
        self._pixels = len(rows) * pencil.resolution[0]
        self._base = rows.start * pencil.resolution[0]
        self._lanes: list[Lanes] = []
        with strict_arithmetic():
            # Opaque: values that differ from image to image must not compile another kernel.
            self._limit = dr.opaque(Float64, np.inf, self._pixels)
            self._dx, self._dy = on_device(pencil.dx), on_device(pencil.dy)
            self._film = FilmRow(**{k: dr.opaque(Float64, v) for k, v in vars(FilmRow.of(pencil)).items()})
            self._seen_from = Viewpoint.of(pencil, JIT)
            self._width, self._start = (dr.opaque(UInt32, n) for n in (pencil.resolution[0], self._base))

    def add(self, rows: Rows) -> None:
        """Take more triangles into account."""
        with strict_arithmetic():
            lanes = self._cut(rows)
            self._lanes.append(lanes)

            def lower(column: Any) -> None:
                s, error, sure, _ = self._evaluated(lanes, column)
                pixel = lanes.base + column
                # Mode Direct: the other modes allocate for each size of image, and compile anew.
                dr.scatter_reduce(
                    dr.ReduceOp.Min, self._limit, s + error, pixel, sure, mode=dr.ReduceMode.Direct
                )

            walk(lanes, lower)
            dr.eval(self._limit)

    def finish(self) -> Sifted:
        """Return the triangles that may be first among all that were added."""
        with strict_arithmetic():
            rivals = dr.opaque(UInt32, 0, self._pixels)
            number = dr.opaque(Int32, NOTHING, self._pixels)
            distance = dr.opaque(Float64, np.nan, self._pixels)
            for lanes in self._lanes:
                self._count(lanes, rivals, number, distance)
            contested = self._contested(rivals, number, distance)
            return Sifted(triangle=number.numpy(), s=distance.numpy(), contested=contested)

    def _cut(self, rows: Rows) -> Lanes:
        size = len(rows.row)
        walk = on_device(np.concatenate((rows.cone, rows.row, rows.orientation + 1)))
        lane, stride = dr.arange(UInt32, size), dr.opaque(UInt32, size)
        cone, row, sign = (dr.gather(Int32, walk, lane + k * stride) for k in range(3))
        (number,), (holds,) = (on_lanes(table, cone) for table in (rows.number, rows.holds_center))
        coordinates = on_lanes(rows.corners, cone)
        c = Cones.of(JIT, [coordinates[k : k + 3] for k in (0, 3, 6)], self._seen_from, holds)

        # Cut the rows by the edges, then by the triangles' boxes of pixels.
        dy = dr.gather(Float64, self._dy, row)
        edges = zip(c.edge, c.edge_magnitude, strict=True)
        low, high, surely_from, surely_to = slopes_inside(edges, Float64(sign) - 1.0, dy, self._film, JIT)
        low, high = columns_between(low, high, self._film, JIT)
        box = on_lanes(rows.columns.T, cone)
        first, last = dr.maximum(Int32(dr.ceil(low)), box[0]), dr.minimum(Int32(dr.floor(high)), box[1])
        empty = first > last
        lanes = Lanes(
            rows=rows,
            planes=row_planes(c.planes, c.within, dy, self._seen_from.ends, dr.select),
            surely_from=dr.select(holds, -np.inf, surely_from),
            surely_to=dr.select(holds, np.inf, surely_to),
            first=UInt32(dr.select(empty, 1, first)),
            last=UInt32(dr.select(empty, 0, last)),
            base=UInt32(row) * self._width - self._start,
            number=number,
        )
        dr.schedule(*vars(lanes.planes).values())
        dr.eval(*(value for name, value in vars(lanes).items() if name not in ("rows", "planes")))
        return lanes

    def _evaluated(self, lanes: Lanes, column: Any) -> tuple[Any, Any, Any, Any]:
        """Return s, its error, whether the line surely meets, and whether it may at all."""
        dx, row = dr.gather(Float64, self._dx, column), lanes.planes
        s, error = plane_meeting(dx, row, dr.select)
        nearest, farthest = s - error, s + error
        sure = (dx >= lanes.surely_from) & (dx <= lanes.surely_to)
        sure &= surely_counts(s, error, row.first, row.last)
        return s, error, sure, (farthest >= row.first) & (nearest <= row.last)

    def _may_be_first(self, lanes: Lanes, column: Any) -> tuple[Any, Any, Any, Any]:
        s, error, sure, possible = self._evaluated(lanes, column)
        limit = dr.gather(Float64, self._limit, lanes.base + column)
        return s, error, sure, possible & (s - error <= limit)

    def _count(self, lanes: Lanes, rivals: Any, number: Any, distance: Any) -> None:
        def count(column: Any) -> None:
            s, _, sure, possible = self._may_be_first(lanes, column)
            pixel = lanes.base + column
            weight = dr.select(sure, UInt32(1), UInt32(_DOUBTFUL_WEIGHT))
            dr.scatter_reduce(dr.ReduceOp.Add, rivals, weight, pixel, possible, mode=dr.ReduceMode.Direct)
            dr.scatter(number, lanes.number, pixel, possible)
            dr.scatter(distance, s, pixel, possible)

        walk(lanes, count)
        dr.eval(rivals, number, distance)

    def _contested(self, rivals: Any, number: Any, distance: Any) -> Pairs:
        """Return all pairs of the pixels for which several triangles may be first, or one not surely met.

        In these pixels number and distance are those of one triangle of several, and are taken back.
        """
        open_pixels = rivals > 1
        size = int(dr.sum(dr.select(open_pixels, rivals, UInt32(0)))[0])
        if size == 0:
            return NO_PAIRS
        found = Pairs.joined([self._pairs(lanes, rivals, size) for lanes in self._lanes])
        pixel = dr.arange(UInt32, self._pixels)
        dr.scatter(number, Int32(NOTHING), pixel, open_pixels)
        dr.scatter(distance, Float64(np.nan), pixel, open_pixels)
        dr.eval(number, distance)
        return found

    def _pairs(self, lanes: Lanes, rivals: Any, size: int) -> Pairs:
        """Return the pairs of open pixels; lanes write them in any order into arrays of the largest size."""
        written = dr.opaque(UInt32, 0)
        kinds = (UInt32, UInt32, Float64, Float64, Bool)
        out: tuple[Any, ...] = tuple(dr.empty(kind, size) for kind in kinds)
        lane = dr.arange(UInt32, dr.width(lanes.first))

        def write(column: Any) -> None:
            s, error, sure, possible = self._may_be_first(lanes, column)
            wanted = possible & (dr.gather(UInt32, rivals, lanes.base + column) > 1)
            slot = dr.scatter_inc(written, UInt32(0), wanted)
            for target, value in zip(out, (lane, column, s, error, sure), strict=True):
                dr.scatter(target, value, slot, wanted)

        walk(lanes, write)
        dr.eval(written, *out)
        at, column, s, error, sure = (values.numpy()[: int(written[0])].copy() for values in out)
        rows, cone = lanes.rows, lanes.rows.cone[at]
        found = Pairs(
            pixel=rows.row[at] * self._pencil.resolution[0] + column,
            triangle=rows.number[cone],
            s=s,
            error=error,
            sure=sure,
        )
        return settled(rows, cone, found, self._pencil)


def walk(lanes: Lanes, visit: Callable[[Any], None]) -> None:
    """Visit every column of every lane."""

    def step(column: Any) -> tuple[Any]:
        visit(column)
        return (column + 1,)

    dr.while_loop((UInt32(lanes.first),), lambda column: column <= lanes.last, step)
