"""Images in bands of rows, made on all processors, in bounded memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from xfrustum.reference.devices.threads import worker_count

Band = TypeVar("Band")

BAND_PIXELS = 1 << 19
"""Largest number of pixels in a band. This bounds the memory, `PIXEL_BYTES` each, for images of any size."""

PIXEL_BYTES = 400
"""Approximate memory for each pixel of the bands that are being made."""

BUSY_PIXELS = 1 << 15
"""Pixels of a band that keep a processor busy: a smaller one costs more to start than it saves."""

WHOLE_PIXELS = 1 << 22
"""Pixels of a band of an image that is kept whole, made by kernels that use all processors. To join smaller
bands would take longer than to make them. A band adds some 80 bytes a pixel to the image's own 70."""

UNDIVIDED_PIXELS = 1 << 18
"""Pixels of a band that is only decided, compiled, on all processors: smaller bands only add launches."""


def in_parallel(
    band: Callable[[range], Band],
    resolution: tuple[int, int],
    *,
    rows: range | None = None,
    least_pixels: int = 1,
) -> Iterator[Band]:
    """Yield an image's bands in order, made on all processors.

    Parameters
    ----------
    band
        Function that makes the band of some rows.
    resolution
        W, H in pixels.
    rows
        Rows that are made; None for all.
    least_pixels
        Smallest number of pixels in a band; the last one may be smaller.
    """
    rows = range(resolution[1]) if rows is None else rows
    workers = worker_count()
    size = rows_at_once(resolution[0], len(rows), least_pixels)
    bands = [rows[start : start + size] for start in range(0, len(rows), size)]
    if len(bands) == 1:
        yield band(bands[0])
        return
    with ThreadPoolExecutor(workers) as pool:
        # At most as many bands as workers are made at once, so that a slow reader bounds the memory.
        for start in range(0, len(bands), workers):
            yield from pool.map(band, bands[start : start + workers])


def in_turn(band: Callable[[range], Band], resolution: tuple[int, int]) -> Iterator[Band]:
    """Yield an image's bands in order, each of at most `WHOLE_PIXELS` unless a row has more."""
    width, height = resolution
    size = max(1, WHOLE_PIXELS // width)
    for start in range(0, height, size):
        yield band(range(start, min(start + size, height)))


def rows_at_once(width: int, rows: int, least_pixels: int = 1) -> int:
    """Return the number of an image's rows that make a band.

    Parameters
    ----------
    width
        Pixels of a row.
    rows
        Number of rows that are made.
    least_pixels
        Smallest number of pixels in a band.
    """
    share = -(-rows // worker_count())
    return max(1, min(BAND_PIXELS // width, max(share, -(-least_pixels // width))))
