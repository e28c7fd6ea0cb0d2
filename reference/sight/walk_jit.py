"""The search for what may hide points, compiled by Dr.Jit for all processors.

Points are sorted by the cells of their lines. There is one lane for each row of cells of a triangle: it walks
the points in these cells, which lie one behind the other, and writes down those before which it may be met.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from xfrustum.reference.devices.arithmetic_jit import (
    JIT,
    Array4f64,
    Bool,
    Float64,
    Int32,
    UInt32,
    on_device,
)
from xfrustum.reference.devices.strict_jit import strict_arithmetic
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.sight.boxes import CellBoxes, cells
from xfrustum.reference.sight.clear import ClearTriangles
from xfrustum.reference.sight.clear_jit import clear_triangles
from xfrustum.reference.sight.coarse import CoarseCells
from xfrustum.reference.sight.kept import Kept
from xfrustum.reference.sight.rows_jit import Rows, lanes_with_items, row_count, rows_of_boxes
from xfrustum.reference.sight.walk import Before, PointLines, Surfaces, film_numbers, meeting
from xfrustum.scenes.arrays import Floats, Mask, Numbers

PAIRS_PER_POINT = 1 / 8
"""Pairs for each point that there is room for at first. Most points are hidden by nothing; where there are
more pairs, the walk is repeated with room for all of them."""

MIN_PAIR_ROOM = 1 << 12
"""Number of pairs that there is always room for."""

KEPT_ROWS = 1 << 22
"""Largest number of rows of boxes that are kept for the next pictures of apertures, in 12 bytes each."""

PAIRS_PER_CHUNK = 1 << 20
"""Largest number of pairs that are yielded at once: looking at one takes some 500 bytes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sorted:
    """Lines through points as Dr.Jit arrays, sorted by their cells.

    Attributes
    ----------
    lines
        (4 N,) slopes dx and dy, end, and the number of the point's own triangle, line by line.
    point
        (N,) numbers of the points.
    start
        First line of each cell.
    """

    lines: Any
    point: Any
    start: Any


class JitSearch:
    """The triangles of a scene, searched on Dr.Jit.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners.
    """

    def __init__(self, triangles: Floats) -> None:
        with strict_arithmetic():
            self._corners = on_device(triangles)
        # The settings of one aperture share its rows, and several threads judge an aperture each.
        self._rows: Kept[CellBoxes, Rows] = Kept(make=rows_of_boxes, size=row_count, room=KEPT_ROWS)

    def clear(self, coarse: CoarseCells, pencil: Pencil, asked: Mask) -> ClearTriangles | None:
        """Return which of the asked triangles (F,) are clear; see `clear_triangles`."""
        return clear_triangles(self._corners, coarse, pencil, asked)

    def before(self, boxes: CellBoxes, position: Floats, own: Numbers, tolerance: Floats) -> Iterator[Before]:
        """Yield what the lines through points meet, or may meet, before them.

        Parameters
        ----------
        boxes
            Boxes of cells of the triangles.
        position
            (N, 3) points in scene units, off the height of the pencil's center.
        own
            (N,) number of the triangle that each point lies on, which is left out.
        tolerance
            (N,) distance within which each point is known.
        """
        with strict_arithmetic():
            lines = _sorted(boxes, position, own, tolerance)
            lanes = lanes_with_items(self._rows(boxes), lines.start)
            if not dr.width(lanes[0]):
                return
            nearest = dr.opaque(Float64, boxes.pencil.s_range[0])
            center = [dr.opaque(Float64, value) for value in boxes.pencil.center]
            room = max(MIN_PAIR_ROOM, int(PAIRS_PER_POINT * len(position)))
            count, found = self._walked(lines, lanes, center, nearest, room)
            if count > room:
                count, found = self._walked(lines, lanes, center, nearest, count)
            point, triangle, sure = (values.numpy()[:count] for values in found)
        for start in range(0, count, PAIRS_PER_CHUNK):
            some = slice(start, start + PAIRS_PER_CHUNK)
            yield Before(
                point=point[some].astype(np.int64),
                triangle=triangle[some].astype(np.int64),
                sure=sure[some],
            )

    def _walked(
        self, lines: _Sorted, lanes: tuple[Any, ...], center: list[Any], nearest: Any, room: int
    ) -> tuple[int, tuple[Any, Any, Any]]:
        """Return the number of pairs of some lanes, and the pairs themselves as far as there is room.

        Pairs are arrays of points, of triangles, and of whether the triangle is surely met.
        """
        first, last, number, holds = lanes
        corners: list[Any] = [
            tuple(dr.gather(Float64, self._corners, 9 * number + (3 * corner + axis)) for axis in range(3))
            for corner in range(3)
        ]
        surfaces = Surfaces.of(corners, center, holds, JIT)
        named = Float64(number)
        written: Any = dr.opaque(UInt32, 0)
        limit: Any = dr.opaque(UInt32, room)
        points, triangles, certain = dr.empty(UInt32, room), dr.empty(UInt32, room), dr.empty(Bool, room)

        def step(query: Any) -> tuple[Any]:
            dx, dy, end, own = dr.gather(Array4f64, lines.lines, query)
            possible, sure = meeting(surfaces, dx, dy, (nearest, end), JIT)
            possible &= own != named
            slot = dr.scatter_inc(written, UInt32(0), possible)
            fits = possible & (slot < limit)
            dr.scatter(points, dr.gather(UInt32, lines.point, query, fits), slot, fits)
            dr.scatter(triangles, number, slot, fits)
            dr.scatter(certain, sure, slot, fits)
            return (query + 1,)

        dr.while_loop((UInt32(first),), lambda query: query < last, step)
        dr.eval(written, points, triangles, certain)
        return int(written[0]), (points, triangles, certain)


def _sorted(boxes: CellBoxes, position: Floats, own: Numbers, tolerance: Floats) -> _Sorted:
    """Return the lines through points, sorted by the cells of the film."""
    width, height = boxes.pencil.resolution
    stride = dr.opaque(Int32, width + 2)
    points = [on_device(values) for values in (*position.T, tolerance)]
    numbers = [dr.opaque(Float64, value) for value in film_numbers(boxes.pencil)]
    lines = PointLines.of(points, numbers, dr.sqrt)
    sides = [dr.opaque(Float64, float(side)) for side in (width, height)]
    column, row = (
        Int32(dr.round(dr.clip(place, -1.0, side))) + 1
        for place, side in zip((lines.column, lines.row), sides, strict=True)
    )
    cell: Any = UInt32(row * stride + column)
    # Counting sort: the order of the lines within a cell means nothing.
    count: Any = dr.opaque(UInt32, 0, cells(boxes.pencil) + 1)
    rank = dr.scatter_inc(count, cell)
    together = Array4f64(lines.dx, lines.dy, lines.end, Float64(on_device(own)))
    dr.eval(together, cell, rank, count)
    start: Any = dr.prefix_sum(count)
    place: Any = dr.gather(UInt32, start, cell)
    target = place + rank
    sorted_lines, point = dr.empty(Float64, 4 * len(position)), dr.empty(UInt32, len(position))
    # Four numbers at a time, one beside the other: a walk reads a line at once.
    dr.scatter(sorted_lines, together, target)
    dr.scatter(point, dr.arange(UInt32, len(position)), target)
    dr.eval(sorted_lines, point)
    return _Sorted(lines=sorted_lines, point=point, start=start)
