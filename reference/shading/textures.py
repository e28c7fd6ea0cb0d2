"""Pictures on surfaces: decoded from sRGB, then bilinear between texel centers, repeated, no mipmaps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from xfrustum.scenes.arrays import Bytes, Floats, Indices

_SRGB = np.arange(256) / 255.0
LINEAR = np.where(_SRGB <= 0.04045, _SRGB / 12.92, ((_SRGB + 0.055) / 1.055) ** 2.4)
"""Linear light of each 8-bit sRGB value (IEC 61966-2-1)."""


def texture_color(texture: Bytes, uv: Floats) -> Floats:
    """Return linear RGB (N, 3) at texture coordinates.

    Parameters
    ----------
    texture
        (H, W, 4) sRGB, row 0 at the top; alpha is ignored.
    uv
        (N, 2) coordinates in units of the picture: u to the right, v up, repeated beyond 0 to 1.
    """
    height, width = texture.shape[:2]

    def texel(rows: Indices, columns: Indices) -> Floats:
        return np.asarray(LINEAR[texture[rows % height, columns % width, :3]])

    return bilinear(texel, (1.0 - uv[:, 1]) * height, uv[:, 0] * width)


def bilinear(texel: Callable[[Indices, Indices], Floats], down: Floats, right: Floats) -> Floats:
    """Return (N, 3) between the centers of the four texels about each point.

    Parameters
    ----------
    texel
        Function that returns the texels (N, 3) of rows and columns, which may lie outside the picture.
    down, right
        (N,) places in texels from the picture's top left corner; texel centers lie at halves.
    """
    row, column = np.floor(down - 0.5), np.floor(right - 0.5)
    below, beside = (down - 0.5 - row)[:, None], (right - 0.5 - column)[:, None]
    r, c = row.astype(np.int64), column.astype(np.int64)
    upper = (1.0 - beside) * texel(r, c) + beside * texel(r, c + 1)
    lower = (1.0 - beside) * texel(r + 1, c) + beside * texel(r + 1, c + 1)
    return (1.0 - below) * upper + below * lower
