"""Lines of one pixel of all hogels, for the filter, with apertures in place of film pixels.

In a centered frustum, the lines of a pixel have the same direction d in all hogels; in a recentered
frustum, they pass through one point of the screen. The edge function of a line a + s d and an edge
(i, j),

    E_ij = d . ((p_i - a) x (p_j - a)),

is linear in the aperture a for one direction, and linear in d for one aperture:

    E_ij(a) = (d x e)_x a_x + (d x e)_y a_y + d . (p_i x p_j),    e = p_j - p_i.

Therefore `filter` also accepts the lines of a direction, with apertures in place of slopes: boxes
bound the triangles projected along d onto the plate. Inside a triangle all three edge functions
have the sign of d . n.

Lines through a point M of the screen are a pencil about M, except for the rounding of their slopes.
At the height of M, the distance of a line from M (`apart`) is less than delta. This distance
changes an edge function by at most |delta . (d x e)|, an amount that is added to the function's
rounding bound.

The values of s, their bounds, and the tests of open pixels are the same expressions of the same
doubles as for lines through one aperture (`cone`), so that all bits are equal (docs/truth.md, "By
directions").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from xfrustum.reference.backend import (
    Float64,
    Int32,
    UInt32,
    constants,
    cross,
    difference,
    dr,
    on_device,
    product,
)
from xfrustum.reference.certify.boxes import (
    MAX_ROWS,
    Boxes,
    FilmAxis,
    NearbyLines,
    bounding_boxes,
    chosen_boxes,
    greatest,
    least,
    pixels_between,
)
from xfrustum.reference.certify.cone import (
    EDGES,
    ROUNDING,
    UNIT_ROUNDOFF,
    Cones,
    Triangles,
    Viewpoint,
    cross_magnitude,
    places,
)
from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.certify.filter import Pairs
from xfrustum.reference.lines import PixelLines, RayBundle
from xfrustum.scenes.arrays import Floats


class ExactGrid:
    """Intersections of the lines of a grid in integers; each line is a separate pencil."""

    def __init__(self, triangles: Floats, grid: PixelLines) -> None:
        self._triangles, self._grid = triangles, grid

    def meets(self, pixel: int, triangle: int) -> Fraction | None:
        """Return s where a pixel's line meets a triangle; see `ExactPencil.meets`."""
        return self._pencil(pixel, (triangle,)).meets(0, 0)

    def coplanar(self, first: int, second: int) -> bool:
        """Return whether every line meets two triangles' planes at the same s."""
        return self._pencil(0, (first, second)).coplanar(0, 1)

    def through_apertures(self, pairs: Pairs) -> Pairs:
        """Return pairs after exact tests of planes that pass through the pixel's aperture.

        If a triangle contains the aperture, all lines of the hogel meet it at s = 0, and the pair
        becomes certain. If only the triangle's plane contains the aperture, no line of the hogel
        meets the triangle, and the pair is dropped. In the image of the hogel, one test per
        triangle has the same result.
        """
        s, error, sure = pairs.s.copy(), pairs.error.copy(), pairs.sure.copy()
        kept = np.ones(len(s), dtype=np.bool_)
        row, column = np.divmod(pairs.pixel, self._grid.resolution[0])
        center = np.stack((self._grid.x[column], self._grid.y[row], np.zeros(len(row))), axis=-1)
        corners = self._triangles[pairs.triangle]
        apart = (corners.min(axis=1) > center) | (corners.max(axis=1) < center)
        for k in np.flatnonzero(~apart.any(axis=1) | ~np.isfinite(error)).tolist():
            pencil = self._pencil(int(pairs.pixel[k]), (int(pairs.triangle[k]),))
            # A needle (a triangle without area) on a line through the aperture covers one point of
            # the hogel's film.
            if pencil.aims_past(0):
                kept[k] = False
            elif apart[k].any():
                # A triangle seen edge-on leaves open the pixels of the hogel that lie in its box.
                kept[k] = np.isfinite(error[k]) or pencil.box_holds(0)
            elif pencil.contains_center(0):
                # Lines that may lie in the triangle's plane are decided in integers.
                if np.isfinite(error[k]):
                    s[k], error[k], sure[k] = pencil.zero(0), 0.0, True
            else:
                kept[k] = pencil.meets_beside_center(0)
        return replace(pairs, s=s, error=error, sure=sure)[kept]

    def _pencil(self, pixel: int, numbers: Sequence[int]) -> ExactPencil:
        row, column = divmod(pixel, self._grid.resolution[0])
        return ExactPencil(self._triangles[list(numbers)], self._grid.line(column, row))


