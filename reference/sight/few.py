"""The search for what may hide few points, on NumPy: it looks only at what reaches into their coarse cells.

The other searches pass over all boxes of cells, however few points are asked about.
"""

from __future__ import annotations

import numpy as np

from xfrustum.reference.devices.arithmetic import NUMPY
from xfrustum.reference.sight.boxes import CellBoxes
from xfrustum.reference.sight.clear import BEHIND
from xfrustum.reference.sight.coarse import SIDE, CoarseCells
from xfrustum.reference.sight.walk import Before, PointLines, Surfaces, film_numbers, meeting
from xfrustum.scenes.arrays import Floats, Indices, Numbers

MAX_FEW_POINTS = 1 << 9
"""Largest number of points that are searched so: some hundred triangles reach into the coarse cell of each,
and with more points, kernels are faster."""

MAX_CANDIDATES = 1 << 15
"""Largest number of pairs of a point and a box in its coarse cell. This bounds the time, to about that of the
other searches, and the memory, where triangles crowd in few cells."""

NONE_BEFORE = Before(
    point=np.zeros(0, dtype=np.int64), triangle=np.zeros(0, dtype=np.int64), sure=np.zeros(0, dtype=np.bool_)
)
"""Answer where nothing is met, as before most points."""


def before_few(
    triangles: Floats,
    boxes: CellBoxes,
    coarse: CoarseCells,
    points: tuple[Floats, Numbers, Floats],
) -> Before | None:
    """Return what the lines through few points meet, or may meet, before them.

    None where there are too many points, or too many triangles near them.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners of all triangles.
    boxes
        Boxes of cells of the triangles.
    coarse
        The same boxes by coarse cells.
    points
        Positions, own triangles and tolerances as `JitSearch.before` takes them.
    """
    position, own, tolerance = points
    if len(position) > MAX_FEW_POINTS:
        return None
    pencil = boxes.pencil
    (width, height), center = pencil.resolution, pencil.center
    with np.errstate(over="ignore", invalid="ignore"):
        lines = PointLines.of((*position.T, tolerance), film_numbers(pencil), np.sqrt)
        column = np.rint(np.clip(lines.column, -1, width)).astype(np.int32) + 1
        row = np.rint(np.clip(lines.row, -1, height)).astype(np.int32) + 1
        pairs = _candidates(coarse, (row // SIDE) * coarse.stride + column // SIDE)
        if pairs is None:
            return None
        point, box = pairs
        left, right, top, bottom = boxes.box.take(box, axis=1)
        x, y, number = column[point], row[point], boxes.number[box]
        shared = (left <= x) & (x <= right) & (top <= y) & (y <= bottom)
        some = np.flatnonzero(shared & (number != own[point]))
        point, box, number = point[some], box[some], number[some]
        corners = triangles.take(number, axis=0)
        # A triangle all of which lies behind a point's end hides nothing of it.
        nearest, end = center[2] - corners[:, :, 2].max(axis=1), lines.end[point]
        some = np.flatnonzero(nearest <= end + BEHIND * (np.abs(nearest) + np.abs(end)))
        if not some.size:
            return NONE_BEFORE
        point, box, number = point[some], box[some], number[some]
        surfaces = Surfaces.of(
            list(np.ascontiguousarray(corners[some].transpose(1, 2, 0))), center, boxes.holds[box], NUMPY
        )
        ends = pencil.s_range[0], end[some]
        possible, sure = meeting(surfaces, lines.dx[point], lines.dy[point], ends, NUMPY)
    kept = np.flatnonzero(possible)
    return Before(point=point[kept], triangle=number[kept].astype(np.int64), sure=sure[kept])


def _candidates(coarse: CoarseCells, cell: Numbers) -> tuple[Indices, Numbers] | None:
    """Return pairs of a point and a box that reaches into its coarse cell, as two arrays of numbers.

    None where there are more than `MAX_CANDIDATES`.
    """
    first = coarse.start[cell]
    count = coarse.start[cell + 1] - first
    ends = np.cumsum(count)
    if ends[-1] > MAX_CANDIDATES:
        return None
    point = np.repeat(np.arange(len(cell)), count)
    return point, coarse.item[np.arange(len(point)) + (first - (ends - count))[point]]
