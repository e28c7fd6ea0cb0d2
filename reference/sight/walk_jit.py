"""The search for what may hide points, compiled by Dr.Jit for all processors.

There is one lane for each row of cells of a triangle. It walks the points in these cells, which lie one behind
the other, and writes down those before which it may be met.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import drjit as dr
import numpy as np
from drjit.llvm import Bool, Float64, Int32, UInt32

from xfrustum.reference.certify.spans import Arithmetic
from xfrustum.reference.devices.strict_jit import strict_arithmetic
from xfrustum.reference.sight.boxes import Lanes, Queries
from xfrustum.reference.sight.walk import TABLE_ROWS, Before, meeting, table

_JIT = Arithmetic(select=dr.select, maximum=dr.maximum, minimum=dr.minimum, isfinite=dr.isfinite)


def search(found: Sequence[Lanes], queries: Queries) -> Iterator[Before]:
    """Yield what the lines of queries meet, or may meet, before their ends."""
    with strict_arithmetic():
        asked = [Float64(queries.dx), Float64(queries.dy), Float64(queries.end)]
        own, first = Int32(queries.own), dr.opaque(Float64, queries.pencil.s_range[0])
        room = max(4 * len(queries.order), 1 << 12)
        for lanes in found:
            pairs = _walked(lanes, asked, own, first, room)
            while pairs is None:
                room *= 4
                pairs = _walked(lanes, asked, own, first, room)
            yield pairs


def _walked(lanes: Lanes, asked: list[Any], own: Any, nearest: Any, room: int) -> Before | None:
    """Return the pairs of some lanes; None where they do not fit into the room."""
    size, triangles = len(lanes.cone), len(lanes.cones.number)
    lane, stride = dr.arange(UInt32, size), dr.opaque(UInt32, size)
    # Gathered, not loaded: Dr.Jit compiles anew for every mix of alignments of arrays that lanes load.
    walk = UInt32(np.concatenate((lanes.cone, lanes.first, lanes.last)).astype(np.uint32))
    cone, first, last = (dr.gather(UInt32, walk, lane + k * stride) for k in range(3))
    flat, rows = Float64(table(lanes.cones).ravel()), dr.opaque(UInt32, triangles)
    numbers = [dr.gather(Float64, flat, cone + k * rows) for k in range(TABLE_ROWS)]
    number = dr.gather(Int32, Int32(lanes.cones.number.astype(np.int32)), cone)
    written, limit = dr.opaque(UInt32, 0), dr.opaque(UInt32, room)
    out = tuple(dr.empty(kind, room) for kind in (UInt32, UInt32, Bool))

    def step(query: Any) -> tuple[Any]:
        dx, dy, end = (dr.gather(Float64, values, query) for values in asked)
        possible, sure = meeting(numbers, dx, dy, (nearest, end), _JIT)
        possible &= dr.gather(Int32, own, query) != number
        slot = dr.scatter_inc(written, UInt32(0), possible)
        fits = possible & (slot < limit)
        for target, value in zip(out, (query, lane, sure), strict=True):
            dr.scatter(target, value, slot, fits)
        return (query + 1,)

    dr.while_loop((first,), lambda query: query < last, step)
    dr.eval(written, *out)
    count = int(written[0])
    if count > room:
        return None
    query, met, sure = (values.numpy()[:count].copy() for values in out)
    return Before(
        query=query.astype(np.int64), triangle=lanes.cones.number[lanes.cone[met]], sure=sure.astype(np.bool_)
    )
