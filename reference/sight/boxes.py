"""Triangles as boxes of cells on the film, and the points that are asked about, sorted by cell.

A cell is a pixel of the film and the half pixel about its center; points beside the film belong to the cells
of a border about it. A triangle's box holds every cell in which a line may meet it: what a point shares no
cell with cannot hide it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.certify.footprints import pixel_slack, slope_range
from xfrustum.reference.certify.sides import Side, sorted_by_side
from xfrustum.reference.lines.cone import Cones, cones, s_bounds
from xfrustum.reference.lines.lines import Pencil, places_off_center
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers

HALF_CELL = 0.5
"""Distance, in pixels, of a cell's sides from its center."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Queries:
    """The lines through points that are asked about, sorted by their cells.

    Attributes
    ----------
    order
        (N,) number of the point of each entry.
    dx, dy
        (N,) slopes of the line center + s (dx, dy, -1) through each point. These doubles define the line.
    end
        (N,) place on the line before which a surface hides the point.
    own
        (N,) number of the triangle that each point lies on.
    start
        ((H + 2) (W + 2) + 1,) first entry of each cell, row by row, with a border of one cell.
    pencil
        Lines of the film.
    """

    order: Indices
    dx: Floats
    dy: Floats
    end: Floats
    own: Numbers
    start: Numbers
    pencil: Pencil

    @classmethod
    def of(cls, position: Floats, own: Numbers, tolerance: Floats, pencil: Pencil) -> Queries:
        """Return the lines through points (N, 3); a point is known to within its tolerance."""
        x, y, z = position.T
        (width, height), center = pencil.resolution, pencil.center
        s = center[2] - z
        dx, dy = (x - center[0]) / s, (y - center[1]) / s
        # What is met nearer than half a tolerance before the point is the point's own surface.
        end = s - tolerance / (2 * np.sqrt(dx * dx + dy * dy + 1.0))
        cell = np.zeros(len(s), dtype=np.int32)
        for place, side, stride in zip(
            places_off_center(x, y, z, pencil)[::-1], (height, width), (width + 2, 1), strict=True
        ):
            np.clip(place, -1, side, out=place)
            np.rint(place, out=place)
            cell += (place.astype(np.int32) + 1) * np.int32(stride)
        order = np.argsort(cell, kind="stable")
        count = np.bincount(cell, minlength=(width + 2) * (height + 2))
        return cls(
            order=order,
            dx=dx[order],
            dy=dy[order],
            end=end[order],
            own=own[order],
            start=np.concatenate(([0], np.cumsum(count))).astype(np.int32),
            pencil=pencil,
        )

    def latest(self) -> Floats:
        """Return the largest end of the points in each row of cells, (H + 2,); minus infinity without points."""
        width, height = self.pencil.resolution
        first = self.start[:: width + 2]
        found = np.full(height + 2, -np.inf)
        some = np.flatnonzero(np.diff(first))
        if len(some):
            found[some] = np.maximum.reduceat(self.end, first[some])
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Lanes:
    """Rows of cells that triangles reach into and that have points, one entry for each row of a triangle.

    Attributes
    ----------
    cones
        The triangles.
    cone
        (L,) triangle of each row, as an index into `cones`.
    first, last
        (L,) first entry of `Queries` in these cells, and the one behind the last.
    """

    cones: Cones
    cone: Indices
    first: Numbers
    last: Numbers


def lanes(triangles: Floats, queries: Queries) -> list[Lanes]:
    """Return the rows of cells in which triangles (F, 3, 3) may lie before points, chunk by chunk."""
    pencil = queries.pencil
    # Surfaces beyond the last point hide nothing, and those beyond the range may hide what is there, too.
    until = max(pencil.s_range[1], float(queries.end.max(initial=-np.inf)))
    asked = replace(pencil, s_range=(pencil.s_range[0], until))
    exact = ExactPencil(triangles, pencil)
    latest, found = queries.latest(), []
    for chunk in sorted_by_side(triangles, asked):
        touching = chunk.touching(*pencil.center[:2])
        for side in (every.without(touching) for every in chunk.sides):
            box, nearest = _cell_box(side, pencil), s_bounds(-side.s, pencil)[0]
            found.append(_lanes(triangles, side.number, box, nearest, None, queries, latest))
        numbers = np.array([n for n in touching.tolist() if exact.has_area(n)], dtype=np.int64)
        holds = np.array([exact.contains_center(n) for n in numbers.tolist()], dtype=np.bool_)
        width, height = pencil.resolution
        whole = np.tile([[0], [width + 1], [0], [height + 1]], len(numbers))
        nearest = np.full(len(numbers), -np.inf)
        found.append(_lanes(triangles, numbers, whole, nearest, holds, queries, latest))
    return [some for some in found if len(some.cone)]


def _cell_box(side: Side, pencil: Pencil) -> Numbers:
    """Return first and last column, first and last row (4, T) of the cells of triangles, border included."""
    bounds = []
    for axis, corners in enumerate((side.x, side.y)):
        pixels = pencil.resolution[axis]
        low, high = slope_range(corners - pencil.center[axis], side.s, side.sign)
        scale = pixels / (2 * pencil.half_extent[axis]) * (1 if axis == 0 else -1)
        ends = [(slope - pencil.shear[axis]) * scale + (pixels - 1) / 2 for slope in (low, high)]
        first, last = ends if axis == 0 else ends[::-1]
        # The rounding of the triangle's place on the film, and that of the point's.
        margin = HALF_CELL + 2 * pixel_slack(pencil, axis)
        bounds.append(np.ceil(np.clip(first - margin, -1, pixels)) + 1)
        bounds.append(np.floor(np.clip(last + margin, -1, pixels)) + 1)
    return np.stack(bounds).astype(np.int32)


def _lanes(
    triangles: Floats,
    number: Indices,
    box: Numbers,
    nearest: Floats,
    holds: Mask | None,
    queries: Queries,
    latest: Floats,
) -> Lanes:
    """Return the rows of some triangles' boxes in which points lie behind the triangle's nearest corner."""
    stride = queries.pencil.resolution[0] + 2
    heights = (box[3] - box[2] + 1).astype(np.int64)
    entry = np.repeat(np.arange(len(number)), heights)
    row = np.arange(len(entry)) + np.repeat(box[2] - (np.cumsum(heights) - heights), heights)
    base = row * stride
    first, last = queries.start[base + box[0, entry]], queries.start[base + box[1, entry] + 1]
    kept = np.flatnonzero((first < last) & (nearest[entry] < latest[row]))
    # Only triangles that have such a row are set up.
    asked = np.zeros(len(number), dtype=np.bool_)
    asked[entry[kept]] = True
    some = np.flatnonzero(asked)
    return Lanes(
        cones=cones(triangles, number[some], queries.pencil, None if holds is None else holds[some]),
        cone=(np.cumsum(asked) - 1)[entry[kept]],
        first=first[kept],
        last=last[kept],
    )
