"""Framebuffers with depth formats that moderngl does not offer, through PyOpenGL.

moderngl draws into the bound framebuffer. It could wrap such a framebuffer, but gives no access to
the attachments and does not free it. It cannot wrap a multisampled framebuffer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from OpenGL import GL
from OpenGL.error import GLError

from xfrustum.raster.cameras.cameras import INTERNAL_FORMAT
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Singles
from xfrustum.scenes.plate import DepthFormat

#: Numbers of the color attachments. The identity is the triangle number + 1 and the number of the
#: camera (uint); the color is linear radiance (float32).
IDENTITY, COLOR = 0, 1

_FORMATS = {IDENTITY: GL.GL_RG32UI, COLOR: GL.GL_RGBA32F}

#: States disabled for every picture
_OFF = (
    GL.GL_SCISSOR_TEST,
    GL.GL_STENCIL_TEST,
    GL.GL_DEPTH_CLAMP,
    GL.GL_POLYGON_OFFSET_FILL,
    GL.GL_FRAMEBUFFER_SRGB,
    GL.GL_RASTERIZER_DISCARD,
    GL.GL_COLOR_LOGIC_OP,
    GL.GL_PRIMITIVE_RESTART,
    GL.GL_SAMPLE_ALPHA_TO_COVERAGE,
    GL.GL_SAMPLE_MASK,
    GL.GL_DITHER,
    *(GL.GL_CLIP_DISTANCE0 + number for number in range(8)),
)


def forget_history() -> None:
    """Reset all OpenGL state that draws do not set, so that no picture depends on earlier pictures.

    A draw sets framebuffer and viewport, depth test and function, blending, culling and front
    faces, clip control, programs, buffers and textures.
    """
    for state in _OFF:
        GL.glDisable(state)
    GL.glEnable(GL.GL_MULTISAMPLE)
    GL.glPolygonMode(GL.GL_FRONT_AND_BACK, GL.GL_FILL)
    GL.glDepthMask(GL.GL_TRUE)
    GL.glDepthRange(0.0, 1.0)
    GL.glColorMask(GL.GL_TRUE, GL.GL_TRUE, GL.GL_TRUE, GL.GL_TRUE)
    GL.glProvokingVertex(GL.GL_LAST_VERTEX_CONVENTION)
    GL.glBlendEquation(GL.GL_FUNC_ADD)
    GL.glBindBuffer(GL.GL_PIXEL_PACK_BUFFER, 0)
    for unit in range(2):  # samplers would override the parameters of textures
        GL.glBindSampler(unit, 0)
    for name in (GL.GL_PACK_ROW_LENGTH, GL.GL_PACK_SKIP_ROWS, GL.GL_PACK_SKIP_PIXELS):
        GL.glPixelStorei(name, 0)


_SAMPLE_LIMITS = (
    GL.GL_MAX_SAMPLES,
    GL.GL_MAX_INTEGER_SAMPLES,
    GL.GL_MAX_COLOR_TEXTURE_SAMPLES,
    GL.GL_MAX_DEPTH_TEXTURE_SAMPLES,
)


def most_samples() -> int:
    """Return the largest number of coverage samples that all attachments support."""
    return min(int(GL.glGetIntegerv(limit)) for limit in _SAMPLE_LIMITS)


def framebuffer(textures: Mapping[int, int], outputs: Sequence[int], *, depth: bool = True) -> int:
    """Return a framebuffer for shader outputs; `textures` are by attachment point.

    An output without a texture is dropped.
    """
    made = int(GL.glGenFramebuffers(1))
    GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, made)
    points = [GL.GL_COLOR_ATTACHMENT0 + number for number in outputs]
    points = [point if point in textures else GL.GL_NONE for point in points]
    for point in (*points, *([GL.GL_DEPTH_ATTACHMENT] if depth else [])):
        if point != GL.GL_NONE:
            GL.glFramebufferTexture(GL.GL_FRAMEBUFFER, point, textures[point], 0)
    GL.glDrawBuffers(len(points), points)
    status = GL.glCheckFramebufferStatus(GL.GL_FRAMEBUFFER)
    if status != GL.GL_FRAMEBUFFER_COMPLETE:
        raise RuntimeError(f"a framebuffer is incomplete: status {status}")
    return made


def look_up_single_texels(kind: int, texture: int) -> None:
    """Bind a texture and disable filtering, which integer textures do not allow."""
    GL.glBindTexture(kind, texture)
    GL.glTexParameteri(kind, GL.GL_TEXTURE_MIN_FILTER, GL.GL_NEAREST)
    GL.glTexParameteri(kind, GL.GL_TEXTURE_MAG_FILTER, GL.GL_NEAREST)


class Target:
    """Framebuffer of W, H pixels with a depth format in the current context, reused by images.

    With several coverage samples, color is their mean. Identities cannot be read then, because each
    pixel has several. A device may store more samples than requested: `samples` is the number
    stored.
    """

    def __init__(self, size: tuple[int, int], depth: DepthFormat, samples: int = 1) -> None:
        self.size = size
        self.samples = samples
        self._kind = GL.GL_TEXTURE_2D if samples == 1 else GL.GL_TEXTURE_2D_MULTISAMPLE
        formats = {
            GL.GL_COLOR_ATTACHMENT0 + number: internal for number, internal in _FORMATS.items()
        }
        formats[GL.GL_DEPTH_ATTACHMENT] = INTERNAL_FORMAT[depth]
        self._textures = {point: self._store(internal) for point, internal in formats.items()}
        self._picture = framebuffer(self._textures, [IDENTITY, COLOR])
        # Pictures with only triangle numbers neither clear nor write color.
        self._numbers = framebuffer(self._textures, [IDENTITY])
        # Reflections read the identities, which therefore must not be attached; reflection.frag
        # needs no depth buffer.
        self._reflection = framebuffer(self._textures, [COLOR], depth=False)
        self._resolved = None if samples == 1 else Target(size, depth)

    def _store(self, internal: int) -> int:
        texture = int(GL.glGenTextures(1))
        GL.glBindTexture(self._kind, texture)
        if self.samples > 1:
            GL.glTexStorage2DMultisample(self._kind, self.samples, internal, *self.size, True)
            self.samples = int(GL.glGetTexLevelParameteriv(self._kind, 0, GL.GL_TEXTURE_SAMPLES))
            return texture
        try:
            GL.glTexStorage2D(self._kind, 1, internal, *self.size)
        except GLError as error:
            if error.err != GL.GL_OUT_OF_MEMORY:
                raise
            width, height = self.size
            raise InputError(
                f"the OpenGL device has no memory left for an image of {width} x {height} pixels; "
                "choose a smaller frustum.resolution"
            ) from error
        look_up_single_texels(self._kind, texture)
        return texture

    def begin(self, *, color: bool = True) -> None:
        """Make this the current target, cleared to number 0 and, with color, to black."""
        forget_history()
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._picture if color else self._numbers)
        GL.glViewport(0, 0, *self.size)
        GL.glClearBufferuiv(GL.GL_COLOR, IDENTITY, np.zeros(4, np.uint32))
        if color:
            GL.glClearBufferfv(GL.GL_COLOR, COLOR, np.zeros(4, np.float32))

    def begin_reflection(self) -> None:
        """Bind only the color of this target for drawing, without clearing it."""
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._reflection)
        GL.glViewport(0, 0, *self.size)

    def clear_depth(self, value: float) -> None:
        """Set the depth of every pixel to one value."""
        GL.glClearBufferfv(GL.GL_DEPTH, 0, np.array([value], dtype=np.float32))

    def bind_identity(self, unit: int) -> None:
        """Bind the identities as a texture for a shader."""
        GL.glActiveTexture(GL.GL_TEXTURE0 + unit)
        GL.glBindTexture(self._kind, self._textures[GL.GL_COLOR_ATTACHMENT0 + IDENTITY])

    def read_identity(self) -> NDArray[np.uint32]:
        """Return triangle number + 1 and camera number, (H, W, 2), row 0 at the top; 0 if empty."""
        return self._read(IDENTITY, GL.GL_RG_INTEGER, GL.GL_UNSIGNED_INT, 2, np.uint32)

    def read_color(self) -> Singles:
        """Return linear RGB, (H, W, 3), row 0 at the top."""
        if self._resolved is not None:
            return self._resolved.resolved_from(self)
        return self._read(COLOR, GL.GL_RGB, GL.GL_FLOAT, 3, np.float32)

    def resolved_from(self, other: Target) -> Singles:
        """Return the mean of another target's samples, computed by the driver."""
        width, height = self.size
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, other._reflection)
        GL.glReadBuffer(GL.GL_COLOR_ATTACHMENT0 + COLOR)
        GL.glBindFramebuffer(GL.GL_DRAW_FRAMEBUFFER, self._reflection)
        whole = (0, 0, width, height)
        GL.glBlitFramebuffer(*whole, *whole, GL.GL_COLOR_BUFFER_BIT, GL.GL_NEAREST)
        return self.read_color()

    def _read(
        self, attachment: int, layout: int, kind: int, channels: int, dtype: type
    ) -> NDArray[Any]:
        into: NDArray[Any] = np.empty((*self.size[::-1], channels), dtype)
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._picture)
        GL.glReadBuffer(GL.GL_COLOR_ATTACHMENT0 + attachment)
        GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
        GL.glReadPixels(0, 0, *self.size, layout, kind, into)
        return into[::-1]

    def release(self) -> None:
        """Free the framebuffers and textures."""
        GL.glDeleteFramebuffers(3, [self._picture, self._numbers, self._reflection])
        GL.glDeleteTextures(list(self._textures.values()))
        if self._resolved is not None:
            self._resolved.release()
