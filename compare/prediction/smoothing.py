"""Smoothing over the width of a contour, of images that are zero nearly everywhere."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from xfrustum.scenes.arrays import Floats, Indices, Mask

CONTOUR_SIGMA_PX = 1.5
"""Standard deviation of the filter that turns a staircase of pixels into a contour with a normal. A line
that leans by one pixel in m repeats its stairs every m pixels: up to m = 4 a period lies within two sigma on
either side, and the normal is exact. On stairs that lean less the normal is too near to an axis, but by at
most 1/5 of a radian, and on average along the line by nothing. A wider filter would round corners off, and
mix contours that are as near to each other."""

SIGMAS = 4.0
"""Standard deviations after which SciPy's filter ends, as it does unless told otherwise."""

RADIUS_PX = int(SIGMAS * CONTOUR_SIGMA_PX + 0.5)
"""Distance from a pixel to the last one along each axis that the filter takes in, pixels."""

MAX_SPARSE_FRACTION = 0.3
"""Largest share of an image that the filter takes anything but zero to, and that is smoothed pixel by pixel.
Contours reach a tenth of most images; SciPy's filter, which smooths every pixel, takes as long as a share of
about a third does."""

CACHE_LINE_VALUES = 8
"""Number of doubles in a line of the processor's cache."""

Mode = Literal["reflect", "constant"]
"""Ways in which an image goes on beyond its border, as SciPy names them: mirrored at it, or with zeros."""


def smoothed_where_reached(image: Floats, mode: Mode = "reflect") -> tuple[Indices, Floats]:
    """Smooth an image (H, W) over `CONTOUR_SIGMA_PX`: the numbers of SciPy's filter, without its zeros.

    Returns
    -------
    Flat numbers (N,) of the pixels that the filter takes anything but zero to, and the smoothed values there.
    """
    padded = np.pad(image, RADIUS_PX, mode="symmetric" if mode == "reflect" else "constant")
    # First along columns, as SciPy does: rows beyond the border are not needed any more, columns are.
    by_columns = _reached(padded != 0, 0)
    by_both = _reached(by_columns, 1)
    found = np.flatnonzero(by_both)
    if found.size > MAX_SPARSE_FRACTION * image.size:
        return found, smoothed(image, mode).ravel().take(found)
    half: Floats = np.zeros(by_columns.shape)
    places = np.flatnonzero(by_columns)
    # A pixel has the same flat number as the first row that its column's filter takes in: rows are as long.
    half.reshape(-1)[places] = _weighted(padded, places, padded.shape[1])
    rows, columns = np.divmod(found, image.shape[1])
    return found, _weighted(half, rows * half.shape[1] + columns, 1)


def smoothed(image: Floats, mode: Mode = "reflect") -> Floats:
    """Return an image (H, W) smoothed over `CONTOUR_SIGMA_PX` by SciPy.

    Rows lie an odd number of cache lines apart. Where they lie a power of two apart, as those of most films
    do, the values of a column displace each other from the cache, and filtering takes twice the time.
    """
    height, width = image.shape
    lines = -(-width // CACHE_LINE_VALUES) | 1
    given: Floats = np.empty((height, lines * CACHE_LINE_VALUES))[:, :width]
    found: Floats = np.empty((height, lines * CACHE_LINE_VALUES))[:, :width]
    given[:] = image
    gaussian_filter(given, CONTOUR_SIGMA_PX, output=found, mode=mode, truncate=SIGMAS)
    return found


def _reached(marked: Mask, axis: int) -> Mask:
    """Return the pixels that lie within `RADIUS_PX` of a marked one along an axis, without a border."""
    width, span = 2 * RADIUS_PX + 1, 1
    while span < width:
        # Each step joins two spans of pixels, so that there are few passes over the image.
        step = min(span, width - span)
        marked = marked[:-step] | marked[step:] if axis == 0 else marked[:, :-step] | marked[:, step:]
        span += step
    return marked


def _weighted(values: Floats, begins: Indices, stride: int) -> Floats:
    """Return sums of values, weighted as along a line of SciPy's filter, in its order.

    Parameters
    ----------
    values
        Values of any shape.
    begins
        (N,) flat numbers of the first value of each sum.
    stride
        Difference of the flat numbers of neighboring values along the line.
    """
    flat = values.reshape(-1)

    def along(distance: int) -> Floats:
        return flat[(RADIUS_PX + distance) * stride :].take(begins)

    weights = _weights()
    found = along(0) * weights[0]
    for distance in range(RADIUS_PX, 0, -1):
        both = along(-distance)
        both += along(distance)
        both *= weights[distance]
        found += both
    return found


@lru_cache(maxsize=1)
def _weights() -> tuple[float, ...]:
    """Return the weights of SciPy's filter by distance: what it makes of a single one."""
    one = np.zeros(2 * RADIUS_PX + 1)
    one[RADIUS_PX] = 1.0
    found = gaussian_filter1d(one, CONTOUR_SIGMA_PX, mode="constant", truncate=SIGMAS)
    return tuple(found[RADIUS_PX:].tolist())
