"""Bands of rows, small enough for a processor's cache, in which two images are judged pixel by pixel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from xfrustum.reference.devices.threads import worker_count
from xfrustum.scenes.model.hogel_image import HogelImage

Judged = TypeVar("Judged")
Part = TypeVar("Part")

BAND_PIXELS = 1 << 16
"""Largest number of pixels of a band: one number for each takes 512 kB in double precision, and the caches of
a processor hold a few such arrays. In smaller bands threads wait for each other: NumPy releases Python's lock
only while it computes."""

MAX_SERIAL_PIXELS = 1 << 20
"""Largest number of pixels of an image whose bands are judged one after the other. Many of these are judged
at a time, each in a thread of its own, and threads for their bands would only wait for each other."""


def in_bands(
    truth: HogelImage, raster: HogelImage, judge: Callable[[HogelImage, HogelImage, slice], Judged]
) -> list[Judged]:
    """Judge two images of one size in bands of rows, from the top.

    Parameters
    ----------
    truth, raster
        Images of one size.
    judge
        Function of a band of each image and their rows; its finding for a pixel depends on no other pixel.
    """
    height, width = truth.triangle.shape
    size = max(1, BAND_PIXELS // max(1, width))
    bands = [slice(start, min(start + size, height)) for start in range(0, height, size)]

    def judged(rows: slice) -> Judged:
        return judge(truth.rows(rows), raster.rows(rows), rows)

    return each_part(judged, bands, height * width)


def each_part(judge: Callable[[Part], Judged], parts: Sequence[Part], pixels: int) -> list[Judged]:
    """Judge the parts of an image, side by side where they have many pixels together."""
    if pixels <= MAX_SERIAL_PIXELS:
        return [judge(part) for part in parts]
    with ThreadPoolExecutor(worker_count()) as pool:
        return list(pool.map(judge, parts))
