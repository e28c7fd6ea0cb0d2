"""Surfaces that a line may meet before its end, by the bounds of double precision, on NumPy and Dr.Jit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from xfrustum.reference.certify.narrow import UNDERFLOW
from xfrustum.reference.devices.arithmetic import Arithmetic, Coordinates, cross, difference
from xfrustum.reference.lines.cone import EDGES, ROUNDING, Planes, cross_magnitude
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Indices, Mask


@dataclass(frozen=True, kw_only=True, eq=False)
class Before:
    """Points and triangles that their lines meet, or may meet, before the points.

    Attributes
    ----------
    point
        (M,) numbers of the points.
    triangle
        (M,) triangle numbers.
    sure
        (M,) whether the line surely meets the triangle, in the range and before the point.
    """

    point: Indices
    triangle: Indices
    sure: Mask


@dataclass(frozen=True, kw_only=True, eq=False)
class PointLines:
    """The lines through points, from their common center, as arrays of any library.

    Attributes
    ----------
    dx, dy
        Slopes: the line is center + s (dx, dy, -1). These doubles define it.
    end
        Place before which a surface hides the point.
    column, row
        Place of the line on the film, in pixels.
    """

    dx: Any
    dy: Any
    end: Any
    column: Any
    row: Any

    @classmethod
    def of(cls, points: Sequence[Any], film: Sequence[Any], root: Any) -> PointLines:
        """Return the lines through points.

        Parameters
        ----------
        points
            Coordinates x, y and z of points off the height of the center, and the distance within which each
            point is known.
        film
            The numbers of `film_numbers`.
        root
            Square root of an array.
        """
        x, y, z, tolerance = points
        center_x, center_y, center_z, shear_x, shear_y, scale_x, scale_y, middle_x, middle_y = film
        s = center_z - z
        dx, dy = (x - center_x) / s, (y - center_y) / s
        # What is met nearer than half a tolerance before the point is the point's own surface.
        end = s - tolerance / (2 * root(dx * dx + dy * dy + 1.0))
        return cls(
            dx=dx,
            dy=dy,
            end=end,
            column=(dx - shear_x) * scale_x + middle_x,
            row=middle_y - (dy - shear_y) * scale_y,
        )


def film_numbers(pencil: Pencil) -> list[float]:
    """Return the numbers of a pencil that `PointLines.of` takes."""
    sides = list(zip(pencil.resolution, pencil.half_extent, strict=True))
    return [
        *pencil.center,
        *pencil.shear,
        *(pixels / (2 * extent) for pixels, extent in sides),
        *((pixels - 1) / 2 for pixels, _ in sides),
    ]


@dataclass(frozen=True, kw_only=True, eq=False)
class Surfaces:
    """Triangles with the bounds of their rounding, as arrays of any library; see `Cones`."""

    edge: list[Coordinates]
    edge_magnitude: list[Coordinates]
    planes: Planes
    holds: Any

    @classmethod
    def of(cls, corners: Sequence[Coordinates], center: Coordinates, holds: Any, by: Arithmetic) -> Surfaces:
        """Return triangles, given their three corners in scene units, about the center of a pencil."""
        seen = [difference(corner, center) for corner in corners]
        return cls(
            edge=[cross(seen[i], seen[j]) for i, j in EDGES],
            edge_magnitude=[cross_magnitude(seen[i], seen[j]) for i, j in EDGES],
            planes=Planes.of(by, corners, center, holds),
            holds=holds,
        )


def meeting(on: Surfaces, dx: Any, dy: Any, ends: tuple[Any, Any], by: Arithmetic) -> tuple[Any, Any]:
    """Return whether lines may meet triangles before some places, and whether they surely do.

    A line meets a triangle where the three edge functions have one common sign (see `cone`), and the place
    where it meets the triangle's plane lies in the range and before the end. Every quantity is known to
    within a bound of its rounding; what the bounds leave open is possible, and not sure.

    Parameters
    ----------
    on
        Triangles, one for each line.
    dx, dy
        Slopes of the lines.
    ends
        First s that counts, and s before which a surface counts.
    by
        The arithmetic of the arrays.
    """
    across, down = abs(dx), abs(dy)
    positive, negative = [], []
    for edge, magnitude in zip(on.edge, on.edge_magnitude, strict=True):
        value = edge[0] * dx + edge[1] * dy - edge[2]
        bound = ROUNDING * (across * magnitude[0] + down * magnitude[1] + magnitude[2])
        positive.append(value > bound)
        negative.append(value < -bound)
    # Lines through a triangle that holds the center meet it there, whatever its edge functions are.
    inside = (positive[0] & positive[1] & positive[2]) | (negative[0] & negative[1] & negative[2])
    outside = (positive[0] | positive[1] | positive[2]) & (negative[0] | negative[1] | negative[2])
    # With a certain sign of the slope d . n, the line meets the plane before s = e where the plane's distance
    # less e times the slope has the other sign: no quotient is needed.
    planes = on.planes
    slope = planes.normal[0] * dx + planes.normal[1] * dy - planes.normal[2]
    magnitude = planes.normal_magnitude
    slope_bound = ROUNDING * (across * magnitude[0] + down * magnitude[1] + magnitude[2])
    certain = abs(slope) > slope_bound
    side = by.select(slope > 0, 1.0, -1.0)
    beyond, doubt = [], []
    for end in ends:
        share = end * slope
        beyond.append(side * (planes.plane - share))
        # The bounds of both terms, and the roundings of this sum and of its bound.
        doubt.append(
            planes.plane_bound
            + abs(end) * slope_bound
            + ROUNDING * (abs(planes.plane) + abs(share))
            + UNDERFLOW
        )
    possible = ~certain | ((beyond[0] >= -doubt[0]) & (beyond[1] <= doubt[1]))
    sure = certain & (beyond[0] >= doubt[0]) & (beyond[1] < -doubt[1])
    return (on.holds | ~outside) & possible, (on.holds | inside) & sure
