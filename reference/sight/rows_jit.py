"""Rows of the boxes of triangles as Dr.Jit arrays: one lane for each walks what lies in its cells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from xfrustum.reference.devices.arithmetic_jit import Bool, UInt32, on_device
from xfrustum.reference.sight.boxes import CellBoxes


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """The rows of the boxes of triangles, whatever points are asked about.

    Attributes
    ----------
    box
        Box of each row.
    begin, end
        First cell of each row, and the one behind its last.
    number, holds
        As in the boxes, for each box.
    """

    box: Any
    begin: Any
    end: Any
    number: Any
    holds: Any


def rows_of_boxes(boxes: CellBoxes) -> Rows:
    """Return the rows of all boxes."""
    heights = boxes.box[3] - boxes.box[2] + 1
    before = np.cumsum(heights, dtype=np.int64) - heights
    rows = int(heights.sum())
    # The box of each row: boxes are counted at their first rows.
    begins = dr.zeros(UInt32, rows)
    dr.scatter(begins, dr.opaque(UInt32, 1), on_device(before.astype(np.uint32)))
    dr.eval(begins)
    box = dr.prefix_sum(begins) + begins - 1
    left, right, top, base = (
        dr.gather(UInt32, on_device(values.astype(np.uint32)), box) for values in (*boxes.box[:3], before)
    )
    stride: Any = dr.opaque(UInt32, boxes.pencil.resolution[0] + 2)
    cell: Any = (dr.arange(UInt32, rows) - base + top) * stride
    made = Rows(
        box=box,
        begin=cell + left,
        end=cell + right + 1,
        number=on_device(boxes.number.astype(np.uint32)),
        holds=on_device(boxes.holds),
    )
    dr.eval(made.box, made.begin, made.end)
    return made


def row_count(rows: Rows) -> int:
    """Return the number of rows."""
    return int(dr.width(rows.box))


def lanes_with_items(rows: Rows, start: Any) -> tuple[Any, ...]:
    """Return the rows of boxes that have lines.

    Returns
    -------
    The first line of each row, the one behind its last, the triangle, and whether this holds the center.
    """
    first, last = dr.gather(UInt32, start, rows.begin), dr.gather(UInt32, start, rows.end)
    dr.eval(first, last)
    # Rows without lines would idle beside those that walk.
    lane: Any = dr.compress(first < last)
    at = dr.gather(UInt32, rows.box, lane)
    return (
        dr.gather(UInt32, first, lane),
        dr.gather(UInt32, last, lane),
        dr.gather(UInt32, rows.number, at),
        dr.gather(Bool, rows.holds, at),
    )
