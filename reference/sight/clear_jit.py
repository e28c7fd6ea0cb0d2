"""The search for clear triangles, compiled by Dr.Jit; `clear` says what they are and why.

There is one lane for each row of coarse cells of a triangle. It walks the triangles in these cells until one
of them may hide a part of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np

from xfrustum.reference.devices.arithmetic_jit import JIT, Array4f64, Bool, Float64, UInt32, on_device
from xfrustum.reference.devices.strict_jit import strict_arithmetic
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.sight.clear import (
    AWAY,
    BEHIND,
    COLUMNS,
    INSIDE,
    SHARE,
    ClearTriangles,
    limit,
    looseness,
)
from xfrustum.reference.sight.coarse import CoarseCells
from xfrustum.reference.sight.rows_jit import lanes_with_items, rows_of_boxes
from xfrustum.reference.sight.walk import film_numbers
from xfrustum.scenes.arrays import Mask


def clear_triangles(corners: Any, coarse: CoarseCells, pencil: Pencil, asked: Mask) -> ClearTriangles | None:
    """Return which triangles are clear; None where none that is asked about is seen.

    Parameters
    ----------
    corners
        (9 F,) corners of all triangles, on the device.
    coarse
        Boxes of cells of the triangles, by coarse cells.
    pencil
        Lines of the film.
    asked
        (F,) triangles that are asked about.
    """
    boxes = coarse.boxes
    mine = np.flatnonzero(asked[boxes.number])
    if not mine.size:
        return None
    boxed = np.zeros_like(asked)
    boxed[boxes.number[mine]] = True
    start, item = (values.astype(np.uint32) for values in (coarse.start, boxes.number[coarse.item]))
    with strict_arithmetic():
        flat = _flattened(corners, pencil)
        some = replace(boxes, number=boxes.number[mine], holds=boxes.holds[mine], box=boxes.box[:, mine])
        first, last, number, _ = lanes_with_items(rows_of_boxes(some), on_device(start))
        hidden = _walk(flat, (first, last, number), on_device(item), pencil)
        table = np.array(flat.table.numpy()).reshape(-1, COLUMNS)
        table[~boxed | hidden.numpy() | ~flat.comparable.numpy(), 2] = -np.inf
    return ClearTriangles(pencil=pencil, table=table)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Flat:
    """Triangles on the film, as Dr.Jit arrays.

    Attributes
    ----------
    places
        (8 F,) column and row of each corner, which are not numbers where the triangle is not comparable, and
        the smallest and the largest s.
    table
        (8 F,) numbers of `ClearTriangles`.
    comparable
        (F,) whether the triangle lies on one side of the center, and within the limit on the film.
    """

    places: Any
    table: Any
    comparable: Any


def _edges(places: Sequence[tuple[Any, Any]]) -> tuple[list[tuple[Any, Any, Any]], Any]:
    """Return the edge functions of triangles, positive inside, and twice their areas.

    An edge function is given as factors of column, row and 1.
    """
    (x0, y0), (x1, y1), (x2, y2) = places
    area = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
    sign = dr.select(area > 0, 1.0, -1.0)
    edges = []
    for (ax, ay), (bx, by) in zip(places, (*places[1:], places[0]), strict=True):
        a, b = (ay - by) * sign, (bx - ax) * sign
        edges.append((a, b, -(a * ax + b * ay)))
    return edges, abs(area)


def _flattened(corners: Any, pencil: Pencil) -> _Flat:
    """Return all triangles on the film."""
    lane = dr.arange(UInt32, dr.width(corners) // 9)
    center_x, center_y, center_z, shear_x, shear_y, scale_x, scale_y, middle_x, middle_y = JIT.constants(
        film_numbers(pencil)
    )
    most, inside = JIT.constants((limit(pencil), INSIDE * looseness(pencil)))
    places, depths = [], []
    comparable: Any = Bool(True)
    for corner in range(3):
        x, y, z = (dr.gather(Float64, corners, 9 * lane + (3 * corner + axis)) for axis in range(3))
        s = center_z - z
        column = ((x - center_x) / s - shear_x) * scale_x + middle_x
        row = middle_y - ((y - center_y) / s - shear_y) * scale_y
        comparable &= (abs(column) <= most) & (abs(row) <= most)
        places.append((column, row))
        depths.append(s)
    nearest = dr.minimum(dr.minimum(depths[0], depths[1]), depths[2])
    farthest = dr.maximum(dr.maximum(depths[0], depths[1]), depths[2])
    comparable &= (nearest > 0) | (farthest < 0)
    edges, area = _edges(places)
    least = dr.maximum(inside, area * SHARE)
    table, flat = dr.empty(Float64, COLUMNS * dr.width(lane)), dr.empty(Float64, 8 * dr.width(lane))
    # The third edge function reaches `least` where the other two, less that, leave this of twice the area.
    left_over = area - 3 * least
    for number, ((a, b, c), last) in enumerate(zip(edges[:2], (farthest, left_over), strict=True)):
        dr.scatter(table, Array4f64(a, b, c - least, last), 2 * lane + number)
    known = [dr.select(comparable, value, np.nan) for place in places for value in place]
    dr.scatter(flat, Array4f64(*known[:4]), 2 * lane)
    dr.scatter(flat, Array4f64(*known[4:], nearest, farthest), 2 * lane + 1)
    dr.eval(table, flat, comparable)
    return _Flat(places=flat, table=table, comparable=comparable)


def _triangle(flat: _Flat, number: Any) -> tuple[list[tuple[Any, Any]], Any, Any]:
    """Return the places of the corners of triangles, and their smallest and largest s."""
    x0, y0, x1, y1 = dr.gather(Array4f64, flat.places, 2 * number)
    x2, y2, nearest, farthest = dr.gather(Array4f64, flat.places, 2 * number + 1)
    return [(x0, y0), (x1, y1), (x2, y2)], nearest, farthest


def _walk(flat: _Flat, lanes: tuple[Any, Any, Any], item: Any, pencil: Pencil) -> Any:
    """Return whether another triangle may hide a part of each triangle, (F,)."""
    first, last, number = lanes
    hidden = dr.zeros(Bool, dr.width(flat.comparable))
    if not dr.width(first):
        return hidden
    mine, _, farthest = _triangle(flat, number)
    my_edges, _ = _edges(mine)
    loose, away = JIT.constants((looseness(pencil), AWAY * looseness(pencil)))

    def values(edge: tuple[Any, Any, Any], places: Sequence[tuple[Any, Any]]) -> list[Any]:
        a, b, c = edge
        return [a * column + b * row + c for column, row in places]

    def step(query: Any, open_so_far: Any) -> tuple[Any, Any]:
        other = dr.gather(UInt32, item, query)
        its, nearest, _ = _triangle(flat, other)
        its_edges, _ = _edges(its)
        harmless: Any = (other == number) | (nearest >= farthest + BEHIND * (abs(nearest) + abs(farthest)))
        # A comparison with what is not a number is false: what is not comparable is nowhere apart.
        for edge in my_edges:
            x, y, z = values(edge, its)
            harmless |= (x <= loose) & (y <= loose) & (z <= loose)
        for edge in its_edges:
            x, y, z = values(edge, mine)
            least = dr.minimum(dr.minimum(x, y), z)
            harmless |= (x <= loose) & (y <= loose) & (z <= loose) & (least <= -away)
        return query + 1, open_so_far & harmless

    _, still_open = dr.while_loop(
        (UInt32(first), first < last), lambda query, open_so_far: (query < last) & open_so_far, step
    )
    dr.scatter(hidden, Bool(True), number, ~still_open)
    dr.eval(hidden)
    return hidden
