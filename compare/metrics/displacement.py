"""Displacement: how far the picture moved, pixel by pixel (docs/method.md, "What is compared")."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from xfrustum.compare.metrics.film import true_lines
from xfrustum.reference.film_shifts import film_shifts
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.hogel_image import HogelCamera, HogelImage


@dataclass(frozen=True, kw_only=True)
class Spread:
    """How a quantity in pixels is distributed over an image."""

    rms: float
    p50: float
    p95: float
    p99: float
    max: float

    @classmethod
    def of(cls, values: Floats, count: int | None = None) -> Spread | None:
        """Return the spread of some values of any shape, None where there are no values.

        `count` is the number of values that are meant, as for `percentiles`.
        """
        count = values.size if count is None else count
        if count == 0:
            return None
        largest = float(values.max())
        if largest == 0 and float(values.min()) == 0:
            return cls(rms=0.0, p50=0.0, p95=0.0, p99=0.0, max=0.0)
        p50, p95, p99 = percentiles(values.ravel(), (50, 95, 99), largest, count)
        return cls(rms=root_mean_square(values, largest, count), p50=p50, p95=p95, p99=p99, max=largest)


SAMPLE_SIZE = 1 << 11
"""Number of values of a sample, which says between which values a rank almost surely lies."""

SAMPLE_MARGIN = 0.03
"""Share of a sample by which these two values are moved apart, so that few samples, of which the standard
error is 1.1 % of the ranks at the median and less elsewhere, are misleading. A misleading one costs time
alone."""

MAX_UPPER_SHARE = 0.125
"""Where no more than about this share of the values lies above a rank, all of them are kept, and the ranks
that follow are sought among them alone."""


def percentiles(
    values: Floats, percents: Sequence[float], largest: float | None = None, count: int | None = None
) -> list[float]:
    """Return percentiles of values (N,), of which there is one: those of `np.percentile`, by selection alone.

    The ranks of each are selected among the few values that a sample leaves.

    Parameters
    ----------
    values
        (N,) values.
    percents
        Percentages, ascending.
    largest
        The largest value, where it is known already.
    count
        Number of values that are meant, at least one; the others are zeros that stand for nothing, and no
        value is negative. None where all are meant.
    """
    total = len(values)
    count = total if count is None else count
    if not np.isfinite(values.max() if largest is None else largest):
        meant = values if count == total else np.sort(values)[total - count :]
        return [float(found) for found in np.percentile(meant, percents)]
    # An odd stride, lest images whose sides are powers of two are sampled in a few of their columns.
    sample = np.sort(values[:: total // SAMPLE_SIZE | 1]) if total > SAMPLE_SIZE else None
    found = []
    for percent in percents:
        # The same steps as numpy's, which goes on from the nearer of both neighbors.
        place = (count - 1) * (percent / 100)
        low, share = int(place), place - int(place)
        # Ranks are counted from the last one back: zeros that stand for nothing do not change them, and they
        # stay when the smallest values are left out.
        ranks = low - count, min(low + 1, count - 1) - count
        above = 0
        chosen = values
        if sample is not None:
            chosen, above = _around(values, ranks, sample, total)
            if not above:
                values = chosen
        ends = ranks[0] + above, ranks[1] + above
        chosen = np.partition(chosen, ends)
        a, b = float(chosen[ends[0]]), float(chosen[ends[1]])
        found.append(b - (b - a) * (1 - share) if share >= 0.5 else a + (b - a) * share)
    return found


def _around(values: Floats, ranks: tuple[int, int], sample: Floats, count: int) -> tuple[Floats, int]:
    """Return the values around two neighboring ranks, and how many others are above them.

    Parameters
    ----------
    values
        (N,) the largest of all values.
    ranks
        Ranks among all values, counted from the last one back: -1 is the largest.
    sample
        Sorted sample of all values.
    count
        Number of all values.
    """
    size = len(sample)
    first, last = (1 + ranks[0] / count - SAMPLE_MARGIN) * size, (1 + ranks[1] / count + SAMPLE_MARGIN) * size
    inside = values >= (sample[int(first)] if first > 0 else -np.inf)
    above = 0
    if first < (1 - MAX_UPPER_SHARE) * size:
        small = values <= sample[int(last) + 1]
        above = len(values) - int(np.count_nonzero(small))
        inside &= small
    chosen = values[inside]
    return (chosen, above) if -len(chosen) <= ranks[0] + above <= ranks[1] + above < 0 else (values, 0)


def root_mean_square(values: Floats, largest: float | None = None, count: int | None = None) -> float:
    """Return the root mean square of values of any shape, of which there is one and none is negative.

    `largest` is the largest value, where it is known already, and `count` the number of values that are
    meant, as for `percentiles`.
    """
    if largest is None:
        largest = float(values.max())
    if not largest > 0:
        return 0.0
    # Values are scaled first: near the plate the squares of displacements may overflow.
    squares = values / largest
    np.square(squares, out=squares)
    return largest * float(np.sqrt(np.sum(squares) / (squares.size if count is None else count)))


def displacement(raster: HogelImage, camera: HogelCamera) -> Floats:
    """Return the place where each pixel's surface point belongs, minus the place where it was drawn.

    No optical flow is needed: the image says which surface point it shows, and the true frustum
    says where that point belongs.

    Parameters
    ----------
    raster
        Image that is judged.
    camera
        Camera of the true frustum.

    Returns
    -------
    (H, W, 2) columns and rows in pixels, rows counting down; NaN where no surface is shown and
    where it lies in the plate.
    """
    shift = film_shifts(raster.position, true_lines(camera))
    return shift.view(np.float64).reshape(*raster.triangle.shape, 2)


def lengths(shift: Floats) -> Floats:
    """Return the lengths (...) of vectors (..., 2), without over- or underflow."""
    return np.abs(np.ascontiguousarray(shift).view(np.complex128)[..., 0])
