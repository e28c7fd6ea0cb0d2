"""Surface points that the true frustum does not see, because another surface hides them.

The answer is decided, as the truth is. A point's own line is that of the doubles (x - a_x)/s and (y - a_y)/s.
A triangle hides the point if this line meets it before the point by more than half of the tolerance within
which the point is known, and if the point lies farther from the triangle's plane than this tolerance: a point
nearer to the plane may as well lie on its other side, where the triangle does not hide it. Both are known
within the bounds of double precision (`walk`, `distance`); what they leave open is decided exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, partial
from importlib import import_module
from threading import Lock
from typing import Protocol

import numpy as np

from xfrustum.reference.certify.arbitrary_lines import ExactLines
from xfrustum.reference.certify.processors import compiled, kernels_on_one_thread
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.sight.boxes import CellBoxes, cell_boxes
from xfrustum.reference.sight.clear import ClearTriangles
from xfrustum.reference.sight.coarse import MAX_ITEMS, CoarseCells, coarse_cells
from xfrustum.reference.sight.distance import off_planes
from xfrustum.reference.sight.few import before_few
from xfrustum.reference.sight.kept import Kept
from xfrustum.reference.sight.walk import Before, PointLines, film_numbers
from xfrustum.reference.sight.walk_numpy import NumpySearch
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.scene import Scene


class Search(Protocol):
    """An engine that finds what lines may meet before points; see `JitSearch`."""

    def __init__(self, triangles: Floats) -> None: ...

    def clear(self, coarse: CoarseCells, pencil: Pencil, asked: Mask) -> ClearTriangles | None:
        """Return which of the asked triangles (F,) are clear; None where the engine does not find it."""
        ...

    def before(self, boxes: CellBoxes, position: Floats, own: Numbers, tolerance: Floats) -> Iterator[Before]:
        """Yield what the lines through points meet, or may meet, before them."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfacePoints:
    """Surface points that an image shows.

    Attributes
    ----------
    position
        (N, 3) scene units, z not 0.
    triangle
        (N,) number of the triangle that each point lies on, `NOTHING` where that is not known.
    tolerance
        (N,) distance within which each point is known, scene units: a triangle whose plane passes within
        this distance of a point does not hide it. Thus a mesh's tessellation makes no difference.
    """

    position: Floats
    triangle: Numbers
    tolerance: Floats


FEWEST_PICTURES = 3
"""Number of a pencil's pictures from which on its clear triangles are known. To find them takes about as long
as to search two pictures for what hides their points; most of that is saved from then on."""

MAX_TRIANGLES_PER_PIXEL = 1 / 4
"""Largest number of triangles for each pixel of the film with which clear triangles are searched for. The
search takes some 0.7 microseconds a triangle, and saves some 0.04 for each pixel of a picture. With more
triangles it pays after five pictures or later; and of triangles that are as small as pixels, few have points
that are well inside."""

KEPT_CLEAR = 1 << 21
"""Largest number of triangles for which it is kept whether they are clear, in 64 bytes each."""

KEPT_BOXES = 1 << 21
"""Largest number of boxes of cells that are kept for the next pictures of apertures, in 41 bytes each; those
of the last two pencils are kept however many they are."""


class _Pictures:
    """Count of a pencil's pictures, and its clear triangles as soon as they are worth finding."""

    def __init__(self) -> None:
        self._lock, self._count, self._searched = Lock(), 0, False
        self._clear: ClearTriangles | None = None

    def __len__(self) -> int:
        """Return the number of triangles of which it is known whether they are clear."""
        return 0 if self._clear is None else len(self._clear.table)

    def more(self, pictures: int, find: Callable[[], ClearTriangles | None]) -> ClearTriangles | None:
        """Return the clear triangles for some more pictures; None as long as there are few pictures."""
        with self._lock:
            self._count += pictures
            if self._count >= FEWEST_PICTURES and not self._searched:
                self._searched, self._clear = True, find()
            return self._clear


def _count(boxes: CellBoxes) -> int:
    """Return the number of boxes."""
    return len(boxes.number)


def _item_count(coarse: CoarseCells | None) -> int:
    """Return the number of items of coarse cells."""
    return 0 if coarse is None else len(coarse.item)


