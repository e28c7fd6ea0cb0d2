"""Occlusion query: points of an image hidden by other surfaces on their own lines (docs/truth.md).

The formulas of `cone` and the boxes of `boxes` decide the answer, as for the truth. A point's own
line has the slopes (x - a_x)/s and (y - a_y)/s, as doubles. A triangle hides the point if this line
meets it before the point by more than half of the tolerance within which the point is known, and if
the point lies farther from the triangle's plane than this tolerance: a point nearer to the plane
may as well lie on its other side, where the triangle does not hide it. Pairs left open by doubles
are decided in rational numbers.

Points are sorted by the cells of the film that their lines pass: one cell about each pixel's
center, with a border for all that lies beside it. A triangle's box of cells holds every cell in
which a line may meet it; a triangle without a cell in common with a point cannot hide it. There is
one lane for each row of cells of a triangle's box. The lane walks the points in these cells, which
are contiguous, and records the points whose lines may meet the triangle before the point.
"""

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np

from xfrustum.reference.backend import (
    Array4f64,
    Bool,
    Float64,
    Int32,
    UInt32,
    constants,
    cross,
    difference,
    dot,
    dr,
    on_device,
    product,
    recording,
    vectors_on_device,
)
from xfrustum.reference.certify.boxes import FilmAxis, bounding_boxes
from xfrustum.reference.certify.cone import (
    ROUNDING,
    UNDERFLOW,
    Cones,
    Planes,
    Triangles,
    Viewpoint,
    in_range,
)
from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.lines.lines import RayBundle
from xfrustum.reference.llvm import worker_count
from xfrustum.reference.rays.integers import meet
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers

#: distance, in pixels, of a cell's sides from its center
HALF_CELL = 0.5

#: Room for pairs of each point at first. Most points are not hidden; if there are more pairs, the
#: walk is repeated with room for all of them.
PAIRS_PER_POINT = 1 / 8

#: least room for pairs
MIN_PAIRS = 1 << 12


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfacePoints:
    """Surface points of an image."""

    position: Floats  #: (N, 3) scene units, off the height of the center from which they are seen
    #: (N,) number of the triangle with the point, `NOTHING` where unknown
    triangle: Numbers
    #: (N,) uncertainty of each point, scene units: a triangle whose plane passes within this
    #: distance of a point does not hide it. A mesh's tessellation therefore has no effect.
    tolerance: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class _Lines:
    """Lines through points, sorted by cells of the film; `start` is the first line of each cell.

    `line` has slopes dx and dy, end, and the number of the point's own triangle, (4 N,) line by
    line; `point` the numbers of the points, and `positions` the coordinates x, y and z of all
    points, and their tolerances.
    """

    line: Any
    point: Any
    start: Any
    positions: list[Any]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Rows:
    """Rows of cells that bounding boxes cover, one lane per row; `behind` follows the last cell."""

    first: Any
    behind: Any
    number: Any
    #: true if the triangle contains the center, where all lines meet it; None if no triangle does
    holds: Any


def _rows_of_cells(triangles: Triangles, bundle: RayBundle) -> list[_Rows]:
    """Return the cells in which a pencil's lines may meet triangles, from its first s on."""
    # Surfaces beyond the range are not imaged. A picture that shows them nevertheless may also show
    # them in front of other surfaces.
    endless = replace(bundle, s_range=(bundle.s_range[0], math.inf))
    exact = ExactPencil(triangles.corners, bundle)
    width, height = (side + 2 for side in bundle.resolution)
    all_rows = []
    for boxes in bounding_boxes(triangles, endless, exact, HALF_CELL, 1):
        reaching = boxes.rows(range(height))
        if reaching is None:
            continue
        box, row = reaching
        number = dr.gather(UInt32, boxes.number, box)
        left, right = (dr.gather(Int32, boxes.box[k], box) for k in (0, 1))
        start = UInt32(row) * dr.opaque(UInt32, width)
        rows = _Rows(
            first=start + UInt32(left),
            behind=start + UInt32(right) + 1,
            number=number,
            holds=None if boxes.holds is None else dr.gather(Bool, boxes.holds, box),
        )
        dr.eval(rows.first, rows.behind, rows.number, rows.holds)
        all_rows.append(rows)
    return all_rows


