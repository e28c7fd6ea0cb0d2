"""The narrow phase compiled by Dr.Jit for all processors: one lane for each span.

Each lane walks the columns of its span, in double precision and with the arithmetic of
`narrow.plane_meeting`: first to lower, pixel by pixel, the largest s at which the first surface
can lie; then to count who may lie before that and to write down who does; and a third time,
only where that leaves more than one, to hand over the pairs.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from drjit.llvm import Bool, Float64, UInt32

from xfrustum.reference.lines import Pencil
from xfrustum.reference.narrow import Sifted, SpanPlanes, plane_meeting, settled
from xfrustum.reference.pairs import NO_PAIRS, Pairs
from xfrustum.reference.spans import Spans
from xfrustum.scenes.hogel_image import NOTHING

_ONE_AT_A_TIME = threading.Lock()
"""Dr.Jit records per process; its kernels themselves use all processors."""


@contextmanager
def _strict_arithmetic() -> Iterator[None]:
    """Hold Dr.Jit to IEEE arithmetic: a proof must not rest on a compiler's liberties."""
    with _ONE_AT_A_TIME, dr.scoped_set_flag(dr.JitFlag.FastMath, False):
        yield


_DOUBTFUL = 2
"""What a pair counts whose coverage is in doubt: it leaves its pixel open even if it is alone."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Lanes:
    """Spans as Dr.Jit arrays."""

    spans: Spans
    planes: SpanPlanes
    columns: list[Any]
    surely: tuple[Any, Any]
    first: Any
    last: Any
    base: Any
    number: Any


class JitNarrowPhase:
    """The narrow phase of some rows of an image.

    Parameters
    ----------
    pencil
        The lines.
    rows
        Rows of the image that all spans lie in.
    """

    def __init__(self, pencil: Pencil, rows: range) -> None:
        self._pencil = pencil
        self._pixels = len(rows) * pencil.resolution[0]
        self._base = rows.start * pencil.resolution[0]
        self._lanes: list[_Lanes] = []
        with _strict_arithmetic():
            # Opaque: values that differ from image to image must not compile another kernel.
            self._limit = dr.opaque(Float64, np.inf, self._pixels)
            self._dx = Float64(np.array(pencil.dx))

    def add(self, spans: Spans) -> None:
        """Take more spans into account."""
        if not len(spans.row):
            return
        with _strict_arithmetic():
            lanes = self._uploaded(spans)
            self._lanes.append(lanes)

            def lower(column: Any) -> None:
                s, error, sure, _ = self._evaluated(lanes, column)
                pixel = lanes.base + column
                # Direct: the alternatives allocate per image size, and compile for each.
                dr.scatter_reduce(
                    dr.ReduceOp.Min, self._limit, s + error, pixel, sure, mode=dr.ReduceMode.Direct
                )

            _walk(lanes, lower)
            dr.eval(self._limit)

    def finish(self) -> Sifted:
        """Return who is first where only one can be, and the pairs of all other pixels."""
        with _strict_arithmetic():
            rivals = dr.opaque(UInt32, 0, self._pixels)
            number = dr.opaque(UInt32, 0, self._pixels)
            distance = dr.opaque(Float64, 0.0, self._pixels)
            for lanes in self._lanes:
                self._count(lanes, rivals, number, distance)
            contested = self._contested(rivals)
            alone = rivals.numpy() == 1
            return Sifted(
                triangle=np.where(alone, number.numpy(), NOTHING).astype(np.int32),
                s=np.where(alone, distance.numpy(), np.nan),
                contested=contested,
            )

    def _uploaded(self, spans: Spans) -> _Lanes:
        # Dr.Jit reads NumPy's memory in place, and compiles anew for every mix of alignments of
        # what lanes load directly. Gathers do not care: all goes through two tables.
        planes = SpanPlanes.of(spans, self._pencil)
        base = spans.row * self._pencil.resolution[0] - self._base
        numbers = (*vars(planes).values(), spans.surely_from, spans.surely_to)
        integers = (spans.first, spans.last, base, spans.cones.number[spans.cone])
        table = Float64(np.concatenate(numbers))
        walk = UInt32(np.concatenate(integers).astype(np.uint32))
        lane, stride = dr.arange(UInt32, len(base)), dr.opaque(UInt32, len(base))
        columns = [dr.gather(Float64, table, lane + k * stride) for k in range(len(numbers))]
        first, last, start, number = (
            dr.gather(UInt32, walk, lane + k * stride) for k in range(len(integers))
        )
        return _Lanes(
            spans=spans,
            planes=planes,
            columns=columns[:-2],
            surely=(columns[-2], columns[-1]),
            first=first,
            last=last,
            base=start,
            number=number,
        )

    def _evaluated(self, lanes: _Lanes, column: Any) -> tuple[Any, Any, Any, Any]:
        """Return s, its error, whether the line surely meets, and whether it may at all."""
        dx = dr.gather(Float64, self._dx, column)
        *plane, first, last = lanes.columns
        s, error = plane_meeting(dx, plane, dr.select)
        nearest, farthest = s - error, s + error
        sure = (dx >= lanes.surely[0]) & (dx <= lanes.surely[1]) & (nearest >= first) & (farthest <= last)
        return s, error, sure, (farthest >= first) & (nearest <= last)

    def _may_be_first(self, lanes: _Lanes, column: Any) -> tuple[Any, Any, Any, Any]:
        s, error, sure, possible = self._evaluated(lanes, column)
        limit = dr.gather(Float64, self._limit, lanes.base + column)
        return s, error, sure, possible & (s - error <= limit)

    def _count(self, lanes: _Lanes, rivals: Any, number: Any, distance: Any) -> None:
        def count(column: Any) -> None:
            s, _, sure, possible = self._may_be_first(lanes, column)
            pixel = lanes.base + column
            weight = dr.select(sure, UInt32(1), UInt32(_DOUBTFUL))
            dr.scatter_reduce(dr.ReduceOp.Add, rivals, weight, pixel, possible, mode=dr.ReduceMode.Direct)
            dr.scatter(number, lanes.number, pixel, possible)
            dr.scatter(distance, s, pixel, possible)

        _walk(lanes, count)
        dr.eval(rivals, number, distance)

    def _contested(self, rivals: Any) -> Pairs:
        """Return all pairs of the pixels for which several triangles may be first, or one in doubt."""
        open_pixels = rivals > 1
        size = int(dr.sum(dr.select(open_pixels, rivals, UInt32(0)))[0])
        if size == 0:
            return NO_PAIRS
        return Pairs.joined([self._pairs(lanes, rivals, size) for lanes in self._lanes])

    def _pairs(self, lanes: _Lanes, rivals: Any, size: int) -> Pairs:
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

        _walk(lanes, write)
        dr.eval(written, *out)
        span, column, s, error, sure = (values.numpy()[: int(written[0])].copy() for values in out)
        spans, span = lanes.spans, span.astype(np.int64)
        found = Pairs(
            pixel=spans.row[span] * self._pencil.resolution[0] + column,
            triangle=spans.cones.number[spans.cone[span]],
            s=s,
            error=error,
            sure=sure,
        )
        return settled(spans, lanes.planes, span, found, self._pencil)


def _walk(lanes: _Lanes, visit: Callable[[Any], None]) -> None:
    """Visit every column of every span."""

    def step(column: Any) -> tuple[Any]:
        visit(column)
        return (column + 1,)

    dr.while_loop((UInt32(lanes.first),), lambda column: column <= lanes.last, step)
