"""Where along a row of pixels does a triangle begin and end? Its three edge functions say.

Conservative intervals: every line of the row that meets the triangle in exact arithmetic lies in
one, and those that surely meet it are known too. Written once for NumPy and for Dr.Jit: the
arguments are either's arrays, one lane for each row of each triangle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from xfrustum.reference.certify.footprints import pixel_slack
from xfrustum.reference.lines.cone import ROUNDING, UNIT_ROUNDOFF
from xfrustum.reference.lines.lines import Pencil


@dataclass(frozen=True, kw_only=True)
class Arithmetic:
    """What NumPy and Dr.Jit spell differently: `select` is `numpy.where`."""

    select: Callable[[Any, Any, Any], Any]
    maximum: Callable[[Any, Any], Any]
    minimum: Callable[[Any, Any], Any]
    isfinite: Callable[[Any], Any]


NUMPY = Arithmetic(select=np.where, maximum=np.maximum, minimum=np.minimum, isfinite=np.isfinite)


@dataclass(frozen=True, kw_only=True)
class FilmRow:
    """How slopes dx become columns; numbers, or Dr.Jit's arrays of one.

    Attributes
    ----------
    steepest
        The largest |dx|.
    shear, scale, middle
        Column = (dx - shear) scale + middle.
    slack
        Bounds in columns the rounding of that, and of the slopes themselves.
    width
        Columns.
    """

    steepest: Any
    shear: Any
    scale: Any
    middle: Any
    slack: Any
    width: Any

    @classmethod
    def of(cls, pencil: Pencil) -> FilmRow:
        """Return that of a pencil's film."""
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
    """Return between which slopes dx a row's lines may meet a triangle, and between which they surely do.

    Parameters
    ----------
    edges
        For each edge the three components of its plane, and of their magnitudes; see `Cones`.
    orientation
        See `Rows`.
    dy
        Slopes of the rows.
    film, by
        The film, and whose arithmetic.
    """
    low, high, surely_low, surely_high = -np.inf, np.inf, -np.inf, np.inf
    for edge, magnitude in edges:
        slope = orientation * edge[0]
        rest = orientation * (edge[1] * dy - edge[2])
        bound = ROUNDING * (film.steepest * magnitude[0] + abs(dy) * magnitude[1] + magnitude[2])
        zero = -rest / slope
        # Twice the bound also pays for rounding `zero` and the sums below.
        margin = 2 * bound / abs(slope) + 4 * UNIT_ROUNDOFF * abs(zero)
        # A slope so small that the quotient overflows changes nothing along the row.
        level = ~by.isfinite(margin)
        rising, falling = (slope > 0) & ~level, (slope < 0) & ~level
        low = by.maximum(low, by.select(rising, zero - margin, -np.inf))
        surely_low = by.maximum(surely_low, by.select(rising, zero + margin, -np.inf))
        high = by.minimum(high, by.select(falling, zero + margin, np.inf))
        surely_high = by.minimum(surely_high, by.select(falling, zero - margin, np.inf))
        low = by.select(level & (rest < -bound), np.inf, low)
        surely_low = by.select(level & (rest <= bound), np.inf, surely_low)
    return low, high, surely_low, surely_high


def columns_between(low: Any, high: Any, film: FilmRow, by: Arithmetic) -> tuple[Any, Any]:
    """Return the columns of slopes, before they are rounded to whole ones inward; -1 to W."""
    first = (low - film.shear) * film.scale + film.middle - film.slack
    last = (high - film.shear) * film.scale + film.middle + film.slack
    return by.minimum(by.maximum(first, -1.0), film.width), by.minimum(by.maximum(last, -1.0), film.width)
