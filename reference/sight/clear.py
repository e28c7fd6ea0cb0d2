"""Clear triangles: nothing hides them well inside their outlines, so that their points need not be searched.

Most points of a picture lie on clear triangles. They are found once for an aperture, and answer for its
pictures with all settings.

A triangle T is clear if each other triangle N that shares a cell of the film with it

- lies apart from T on the film: an edge of T or of N has T on its one side and N on its other; or
- lies behind T: all of N is farther along the lines than all of T.

A line that passes through T well inside its outline meets no N of the first kind. It meets an N of the second
kind behind all of T, and so not before a point that is no farther than T. Thus nothing hides such a point.

The three edge functions of a triangle add up to twice its area at every place. Two of them are kept, and the
third follows: eight numbers for each triangle are looked up faster than twelve.

What rounding does. Places on the film are computed in doubles. Let e bound the rounding of a place
(`place_error`) and D the distance between two places, both of corners and points within `limit`. The edge
function of an edge from a to b at a place q is the edge's length times the distance of q from its line. It is
known to within 6 e D for the roundings of places, and e D for its own: together less than half of l = 16 e D
(`looseness`). Twice the area is the edge function of an edge at the third corner, and known as well. The
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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from xfrustum.reference.devices.arithmetic import Arithmetic, Table
from xfrustum.reference.lines.cone import UNIT_ROUNDOFF
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats

LIMIT_PER_SIDE = 2
"""Largest column and row of a corner, in units of the film's longer side, of a triangle that is compared by
places on the film. Others hide, as far as is known, whatever they share cells with."""

INSIDE = 4.0
"""Smallest edge functions of points that are well inside, in units of `looseness`."""

SHARE = 2.0**-10
"""Smallest edge functions of points that are well inside, in units of twice the area of their triangle."""

AWAY = 2.0**13
"""Edge function, in units of `looseness`, of a corner that is well outside an edge."""

BEHIND = 2.0**-48
"""Share of s by which a triangle that is behind another one must be farther: some roundings of doubles."""

TOLERANCE_SHARE = 0.49
"""Share of its tolerance by which a point may seem to be farther than its triangle, in units of the length of
the lines for a step of s: only what is met by more than half of the tolerance before a point hides it."""

COLUMNS = 8
"""Numbers for each triangle: two edge functions, as factors of column, row and 1, less what a point well
inside must reach. Behind the first, the largest s; behind the second, what both together may reach."""


def limit(pencil: Pencil) -> float:
    """Return the largest column and row of a corner that is compared, and of a point that is asked about."""
    return float(LIMIT_PER_SIDE * max(pencil.resolution))


def place_error(pencil: Pencil) -> float:
    """Return a bound in pixels on the rounding of a place within the limit.

    A slope has a relative error of 3 u; the shear is subtracted, and pixels are counted, with some more
    roundings of what is at most W (|k| / t + 2) + limit. The bound is twice the result.
    """
    sides = zip(pencil.resolution, pencil.shear, pencil.half_extent, strict=True)
    return max(
        16 * UNIT_ROUNDOFF * (pixels * (abs(shear) / half + 2) + limit(pencil))
        for pixels, shear, half in sides
    )


def looseness(pencil: Pencil) -> float:
    """Return twice the bound on the rounding of an edge function, in square pixels."""
    # Columns and rows lie between -limit and limit.
    distance = 2 * np.sqrt(2) * limit(pencil)
    return float(16 * place_error(pencil) * distance)


def largest_length(pencil: Pencil) -> float:
    """Return a bound on the length of a line for a step of s, at places within the limit."""
    slopes = [
        abs(shear) + half * (1 + 2 * limit(pencil) / pixels)
        for pixels, shear, half in zip(pencil.resolution, pencil.shear, pencil.half_extent, strict=True)
    ]
    return float(np.sqrt(1 + slopes[0] ** 2 + slopes[1] ** 2))


@dataclass(frozen=True, kw_only=True, eq=False)
class ClearTriangles:
    """Triangles of a scene that nothing hides, as the lines of a pencil see them.

    Attributes
    ----------
    pencil
        The lines.
    table
        (F, `COLUMNS`) numbers of each triangle. Those of triangles that may be hidden say that no point is
        well inside.
    """

    pencil: Pencil
    table: Floats
    _tables: dict[Arithmetic, Table] = field(default_factory=dict, init=False, repr=False)

    def seen(self, by: Arithmetic) -> Callable[[Any, Sequence[Any], Any, Any], Any]:
        """Return the formula that says which points are surely hidden by nothing.

        Its arguments are the number of the triangle on which each point lies, column and row of the point,
        its s, and the distance within which it is known.
        """
        if by not in self._tables:
            self._tables[by] = by.table(self.table)
        look_up = self._tables[by]
        farther, most = by.constants((TOLERANCE_SHARE / largest_length(self.pencil), limit(self.pencil)))

        def formula(triangle: Any, place: Sequence[Any], s: Any, tolerance: Any) -> Any:
            numbers = look_up(triangle)
            seen = s - tolerance * farther <= numbers[3]
            # The bounds of rounding hold within the limit, beyond which there is nothing of clear triangles.
            seen = seen & (abs(place[0]) <= most) & (abs(place[1]) <= most)
            left_over = numbers[7]
            for first in (0, 4):
                a, b, c = numbers[first : first + 3]
                edge = a * place[0] + b * place[1] + c
                seen, left_over = seen & (edge >= 0), left_over - edge
            return seen & (left_over >= 0)

        return formula
