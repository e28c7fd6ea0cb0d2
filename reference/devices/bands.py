"""Images in bands of rows, made on all processors, in bounded memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from xfrustum.reference.devices.threads import worker_count

Band = TypeVar("Band")

BAND_PIXELS = 1 << 19
"""Pixels decided at once: bounds the memory, `PIXEL_BYTES` each, whatever the image's size."""

PIXEL_BYTES = 400
"""Memory for each pixel of the bands under way, about."""

BUSY_PIXELS = 1 << 15
"""A smaller band costs more to start than another processor saves."""

UNDIVIDED_PIXELS = 1 << 18
"""Deciding alone runs compiled on all processors anyway: smaller bands only add launches."""


def in_parallel(
    band: Callable[[range], Band],
    resolution: tuple[int, int],
    *,
    rows: range | None = None,
    least_pixels: int = 1,
) -> Iterator[Band]:
    """Yield an image's bands in order, made on all processors; none but the last is smaller than asked.

    Parameters
    ----------
    band
        Makes the band of some rows.
    resolution
        W, H in pixels.
    rows
        Those to be made; all by default.
    least_pixels
        How small a band may be.
    """
    rows = range(resolution[1]) if rows is None else rows
    workers = worker_count()
    size = rows_at_once(resolution[0], len(rows), least_pixels)
    bands = [rows[start : start + size] for start in range(0, len(rows), size)]
    if len(bands) == 1:
        yield band(bands[0])
        return
    with ThreadPoolExecutor(workers) as pool:
        # No more bands under way than workers, so that a slow reader bounds the memory.
        for start in range(0, len(bands), workers):
            yield from pool.map(band, bands[start : start + workers])


def rows_at_once(width: int, rows: int, least_pixels: int = 1) -> int:
    """Return how many of an image's rows make a band.

    Parameters
    ----------
    width
        Pixels of a row.
    rows
        That are to be made.
    least_pixels
        How small a band may be.
    """
    share = -(-rows // worker_count())
    return max(1, min(BAND_PIXELS // width, max(share, -(-least_pixels // width))))
