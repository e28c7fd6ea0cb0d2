"""Pictures on surfaces: decoded from sRGB, then bilinear between texel centers, repeated, no mipmaps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from xfrustum.reference.devices.arithmetic import Arithmetic
from xfrustum.scenes.arrays import Bytes, Numbers

_SRGB = np.arange(256) / 255.0
LINEAR = np.where(_SRGB <= 0.04045, _SRGB / 12.92, ((_SRGB + 0.055) / 1.055) ** 2.4)
"""Linear light of each 8-bit sRGB value (IEC 61966-2-1)."""


class Textures:
    """The pictures of a scene in one table, one texel after the other.

    Parameters
    ----------
    by
        Arithmetic of the points.
    textures
        (H, W, 4) sRGB each, row 0 at the top; alpha is ignored.
    texture_of_triangle
        (F,) index of a picture, negative for none.
    """

    def __init__(self, by: Arithmetic, textures: Sequence[Bytes], texture_of_triangle: Numbers) -> None:
        self._by = by
        packed = [np.ascontiguousarray(texture).view("<u4").ravel() for texture in textures]
        self._texel = by.table(np.concatenate([*packed, np.zeros(1)]).astype(np.uint32))
        starts = np.cumsum([0, *(len(part) for part in packed)])
        # Start, height and width; the row after the last stands for a scene without pictures.
        sizes = [texture.shape[:2] for texture in textures]
        self._sizes = by.table(
            np.array([(start, *size) for start, size in zip(starts, [*sizes, (1, 1)], strict=True)], np.int32)
        )
        self._of_triangle = by.table(texture_of_triangle.astype(np.int32))
        self._linear = by.table(LINEAR)

    def color(self, triangle: Any, uv: Sequence[Any]) -> list[Any]:
        """Return the linear RGB of points on triangles; 1 where a triangle has no picture.

        Parameters
        ----------
        triangle
            Numbers of the triangles.
        uv
            Coordinates in units of the picture: u to the right, v up, repeated beyond 0 to 1.
        """
        by = self._by
        (number,) = self._of_triangle(triangle)
        textured = number >= 0
        start, height, width = self._sizes(by.maximum(number, 0))

        def texel(row: Any, column: Any) -> list[Any]:
            place = start + repeated(by, row, height) * width + repeated(by, column, width)
            (code,) = self._texel(place)
            return [self._linear((code >> bits) & 255)[0] for bits in (0, 8, 16)]

        u, v = (by.select(textured, coordinate, 0.0) for coordinate in uv)
        found = bilinear(by, texel, (1.0 - v) * height, u * width)
        return [by.select(textured, channel, 1.0) for channel in found]


def bilinear(by: Arithmetic, texel: Callable[[Any, Any], list[Any]], down: Any, right: Any) -> list[Any]:
    """Return the channels between the centers of the four texels about each point.

    Parameters
    ----------
    by
        Arithmetic of the points.
    texel
        Function that returns the channels of the texels in rows and columns, whole numbers as doubles,
        which may lie outside the picture.
    down, right
        Places in texels from the picture's top left corner; texel centers lie at halves.
    """
    row, column = by.floor(down - 0.5), by.floor(right - 0.5)
    below, beside = down - 0.5 - row, right - 0.5 - column

    def mixed(one: list[Any], other: list[Any], share: Any) -> list[Any]:
        return [(1.0 - share) * a + share * b for a, b in zip(one, other, strict=True)]

    upper = mixed(texel(row, column), texel(row, column + 1.0), beside)
    lower = mixed(texel(row + 1.0, column), texel(row + 1.0, column + 1.0), beside)
    return mixed(upper, lower, below)


def repeated(by: Arithmetic, index: Any, size: Any) -> Any:
    """Return whole numbers, given as doubles, as indices modulo a size."""
    # So far out that the quotient is rounded up, a number may come out just below zero.
    return by.whole(bounded(by, index - size * by.floor(index / size), size - 1.0))


def bounded(by: Arithmetic, index: Any, last: Any) -> Any:
    """Return whole numbers from 0 to a last one, 0 in place of NaN: nothing is looked up outside a table."""
    index = by.select(index > 0.0, index, 0.0)
    return by.select(index < last, index, last)
