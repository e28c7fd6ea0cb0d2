"""The narrow phase compiled by Dr.Jit for all processors: one lane for each row of a triangle.

Each lane cuts its row by the triangle's edges (`spans.slopes_inside`), which leaves columns from first to
last, and marks the pixel of the first column and the one after the last in an array of zeros. The sums from
the start of that array count the lanes of each pixel. A lane walks its columns in double precision, with the
arithmetic of `narrow.plane_meeting`. Where it surely meets and the pixel has no other lane, nothing else can
be first, and the lane writes down the place. Lanes that have other pixels, too, walk twice more: to lower,
pixel by pixel, the largest s at which the first surface can lie, and to count the triangles that may lie
before this limit, and write one of them down. Only if some pixel is left with more than one, or with one that
is not surely met, do lanes return the pairs of such pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.certify.narrow import (
    RowPlanes,
    Sifted,
    counted_range,
    plane_meeting,
    row_planes,
    settled,
    surely_counts,
)
from xfrustum.reference.certify.rows import Rows
from xfrustum.reference.certify.spans import FilmRow, columns_between, slopes_inside
from xfrustum.reference.devices.arithmetic_jit import (
    JIT,
    Array4i,
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
from xfrustum.scenes.arrays import Numbers
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.scenes.room import with_room

SAMPLED_PIXELS = 101
"""Step from pixel to pixel of those that are looked at for the number of their lanes: no divisor of usual
widths, so that they lie in all columns."""

_DOUBTFUL_WEIGHT = 2
"""Count of a pair that is not surely met, so that it leaves its pixel open even if it is alone."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Lanes:
    """Rows cut by edges, one lane each, as Dr.Jit arrays.

    Attributes
    ----------
    rows
        The rows before they were cut.
    place
        Number of each lane's row among these rows.
    planes
        Planes of the triangles along these rows.
    within, ends
        Whether the triangles surely lie within the pencil's range, and first and last s of that range.
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
    place: Any
    planes: RowPlanes
    within: Any
    ends: Sequence[Any]
    surely_from: Any
    surely_to: Any
    first: Any
    last: Any
    base: Any
    number: Any

    def some(self, kept: Any) -> Lanes:
        """Return the lanes with some numbers, of which there is at least one."""

        def taken(arrays: dict[str, Any]) -> dict[str, Any]:
            return {name: dr.gather(type(array), array, kept) for name, array in arrays.items()}

        planes, lanes = (taken(arrays) for arrays in self._kept())
        first, last = counted_range(lanes["within"], self.ends, dr.select)
        found = Lanes(
            rows=self.rows,
            place=kept,
            planes=RowPlanes(**planes, first=first, last=last),
            ends=self.ends,
            **lanes,
        )
        found.evaluate()
        return found

    def evaluate(self) -> None:
        """Have all arrays computed, in one kernel."""
        planes, lanes = self._kept()
        dr.eval(*planes.values(), *lanes.values())

    def _kept(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the arrays that kernels keep for the next ones: parts of the planes, and all others.

        Kernels wait for memory: what is computed at once from other arrays is left out, and computed again.
        """
        planes = {name: part for name, part in vars(self.planes).items() if name not in ("first", "last")}
        left_out = ("rows", "place", "planes", "ends")
        return planes, {name: array for name, array in vars(self).items() if name not in left_out}


@dataclass(frozen=True, kw_only=True, eq=False)
class _Marks:
    """What lanes write down for each pixel: number and place of a triangle, `NOTHING` and NaN before."""

    number: Any
    distance: Any

    @classmethod
    def none(cls, pixels: int) -> _Marks:
        """Return the marks of pixels for which there is no triangle yet."""
        return cls(
            number=dr.opaque(Int32, NOTHING, pixels),
            distance=dr.opaque(Float64, np.nan, pixels),
        )


