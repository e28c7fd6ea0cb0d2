"""What is judged pixel by pixel, in bands of rows: small enough for a processor's cache."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from xfrustum.scenes.model.hogel_image import HogelImage

Judged = TypeVar("Judged")

BAND_PIXELS = 1 << 16
"""Of a band: a plane in double precision takes 512 kB, and a processor's caches hold a few. In smaller bands
threads wait for each other: NumPy lets go of Python's lock only while it computes."""

ALONE_PIXELS = 1 << 20
"""Of an image: up to here bands follow each other. Smaller images come in numbers, each with a thread of
its own, and that is less to wait for."""


def in_bands(
    truth: HogelImage, raster: HogelImage, judge: Callable[[HogelImage, HogelImage, slice], Judged]
) -> list[Judged]:
    """Judge two images of one size in bands of rows, from the top.

    Parameters
    ----------
    truth, raster
        Of the same size.
    judge
        Takes the two bands and their rows; what it finds in one pixel depends on no other.
    """
    height, width = truth.triangle.shape
    size = max(1, BAND_PIXELS // max(1, width))
    bands = [slice(start, min(start + size, height)) for start in range(0, height, size)]

    def judged(rows: slice) -> Judged:
        return judge(truth.rows(rows), raster.rows(rows), rows)

    if height * width <= ALONE_PIXELS:
        return [judged(rows) for rows in bands]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(judged, bands))
