"""Framebuffers with the depth formats that moderngl does not offer, made and freed through PyOpenGL.

A framebuffer wrapped by moderngl knows no attachments and frees nothing: this class owns them.
"""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray
from OpenGL import GL

from xfrustum.raster.depth_formats import INTERNAL_FORMAT
from xfrustum.scenes.double_frustum import DepthFormat

IDENTITY, COLOR = 0, 1
"""Color attachments: triangle number + 1 and number of the camera (uint), linear radiance (float32)."""

_FORMATS = {IDENTITY: GL.GL_RG32UI, COLOR: GL.GL_RGBA32F}


class Target:
    """One framebuffer of a size and depth format, reused from image to image.

    Parameters
    ----------
    context
        The current context.
    size
        W, H in pixels.
    depth
        Format of the depth buffer.
    """

    def __init__(self, context: moderngl.Context, size: tuple[int, int], depth: DepthFormat) -> None:
        self.size = size
        self._framebuffer = int(GL.glGenFramebuffers(1))
        self._textures = [int(t) for t in np.atleast_1d(GL.glGenTextures(len(_FORMATS) + 1))]
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._framebuffer)
        for attachment, internal in _FORMATS.items():
            self._attach(self._textures[attachment], internal, GL.GL_COLOR_ATTACHMENT0 + attachment)
        self._attach(self._textures[-1], INTERNAL_FORMAT[depth], GL.GL_DEPTH_ATTACHMENT)
        GL.glDrawBuffers(len(_FORMATS), [GL.GL_COLOR_ATTACHMENT0 + a for a in _FORMATS])
        status = GL.glCheckFramebufferStatus(GL.GL_FRAMEBUFFER)
        if status != GL.GL_FRAMEBUFFER_COMPLETE:
            raise RuntimeError(f"framebuffer {size} with {depth} is incomplete: status {status}")
        self._wrapped = context.detect_framebuffer(self._framebuffer)

    def _attach(self, texture: int, internal: int, attachment: int) -> None:
        GL.glBindTexture(GL.GL_TEXTURE_2D, texture)
        GL.glTexStorage2D(GL.GL_TEXTURE_2D, 1, internal, *self.size)
        # Integer textures are complete, and can be sampled, only without filtering.
        GL.glTexParameteri(GL.GL_TEXTURE_2D, GL.GL_TEXTURE_MIN_FILTER, GL.GL_NEAREST)
        GL.glTexParameteri(GL.GL_TEXTURE_2D, GL.GL_TEXTURE_MAG_FILTER, GL.GL_NEAREST)
        GL.glFramebufferTexture2D(GL.GL_FRAMEBUFFER, attachment, GL.GL_TEXTURE_2D, texture, 0)

    def begin(self) -> None:
        """Draw here from now on, over nothing: number 0, black."""
        self._wrapped.use()
        GL.glViewport(0, 0, *self.size)
        GL.glClearBufferuiv(GL.GL_COLOR, IDENTITY, np.zeros(4, np.uint32))
        GL.glClearBufferfv(GL.GL_COLOR, COLOR, np.zeros(4, np.float32))

    def clear_depth(self, value: float) -> None:
        """Set every depth."""
        GL.glClearBufferfv(GL.GL_DEPTH, 0, np.array([value], dtype=np.float32))

    def bind_identity(self, unit: int) -> None:
        """Make the identities a texture for a shader."""
        GL.glActiveTexture(GL.GL_TEXTURE0 + unit)
        GL.glBindTexture(GL.GL_TEXTURE_2D, self._textures[IDENTITY])

    def read_triangle(self) -> NDArray[np.int32]:
        """Return triangle numbers, (H, W), row 0 at the top, -1 where nothing was drawn."""
        identity = self._read(
            IDENTITY, GL.GL_RED_INTEGER, GL.GL_UNSIGNED_INT, np.empty(self._shape(1), np.uint32)
        )
        return identity.view(np.int32) - 1

    def read_color(self) -> NDArray[np.float32]:
        """Return linear RGB, (H, W, 3), row 0 at the top."""
        return self._read(COLOR, GL.GL_RGB, GL.GL_FLOAT, np.empty(self._shape(3), np.float32))

    def _shape(self, channels: int) -> tuple[int, ...]:
        width, height = self.size
        return (height, width) if channels == 1 else (height, width, channels)

    def _read(self, attachment: int, layout: int, kind: int, into: NDArray[Any]) -> NDArray[Any]:
        GL.glReadBuffer(GL.GL_COLOR_ATTACHMENT0 + attachment)
        GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
        GL.glReadPixels(0, 0, *self.size, layout, kind, into)
        return into[::-1]

    def release(self) -> None:
        """Free what it owns."""
        GL.glDeleteFramebuffers(1, [self._framebuffer])
        GL.glDeleteTextures(self._textures)
