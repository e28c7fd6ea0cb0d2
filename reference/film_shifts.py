"""Shifts of surface points on a film: where they belong, minus where an image shows them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.lines.lines import Pencil, places_off_center
from xfrustum.scenes.arrays import Floats, Indices, Mask

Vectors = NDArray[np.complex128]
"""Vectors on a film, columns plus i times rows."""


def film_shifts(position: NDArray[np.floating], pencil: Pencil) -> Vectors:
    """Return by how far an image has moved the surface points that it shows.

    Parameters
    ----------
    position
        (H, W, 3) surface points in scene units, not finite where there is none.
    pencil
        Lines of the film, through a point in the plate.

    Returns
    -------
    (H W,) place where each point belongs minus the center of the pixel that shows it, in pixels; rows count
    down. NaN where no surface is shown and where it lies in the plate.
    """
    return _shifts(position, pencil, np.arange(pencil.resolution[0] * pencil.resolution[1]))


def film_steps(
    positions: Sequence[NDArray[np.floating]], pencil: Pencil, first: Vectors
) -> tuple[Mask, list[Floats]]:
    """Return by how far each of several images moves what it shows beyond the image before it.

    Parameters
    ----------
    positions
        (H, W, 3) surface points of each image, as for `film_shifts`.
    pencil
        Lines of the film, through a point in the plate.
    first
        (H W,) `film_shifts` of the first image.

    Returns
    -------
    (H W,) pixels at which all lengths are finite numbers: every image shows a point, whose shift is one.
    For each image but the first, (H W,) lengths in pixels of the differences of the images' shifts, zero at
    other pixels.
    """
    shifts = [first, *(film_shifts(one, pencil) for one in positions[1:])]
    lengths = [np.abs(after - before) for before, after in pairwise(shifts)]
    known = np.logical_and.reduce([np.isfinite(first), *map(np.isfinite, lengths)])
    return known, [np.where(known, one, 0.0) for one in lengths]


def some_film_steps(
    positions: Sequence[NDArray[np.floating]], pencil: Pencil, pixels: Indices
) -> list[Floats]:
    """Return the lengths of `film_steps` at some pixels (N,), not finite where a shift is unknown."""
    shifts = [_shifts(position, pencil, pixels) for position in positions]
    return [np.abs(after - before) for before, after in pairwise(shifts)]


def _shifts(position: NDArray[np.floating], pencil: Pencil, pixels: Indices) -> Vectors:
    rows = position.reshape(-1, 3)[pixels]
    found = np.full(len(rows), complex(np.nan, np.nan))
    shown = np.flatnonzero(np.isfinite(rows).all(axis=1) & (rows[:, 2] != 0))
    x, y, z = np.ascontiguousarray(rows[shown].T, dtype=np.float64)
    columns, lines = places_off_center(x, y, z, pencil)
    row, column = np.divmod(pixels[shown], pencil.resolution[0])
    found[shown] = (columns - column) + 1j * (lines - row)
    return found
