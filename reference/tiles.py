"""First surfaces of all hogels of a tile, decided direction by direction.

One pixel of all hogels is certified at once (`certify.directions`), so that the broad phase of the
filter runs once for each pixel of a hogel, and not once for each hogel. Results are stored by
direction, and read by hogel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from xfrustum.reference.certify.certify import Certifier, FirstSurfaces
from xfrustum.reference.certify.cone import Triangles
from xfrustum.reference.lines.lines import RayBundle, TileLines, crossed_frustum
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.plate import Frustum, PlateTile

#: Largest number of pixels of all hogels of a tile, decided at once. A pixel takes 13 bytes, and 16
#: more with gaps: 440 MB, or 970 MB.
TILE_PIXELS = 1 << 25

#: triangles across the plate whose boxes are compared with apertures at once
TOUCHING_AT_ONCE = 1 << 14


def tile_rows(frustum: Frustum, columns: int) -> int:
    """Return the number of whole rows of hogels in a tile, at least 1; see `TILE_PIXELS`."""
    return max(1, TILE_PIXELS // (math.prod(frustum.resolution) * columns))


@dataclass(frozen=True, kw_only=True, eq=False)
class HogelDecisions:
    """Decisions of one hogel, with the interface of a `Certifier` of its ray bundle."""

    first: FirstSurfaces
    #: (H, W) gaps to the next surface, and to the next with a smaller number; None if not decided,
    #: or if a surface may pass through the aperture
    behind: tuple[Floats, Floats] | None

    def decide(self, rows: range) -> FirstSurfaces:
        """Return the first surface of every pixel in some rows."""
        some, first = slice(rows.start, rows.stop), self.first
        tied = first.tied_triangles
        return replace(
            first,
            triangle=first.triangle[some],
            s=first.s[some],
            certainty=first.certainty[some],
            tied_triangles=tied[(tied[:, 0] >= rows.start) & (tied[:, 0] < rows.stop)],
        )

    def gaps(self, rows: range, numbers: Indices | None = None) -> Floats:
        """Return the gaps of some rows; `numbers` are the triangles of the first surfaces."""
        assert self.behind is not None, "the tile was decided with gaps"
        return self.behind[0 if numbers is None else 1][rows.start : rows.stop]


class TileDecisions:
    """Decisions of all hogels of a tile, with the bits of each hogel's own `Certifier`."""

    def __init__(
        self, triangles: Triangles, frustum: Frustum, tile: PlateTile, *, gaps: bool
    ) -> None:
        width, height = frustum.resolution
        self._shape = height, width
        columns, rows = tile.size
        places = [(row, column) for row in range(rows) for column in range(columns)]
        self._places = {
            crossed_frustum(frustum, tile.plate.aperture(tile.columns[column], tile.rows[row])): (
                row,
                column,
            )
            for row, column in places
        }
        stored = (height * width, rows, columns)
        self._triangle = np.empty(stored, dtype=np.int32)
        self._s, self._certainty = np.empty(stored), np.empty(stored, dtype=np.uint8)
        self._gaps = np.empty((2, *stored)) if gaps else None
        self._touched = _touched(triangles.corners, tile) if gaps else None
        self._tied: dict[tuple[int, int], list[tuple[int, int, int]]] = {}
        lines, every = TileLines(frustum, tile), range(rows)
        for number in range(height * width):
            row, column = divmod(number, width)
            grid = lines.of_pixel((column, row))
            certifier = Certifier(triangles, grid)
            decided = certifier.decide(every)
            # Columns and rows of lines run through the tile in steps of 1 or -1.
            turned = (slice(None, None, grid.step),) * 2
            self._triangle[number] = decided.triangle[turned]
            self._s[number] = decided.s[turned]
            self._certainty[number] = decided.certainty[turned]
            for down, across, triangle in decided.tied_triangles.tolist():
                place = (down, across) if grid.step > 0 else (rows - 1 - down, columns - 1 - across)
                self._tied.setdefault(place, []).append((row, column, triangle))
            if self._gaps is not None:
                numbers = decided.triangle.astype(np.int64).reshape(-1)
                self._gaps[0, number] = certifier.gaps(every)[turned]
                self._gaps[1, number] = certifier.gaps(every, numbers)[turned]

    def of(self, bundle: RayBundle) -> HogelDecisions | None:
        """Return the decisions along the crossed frustum of a hogel; None for other lines."""
        place = self._places.get(bundle)
        if place is None:
            return None
        here = (slice(None), *place)
        shape, gaps = self._shape, self._gaps
        first = FirstSurfaces(
            triangle=self._triangle[here].reshape(shape),
            s=self._s[here].reshape(shape),
            certainty=self._certainty[here].reshape(shape),
            tied_triangles=np.array(self._tied.get(place, []), dtype=np.int64).reshape(-1, 3),
        )
        behind = None
        if gaps is not None and self._touched is not None and not self._touched[place]:
            behind = gaps[0][here].reshape(shape), gaps[1][here].reshape(shape)
        return HogelDecisions(first=first, behind=behind)


def _touched(corners: Floats, tile: PlateTile) -> Mask:
    """Return the hogels (rows, columns) whose apertures lie in the boxes of triangles.

    All lines of a hogel meet a triangle through its aperture at exactly s = 0. Parallel lines meet
    it within rounding, which does not bound a gap.
    """
    plate, (columns, rows) = tile.plate, tile.size
    x = np.array([plate.aperture(number, tile.rows[0]).x for number in tile.columns])
    y = np.array([plate.aperture(tile.columns[0], number).y for number in tile.rows])
    low, high = corners.min(axis=1), corners.max(axis=1)
    crossing = np.flatnonzero((low[:, 2] <= 0) & (high[:, 2] >= 0))
    touched = np.zeros((rows, columns), dtype=np.bool_)
    for start in range(0, len(crossing), TOUCHING_AT_ONCE):
        some = crossing[start : start + TOUCHING_AT_ONCE]
        across = (low[some, 0, None] <= x) & (x <= high[some, 0, None])
        down = (low[some, 1, None] <= y) & (y <= high[some, 1, None])
        touched |= down.T.astype(np.float32) @ across.astype(np.float32) > 0
    return touched
