"""Tables and pictures on the device that computes light paths.

They are Dr.Jit's arrays or, in Mitsuba's scalar variant, entries that are picked one at a time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.llvm import mitsuba_backend
from xfrustum.reference.memory import padded
from xfrustum.reference.shading.surroundings import LINEAR
from xfrustum.scenes.appearance.light import Environment
from xfrustum.scenes.arrays import Bytes, Numbers


class Table:
    """Numbers, or rows of three, looked up by index.

    Dr.Jit gathers from NumPy's memory. The scalar variant of Mitsuba has no gather, and indexes NumPy's
    array.
    """

    def __init__(self, entries: NDArray[Any]) -> None:
        self._entries = padded(entries, entries.dtype)
        self._array = None if mitsuba_backend().scalar else self._on_device()

    def _on_device(self) -> Any:
        mi = mitsuba_backend().mitsuba
        kinds = {"float64": mi.Float64, "float32": mi.Float32, "int32": mi.Int32, "uint32": mi.UInt32}
        return kinds[str(self._entries.dtype)](self._entries)

    def number(self, index: Any) -> Any:
        """Return an entry; the index counts all entries of all rows."""
        if mitsuba_backend().scalar:
            return self._entries[index].item()
        return mitsuba_backend().drjit.gather(type(self._array), self._array, index)

    def vector(self, row: Any) -> Any:
        """Return a row of three as a vector of doubles."""
        mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
        if mitsuba_backend().scalar:
            return mi.Vector3d(*self._entries[3 * row : 3 * row + 3].tolist())
        kind = mi.Vector3f if self._entries.dtype == np.float32 else mi.Vector3d
        return mi.Vector3d(dr.gather(kind, self._array, row))


class Textures:
    """All pictures in one table, four bytes a texel.

    Parameters
    ----------
    textures
        (H, W, 4) uint8 sRGB each, row 0 at the top.
    texture_of_triangle
        (F,) index of a picture, negative for none.
    """

    def __init__(self, textures: tuple[Bytes, ...], texture_of_triangle: Numbers) -> None:
        packed = [np.ascontiguousarray(texture).view("<u4").ravel() for texture in textures]
        self._texels = Table(np.concatenate(packed).astype(np.uint32, copy=False))
        self._starts = Table(np.cumsum([0, *(len(part) for part in packed[:-1])]).astype(np.int32))
        self._heights, self._widths = (
            Table(np.array([texture.shape[axis] for texture in textures], dtype=np.int32)) for axis in (0, 1)
        )
        self._of_triangle = Table(texture_of_triangle.astype(np.int32))
        self._linear = Table(LINEAR)

    def color(self, triangle: Any, uv: Any) -> Any:
        """Return linear RGB at texture coordinates, x and y of a vector; 1 where there is no texture."""
        mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
        number = self._of_triangle.number(triangle)
        textured = number >= 0
        number = dr.maximum(number, 0)
        start, width, height = (t.number(number) for t in (self._starts, self._widths, self._heights))

        def texel(row: Any, column: Any) -> Any:
            code = self._texels.number(start + _repeated(row, height) * width + _repeated(column, width))
            return mi.Vector3d(*(self._linear.number((code >> bits) & 255) for bits in (0, 8, 16)))

        u, v = dr.select(textured, uv.x, 0.0), dr.select(textured, uv.y, 0.0)
        found = _between_texels(texel, (1.0 - v) * mi.Float64(height), u * mi.Float64(width))
        return dr.select(textured, found, mi.Vector3d(1.0))


class Surroundings:
    """The environment by direction."""

    def __init__(self, environment: Environment) -> None:
        self._height, self._width = environment.radiance.shape[:2]
        self._strength = environment.strength
        self._texels = Table(environment.radiance)

    def radiance(self, direction: Any) -> Any:
        """Return the environment's linear RGB in a direction, of any length."""
        dr = mitsuba_backend().drjit

        def texel(row: Any, column: Any) -> Any:
            inside = dr.clip(row, 0.0, self._height - 1.0)
            index = mitsuba_backend().mitsuba.Int32 if not mitsuba_backend().scalar else int
            return self._texels.vector(index(inside) * self._width + _repeated(column, self._width))

        around = dr.atan2(direction.x, -direction.z) / (2.0 * dr.pi) + 0.5
        down = 0.5 - dr.atan2(direction.y, dr.hypot(direction.x, direction.z)) / dr.pi
        return self._strength * _between_texels(texel, down * self._height, around * self._width)


def _repeated(index: Any, size: Any) -> Any:
    """Return a whole number, given as a double, as an index modulo a size."""
    mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
    count = mi.Float64(size)
    whole = index - count * dr.floor(index / count)
    return int(whole) if mitsuba_backend().scalar else mi.Int32(whole)


def _between_texels(texel: Callable[[Any, Any], Any], down: Any, right: Any) -> Any:
    """Mix the four texels whose centers, at halves, enclose a place; `texel` takes whole rows and columns."""
    dr = mitsuba_backend().drjit
    row, column = dr.floor(down - 0.5), dr.floor(right - 0.5)
    below, beside = down - 0.5 - row, right - 0.5 - column
    upper = dr.lerp(texel(row, column), texel(row, column + 1.0), beside)
    lower = dr.lerp(texel(row + 1.0, column), texel(row + 1.0, column + 1.0), beside)
    return dr.lerp(upper, lower, below)
