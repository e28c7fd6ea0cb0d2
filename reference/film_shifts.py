"""Shifts of surface points on a film: where they belong, minus where an image shows them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from importlib import import_module
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.certify.processors import compiled
from xfrustum.reference.lines.lines import Pencil, places_off_center
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.scene import read_only
from xfrustum.scenes.room import picked, with_room

Vectors = NDArray[np.complex128]
"""Vectors on a film, columns plus i times rows: NumPy is several times slower along rows of two numbers."""


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
    if compiled():
        # Imported only here, because Dr.Jit's arrays need the LLVM that `compiled` has chosen.
        shifts = import_module("xfrustum.reference.film_shifts_jit").compiled_shifts
        found = with_room((pencil.resolution[0] * pencil.resolution[1],), np.complex128)
        found.real, found.imag = shifts(position, pencil)
        return found
    return _numpy_shifts(position.reshape(-1, 3), pencil, _centers(pencil.resolution))


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
    if compiled():
        steps = import_module("xfrustum.reference.film_shifts_jit").compiled_steps
        known, *lengths = steps(positions, pencil, first)
        return known, lengths
    centers = _centers(pencil.resolution)
    shifts = [first, *(_numpy_shifts(one.reshape(-1, 3), pencil, centers) for one in positions[1:])]
    lengths = [np.abs(after - before) for before, after in pairwise(shifts)]
    known = np.logical_and.reduce([np.isfinite(first), *map(np.isfinite, lengths)])
    return known, [np.where(known, one, 0.0) for one in lengths]


def some_film_steps(
    positions: Sequence[NDArray[np.floating]], pencil: Pencil, pixels: Indices
) -> list[Floats]:
    """Return the lengths of `film_steps` at some pixels.

    Parameters
    ----------
    positions, pencil
        Surface points and lines as for `film_steps`.
    pixels
        (N,) flat numbers of the pixels that are asked about.

    Returns
    -------
    (N,) lengths in pixels; not finite where either image shows no point, or where its shift is beyond all
    numbers.
    """
    if compiled() and len(pixels):
        steps = import_module("xfrustum.reference.film_shifts_jit").some_compiled_steps
        return list(steps(positions, pencil, pixels))
    centers = _centers(pencil.resolution).take(pixels)
    shifts = [
        _numpy_shifts(picked(position.reshape(-1, 3), pixels), pencil, centers) for position in positions
    ]
    return [np.abs(after - before) for before, after in pairwise(shifts)]


def _numpy_shifts(rows: NDArray[np.floating], pencil: Pencil, centers: Vectors) -> Vectors:
    """Return the shifts (N,) of surface points (N, 3), given the centers of the pixels that show them."""
    found = np.full(len(rows), complex(np.nan, np.nan))
    shown = np.flatnonzero(np.isfinite(rows).all(axis=1) & (rows[:, 2] != 0))
    x, y, z = np.ascontiguousarray(rows.take(shown, axis=0).T, dtype=np.float64)
    shift = np.empty(len(shown), dtype=np.complex128)
    shift.real, shift.imag = places_off_center(x, y, z, pencil)
    found[shown] = shift - centers.take(shown)
    return found


@lru_cache(maxsize=1)
def _centers(resolution: tuple[int, int]) -> Vectors:
    """Return columns plus i times rows of the centers of all pixels, (H W,), read-only."""
    width, height = resolution
    return np.asarray(read_only(np.add.outer(1j * np.arange(height), np.arange(width)).ravel()))
