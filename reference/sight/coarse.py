"""Coarse cells of the film, and the triangles that reach into each: found once for a pencil.

The boxes of cells say which cells a triangle reaches into. Here the same is known the other way round, for
cells of some pixels each: to those who ask about few triangles or few points, nothing else need be looked at.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from xfrustum.reference.sight.boxes import CellBoxes
from xfrustum.scenes.arrays import Numbers

SIDE = 8
"""Sides of a coarse cell, in cells. Triangles of some ten pixels share few of these, and few share none."""

MAX_ITEMS = 1 << 23
"""Largest number of coarse cells of all triangles together, in some 40 bytes each while they are sorted."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CoarseCells:
    """Boxes of cells of triangles, sorted by the coarse cells that they reach into.

    Attributes
    ----------
    boxes
        Boxes in coarse cells; the resolution of their pencil is that of a film of coarse cells.
    start
        First item of each coarse cell, and the one behind the last of all.
    item
        Numbers of the boxes in each coarse cell, one cell after another.
    """

    boxes: CellBoxes
    start: Numbers
    item: Numbers

    @property
    def stride(self) -> int:
        """Number of the coarse cells in a row, border included."""
        return self.boxes.pencil.resolution[0] + 2


def coarse_cells(boxes: CellBoxes) -> CoarseCells | None:
    """Return the boxes sorted by coarse cells; None where triangles reach into too many cells together."""
    width, height = ((side + 1) // SIDE + 1 for side in boxes.pencil.resolution)
    pencil = replace(boxes.pencil, resolution=(width, height))
    coarse = replace(boxes, pencil=pencil, box=boxes.box // SIDE)
    left, right, top, bottom = coarse.box
    wide = right - left + 1
    count = wide.astype(np.int64) * (bottom - top + 1)
    ends = np.cumsum(count)
    if len(ends) and ends[-1] > MAX_ITEMS:
        return None
    box = np.repeat(np.arange(len(count), dtype=np.int32), count)
    within = np.arange(len(box), dtype=np.int32) - (ends - count).astype(np.int32)[box]
    down, across = np.divmod(within, wide[box])
    cells = (width + 2) * (height + 2)
    cell = (top[box] + down) * (width + 2) + left[box] + across
    # NumPy sorts whole numbers of 16 bits several times faster than longer ones.
    order = np.argsort(cell.astype(np.uint16 if cells < 1 << 16 else np.uint32), kind="stable")
    start = np.concatenate(([0], np.cumsum(np.bincount(cell, minlength=cells))))
    return CoarseCells(boxes=coarse, start=start.astype(np.int32), item=box[order])