class Occlusion:
    """The triangles of a scene, ready to be searched for those that occlude points."""

    def __init__(self, triangles: Triangles) -> None:
        self._triangles = triangles
        # All settings of an aperture share its rows, and each of several threads judges one
        # aperture.
        self._rows = lru_cache(maxsize=worker_count() + 1)(
            lambda bundle: _rows_of_cells(triangles, bundle)
        )

    def hidden(self, bundle: RayBundle, points: SurfacePoints) -> Mask:
        """Return which points (N,) lie behind another surface on their own line from the center."""
        behind = np.zeros(len(points.position), dtype=np.bool_)
        if not len(behind) or not len(self._triangles):
            return behind
        with recording():
            hidden = dr.zeros(Bool, len(behind))
            lines = _sorted_lines(bundle, points)
            open_pairs = [
                self._classify_pairs(bundle, rows, lines, hidden) for rows in self._rows(bundle)
            ]
            behind |= hidden.numpy()
        for point, triangle in open_pairs:
            # Only points that no triangle surely hides are decided in rational numbers.
            undecided = np.flatnonzero(~behind[point])
            met = self._hides(bundle, points, point[undecided], triangle[undecided])
            behind[point[undecided][met]] = True
        return behind

    def _classify_pairs(
        self, bundle: RayBundle, rows: _Rows, lines: _Lines, hidden: Any
    ) -> tuple[Indices, Indices]:
        """Mark points that are surely hidden; return the pairs of point and triangle left open."""
        none = np.zeros(0, dtype=np.int64)
        first, last = (dr.gather(UInt32, lines.start, cell) for cell in (rows.first, rows.behind))
        # Rows without lines would idle beside those that walk.
        lane: Any = dr.compress(first < last)
        if not dr.width(lane):
            return none, none
        first, last, number = (
            dr.gather(UInt32, values, lane) for values in (first, last, rows.number)
        )
        holds = False if rows.holds is None else dr.gather(Bool, rows.holds, lane)
        cones = Cones.from_points(
            self._triangles.points(number), Viewpoint.from_bundle(bundle), holds
        )
        room = max(MIN_PAIRS, int(PAIRS_PER_POINT * dr.width(lines.point)))
        (nearest,) = constants(bundle.s_range[:1])
        count, pairs = _walk(cones, (first, last, number), lines, nearest, room)
        if count > room:
            count, pairs = _walk(cones, (first, last, number), lines, nearest, count)
        if not count:
            return none, none
        at = dr.arange(UInt32, count)
        point, triangle, sure = (dr.gather(type(values), values, at) for values in pairs)
        x, y, z, tolerance = (dr.gather(Float64, values, point) for values in lines.positions)
        # A point is hidden only if it is not near the triangle's plane: |(p_0 - P) . n| > t |n|.
        # The bounds of n's coordinates bound its length.
        planes = Planes.from_points(self._triangles.points(triangle), (x, y, z), False)
        length, magnitude = (
            dr.sqrt(dot(values, values)) for values in (planes.normal, planes.magnitude)
        )
        beyond = abs(planes.offset) - product(tolerance, length)
        bound = planes.bound + product(product(ROUNDING, tolerance), magnitude) + UNDERFLOW
        surely = sure & (beyond > bound)
        dr.scatter(hidden, Bool(True), point, surely)
        left: Any = dr.compress(~surely & (beyond >= -bound))
        point, triangle = (dr.gather(UInt32, values, left) for values in (point, triangle))
        dr.eval(hidden, point, triangle)
        return point.numpy().astype(np.int64), triangle.numpy().astype(np.int64)

    def _hides(
        self, bundle: RayBundle, points: SurfacePoints, point: Indices, triangle: Indices
    ) -> Mask:
        """Return which triangles hide points, pair by pair, decided in rational numbers."""
        if not len(point):
            return np.zeros(0, dtype=np.bool_)
        position, tolerance = points.position[point], points.tolerance[point]
        # The same doubles as in `_sorted_lines`.
        offset = position - bundle.center
        dx, dy = offset[:, 0] / -offset[:, 2], offset[:, 1] / -offset[:, 2]
        ends = -offset[:, 2] - tolerance / (2 * np.sqrt(dx * dx + dy * dy + 1.0))
        directions = np.stack((dx, dy, np.full(len(point), -1.0)), axis=1)
        corners = self._triangles.corners[triangle]
        centers = np.tile(bundle.center, (len(point), 1))
        # A line that ends before the range begins meets nothing.
        ranges = np.stack((np.full(len(point), bundle.s_range[0]), ends), axis=1)
        decided = meet(corners, centers, directions, ranges)
        hides = decided.met
        for pair in np.flatnonzero(hides).tolist():
            hides[pair] = decided.place(pair) < Fraction(ends[pair]) and _off_plane(
                position[pair], corners[pair], float(tolerance[pair])
            )
        return hides


