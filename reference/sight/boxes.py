"""Triangles as boxes of cells on the film: what shares no cell with a point cannot hide it.

A cell is a pixel of the film with the half pixel about its center; the cells of a border about the film hold
all that lies beside it. A triangle's box holds every cell in which a line may meet it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.certify.footprints import pixel_slack, slope_range
from xfrustum.reference.certify.sides import Side, sorted_by_side
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers

HALF_CELL = 0.5
"""Distance, in pixels, of a cell's sides from its center."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CellBoxes:
    """Boxes of cells that triangles reach into.

    Attributes
    ----------
    pencil
        Lines of the film.
    number
        (T,) triangle numbers; a triangle on both sides of the center's height has two boxes.
    holds
        (T,) whether the triangle holds the pencil's center, where all lines meet it.
    box
        (4, T) first and last column, first and last row, counted from those of the border.
    """

    pencil: Pencil
    number: Numbers
    holds: Mask
    box: Numbers


def cells(pencil: Pencil) -> int:
    """Return the number of the cells of a film with their border."""
    width, height = pencil.resolution
    return (width + 2) * (height + 2)


def cell_boxes(triangles: Floats, pencil: Pencil) -> CellBoxes:
    """Return the cells in which a pencil's lines may meet triangles (F, 3, 3), from its first s on."""
    # What lies beyond the range is not imaged, but where a picture shows it, it may be hidden, and hide.
    endless = replace(pencil, s_range=(pencil.s_range[0], np.inf))
    exact = ExactPencil(triangles, pencil)
    width, height = pencil.resolution
    numbers: list[Indices] = [np.zeros(0, dtype=np.int64)]
    boxes: list[Numbers] = [np.zeros((4, 0), dtype=np.int32)]
    holding: list[int] = []
    for chunk in sorted_by_side(triangles, endless):
        touching = chunk.touching(*pencil.center[:2])
        for side in (every.without(touching) for every in chunk.sides):
            numbers.append(side.number)
            boxes.append(_cell_box(side, pencil))
        # The others may hold the center, and may then be met by every line. A triangle whose plane runs
        # through the center beside the triangle is met by none, and neither is one without area.
        met = [n for n in touching.tolist() if exact.meets_beside_center(n) or exact.contains_center(n)]
        whole = np.array(met, dtype=np.int64)
        numbers.append(whole)
        boxes.append(np.tile(np.array([[0], [width + 1], [0], [height + 1]], dtype=np.int32), len(whole)))
        holding.extend(n for n in whole.tolist() if exact.contains_center(n))
    number = np.concatenate(numbers).astype(np.int32)
    return CellBoxes(
        pencil=pencil,
        number=number,
        holds=np.isin(number, holding) if holding else np.zeros(len(number), dtype=np.bool_),
        box=np.concatenate(boxes, axis=1),
    )


def _cell_box(side: Side, pencil: Pencil) -> Numbers:
    """Return first and last column, first and last row (4, T) of the cells of triangles, border included."""
    bounds = np.empty((4, len(side.number)), dtype=np.int32)
    for axis, corners in enumerate((side.x, side.y)):
        pixels = pencil.resolution[axis]
        low, high = slope_range(corners - pencil.center[axis], side.s, side.sign)
        scale = pixels / (2 * pencil.half_extent[axis]) * (1 if axis == 0 else -1)
        ends = [(slope - pencil.shear[axis]) * scale + (pixels - 1) / 2 for slope in (low, high)]
        first, last = ends if axis == 0 else ends[::-1]
        # The rounding of the triangle's place on the film, and that of the point's.
        margin = HALF_CELL + 2 * pixel_slack(pencil, axis)
        bounds[2 * axis] = np.ceil(np.clip(first - margin, -1, pixels)) + 1
        bounds[2 * axis + 1] = np.floor(np.clip(last + margin, -1, pixels)) + 1
    return bounds
