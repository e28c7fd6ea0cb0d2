"""The columns of a row between which a triangle can be met, by its three edge functions.

The intervals are conservative: every line of the row that meets the triangle in exact arithmetic lies
inside. A second interval holds lines that surely meet it. Written once for NumPy and for Dr.Jit: the
arguments are arrays of either library, with one lane for each row of each triangle.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from xfrustum.reference.certify.footprints import pixel_slack
from xfrustum.reference.devices.arithmetic import Arithmetic
from xfrustum.reference.lines.cone import ROUNDING, UNIT_ROUNDOFF
from xfrustum.reference.lines.lines import Pencil


@dataclass(frozen=True, kw_only=True)
class FilmRow:
    """The map from slopes dx to columns; its parts are numbers, or arrays of one element in Dr.Jit.

    Attributes
    ----------
    steepest
        The largest |dx|.
    shear, scale, middle
        Parts of column = (dx - shear) scale + middle.
    slack
        Bound, in columns, on the rounding of this formula and of the slopes themselves.
    width
        Number of columns.
    """

    steepest: Any
    shear: Any
    scale: Any
    middle: Any
    slack: Any
    width: Any

    @classmethod
    def of(cls, pencil: Pencil) -> FilmRow:
        """Return the map of a pencil's film."""
        width = pencil.resolution[0]
        return cls(
            steepest=float(np.abs(pencil.dx).max()),
            shear=pencil.shear[0],
            scale=width / (2 * pencil.half_extent[0]),
            middle=(width - 1) / 2,
            slack=pixel_slack(pencil, 0),
            width=float(width),
        )


def slopes_inside(
    edges: Iterable[tuple[Any, Any]],
    orientation: Any,
    dy: Any,
    film: FilmRow,
    by: Arithmetic,
) -> tuple[Any, Any, Any, Any]:
    """Return the slopes dx between which a row's lines may meet a triangle, and between which they surely do.

    Along a row, each edge function is E(dx) = slope dx + rest, positive inside; so each edge bounds dx on
    one side, at its zero -rest / slope.

    Parameters
    ----------
    edges
        For each edge the three components of its plane, and their magnitudes; see `Cones`.
    orientation
        Sign of the edge functions inside the triangle; see `Rows`.
    dy
        Slopes of the rows.
    film
        The film.
    by
        The arithmetic of the arrays.

    Returns
    -------
    low, high
        No line with a slope outside [low, high] meets the triangle.
    surely_low, surely_high
        Every line with a slope inside [surely_low, surely_high] meets it.
    """
    low, high, surely_low, surely_high = -np.inf, np.inf, -np.inf, np.inf
    for edge, magnitude in edges:
        # The edge function along the row, turned to be positive inside, and the bound of its rounding.
        slope = orientation * edge[0]
        rest = orientation * (edge[1] * dy - edge[2])
        bound = ROUNDING * (film.steepest * magnitude[0] + abs(dy) * magnitude[1] + magnitude[2])
        # Its zero, and how far rounding may have moved it: an error `bound` of E moves the zero by
        # bound / |slope|. Twice that, and 4 u |zero|, also cover rounding `zero` and the sums below.
        zero = -rest / slope
        margin = 2 * bound / abs(slope) + 4 * UNIT_ROUNDOFF * abs(zero)
        # Where the slope is so small that the quotient overflows, E has one sign along the whole row.
        level = ~by.isfinite(margin)
        # A rising edge bounds dx from below, a falling one from above.
        rising, falling = (slope > 0) & ~level, (slope < 0) & ~level
        low = by.maximum(low, by.select(rising, zero - margin, -np.inf))
        surely_low = by.maximum(surely_low, by.select(rising, zero + margin, -np.inf))
        high = by.minimum(high, by.select(falling, zero + margin, np.inf))
        surely_high = by.minimum(surely_high, by.select(falling, zero - margin, np.inf))
        # A level edge empties the interval if it is surely negative, and the sure one unless surely positive.
        low = by.select(level & (rest < -bound), np.inf, low)
        surely_low = by.select(level & (rest <= bound), np.inf, surely_low)
    return low, high, surely_low, surely_high


def columns_between(low: Any, high: Any, film: FilmRow, by: Arithmetic) -> tuple[Any, Any]:
    """Return the columns of two slopes, as numbers from -1 to W that the caller rounds inward."""
    first = (low - film.shear) * film.scale + film.middle - film.slack
    last = (high - film.shear) * film.scale + film.middle + film.slack
    return by.minimum(by.maximum(first, -1.0), film.width), by.minimum(by.maximum(last, -1.0), film.width)
