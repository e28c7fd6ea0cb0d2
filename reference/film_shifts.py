"""Shifts of surface points on a film: where they belong, minus where an image shows them."""

from __future__ import annotations

from functools import lru_cache
from importlib import import_module

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.certify.processors import compiled
from xfrustum.reference.lines.lines import Pencil, places_off_center
from xfrustum.scenes.model.scene import read_only

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
    found = np.empty(pencil.resolution[0] * pencil.resolution[1], dtype=np.complex128)
    if compiled():
        # Imported only here, because Dr.Jit's arrays need the LLVM that `compiled` has chosen.
        shifts = import_module("xfrustum.reference.film_shifts_jit").compiled_shifts
        found.real, found.imag = shifts(position, pencil)
        return found
    found.fill(complex(np.nan, np.nan))
    rows = position.reshape(-1, 3)
    pixels = np.flatnonzero(np.isfinite(rows).all(axis=1) & (rows[:, 2] != 0))
    x, y, z = np.ascontiguousarray(rows.take(pixels, axis=0).T, dtype=np.float64)
    shift = np.empty(len(pixels), dtype=np.complex128)
    shift.real, shift.imag = places_off_center(x, y, z, pencil)
    found[pixels] = shift - _centers(pencil.resolution).take(pixels)
    return found


@lru_cache(maxsize=1)
def _centers(resolution: tuple[int, int]) -> Vectors:
    """Return columns plus i times rows of the centers of all pixels, (H W,), read-only."""
    width, height = resolution
    return np.asarray(read_only(np.add.outer(1j * np.arange(height), np.arange(width)).ravel()))
