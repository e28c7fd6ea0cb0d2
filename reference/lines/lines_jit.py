"""Lines of pixels and vectors of pixels on Dr.Jit, one lane for each pixel."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import drjit as dr
from numpy.typing import NDArray

from xfrustum.reference.devices.arithmetic_jit import (
    Array3f,
    Array3f64,
    Float32,
    Float64,
    UInt32,
    on_device,
)
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.room import values_with_room


def pixel_directions(pencil: Pencil, rows: range) -> list[Any]:
    """Return the three coordinates of d of every pixel in some rows, row by row; see `Pencil.directions`."""
    lane = dr.arange(UInt32, len(rows) * pencil.resolution[0])
    width, start = dr.opaque(UInt32, pencil.resolution[0]), dr.opaque(UInt32, rows.start)
    # A quotient in doubles: it is off by less than the half that is added, and faster than of integers.
    row = UInt32(dr.floor((Float64(lane) + 0.5) / Float64(width)))
    dx, dy = on_device(pencil.dx), on_device(pencil.dy)
    return [dr.gather(Float64, dx, lane - row * width), dr.gather(Float64, dy, row + start), Float64(-1.0)]


_VECTORS = {Float32: Array3f, Float64: Array3f64}
"""Type of three coordinates, by the type of one."""


def read_interleaved(array: Any, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return what `interleaved` made as an array of NumPy of a shape, with room behind its end."""
    values: NDArray[Any] = array.numpy()[: math.prod(shape)]
    return values.reshape(shape)


def interleaved(coordinates: Sequence[Any], size: int) -> Any:
    """Return coordinates of all lanes side by side for each lane, as NumPy's arrays of vectors have them.

    There is room behind the last coordinate, so that kernels later read the array in place;
    `read_interleaved` leaves the room out.

    There are three coordinates, or one. They are scattered together: of several scatters into one array
    Dr.Jit makes a kernel each, and every one of these computes again all that the coordinates have in common.
    """
    kind = type(coordinates[0])
    found = dr.empty(kind, values_with_room(size) * len(coordinates))
    together = coordinates[0] if len(coordinates) == 1 else _VECTORS[kind](*coordinates)
    dr.scatter(found, together, dr.arange(UInt32, size))
    return found
