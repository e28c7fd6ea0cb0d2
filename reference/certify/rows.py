"""The rows of pixels that triangles' boxes on the film reach into."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.certify.footprints import Footprints
from xfrustum.reference.certify.sides import TRIANGLES_PER_CHUNK
from xfrustum.reference.devices.arithmetic import NUMPY
from xfrustum.reference.lines.cone import Cones, Planes, Viewpoint
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers

ROWS_PER_CHUNK = 1 << 20
"""Rows of triangles that are cut by edges at once. This bounds the memory, some 200 bytes for each row."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """Rows of pixels that triangles' boxes on the film reach into, before they are cut by edges.

    Attributes
    ----------
    corners
        (T, 3, 3) corners of the triangles, in scene units.
    number
        (T,) triangle numbers.
    holds_center
        (T,) whether the center lies exactly in the closed triangle: then every line meets it at s = 0.
    columns
        (2, T) first and last column of each triangle's box, inclusive.
    cone
        (S,) the triangle of each row, as an index into the above.
    row
        (S,) row of the image.
    orientation
        (S,) the sign of the edge functions inside the triangle; 0 where the triangle's box in space
        contains the center, so that edges cannot cut the row.
    """

    corners: Floats
    number: Indices
    holds_center: Mask
    columns: Numbers
    cone: Indices
    row: Indices
    orientation: NDArray[np.int8]

    def cones(self, pencil: Pencil, some: Indices | slice = slice(None)) -> Cones:
        """Return some of the triangles as cones about a pencil's center, in NumPy."""
        points = list(np.ascontiguousarray(self.corners[some].transpose(1, 2, 0)))
        return Cones.of(NUMPY, points, Viewpoint.of(pencil, NUMPY), self.holds_center[some])


def boxed_rows(triangles: Floats, pencil: Pencil, found: Footprints, rows: range) -> Iterator[Rows]:
    """Yield the rows of pixels that triangles may cover in some rows of the image, in bounded chunks."""
    top, bottom = np.maximum(found.box[2], rows.start), np.minimum(found.box[3], rows.stop - 1)
    here = np.flatnonzero(top <= bottom)
    until = np.cumsum((bottom - top + 1)[here])
    start = 0
    while start < len(here):
        before = until[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(until, before + ROWS_PER_CHUNK, side="right")))
        some = here[start : min(stop, start + TRIANGLES_PER_CHUNK)]
        start += len(some)
        yield _rows_of(found, some, top[some], bottom[some], (triangles[found.number[some]], pencil))


def _rows_of(
    found: Footprints, some: Indices, top: Numbers, bottom: Numbers, seen: tuple[Floats, Pencil]
) -> Rows:
    """Return the rows of some triangles, given with their corners, from the top to the bottom of each."""
    corners, pencil = seen
    side, holds = found.side[some], found.holds_center[some]
    points = list(np.ascontiguousarray(corners.transpose(1, 2, 0)))
    of = Planes.of(NUMPY, points, pencil.center, holds)
    # Where the plane passes so near the center that its side is in doubt, both orientations are tried.
    in_doubt = (np.abs(of.plane) <= of.plane_bound) & (side != 0)
    entry = np.concatenate((np.arange(len(side)), np.flatnonzero(in_doubt)))
    orientation = np.where(of.plane < 0, -side, side)
    orientation = np.concatenate((orientation, -orientation[in_doubt]))
    # One entry for each row from top to bottom of each box.
    heights = (bottom - top + 1)[entry].astype(np.int64)
    before = np.cumsum(heights) - heights
    return Rows(
        corners=corners,
        number=found.number[some],
        holds_center=holds,
        columns=found.box[:2, some],
        cone=np.repeat(entry, heights),
        row=np.arange(heights.sum()) + np.repeat(top[entry] - before, heights),
        orientation=np.repeat(orientation, heights),
    )