class DirectionLines:
    """Lines of one pixel of all hogels, for the filter; see `filter.Lines`."""

    def __init__(self, grid: PixelLines, triangles: Triangles) -> None:
        self.resolution = grid.resolution
        self._film = _ParallelFilm(grid, triangles) if grid.center is None else _PencilFilm(grid)
        self.film = self._film.axes[0]
        self.across, self.down = (on_device(values) for values in self._film.variables)
        self._x, self._y = on_device(grid.x), on_device(grid.y)
        self._dx, self._dy = on_device(grid.dx), on_device(grid.dy)
        self.ends = constants(grid.s_range)

    def boxes(self, triangles: Triangles) -> list[Boxes]:
        """Return the boxes of all triangles, projected by the lines onto the plate."""
        return self._film.boxes(triangles)

    def cones(self, points: Sequence[Sequence[Any]], holds: Any) -> Cones:
        """Return edge functions and planes of triangles, given by corners, for these lines."""
        edges, magnitudes = self._film.edges(points)
        normal, magnitude = _normals(points)
        z = [point[2] for point in points]
        return Cones(
            edges=edges,
            magnitudes=magnitudes,
            planes=_Planes(corner=points[0], normal=normal, magnitude=magnitude),
            within=(-greatest(z) >= self.ends[0]) & (-least(z) <= self.ends[1]),
            holds=holds,
        )

    def covering(
        self, points: Sequence[Sequence[Any]], column: Any, row: Any
    ) -> tuple[Any, Any, Any]:
        """Return whether lines may, or surely do, pass through triangles; see `filter.Lines`."""
        # Use the formulas of the lines through each pixel's aperture, so that the same pixels are
        # open as in the image of the hogel.
        (x, dx), (y, dy), zero = self._line_of_column(column), self._line_of_row(row), Float64(0.0)
        seen_from = Viewpoint(center=[x, y, zero], ends=self.ends, slack=zero)
        cones = Cones.from_points(points, seen_from, False)
        return *cones.covering(dx, dy), cones.within

    def along_rows(self, cones: Cones, row: Any) -> RowPlanes:
        """Return the planes of triangles along rows of apertures."""
        planes: _Planes = cones.planes
        return planes.along_row(*self._line_of_row(row))

    def met(self, planes: RowPlanes, column: Any) -> tuple[Any, Any]:
        """Return s where the lines of columns meet planes, and a bound on its error."""
        return planes.met(*self._line_of_column(column))

    def _line_of_column(self, column: Any) -> tuple[Any, Any]:
        return dr.gather(Float64, self._x, column), dr.gather(Float64, self._dx, column)

    def _line_of_row(self, row: Any) -> tuple[Any, Any]:
        return dr.gather(Float64, self._y, row), dr.gather(Float64, self._dy, row)


