"""Cells of a film: one about each pixel's center, with a border for all that lies beside it.

A triangle's box of cells holds every cell in which a line may meet it, so that what shares no cell with a
point cannot hide it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from xfrustum.reference.backend import Bool, Int32, UInt32, constants, dr
from xfrustum.reference.certify.boxes import bounding_boxes
from xfrustum.reference.certify.cone import Triangles
from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.lines.lines import Pencil

HALF_CELL = 0.5
"""Distance, in pixels, of a cell's sides from its center."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """Rows of cells that triangles reach into, one lane each.

    Attributes
    ----------
    first, behind
        First cell, and the one behind the last.
    number
        Triangle number.
    holds
        Whether the triangle holds the pencil's center, where all lines meet it; None where none does.
    """

    first: Any
    behind: Any
    number: Any
    holds: Any

    def walk(self, visit: Callable[[Any], object]) -> None:
        """Visit every cell of every lane."""

        def step(cell: Any) -> tuple[Any]:
            visit(cell)
            return (cell + 1,)

        dr.while_loop((UInt32(self.first),), lambda cell: cell < self.behind, step)


def rows_of_cells(triangles: Triangles, pencil: Pencil) -> list[Rows]:
    """Return the cells in which a pencil's lines may meet triangles, from its first s on."""
    # What lies beyond the range is not imaged, but where a picture shows it, it may be hidden, and hide.
    endless = replace(pencil, s_range=(pencil.s_range[0], math.inf))
    exact = ExactPencil(triangles.corners, pencil)
    width, height = (side + 2 for side in pencil.resolution)
    found = []
    for boxes in bounding_boxes(triangles, endless, exact, HALF_CELL, 1):
        reaching = boxes.rows(range(height))
        if reaching is None:
            continue
        box, row = reaching
        number = dr.gather(UInt32, boxes.number, box)
        left, right = (dr.gather(Int32, boxes.box[k], box) for k in (0, 1))
        start = UInt32(row) * dr.opaque(UInt32, width)
        rows = Rows(
            first=start + UInt32(left),
            behind=start + UInt32(right) + 1,
            number=number,
            holds=None if boxes.holds is None else dr.gather(Bool, boxes.holds, box),
        )
        dr.eval(rows.first, rows.behind, rows.number, rows.holds)
        found.append(rows)
    return found


def triangles_of_cells(pencil: Pencil, rows: Sequence[Rows], most: int) -> tuple[Any, Any] | None:
    """Return the numbers of the triangles in each cell of a film, cell by cell, and where each cell begins.

    Returns
    -------
    The first item of each cell, and the one behind the last; and the items. None where there are more than
    `most`.
    """
    width, height = (side + 2 for side in pencil.resolution)
    count: Any = dr.zeros(UInt32, width * height + 1)
    dr.make_opaque(count)
    for some in rows:
        some.walk(lambda cell: dr.scatter_inc(count, cell))
        dr.eval(count)
    start: Any = dr.prefix_sum(count)
    dr.eval(start)
    if int(start[-1]) > most:
        return None
    free, items = dr.copy(start), dr.empty(UInt32, int(start[-1]))
    for some in rows:

        def note(cell: Any, number: Any = some.number) -> None:
            dr.scatter(items, number, dr.scatter_inc(free, cell))

        some.walk(note)
        dr.eval(items)
    return start, items


def film_places(pencil: Pencil, points: Sequence[Any]) -> tuple[Any, tuple[Any, Any], tuple[Any, Any]]:
    """Return s of points (x, y, z), the slopes dx and dy of their lines, and their columns and rows."""
    center = constants(pencil.center)
    s = center[2] - points[2]
    slopes, places = [], []
    for axis, sign in enumerate((1, -1)):
        pixels = pencil.resolution[axis]
        scale = sign * pixels / (2 * pencil.half_extent[axis])
        shear, scale, middle = constants((pencil.shear[axis], scale, (pixels - 1) / 2))
        slopes.append((points[axis] - center[axis]) / s)
        places.append((slopes[axis] - shear) * scale + middle)
    return s, (slopes[0], slopes[1]), (places[0], places[1])
