"""Shifts of surface points on a film, compiled by Dr.Jit: one lane for each pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.devices.arithmetic_jit import (
    JIT,
    Float64,
    UInt32,
    doubles_of,
    length,
    on_device,
)
from xfrustum.reference.devices.strict_jit import strict_arithmetic
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats, Indices


@dataclass(frozen=True, kw_only=True, eq=False)
class _Film:
    """A film as lanes see it: constants of its pencil, and each lane's pixel, column and row."""

    center: list[Any]
    shear: list[Any]
    half: list[Any]
    sides: list[Any]
    pixel: Any
    column: Any
    row: Any

    @classmethod
    def of(cls, pencil: Pencil, pixel: Any) -> _Film:
        center, shear, half = map(JIT.constants, (pencil.center, pencil.shear, pencil.half_extent))
        sides = JIT.constants(pencil.resolution)
        # A product with 1/W is off by less than the half that is added, and faster than a quotient.
        row = dr.floor((Float64(pixel) + 0.5) * JIT.constants([1 / pencil.resolution[0]])[0])
        column = Float64(pixel) - row * sides[0]
        return cls(center=center, shear=shear, half=half, sides=sides, pixel=pixel, column=column, row=row)

    def shifts(self, position: NDArray[np.floating]) -> list[Any]:
        """Return columns and rows of `film_shifts` of the lanes' pixels, NaN where no surface is shown."""
        x, y, z = doubles_of(position.reshape(-1, 3))(self.pixel)
        depth = -(z - self.center[2])
        across, down = (
            ((value - self.center[axis]) / depth - self.shear[axis]) / self.half[axis]
            for axis, value in enumerate((x, y))
        )
        shown = dr.isfinite(x) & dr.isfinite(y) & dr.isfinite(z) & (z != 0)
        column = _place(across + 1, self.sides[0]) - self.column
        return [
            dr.select(shown, value, np.nan) for value in (column, _place(1 - down, self.sides[1]) - self.row)
        ]


def compiled_shifts(position: NDArray[np.floating], pencil: Pencil) -> tuple[Floats, Floats]:
    """Return columns and rows (H W,) of `film_shifts`, by the same operations in the same order."""
    with strict_arithmetic():
        pixel = dr.arange(UInt32, pencil.resolution[0] * pencil.resolution[1])
        columns, rows = _Film.of(pencil, pixel).shifts(position)
        dr.eval(columns, rows)
        return columns.numpy(), rows.numpy()


def compiled_steps(
    positions: Sequence[NDArray[np.floating]], pencil: Pencil, first: NDArray[np.complex128]
) -> list[NDArray[Any]]:
    """Return the pixels and the lengths (H W,) of `film_steps`, by the same operations in the same order."""
    with strict_arithmetic():
        film = _Film.of(pencil, dr.arange(UInt32, len(first)))
        given = on_device(first.view(np.float64))
        begun = [dr.gather(Float64, given, film.pixel * 2 + part) for part in (0, 1)]
        lengths = _lengths([begun, *(film.shifts(position) for position in positions[1:])])
        known = dr.isfinite(begun[0]) & dr.isfinite(begun[1])
        for one in lengths:
            known &= dr.isfinite(one)
        return _read([known, *(dr.select(known, one, 0.0) for one in lengths)])


def some_compiled_steps(
    positions: Sequence[NDArray[np.floating]], pencil: Pencil, pixels: Indices
) -> list[NDArray[Any]]:
    """Return the lengths (N,) of `some_film_steps`, by the same operations in the same order."""
    with strict_arithmetic():
        film = _Film.of(pencil, UInt32(on_device(pixels)))
        return _read(_lengths([film.shifts(position) for position in positions]))


def _lengths(shifts: Sequence[Sequence[Any]]) -> list[Any]:
    """Return the lengths of the differences of neighboring shifts."""
    return [
        length(*(new - old for old, new in zip(before, after, strict=True)))
        for before, after in pairwise(shifts)
    ]


def _read(values: Sequence[Any]) -> list[NDArray[Any]]:
    """Evaluate values, and return copies, so that no array of Dr.Jit is kept."""
    dr.eval(*values)
    return [one.numpy().copy() for one in values]


def _place(along: Any, side: Any) -> Any:
    """Return the place in pixels of what lies so far along a side of the film, which is two long."""
    return along * side / 2 - 0.5
