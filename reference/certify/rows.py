"""The rows of pixels that triangles' boxes on the film reach into."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.certify.footprints import Footprints
from xfrustum.reference.certify.sides import TRIANGLES_PER_CHUNK
from xfrustum.reference.devices.arithmetic import NUMPY
from xfrustum.reference.lines.cone import Cones, Planes, Viewpoint
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers

if TYPE_CHECKING:
    from xfrustum.reference.lines.corners_jit import CornerTable

ROWS_PER_CHUNK = 1 << 20
"""Rows of triangles that are cut by edges at once. This bounds the memory, some 200 bytes for each row."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """Rows of pixels that triangles' boxes on the film reach into, before they are cut by edges.

    A triangle has an entry with its rows from top to bottom, and two where its turn is in doubt.

    Attributes
    ----------
    triangles
        (F, 3, 3) corners of the scene's triangles, in scene units.
    table
        The same on the device; None where they are not there.
    number
        (T,) triangle numbers.
    holds_center
        (T,) whether the center lies exactly in the closed triangle: then every line meets it at s = 0.
    columns
        (2, T) first and last column of each triangle's box, inclusive.
    entry
        (E,) the triangle of each entry, as an index into the above.
    turn
        (E,) the sign of the edge functions inside the triangle; 0 where the triangle's box in space
        contains the center, so that edges cannot cut the row.
    top, heights
        (E,) first row of the image, and number of rows.
    """

    triangles: Floats
    table: CornerTable | None
    number: Indices
    holds_center: Mask
    columns: Numbers
    entry: Indices
    turn: NDArray[np.int8]
    top: Numbers
    heights: Numbers

    @cached_property
    def corners(self) -> Floats:
        """(T, 3, 3) corners of the triangles."""
        return np.asarray(self.triangles[self.number])

    @cached_property
    def entry_of_row(self) -> Numbers:
        """(S,) int32 the entry of each row."""
        return np.repeat(np.arange(len(self.entry), dtype=np.int32), self.heights)

    @cached_property
    def row_offset(self) -> Numbers:
        """(E,) row of the image minus place among all rows, which is the same for all rows of an entry."""
        return np.asarray(self.top - (np.cumsum(self.heights) - self.heights))

    @property
    def cone(self) -> Indices:
        """(S,) the triangle of each row, as an index into the triangles."""
        return np.asarray(self.entry[self.entry_of_row])

    @property
    def row(self) -> Indices:
        """(S,) row of the image."""
        return np.arange(len(self.entry_of_row)) + self.row_offset[self.entry_of_row]

    @property
    def orientation(self) -> NDArray[np.int8]:
        """(S,) turn of each row's triangle."""
        return np.asarray(self.turn[self.entry_of_row])

    def cones(self, pencil: Pencil, some: Indices | slice = slice(None)) -> Cones:
        """Return some of the triangles as cones about a pencil's center, in NumPy."""
        points = list(np.ascontiguousarray(self.corners[some].transpose(1, 2, 0)))
        return Cones.of(NUMPY, points, Viewpoint.of(pencil, NUMPY), self.holds_center[some])


def boxed_rows(
    triangles: Floats, pencil: Pencil, found: Footprints, rows: range, table: CornerTable | None = None
) -> Iterator[Rows]:
    """Yield the rows of pixels that triangles may cover in some rows of the image, in bounded chunks.

    Parameters
    ----------
    triangles, table
        (F, 3, 3) corners of the scene's triangles, and the same on the device; None where they are not there.
    pencil, found
        Lines of the image, and the boxes of the triangles on its film.
    rows
        Rows of the image.
    """
    top, bottom = np.maximum(found.box[2], rows.start), np.minimum(found.box[3], rows.stop - 1)
    here = np.flatnonzero(top <= bottom)
    until = np.cumsum((bottom - top + 1)[here], dtype=np.int64)
    # Where turns are known, nothing is computed for the triangles of a chunk.
    most = TRIANGLES_PER_CHUNK if found.turned is None else len(here)
    start = 0
    while start < len(here):
        before = until[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(until, before + ROWS_PER_CHUNK, side="right")))
        stop = min(stop, start + most)
        # Where all triangles reach into these rows, as into a whole image, nothing need be copied.
        some = slice(start, stop) if len(here) == len(top) else here[start:stop]
        start = stop
        entry, turn = _entries(triangles, pencil, found, some)
        first = top[some]
        yield Rows(
            triangles=triangles,
            table=table,
            number=found.number[some],
            holds_center=found.holds_center[some],
            columns=found.box[:2, some],
            entry=entry,
            turn=turn,
            top=first[entry],
            heights=(bottom[some] - first + 1)[entry],
        )


def _entries(
    triangles: Floats, pencil: Pencil, found: Footprints, some: Indices | slice
) -> tuple[Indices, NDArray[np.int8]]:
    """Return the triangle of each entry, as an index into some triangles, and its turn.

    Where a plane passes so near the center that its side is in doubt, both turns are tried.
    """
    if found.turned is None:
        side = found.side[some]
        points = list(np.ascontiguousarray(triangles[found.number[some]].transpose(1, 2, 0)))
        of = Planes.of(NUMPY, points, pencil.center, found.holds_center[some])
        in_doubt = (np.abs(of.plane) <= of.plane_bound) & (side != 0)
        turn = np.where(of.plane < 0, -side, side)
    else:
        turn = np.sign(found.turned[some])
        in_doubt = found.turned[some] != turn
    doubtful = np.flatnonzero(in_doubt)
    return np.concatenate((np.arange(len(turn)), doubtful)), np.concatenate((turn, -turn[doubtful]))
