"""The triangles that may lie before points, by the bounds of double precision: one text for all arithmetics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from xfrustum.reference.certify.narrow import RowPlanes, plane_meeting
from xfrustum.reference.certify.spans import Arithmetic
from xfrustum.reference.lines.cone import ROUNDING, Cones
from xfrustum.scenes.arrays import Floats, Indices, Mask

TABLE_ROWS = 27
"""Numbers of a triangle in `table`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Before:
    """Points and triangles that their lines meet, or may meet, before the points.

    Attributes
    ----------
    query
        (M,) entries of `Queries`.
    triangle
        (M,) triangle numbers.
    sure
        (M,) whether the line surely meets the triangle, in the range and before the point.
    """

    query: Indices
    triangle: Indices
    sure: Mask


def table(cones: Cones) -> Floats:
    """Return the numbers of triangles that `meeting` takes, (27, T)."""
    return np.concatenate(
        (
            cones.edge.reshape(9, -1),
            cones.edge_magnitude.reshape(9, -1),
            cones.normal,
            cones.normal_magnitude,
            cones.plane[None],
            cones.plane_bound[None],
            cones.holds_center[None],
        )
    )


def meeting(triangle: list[Any], dx: Any, dy: Any, ends: tuple[Any, Any], by: Arithmetic) -> tuple[Any, Any]:
    """Return whether lines may meet triangles before some places, and whether they surely do.

    A line meets a triangle where the three edge functions have one common sign (see `cone`), and the place
    where it meets the triangle's plane lies in the range and before the end. Every quantity is known to within
    a bound of its rounding; what the bounds leave open is possible, and not sure.

    Parameters
    ----------
    triangle
        The numbers of `table`, one triangle for each line.
    dx, dy
        Slopes of the lines.
    ends
        First s that counts, and s before which a surface counts.
    by
        The arithmetic of the arrays.
    """
    edge, magnitude, normal, normal_magnitude = triangle[:9], triangle[9:18], triangle[18:21], triangle[21:24]
    plane, plane_bound, holds = triangle[24:]
    across, down = abs(dx), abs(dy)
    positive, negative = [], []
    for k in (0, 3, 6):
        value = edge[k] * dx + edge[k + 1] * dy - edge[k + 2]
        bound = ROUNDING * (across * magnitude[k] + down * magnitude[k + 1] + magnitude[k + 2])
        positive.append(value > bound)
        negative.append(value < -bound)
    # Lines through a triangle that holds the center meet it there, whatever its edge functions are.
    center = holds > 0
    inside = center | (positive[0] & positive[1] & positive[2]) | (negative[0] & negative[1] & negative[2])
    outside = (positive[0] | positive[1] | positive[2]) & (negative[0] | negative[1] | negative[2])
    possible = center | ~outside
    line = RowPlanes(
        plane=plane,
        plane_bound=plane_bound,
        normal_x=normal[0],
        magnitude_x=normal_magnitude[0],
        level=normal[1] * dy - normal[2],
        level_magnitude=normal_magnitude[1] * down + normal_magnitude[2],
        first=ends[0],
        last=ends[1],
    )
    s, error = plane_meeting(dx, line, by.select)
    possible = possible & (s + error >= ends[0]) & (s - error < ends[1])
    return possible, inside & (s - error >= ends[0]) & (s + error < ends[1])
