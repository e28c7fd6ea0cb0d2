"""The narrow phase on NumPy, where there is no LLVM for Dr.Jit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

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
from xfrustum.reference.devices.arithmetic import NUMPY
from xfrustum.reference.lines.cone import Cones, Planes
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.lines.pairs import NO_PAIRS, Pairs
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.model.hogel_image import NOTHING

PAIRS_PER_CHUNK = 1 << 20
"""Pairs that are evaluated at once. This bounds the memory of the narrow phase, about 200 bytes per pair."""

PENDING_PAIRS = 1 << 22
"""Pairs that are kept before those that cannot be first are dropped."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Spans:
    """Rows cut by their triangles' edges, without those that are empty.

    Attributes
    ----------
    rows
        The rows before they were cut.
    cones
        Their triangles.
    cone
        (S,) the triangle of each row, as an index into the triangles.
    row, first, last
        (S,) row, and first and last column, inclusive.
    surely_from, surely_to
        (S,) slopes dx between which coverage is certain; no slope where from > to.
    """

    rows: Rows
    cones: Cones
    cone: Indices
    row: Indices
    first: Indices
    last: Indices
    surely_from: Floats
    surely_to: Floats

    @classmethod
    def of(cls, rows: Rows, pencil: Pencil) -> Spans:
        """Cut the rows of triangles by their edges."""
        c, cone, film = rows.cones(pencil), rows.cone, FilmRow.of(pencil)

        def edges() -> Iterator[tuple[list[Floats], list[Floats]]]:
            for edge, magnitude in zip(c.edge, c.edge_magnitude, strict=True):
                yield [part[cone] for part in edge], [part[cone] for part in magnitude]

        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            low, high, surely_from, surely_to = slopes_inside(
                edges(), rows.orientation, pencil.dy[rows.row], film, NUMPY
            )
        first, last = columns_between(low, high, film, NUMPY)
        first = np.maximum(np.ceil(first).astype(np.int64), rows.columns[0][cone])
        last = np.minimum(np.floor(last).astype(np.int64), rows.columns[1][cone])
        some = first <= last
        holds = rows.holds_center[cone]
        return cls(
            rows=rows,
            cones=c,
            cone=cone[some],
            row=rows.row[some],
            first=first[some],
            last=last[some],
            surely_from=np.where(holds, -np.inf, surely_from)[some],
            surely_to=np.where(holds, np.inf, surely_to)[some],
        )

    def planes(self, pencil: Pencil) -> RowPlanes:
        """Return the planes of the triangles along these rows."""
        own, lane = self.cones.planes, self.cone
        planes = Planes(
            normal=[part[lane] for part in own.normal],
            normal_magnitude=[part[lane] for part in own.normal_magnitude],
            plane=own.plane[lane],
            plane_bound=own.plane_bound[lane],
        )
        return row_planes(planes, self.cones.within[lane], pencil.dy[self.row], pencil.s_range, np.where)


class NumpyNarrowPhase:
    """The narrow phase of some rows of an image on NumPy; see `NarrowPhase`."""

    def __init__(self, pencil: Pencil, rows: range) -> None:
        self._pencil = pencil
        self._base = rows.start * pencil.resolution[0]
        self._limit = np.full(len(rows) * pencil.resolution[0], np.inf)
        self._kept: list[Pairs] = []

    def add(self, rows: Rows) -> None:
        """Take more triangles into account."""
        for found in self._pairs_of(rows):
            np.minimum.at(self._limit, found.pixel[found.sure] - self._base, found.farthest[found.sure])
            self._kept.append(self._not_behind(found))
            if sum(len(kept.pixel) for kept in self._kept) > PENDING_PAIRS:
                self._kept = [self._not_behind(Pairs.joined(self._kept))]

    def _pairs_of(self, rows: Rows) -> Iterator[Pairs]:
        """Yield the pairs of rows that meet or may meet, in bounded chunks."""
        spans = Spans.of(rows, self._pencil)
        planes = spans.planes(self._pencil)
        lengths = spans.last - spans.first + 1
        ends = np.cumsum(lengths)
        start = 0
        while start < len(lengths):
            before = ends[start - 1] if start else 0
            stop = max(start + 1, int(np.searchsorted(ends, before + PAIRS_PER_CHUNK)))
            yield self._evaluated(spans, planes, np.repeat(np.arange(start, stop), lengths[start:stop]))
            start = stop

    def finish(self) -> Sifted:
        """Return the triangles that may be first among all that were added."""
        found = self._not_behind(Pairs.joined([NO_PAIRS, *self._kept]))
        pixel = found.pixel - self._base
        rivals = np.bincount(pixel, minlength=len(self._limit))
        alone = (rivals[pixel] == 1) & found.sure
        triangle = np.full(len(self._limit), NOTHING, dtype=np.int32)
        s = np.full(len(self._limit), np.nan)
        triangle[pixel[alone]], s[pixel[alone]] = found.triangle[alone], found.s[alone]
        return Sifted(triangle=triangle, s=s, contested=found[~alone])

    def _not_behind(self, found: Pairs) -> Pairs:
        return found[found.nearest <= self._limit[found.pixel - self._base]]

    def _evaluated(self, spans: Spans, planes: RowPlanes, span: Indices) -> Pairs:
        """Return the pairs of consecutive spans; `span` repeats each one's number for each of its pixels."""
        # Columns count up from the first one of each span.
        run = np.flatnonzero(np.diff(span, prepend=-1))
        column = spans.first[span] + np.arange(len(span)) - np.repeat(run, np.diff(run, append=len(span)))
        dx = self._pencil.dx[column]
        row = RowPlanes(**{field.name: getattr(planes, field.name)[span] for field in fields(RowPlanes)})
        s, error = plane_meeting(dx, row, np.where)
        sure = (dx >= spans.surely_from[span]) & (dx <= spans.surely_to[span])
        found = Pairs(
            pixel=spans.row[span] * self._pencil.resolution[0] + column,
            triangle=spans.rows.number[spans.cone[span]],
            s=s,
            error=error,
            sure=sure & surely_counts(s, error, row.first, row.last),
        )
        possible = (found.farthest >= row.first) & (found.nearest <= row.last)
        return settled(spans.rows, spans.cone[span[possible]], found[possible], self._pencil)