class _ParallelFilm:
    """The plate as the film of parallel lines: variables are the positions of apertures."""

    def __init__(self, grid: PixelLines, triangles: Triangles) -> None:
        self.variables = (grid.x, grid.y)
        self._direction = constants((grid.dx[0], grid.dy[0]))
        self._ends = constants(grid.s_range)
        self.axes = [
            FilmAxis(
                len(values),
                shear=float((values[0] + values[-1]) / 2),
                scale=1 / pitch,
                slack=self._slack(triangles, axis, grid) / pitch,
                steepest=float(np.abs(values).max()),
            )
            for axis, (values, pitch) in enumerate(zip(self.variables, grid.pitch, strict=True))
        ]

    @staticmethod
    def _slack(triangles: Triangles, axis: int, grid: PixelLines) -> float:
        # A projection x + z dx has a rounding error of 2 u relative to its terms. The subtraction,
        # the product and the sum of the map add 3 u of a position on the film. The doubles of the
        # apertures deviate from an even grid by at most 4 u of the plate's size. The bound is at
        # least twice the sum.
        size = triangles.extent
        slope, place = abs((grid.dx, grid.dy)[axis][0]), np.abs((grid.x, grid.y)[axis]).max()
        extent = place + grid.pitch[axis]
        return 16 * UNIT_ROUNDOFF * float(size[axis] + size[2] * slope + 2 * extent)

    def boxes(self, triangles: Triangles) -> list[Boxes]:
        dx, dy = self._direction
        all_boxes: list[Boxes] = []
        most = max(1, MAX_ROWS // len(self.variables[1]))
        for start in range(0, len(triangles), most):
            lane = dr.arange(UInt32, min(most, len(triangles) - start)) + dr.opaque(UInt32, start)
            points = triangles.points(lane)
            x, y, z = ([point[axis] for point in points] for axis in range(3))
            across = [at + product(height, dx) for at, height in zip(x, z, strict=True)]
            down = [at + product(height, dy) for at, height in zip(y, z, strict=True)]
            box = pixels_between(
                self.axes, (least(across), greatest(across)), (least(down), greatest(down))
            )
            normal, magnitude = _normals(points)
            slope, bound = _slopes(normal, magnitude, dx, dy)
            imaged = (-greatest(z) <= self._ends[1]) & (-least(z) >= self._ends[0])
            hit = imaged & (box[0] <= box[1]) & (box[2] <= box[3])
            known = abs(slope) > bound
            turn = dr.select(slope < 0, Int32(-1), Int32(1))
            dr.eval(box, hit, known, turn)
            all_boxes += chosen_boxes(lane, box, hit & known, turn)
            # A triangle seen edge-on covers nothing. If this is uncertain, its rows are not cut.
            all_boxes += chosen_boxes(lane, box, hit & ~known, None)
        return all_boxes

    def edges(self, points: Sequence[Sequence[Any]]) -> tuple[list[list[Any]], list[list[Any]]]:
        """Return coefficients of the edge functions, and sums of absolute products in them."""
        dx, dy = self._direction
        edges, magnitudes = [], []
        for i, j in EDGES:
            ex, ey, ez = difference(points[j], points[i])
            normal = cross(points[i], points[j])
            size = cross_magnitude(points[i], points[j])
            # The sign of `rest` is such that `Cones` subtracts it.
            rest = normal[2] - (product(dx, normal[0]) + product(dy, normal[1]))
            edges.append([product(dy, ez) + ey, -(ex + product(dx, ez)), rest])
            magnitudes.append(
                [
                    product(abs(dy), abs(ez)) + abs(ey),
                    abs(ex) + product(abs(dx), abs(ez)),
                    product(abs(dx), size[0]) + product(abs(dy), size[1]) + size[2],
                ]
            )
        return edges, magnitudes


class _PencilFilm:
    """The plate as the film of lines through a point of the screen: variables are their slopes."""

    def __init__(self, grid: PixelLines) -> None:
        assert grid.center is not None
        self.variables = (grid.dx, grid.dy)
        self._apart = grid.apart()
        depth = -grid.center[2]
        first, last = grid.s_range
        shear = [float((slopes[0] + slopes[-1]) / 2) for slopes in self.variables]
        half = [
            hogels * pitch / (2 * abs(depth))
            for hogels, pitch in zip(grid.resolution, grid.pitch, strict=True)
        ]
        self._bundle = RayBundle(
            center=grid.center,
            shear=(shear[0], shear[1]),
            half_extent=(half[0], half[1]),
            resolution=grid.resolution,
            s_range=(first - depth, last - depth),
        )
        # The margin covers the distance of lines from the pencil, and of apertures (doubles) from
        # an even grid.
        margins = [
            (apart + 4 * UNIT_ROUNDOFF * float(np.abs(place).max())) / pitch
            for apart, place, pitch in zip(self._apart, (grid.x, grid.y), grid.pitch, strict=True)
        ]
        self._margin = max(margins)
        self.axes = [FilmAxis.from_bundle(self._bundle, axis, self._margin) for axis in range(2)]
        self._seen_from = Viewpoint.from_bundle(self._bundle)
        self._aside = constants(self._apart)
        self._nearby = NearbyLines(apart=self._aside, ends=constants(grid.s_range))
        self._steepest = constants([float(np.abs(v).max()) for v in self.variables])

    def boxes(self, triangles: Triangles) -> list[Boxes]:
        return bounding_boxes(triangles, self._bundle, self._nearby, self._margin)

    def edges(self, points: Sequence[Sequence[Any]]) -> tuple[list[list[Any]], list[list[Any]]]:
        """Return coefficients of the edge functions, and sums of absolute products in them."""
        corners = [difference(point, self._seen_from.center) for point in points]
        edges = [cross(corners[i], corners[j]) for i, j in EDGES]
        magnitudes = []
        for i, j in EDGES:
            size = cross_magnitude(corners[i], corners[j])
            ex, ey, ez = (abs(part) for part in difference(points[j], points[i]))
            # The edge function changes by at most delta . (d x e). This bound is divided by
            # `ROUNDING` and added to a magnitude, because magnitudes are later multiplied by it.
            moved = product(self._aside[0], ey + product(self._steepest[1], ez))
            moved = moved + product(self._aside[1], ex + product(self._steepest[0], ez))
            magnitudes.append([size[0], size[1], size[2] + product(moved, 1 / ROUNDING)])
        return edges, magnitudes


def _normals(points: Sequence[Sequence[Any]]) -> tuple[list[Any], list[Any]]:
    """Return normals, not normalized, and the sums of absolute products in them."""
    first, second = difference(points[1], points[0]), difference(points[2], points[0])
    return cross(first, second), cross_magnitude(first, second)


def _slopes(normal: list[Any], magnitude: list[Any], dx: Any, dy: Any) -> tuple[Any, Any]:
    """Return d . n of planes, with the bound of its rounding, as `cone.RowPlanes` does."""
    slope = product(normal[0], dx) + (product(normal[1], dy) - normal[2])
    size = product(magnitude[0], abs(dx)) + (product(abs(dy), magnitude[1]) + magnitude[2])
    return slope, product(ROUNDING, size)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Planes:
    """Planes of triangles with normals, not normalized, and the sums of absolute products in them.

    The bound of q_0 . n depends on the aperture, and is not stored.
    """

    corner: Sequence[Any]
    normal: list[Any]
    magnitude: list[Any]

    def along_row(self, y: Any, dy: Any) -> RowPlanes:
        """Return the planes along rows of apertures, for any column."""
        aside, (x, _, z), n, m = self.corner[1] - y, self.corner, self.normal, self.magnitude
        return RowPlanes(
            corner_x=x,
            normal_x=n[0],
            magnitude_x=m[0],
            depth=product(z, n[2]),
            depth_magnitude=product(abs(z), m[2]),
            down=product(aside, n[1]),
            down_magnitude=product(abs(aside), m[1]),
            level=product(n[1], dy) - n[2],
            level_magnitude=product(abs(dy), m[1]) + m[2],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class RowPlanes:
    """Planes of triangles along single rows of apertures; see `cone.RowPlanes`.

    q_0 . n = (corner_x - x) normal_x + depth + down, in the order of `cone.Planes`, and
    d . n = normal_x dx + level.
    """

    corner_x: Any
    normal_x: Any
    magnitude_x: Any
    depth: Any
    depth_magnitude: Any
    down: Any
    down_magnitude: Any
    level: Any
    level_magnitude: Any

    def met(self, x: Any, dx: Any) -> tuple[Any, Any]:
        """Return s where the lines of columns meet the planes, and a bound on its error."""
        aside = self.corner_x - x
        offset = product(aside, self.normal_x) + self.depth + self.down
        size = product(abs(aside), self.magnitude_x) + self.depth_magnitude + self.down_magnitude
        slope = product(self.normal_x, dx) + self.level
        slope_size = product(self.magnitude_x, abs(dx)) + self.level_magnitude
        return places(offset, product(ROUNDING, size), slope, product(ROUNDING, slope_size))
