"""Pictures that surfaces show: textures, and the environment that they reflect.

Textures are decoded from sRGB, then filtered bilinearly between texel centers and repeated, with no mipmaps.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from xfrustum.reference.backend import Int32, constants, dr, recording, table, vectors_on_device
from xfrustum.scenes.appearance.appearance import Environment
from xfrustum.scenes.arrays import Bytes, Floats, Numbers

_SRGB = np.arange(256) / 255.0
LINEAR = np.where(_SRGB <= 0.04045, _SRGB / 12.92, ((_SRGB + 0.055) / 1.055) ** 2.4)
"""Linear light of each 8-bit sRGB value (IEC 61966-2-1)."""


class Textures:
    """The pictures of a scene in one table, one texel after the other.

    Each is (H, W, 4) sRGB, row 0 at the top; alpha is ignored. Triangles (F,) have an index, negative for
    none.
    """

    def __init__(self, textures: Sequence[Bytes], texture_of_triangle: Numbers) -> None:
        packed = [np.ascontiguousarray(texture).view("<u4").ravel() for texture in textures]
        self._texel = table(np.concatenate([*packed, np.zeros(1)]).astype(np.uint32))
        starts = np.cumsum([0, *(len(part) for part in packed)])
        # Start, height and width; the row after the last stands for a scene without pictures.
        sizes = [texture.shape[:2] for texture in textures]
        self._sizes = table(
            np.array([(start, *size) for start, size in zip(starts, [*sizes, (1, 1)], strict=True)], np.int32)
        )
        self._of_triangle = table(texture_of_triangle.astype(np.int32))
        self._linear = table(LINEAR)

    def color(self, triangle: Any, uv: Sequence[Any]) -> list[Any]:
        """Return linear RGB of points at `uv`, v up, repeated beyond 0 to 1; 1 where there is no picture."""
        (number,) = self._of_triangle(triangle)
        textured = number >= 0
        start, height, width = self._sizes(dr.maximum(number, 0))

        def texel(row: Any, column: Any) -> list[Any]:
            place = start + _repeated(row, height) * width + _repeated(column, width)
            (code,) = self._texel(place)
            return [self._linear((code >> bits) & 255)[0] for bits in (0, 8, 16)]

        u, v = (dr.select(textured, coordinate, 0.0) for coordinate in uv)
        found = _bilinear(texel, (1.0 - v) * height, u * width)
        return [dr.select(textured, channel, 1.0) for channel in found]


class Surroundings:
    """An environment by direction."""

    def __init__(self, environment: Environment) -> None:
        height, width = environment.radiance.shape[:2]
        self._texel = table(environment.radiance.reshape(-1, 3))
        self._height, self._width, self._strength = constants((height, width, environment.strength))

    def radiance(self, directions: Sequence[Any]) -> list[Any]:
        """Return the environment's linear RGB in each direction, of any length but zero.

        The map's middle lies toward -z, its top toward +y; +x follows to the right of the middle. Between
        texel centers it is filtered bilinearly: around in longitude, clamped beyond its first and last row.
        """
        x, y, z = directions
        longitude = dr.atan2(x, -z)
        # The arc tangent is exact near the poles, where the arc cosine of y is coarse.
        from_top = dr.atan2(dr.hypot(x, z), y)  # type: ignore[no-untyped-call]

        def texel(row: Any, column: Any) -> list[Any]:
            inside = _bounded(row, self._height - 1.0)
            return self._texel(Int32(inside * self._width) + _repeated(column, self._width))

        right, down = (longitude / (2.0 * np.pi) + 0.5) * self._width, from_top / np.pi * self._height
        return [self._strength * channel for channel in _bilinear(texel, down, right)]


def radiance_toward(environment: Environment, directions: Floats) -> Floats:
    """Return the environment's linear RGB (N, 3) in each direction (N, 3), of any length but zero."""
    if not len(directions):
        return np.zeros((0, 3))
    with recording():
        channels = Surroundings(environment).radiance(vectors_on_device(directions))
        dr.eval(*channels)
        return np.stack([channel.numpy() for channel in channels], axis=-1)


def _bilinear(texel: Callable[[Any, Any], list[Any]], down: Any, right: Any) -> list[Any]:
    """Return the channels between the centers of the four texels about each point.

    `texel` looks up whole rows and columns, as doubles, also outside of the picture. Places count from its
    top left corner; texel centers lie at halves.
    """
    row, column = dr.floor(down - 0.5), dr.floor(right - 0.5)
    below, beside = down - 0.5 - row, right - 0.5 - column

    def mixed(one: list[Any], other: list[Any], share: Any) -> list[Any]:
        return [(1.0 - share) * a + share * b for a, b in zip(one, other, strict=True)]

    upper = mixed(texel(row, column), texel(row, column + 1.0), beside)
    lower = mixed(texel(row + 1.0, column), texel(row + 1.0, column + 1.0), beside)
    return mixed(upper, lower, below)


def _repeated(index: Any, size: Any) -> Any:
    """Return whole numbers, given as doubles, as indices modulo a size."""
    # So far out that the quotient is rounded up, a number may come out just below zero.
    return Int32(_bounded(index - size * dr.floor(index / size), size - 1.0))


def _bounded(index: Any, last: Any) -> Any:
    """Return whole numbers from 0 to a last one, 0 in place of NaN: nothing is looked up outside a table."""
    index = dr.select(index > 0.0, index, 0.0)
    return dr.select(index < last, index, last)
