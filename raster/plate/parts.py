"""Parts of films that are wanted: drawn and read back alone, with the pixels of whole films."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from xfrustum.raster.plate.clusters import WHOLE_FILM
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.plate_content import FilmPart
from xfrustum.scenes.plate.plate import Aperture

Parts = Mapping[tuple[int, int], FilmPart]
"""Part of the film that is wanted, by column and row of the hogel."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Wanted:
    """What is wanted of the hogels of one submission.

    Attributes
    ----------
    windows
        (L, 4) least and largest u and v of each part, with its pixels' borders; see `clusters.clip_planes`.
    box
        First column, first row from the bottom, width and height in pixels of what holds all parts; None for
        whole films.
    """

    windows: Floats
    box: tuple[int, int, int, int] | None

    @classmethod
    def of(cls, apertures: Sequence[Aperture], parts: Parts | None, size: tuple[int, int]) -> Self:
        """Return what is wanted of some hogels whose films have a size W, H; all where `parts` is None."""
        if parts is None:
            return cls(windows=WHOLE_FILM, box=None)
        width, height = size
        windows = np.empty((len(apertures), 4))
        columns: list[int] = []
        rows: list[int] = []
        for window, aperture in zip(windows, apertures, strict=True):
            part = parts[aperture.index]
            (left, right), (top, bottom) = part.columns, part.rows
            window[:2] = 2 * left / width - 1, 2 * (right + 1) / width - 1
            window[2:] = 1 - 2 * (bottom + 1) / height, 1 - 2 * top / height
            columns += part.columns
            rows += part.rows
        box = (
            min(columns),
            height - 1 - max(rows),
            max(columns) - min(columns) + 1,
            max(rows) - min(rows) + 1,
        )
        return cls(windows=windows, box=box)


WHOLE = Wanted(windows=WHOLE_FILM, box=None)
"""Whole films."""