class Sight:
    """The triangles of a scene, ready to be searched for what hides points.

    Parameters
    ----------
    scene
        Scene with the triangles.
    """

    def __init__(self, scene: Scene) -> None:
        self._triangles = scene.triangles
        # The settings of one aperture share its boxes of cells, and several threads judge an aperture each.
        self._boxes: Kept[Pencil, CellBoxes] = Kept(
            make=partial(cell_boxes, self._triangles), size=_count, room=KEPT_BOXES, least=2
        )
        self._coarse: Kept[CellBoxes, CoarseCells | None] = Kept(
            make=coarse_cells, size=_item_count, room=MAX_ITEMS
        )
        self._pictures: Kept[Pencil, _Pictures] = Kept(make=lambda _: _Pictures(), size=len, room=KEPT_CLEAR)

    @cached_property
    def _search(self) -> Search:
        if not compiled():
            return NumpySearch(self._triangles)
        # Imported only here, because Dr.Jit's arrays need the LLVM that `compiled` has chosen.
        search: type[Search] = import_module("xfrustum.reference.sight.walk_jit").JitSearch
        return search(self._triangles)

    def clear(self, pencil: Pencil, shown: Callable[[], Mask], pictures: int) -> ClearTriangles | None:
        """Return the triangles on which points are hidden by nothing, for some more pictures of a pencil.

        None for the first few pictures of a pencil, where there are many triangles, and without LLVM.

        Parameters
        ----------
        pencil
            Lines through the point from which points are seen.
        shown
            Function that returns the triangles (F,) which are of interest.
        pictures
            Number of the pictures.
        """
        count = len(self._triangles)
        if not 0 < count <= MAX_TRIANGLES_PER_PIXEL * math.prod(pencil.resolution):
            return None
        return self._pictures(pencil).more(pictures, partial(self._find_clear, pencil, shown))

    def _find_clear(self, pencil: Pencil, shown: Callable[[], Mask]) -> ClearTriangles | None:
        """Return the clear triangles of those that are shown."""
        coarse = self._coarse(self._boxes(pencil))
        return None if coarse is None else self._search.clear(coarse, pencil, shown())

    def make_ready(self, pencil: Pencil, shown: Callable[[], Mask], pictures: int) -> None:
        """Find in advance what `clear` and `hidden` need for so many pictures of a pencil.

        Nothing is found that they would not find themselves. Parameters are those of `clear`.
        """
        if len(self._triangles):
            self._boxes(pencil)
        if pictures >= FEWEST_PICTURES:
            self.clear(pencil, shown, pictures)

    def hidden(self, pencil: Pencil, points: SurfacePoints) -> Mask:
        """Return which points lie behind another surface on their own line.

        Parameters
        ----------
        pencil
            Lines through the point from which the points are seen.
        points
            Points that are asked about.
        """
        behind = np.zeros(len(points.position), dtype=np.bool_)
        if not len(behind) or not len(self._triangles):
            return behind
        boxes = self._boxes(pencil)
        if not len(boxes.number):
            return behind
        with kernels_on_one_thread(len(behind)):
            self._mark(behind, boxes, pencil, points)
        return behind

    def _mark(self, behind: Mask, boxes: CellBoxes, pencil: Pencil, points: SurfacePoints) -> None:
        """Mark the hidden points in `behind`, (N,)."""
        for found in self._before(boxes, points):
            # What hides a point that is known to be hidden need not be asked.
            asked = np.flatnonzero(~behind[found.point])
            point, triangle, sure = found.point[asked], found.triangle[asked], found.sure[asked]
            position, tolerance = points.position[point], points.tolerance[point]
            far = off_planes(position, self._triangles[triangle], tolerance)
            behind[point[far & sure]] = True
            # Only points that nothing surely hides are decided in integers.
            doubtful = np.flatnonzero(far & ~sure & ~behind[point])
            met = self._met(pencil, position[doubtful], tolerance[doubtful], triangle[doubtful])
            behind[point[doubtful[met]]] = True

    def _before(self, boxes: CellBoxes, points: SurfacePoints) -> Iterator[Before]:
        """Yield what the lines through points meet, or may meet, before them."""
        asked = points.position, points.triangle, points.tolerance
        # To sort the boxes by coarse cells takes longer than a search, but many pictures share it with the
        # clear triangles.
        coarse = self._coarse.known(boxes)
        found = None if coarse is None else before_few(self._triangles, boxes, coarse, asked)
        if found is not None:
            yield found
        else:
            yield from self._search.before(boxes, *asked)

    def _met(self, pencil: Pencil, position: Floats, tolerance: Floats, triangle: Indices) -> Mask:
        """Return which of some points' lines meet triangles before the points, decided in integers."""
        if not len(position):
            return np.zeros(0, dtype=np.bool_)
        lines = PointLines.of((*position.T, tolerance), film_numbers(pencil), np.sqrt)
        directions = np.stack((lines.dx, lines.dy, np.full(len(position), -1.0)), axis=1)
        numbers, which = np.unique(triangle, return_inverse=True)
        # Nothing is met before its end by a line that ends before the range.
        ends = np.maximum(lines.end, pencil.s_range[0]).tolist()
        exact = ExactLines(
            self._triangles[numbers], pencil.center, directions, (pencil.s_range[0], max(ends))
        )
        met = [exact.meets(line, number) for line, number in enumerate(which.tolist())]
        return np.array([s is not None and s < Fraction(end) for s, end in zip(met, ends, strict=True)])
