"""Textures of any number and size in one block of storage, decoded and filtered by the shader."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np
from OpenGL import GL

from xfrustum.scenes.arrays import Bytes, Floats
from xfrustum.scenes.errors import InputError

TEXELS, PLACES, DECODED = 9, 10, 11
"""Bindings of storage blocks, as in texture.glsl."""

BYTES_PER_TEXEL = 4
"""Bytes of a texel: red, green, blue and alpha, of 8 bits each."""


def linear_of_srgb() -> Floats:
    """Return the linear light of each code of 8-bit sRGB (IEC 61966-2-1), (256,)."""
    code = np.arange(256) / 255
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


class Textures:
    """Textures on the GPU: all texels, where each texture begins, and the table that decodes them.

    Parameters
    ----------
    context
        The current context.
    textures
        (H, W, 4) uint8 sRGB each, row 0 at the top.

    Raises
    ------
    InputError
        All textures together are larger than the device's largest block.
    """

    def __init__(self, context: moderngl.Context, textures: Sequence[Bytes]) -> None:
        largest = int(GL.glGetIntegerv(GL.GL_MAX_SHADER_STORAGE_BLOCK_SIZE))
        counts = [texture.shape[0] * texture.shape[1] for texture in textures]
        needed = BYTES_PER_TEXEL * sum(counts)
        if needed > largest:
            raise InputError(
                f"the scene's {len(textures)} textures need {needed >> 20} MiB in one block, "
                f"{context.info['GL_RENDERER']} has {largest >> 20}; use smaller textures"
            )
        first = np.cumsum([0, *counts[:-1]])
        places = [(at, t.shape[1], t.shape[0], 0) for at, t in zip(first, textures, strict=False)]
        # A block cannot be empty: without textures there is one texel, which no triangle refers to.
        texels = np.concatenate([t.reshape(-1, 4) for t in textures] or [np.zeros((1, 4), np.uint8)])
        self._buffers = {
            TEXELS: context.buffer(np.ascontiguousarray(texels).tobytes()),
            PLACES: context.buffer(np.array(places or [(0, 1, 1, 0)], dtype=np.uint32).tobytes()),
            DECODED: context.buffer(linear_of_srgb().astype(np.float32).tobytes()),
        }

    def bind(self) -> None:
        """Bind the blocks for the shaders."""
        for binding, buffer in self._buffers.items():
            buffer.bind_to_storage_buffer(binding)
