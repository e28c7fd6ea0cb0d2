"""The search for what may hide points on NumPy, where there is no LLVM for Dr.Jit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from xfrustum.reference.certify.spans import NUMPY
from xfrustum.reference.sight.boxes import Lanes, Queries
from xfrustum.reference.sight.walk import Before, meeting, table

PAIRS_PER_CHUNK = 1 << 17
"""Pairs that are evaluated at once. This bounds the memory, about 500 bytes for each."""


def search(found: Sequence[Lanes], queries: Queries) -> Iterator[Before]:
    """Yield what the lines of queries meet, or may meet, before their ends, in bounded chunks."""
    for lanes in found:
        numbers, lengths = table(lanes.cones), (lanes.last - lanes.first).astype(np.int64)
        ends = np.cumsum(lengths)
        start = 0
        while start < len(lengths):
            before = ends[start - 1] if start else 0
            stop = max(start + 1, int(np.searchsorted(ends, before + PAIRS_PER_CHUNK)))
            some = slice(start, stop)
            lane = np.repeat(np.arange(start, stop), lengths[some])
            query = np.arange(len(lane)) + np.repeat(
                lanes.first[some] - (ends[some] - lengths[some] - before), lengths[some]
            )
            start = stop
            cone = lanes.cone[lane]
            reached = (queries.pencil.s_range[0], queries.end[query])
            with np.errstate(over="ignore", invalid="ignore"):
                possible, sure = meeting(
                    list(numbers[:, cone]), queries.dx[query], queries.dy[query], reached, NUMPY
                )
            triangle = lanes.cones.number[cone]
            kept = np.flatnonzero(possible & (triangle != queries.own[query]))
            yield Before(query=query[kept], triangle=triangle[kept], sure=np.asarray(sure)[kept])