def _sorted_lines(bundle: RayBundle, points: SurfacePoints) -> _Lines:
    """Return the lines to points, up to half a tolerance before their own surface."""
    positions = [*vectors_on_device(points.position), on_device(points.tolerance)]
    own, point = on_device(points.triangle), dr.arange(UInt32, len(points.position))
    center = constants(bundle.center)
    s = center[2] - positions[2]
    dx, dy = ((positions[axis] - center[axis]) / s for axis in range(2))
    film = [FilmAxis.from_bundle(bundle, axis) for axis in range(2)]
    # Rows count down.
    places = [
        product(slope - axis.shear, product(sign, axis.scale)) + axis.middle
        for slope, axis, sign in zip((dx, dy), film, (1.0, -1.0), strict=True)
    ]
    end = s - positions[3] / product(2.0, dr.sqrt(product(dx, dx) + product(dy, dy) + 1.0))
    column, row = (
        UInt32(Int32(dr.round(dr.clip(place, -1.0, side))) + 1)
        for place, side in zip(places, constants(bundle.resolution), strict=True)
    )
    width, height = (side + 2 for side in bundle.resolution)
    cell = row * dr.opaque(UInt32, width) + column
    # Counting sort: the order of the lines within a cell does not matter.
    number: Any = dr.zeros(UInt32, width * height + 1)
    rank = dr.scatter_inc(number, cell)
    together = Array4f64(dx, dy, end, Float64(own))
    dr.eval(together, cell, rank, number)
    start: Any = dr.prefix_sum(number)
    first: Any = dr.gather(UInt32, start, cell)
    target = first + rank
    line, sorted_point = dr.empty(Float64, 4 * dr.width(own)), dr.empty(UInt32, dr.width(own))
    # The four numbers of a line are adjacent, so that a walk reads a line at once.
    dr.scatter(line, together, target)
    dr.scatter(sorted_point, point, target)
    dr.eval(line, sorted_point, start)
    return _Lines(line=line, point=sorted_point, start=start, positions=positions)


def _walk(
    cones: Cones, lanes: tuple[Any, Any, Any], lines: _Lines, nearest: Any, room: int
) -> tuple[int, tuple[Any, Any, Any]]:
    """Return the number of pairs of point and triangle, and the pairs for which there is room.

    Pairs are arrays of points, of triangles that may be met before them, and of whether they surely
    are.
    """
    first, last, number = lanes
    named = Float64(number)
    written: Any = dr.opaque(UInt32, 0)
    limit: Any = dr.opaque(UInt32, room)
    points, triangles, certain = (
        dr.empty(UInt32, room),
        dr.empty(UInt32, room),
        dr.empty(Bool, room),
    )

    def step(query: Any) -> tuple[Any]:
        dx, dy, end, own = dr.gather(Array4f64, lines.line, query)
        s, error = cones.planes.along_rows(dy).met(dx)
        possible, sure = in_range(s, error, False, (nearest, end))
        may_cover, covers = cones.covering(dx, dy)
        possible &= may_cover & (own != named)
        sure &= covers & (s + error < end)
        slot = dr.scatter_inc(written, UInt32(0), possible)
        fits = possible & (slot < limit)
        dr.scatter(points, dr.gather(UInt32, lines.point, query, fits), slot, fits)
        dr.scatter(triangles, number, slot, fits)
        dr.scatter(certain, sure, slot, fits)
        return (query + 1,)

    dr.while_loop((UInt32(first),), lambda query: query < last, step)
    dr.eval(written, points, triangles, certain)
    return int(written[0]), (points, triangles, certain)


def _off_plane(point: Floats, corners: Floats, tolerance: float) -> bool:
    """Return whether a point lies farther than a tolerance from a plane, in rationals.

    False for a triangle without area.
    """
    p, *triangle = (
        [Fraction(value) for value in row] for row in (point.tolist(), *corners.tolist())
    )
    first, second = difference(triangle[1], triangle[0]), difference(triangle[2], triangle[0])
    normal = cross(first, second)
    along = dot(difference(triangle[0], p), normal)
    return bool(along * along > Fraction(tolerance) ** 2 * dot(normal, normal))
