"""The search for what may hide points on NumPy, where there is no LLVM for Dr.Jit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from xfrustum.reference.devices.arithmetic import NUMPY
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.sight.boxes import CellBoxes, cells
from xfrustum.reference.sight.clear import ClearTriangles
from xfrustum.reference.sight.coarse import CoarseCells
from xfrustum.reference.sight.walk import Before, PointLines, Surfaces, film_numbers, meeting
from xfrustum.scenes.arrays import Floats, Mask, Numbers

PAIRS_PER_CHUNK = 1 << 17
"""Pairs that are evaluated at once. This bounds the memory, about 500 bytes for each."""


class NumpySearch:
    """The triangles of a scene, searched on NumPy; see `JitSearch`.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners.
    """

    def __init__(self, triangles: Floats) -> None:
        self._triangles = triangles

    def clear(self, coarse: CoarseCells, pencil: Pencil, asked: Mask) -> ClearTriangles | None:
        """Return None: this would take NumPy longer than it saves."""
        return None

    def before(self, boxes: CellBoxes, position: Floats, own: Numbers, tolerance: Floats) -> Iterator[Before]:
        """Yield what the lines through points meet, or may meet, before them; see `JitSearch.before`."""
        lines = PointLines.of((*position.T, tolerance), film_numbers(boxes.pencil), np.sqrt)
        (width, height), center = boxes.pencil.resolution, boxes.pencil.center
        column, row = np.rint(np.clip(lines.column, -1, width)), np.rint(np.clip(lines.row, -1, height))
        cell = (row.astype(np.int64) + 1) * (width + 2) + column.astype(np.int64) + 1
        order = np.argsort(cell, kind="stable")
        start = np.concatenate(([0], np.cumsum(np.bincount(cell, minlength=cells(boxes.pencil)))))
        # One entry for each row of each box.
        left, right, top, bottom = boxes.box.astype(np.int64)
        heights = bottom - top + 1
        box = np.repeat(np.arange(len(top)), heights)
        base = (np.arange(len(box)) + np.repeat(top - (np.cumsum(heights) - heights), heights)) * (width + 2)
        first, last = start[base + left[box]], start[base + right[box] + 1]
        some = np.flatnonzero(first < last)
        ends = np.cumsum((last - first)[some])
        done = 0
        while done < len(some):
            before = ends[done - 1] if done else 0
            stop = max(done + 1, int(np.searchsorted(ends, before + PAIRS_PER_CHUNK)))
            part, done = some[done:stop], stop
            length = (last - first)[part]
            at = np.repeat(part, length)
            point = order[np.arange(len(at)) + np.repeat(first[part] - (np.cumsum(length) - length), length)]
            number = boxes.number[box[at]]
            corners = [tuple(corner.T) for corner in self._triangles[number].transpose(1, 0, 2)]
            reached = (boxes.pencil.s_range[0], lines.end[point])
            with np.errstate(over="ignore", invalid="ignore"):
                possible, sure = meeting(
                    Surfaces.of(corners, center, boxes.holds[box[at]], NUMPY),
                    lines.dx[point],
                    lines.dy[point],
                    reached,
                    NUMPY,
                )
            kept = np.flatnonzero(possible & (number != own[point]))
            yield Before(point=point[kept], triangle=number[kept].astype(np.int64), sure=sure[kept])
