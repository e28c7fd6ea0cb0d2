"""Images in bands of rows, which bound the memory that making them takes."""

from __future__ import annotations

from collections.abc import Iterator

BAND_PIXELS = 1 << 19
"""Pixels of a band of an image that is written band by band, `PIXEL_BYTES` each: of any size at all."""

PIXEL_BYTES = 400
"""Approximate memory for each pixel of a band that is being made."""

WHOLE_PIXELS = 1 << 22
"""Pixels of a band of an image that is kept whole: to join smaller bands would take longer than to make them.
A band adds some 80 bytes a pixel to the image's own 70."""


def bands(width: int, rows: range, pixels: int = BAND_PIXELS) -> Iterator[range]:
    """Yield rows of an image in order, in bands of at most so many pixels unless a row has more."""
    size = max(1, pixels // width)
    for start in range(rows.start, rows.stop, size):
        yield range(start, min(start + size, rows.stop))