class JitNarrowPhase:
    """The narrow phase of some rows of an image on Dr.Jit; see `NarrowPhase`."""

    def __init__(self, pencil: Pencil, rows: range) -> None:
        self._pencil = pencil
        self._pixels = len(rows) * pencil.resolution[0]
        self._base = rows.start * pencil.resolution[0]
        self._lanes: list[Lanes] = []
        with strict_arithmetic():
            # Opaque: values that differ from image to image must not compile another kernel.
            self._ends = dr.opaque(UInt32, 0, self._pixels + 1)
            self._dx, self._dy = on_device(pencil.dx), on_device(pencil.dy)
            self._film = FilmRow(**{k: dr.opaque(Float64, v) for k, v in vars(FilmRow.of(pencil)).items()})
            self._seen_from = Viewpoint.of(pencil, JIT)
            self._width, self._start = (dr.opaque(UInt32, n) for n in (pencil.resolution[0], self._base))

    def add(self, rows: Rows) -> None:
        """Take more triangles into account."""
        with strict_arithmetic():
            self._lanes.append(self._cut(rows))

    def finish(self) -> Sifted:
        """Return the triangles that may be first among all that were added."""
        with strict_arithmetic():
            # The sum up to each pixel of what `_cut` has marked: the number of lanes that have it.
            sharing = dr.cumsum(self._ends)
            marks = _Marks.none(self._pixels)
            unsettled = self._lanes
            if _mostly_alone(sharing.numpy()):
                left = [(lanes, self._write_alone(lanes, sharing, marks)) for lanes in self._lanes]
                unsettled = [lanes.some(kept) for lanes, kept in left if dr.width(kept)]
            contested = self._contested(unsettled, marks) if unsettled else NO_PAIRS
            return Sifted(
                triangle=marks.number.numpy(),
                s=marks.distance.numpy(),
                contested=contested,
                device=(marks.number, marks.distance),
            )

    def _cut(self, rows: Rows) -> Lanes:
        place = dr.arange(UInt32, len(rows.entry_of_row))
        entry = UInt32(dr.gather(Int32, on_device(rows.entry_of_row), place))
        # Four numbers that lie beside each other are read at once.
        table = on_device(_entry_table(rows))
        row_offset, sign, cone, number = dr.gather(Array4i, table, 2 * entry)
        holds, first_column, last_column, _ = dr.gather(Array4i, table, 2 * entry + 1)
        holds, row = holds != 0, Int32(place) + row_offset
        if rows.table is None:
            coordinates = on_lanes(rows.corners, cone)
            corners = [coordinates[k : k + 3] for k in (0, 3, 6)]
        else:
            corners = rows.table.look_up(UInt32(number))
        c = Cones.of(JIT, corners, self._seen_from, holds)

        # Cut the rows by the edges, then by the triangles' boxes of pixels.
        dy = dr.gather(Float64, self._dy, row)
        edges = zip(c.edge, c.edge_magnitude, strict=True)
        low, high, surely_from, surely_to = slopes_inside(edges, Float64(sign), dy, self._film, JIT)
        low, high = columns_between(low, high, self._film, JIT)
        first = dr.maximum(Int32(dr.ceil(low)), first_column)
        last = dr.minimum(Int32(dr.floor(high)), last_column)
        empty = first > last
        lanes = Lanes(
            rows=rows,
            place=place,
            planes=row_planes(c.planes, c.within, dy, self._seen_from.ends, dr.select),
            within=c.within,
            ends=self._seen_from.ends,
            surely_from=dr.select(holds, -np.inf, surely_from),
            surely_to=dr.select(holds, np.inf, surely_to),
            first=UInt32(dr.select(empty, 1, first)),
            last=UInt32(dr.select(empty, 0, last)),
            base=UInt32(row) * self._width - self._start,
            number=number,
        )
        # Counts of 32 bits wrap around: what is taken away after the last column is what was added before.
        for at, step in ((lanes.first, UInt32(1)), (lanes.last + 1, UInt32(0xFFFFFFFF))):
            dr.scatter_reduce(
                dr.ReduceOp.Add, self._ends, step, lanes.base + at, ~empty, mode=dr.ReduceMode.Direct
            )
        lanes.evaluate()
        return lanes

    def _write_alone(self, lanes: Lanes, sharing: Any, marks: _Marks) -> Any:
        """Write the triangles that are surely met in pixels that have one lane.

        Returns
        -------
        The numbers of the lanes that have other pixels, too.
        """

        def write(column: Any, left: Any) -> tuple[Any, Any]:
            s, _, sure, possible = self._evaluated(lanes, column)
            pixel = lanes.base + column
            alone = sure & (dr.gather(UInt32, sharing, pixel) == 1)
            dr.scatter(marks.number, lanes.number, pixel, alone)
            dr.scatter(marks.distance, s, pixel, alone)
            return column + 1, left | (possible & ~alone)

        _, left = dr.while_loop(
            (UInt32(lanes.first), Bool(False)), lambda column, _: column <= lanes.last, write
        )
        dr.eval(left, marks.number, marks.distance)
        return dr.compress(left)

    def _lower(self, lanes: Lanes) -> None:
        """Lower the largest s at which the first surface of each pixel can lie."""

        def lower(column: Any) -> None:
            s, error, sure, _ = self._evaluated(lanes, column)
            pixel = lanes.base + column
            # Mode Direct: the other modes allocate for each size of image, and compile anew.
            dr.scatter_reduce(dr.ReduceOp.Min, self._limit, s + error, pixel, sure, mode=dr.ReduceMode.Direct)

        walk(lanes, lower)
        dr.eval(self._limit)

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

    def _count(self, lanes: Lanes, rivals: Any, marks: _Marks) -> None:
        """Count the triangles that may be first in each pixel of some lanes, and write one of them down."""

        def count(column: Any) -> None:
            s, _, sure, possible = self._may_be_first(lanes, column)
            pixel = lanes.base + column
            weight = dr.select(sure, UInt32(1), UInt32(_DOUBTFUL_WEIGHT))
            # In the mode Direct, as in `_lower`.
            dr.scatter_reduce(dr.ReduceOp.Add, rivals, weight, pixel, possible, mode=dr.ReduceMode.Direct)
            dr.scatter(marks.number, lanes.number, pixel, possible)
            dr.scatter(marks.distance, s, pixel, possible)

        walk(lanes, count)
        dr.eval(rivals, marks.number, marks.distance)

    def _contested(self, unsettled: list[Lanes], marks: _Marks) -> Pairs:
        """Settle what can be settled in the pixels of some lanes, and return the pairs of all others.

        These are all pairs of the pixels for which several triangles may be first, or one not surely met. In
        these pixels number and distance are those of one triangle of several, and are taken back. A pixel
        that is settled already belongs to one lane, which writes the same again.
        """
        self._limit = dr.opaque(Float64, np.inf, self._pixels)
        rivals = dr.opaque(UInt32, 0, self._pixels)
        for lanes in unsettled:
            self._lower(lanes)
        for lanes in unsettled:
            self._count(lanes, rivals, marks)
        if int(dr.max(rivals)[0]) <= 1:
            return NO_PAIRS
        open_pixels = rivals > 1
        size = int(dr.sum(dr.select(open_pixels, rivals, UInt32(0)))[0])
        found = Pairs.joined([self._pairs(lanes, rivals, size) for lanes in unsettled])
        pixel = dr.arange(UInt32, self._pixels)
        dr.scatter(marks.number, Int32(NOTHING), pixel, open_pixels)
        dr.scatter(marks.distance, Float64(np.nan), pixel, open_pixels)
        dr.eval(marks.number, marks.distance)
        return found

    def _pairs(self, lanes: Lanes, rivals: Any, size: int) -> Pairs:
        """Return the pairs of open pixels; lanes write them in any order into arrays of the largest size."""
        written = dr.opaque(UInt32, 0)
        kinds = (UInt32, UInt32, Float64, Float64, Bool)
        out: tuple[Any, ...] = tuple(dr.empty(kind, size) for kind in kinds)

        def write(column: Any) -> None:
            s, error, sure, possible = self._may_be_first(lanes, column)
            wanted = possible & (dr.gather(UInt32, rivals, lanes.base + column) > 1)
            slot = dr.scatter_inc(written, UInt32(0), wanted)
            for target, value in zip(out, (lanes.place, column, s, error, sure), strict=True):
                dr.scatter(target, value, slot, wanted)

        walk(lanes, write)
        dr.eval(written, *out)
        at, column, s, error, sure = (values.numpy()[: int(written[0])].copy() for values in out)
        rows, entry = lanes.rows, lanes.rows.entry_of_row[at]
        cone = rows.entry[entry]
        found = Pairs(
            pixel=(at + rows.row_offset[entry]) * self._pencil.resolution[0] + column,
            triangle=rows.number[cone],
            s=s,
            error=error,
            sure=sure,
        )
        return settled(rows, cone, found, self._pencil)


def _entry_table(rows: Rows) -> Numbers:
    """Return the numbers that the rows of an entry have in common, two times four for each entry (E, 8)."""
    table = with_room((len(rows.entry), 8), np.int32)
    columns = rows.row_offset, rows.turn, rows.entry, rows.number, rows.holds_center, *rows.columns
    per_triangle = columns[3:]
    for k, values in enumerate(columns[:3]):
        table[:, k] = values
    for k, values in enumerate(per_triangle, start=3):
        table[:, k] = values[rows.entry]
    table[:, 7] = 0
    return table


def walk(lanes: Lanes, visit: Callable[[Any], None]) -> None:
    """Visit every column of every lane."""

    def step(column: Any) -> tuple[Any]:
        visit(column)
        return (column + 1,)

    dr.while_loop((UInt32(lanes.first),), lambda column: column <= lanes.last, step)


def _mostly_alone(sharing: NDArray[np.uint32]) -> bool:
    """Return whether most pixels that have lanes have one.

    If they do not, most lanes would walk once more, and hardly any would be settled by that. Either way the
    same is decided, so that some pixels are enough to tell.
    """
    some = sharing[::SAMPLED_PIXELS]
    return bool(2 * np.count_nonzero(some == 1) > np.count_nonzero(some))
