"""Clear triangles: nothing hides them well inside their outlines, so that their points need not be searched.

Most points of a picture lie on clear triangles. They are found once for an aperture, and answer for its
pictures with all settings. A triangle T is clear if each other triangle N that shares a cell of the film


- lies apart from T on the film: an edge of T or of N has T on its one side and N on its other; or
- lies behind T: all of N is farther along the lines than all of T.

A line that passes through T well inside its outline meets no N of the first kind. It meets an N of the second
kind behind all of T, and so not before a point that is no farther than T. Thus nothing hides such a point.

The three edge functions of a triangle add up to twice its area at every place. Two of them are kept, and the
third follows: eight numbers for each triangle are looked up faster than twelve.

What rounding does. Places on the film are computed in doubles. Let e bound the rounding of a place
(`_place_error`) and D the distance between two places, both of corners and points within `_limit`. The edge
function of an edge from a to b at a place q is the edge's length times the distance of q from its line. It is
known to within 6 e D for the roundings of places, and e D for its own: together less than half of l = 16 e D
(`_looseness`). Twice the area is the edge function of an edge at the third corner, and known as well. The
third edge function of T is known from both others and twice the area, to within 21 e D, and e D for the
roundings of its sum, whose terms are no larger than D^2: together less than 1.5 l.

- An edge of T that separates has all of N on its outer side, up to 1.5 l where l was computed. A point whose
  edge functions are `INSIDE` l is farther in than that: by 4 l less 1.5 l, which is 2.5 l.
- An edge of N that separates has all of T on its outer side, up to 1.5 l, and one corner of T farther out
  than `AWAY` l. A point of T whose barycentric coordinates are at least 2^-11 is farther out than
  (2^-11 2^13 - 1.5) l = 2.5 l, and N reaches out by no more than l. Edge functions of `SHARE` of twice the
  area and of `INSIDE` l mean such coordinates, whatever the area is: 1.5 l is at most 3/8 of what they reach.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from xfrustum.reference.backend import Array4f64, Bool, Float64, UInt32, constants, dr
from xfrustum.reference.certify.cells import film_places, rows_of_cells, triangles_of_cells
from xfrustum.reference.certify.cone import UNIT_ROUNDOFF, Triangles
from xfrustum.reference.lines.lines import Pencil

LIMIT_PER_SIDE = 2
"""Largest column and row of a corner, in units of the film's longer side, of a triangle that is compared by
places on the film. Others hide, as far as is known, whatever they share cells with."""

INSIDE = 4.0
"""Smallest edge functions of points that are well inside, in units of `_looseness`."""

SHARE = 2.0**-10
"""Smallest edge functions of points that are well inside, in units of twice the area of their triangle."""

AWAY = 2.0**13
"""Edge function, in units of `_looseness`, of a corner that is well outside an edge."""

BEHIND = 2.0**-48
"""Share of s by which a triangle that is behind another one must be farther: some roundings of doubles."""

TOLERANCE_SHARE = 0.49
"""Share of its tolerance by which a point may seem to be farther than its triangle, in units of the length of
the lines for a step of s: only what is met by more than half of the tolerance before a point hides it."""

COARSE = 8
"""Sides of a coarse cell, in pixels. Triangles of some ten pixels share few of these, and few share none."""

MAX_ITEMS = 1 << 23
"""Largest number of coarse cells of all triangles together. This bounds time and memory."""

Edge = tuple[Any, Any, Any]
"""An edge function on the film, positive inside, as factors of column, row and 1."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ClearTriangles:
    """Triangles that nothing hides, as the lines of a pencil see them.

    `table` has eight numbers for each triangle: two edge functions less what a point well inside must reach;
    behind the first, the largest s; behind the second, what both together may reach. Of triangles that may
    be hidden no point is well inside.
    """

    pencil: Pencil
    table: Any

    def seen(self, triangle: Any, place: tuple[Any, Any], s: Any, tolerance: Any) -> Any:
        """Return which points are surely hidden by nothing.

        Parameters
        ----------
        triangle
            Number of the triangle that each point lies on, negative for none.
        place, s
            Column and row of the point, and its place along its line.
        tolerance
            Distance within which it is known.
        """
        farther, most = constants((TOLERANCE_SHARE / _largest_length(self.pencil), _limit(self.pencil)))
        known = (triangle >= 0) & (triangle < dr.width(self.table) // 8)
        at = UInt32(dr.maximum(triangle, 0))
        first = dr.gather(Array4f64, self.table, 2 * at, known)
        second = dr.gather(Array4f64, self.table, 2 * at + 1, known)
        column, row = place
        # The bounds of rounding hold within the limit, beyond which there is nothing of clear triangles.
        seen = known & (abs(column) <= most) & (abs(row) <= most) & (s - tolerance * farther <= first[3])
        left_over = second[3]
        for a, b, c, _ in (first, second):
            edge = a * column + b * row + c
            seen, left_over = seen & (edge >= 0), left_over - edge
        return seen & (left_over >= 0)


def clear_triangles(triangles: Triangles, pencil: Pencil) -> ClearTriangles | None:
    """Return which triangles are clear, as a pencil's lines see them; None where too many share cells."""
    width, height = (-(-side // COARSE) for side in pencil.resolution)
    coarse = replace(pencil, resolution=(width, height))
    rows = rows_of_cells(triangles, coarse)
    sorted_items = triangles_of_cells(coarse, rows, MAX_ITEMS)
    if sorted_items is None:
        return None
    start, item = sorted_items
    flat = _Flat.of(triangles, pencil)
    hidden = dr.zeros(Bool, len(triangles))
    boxed = dr.zeros(Bool, len(triangles))
    for some in rows:
        first, last = (dr.gather(UInt32, start, cell) for cell in (some.first, some.behind))
        dr.scatter(boxed, Bool(True), some.number)
        _mark_hidden(hidden, flat, (some.number, first, last), item, pencil)
    least, count = flat.table, len(triangles)
    # No point is inside an edge function of minus infinity.
    out = hidden | ~boxed | ~flat.comparable
    dr.scatter(least, Float64(-np.inf), dr.arange(UInt32, count) * 8 + 2, out)
    dr.eval(least)
    return ClearTriangles(pencil=pencil, table=least)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Flat:
    """Triangles on the film: eight numbers each of `ClearTriangles` (`table`) and of `places`.

    These are column and row of each corner, which are not numbers where the triangle is not comparable, and
    the smallest and the largest s. Comparable are triangles on one side of the center, within the limit.
    """

    places: Any
    table: Any
    comparable: Any

    @classmethod
    def of(cls, triangles: Triangles, pencil: Pencil) -> _Flat:
        """Return all triangles on the film."""
        lane = dr.arange(UInt32, len(triangles))
        most, inside = constants((_limit(pencil), INSIDE * _looseness(pencil)))
        places, depths = [], []
        comparable: Any = Bool(True)
        for corner in triangles.points(lane):
            s, _, place = film_places(pencil, corner)
            comparable &= (abs(place[0]) <= most) & (abs(place[1]) <= most)
            places.append(place)
            depths.append(s)
        nearest = dr.minimum(dr.minimum(depths[0], depths[1]), depths[2])
        farthest = dr.maximum(dr.maximum(depths[0], depths[1]), depths[2])
        comparable &= (nearest > 0) | (farthest < 0)
        edges, area = _edges(places)
        least = dr.maximum(inside, area * SHARE)
        table, flat = dr.empty(Float64, 8 * len(triangles)), dr.empty(Float64, 8 * len(triangles))
        # The third edge function reaches `least` where the others, less that, leave this of twice the area.
        for number, ((a, b, c), last) in enumerate(zip(edges[:2], (farthest, area - 3 * least), strict=True)):
            dr.scatter(table, Array4f64(a, b, c - least, last), 2 * lane + number)
        known = [dr.select(comparable, value, np.nan) for place in places for value in place]
        dr.scatter(flat, Array4f64(*known[:4]), 2 * lane)
        dr.scatter(flat, Array4f64(*known[4:], nearest, farthest), 2 * lane + 1)
        dr.eval(table, flat, comparable)
        return cls(places=flat, table=table, comparable=comparable)

    def triangle(self, number: Any) -> tuple[list[tuple[Any, Any]], Any, Any]:
        """Return the places of the corners of triangles, and their smallest and largest s."""
        x0, y0, x1, y1 = dr.gather(Array4f64, self.places, 2 * number)
        x2, y2, nearest, farthest = dr.gather(Array4f64, self.places, 2 * number + 1)
        return [(x0, y0), (x1, y1), (x2, y2)], nearest, farthest


def _edges(places: Sequence[tuple[Any, Any]]) -> tuple[list[Edge], Any]:
    """Return the edge functions of triangles, and twice their areas."""
    (x0, y0), (x1, y1), (x2, y2) = places
    area = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
    sign = dr.select(area > 0, 1.0, -1.0)
    edges = []
    for (ax, ay), (bx, by) in zip(places, (*places[1:], places[0]), strict=True):
        a, b = (ay - by) * sign, (bx - ax) * sign
        edges.append((a, b, -(a * ax + b * ay)))
    return edges, abs(area)


def _mark_hidden(hidden: Any, flat: _Flat, lanes: tuple[Any, Any, Any], item: Any, pencil: Pencil) -> None:
    """Mark triangles of which another one may hide a part: each lane walks the items of its cells."""
    number, first, last = lanes
    mine, _, farthest = flat.triangle(number)
    my_edges, _ = _edges(mine)
    loose, away = constants((_looseness(pencil), AWAY * _looseness(pencil)))

    def values(edge: Edge, places: Sequence[tuple[Any, Any]]) -> list[Any]:
        a, b, c = edge
        return [a * column + b * row + c for column, row in places]

    def step(query: Any, open_so_far: Any) -> tuple[Any, Any]:
        other = dr.gather(UInt32, item, query)
        its, nearest, _ = flat.triangle(other)
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


def _limit(pencil: Pencil) -> float:
    """Return the largest column and row of a corner that is compared, and of a point that is asked about."""
    return float(LIMIT_PER_SIDE * max(pencil.resolution))


def _place_error(pencil: Pencil) -> float:
    """Return a bound in pixels on the rounding of a place within the limit.

    A slope has a relative error of 3 u; the shear is subtracted, and pixels are counted, with some more
    roundings of what is at most W (|k| / t + 2) + limit. The bound is twice the result.
    """
    sides = zip(pencil.resolution, pencil.shear, pencil.half_extent, strict=True)
    return max(
        16 * UNIT_ROUNDOFF * (pixels * (abs(shear) / half + 2) + _limit(pencil))
        for pixels, shear, half in sides
    )


def _looseness(pencil: Pencil) -> float:
    """Return twice the bound on the rounding of an edge function, in square pixels."""
    # Columns and rows lie between -limit and limit.
    distance = 2 * np.sqrt(2) * _limit(pencil)
    return float(16 * _place_error(pencil) * distance)


def _largest_length(pencil: Pencil) -> float:
    """Return a bound on the length of a line for a step of s, at places within the limit."""
    slopes = [
        abs(shear) + half * (1 + 2 * _limit(pencil) / pixels)
        for pixels, shear, half in zip(pencil.resolution, pencil.shear, pencil.half_extent, strict=True)
    ]
    return float(np.sqrt(1 + slopes[0] ** 2 + slopes[1] ** 2))
