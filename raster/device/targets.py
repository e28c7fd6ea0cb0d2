"""Framebuffers with depth formats that moderngl does not offer, drawn and read through PyOpenGL.

A target has one layer, or a layer for each of several hogels. moderngl draws into the bound
framebuffer. It could wrap such a framebuffer, but gives no access to the attachments and does not
free it. It cannot wrap a multisampled framebuffer.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from OpenGL import GL
from OpenGL.error import GLError

from xfrustum.raster.cameras import INTERNAL_FORMAT
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Numbers, Singles
from xfrustum.scenes.model.images import ColorType, PlateContent
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


_COLOR_FORMAT: dict[ColorType, int] = {
    ColorType.UINT8: GL.GL_RGBA8,
    ColorType.FLOAT16: GL.GL_RGBA16F,
    ColorType.FLOAT32: GL.GL_RGBA32F,
}
_COLOR_READ: dict[ColorType, int] = {
    ColorType.UINT8: GL.GL_UNSIGNED_BYTE,
    ColorType.FLOAT16: GL.GL_HALF_FLOAT,
    ColorType.FLOAT32: GL.GL_FLOAT,
}
_DEPTH_BYTES: dict[DepthFormat, int] = {DepthFormat.D16: 2, DepthFormat.D24: 4, DepthFormat.D32F: 4}


@dataclass(frozen=True, kw_only=True)
class TargetFormat:
    """Formats of the buffers into which a hogel is drawn."""

    depth: DepthFormat  #: Format of the depth buffer
    content: PlateContent  #: The images that are read back
    #: Whether a later pass looks up the drawn triangle numbers
    identified: bool = False
    #: False for pictures with only triangle numbers, without color
    colored: bool = True

    @property
    def attachments(self) -> dict[int, int]:
        """Internal format of each color attachment; numbered as in `Target`."""
        color = {COLOR: _COLOR_FORMAT[self.content.color]} if self.colored else {}
        # Passes that look up identities also compare the camera's number.
        numbers = GL.GL_RG32UI if self.identified else GL.GL_R32UI
        return {**color, IDENTITY: numbers} if self.identified or self.content.ids else color

    @property
    def bytes_per_pixel(self) -> int:
        """Bytes of a pixel in all attachments."""
        identity = 8 if IDENTITY in self.attachments else 0
        color = 4 * self.content.color.dtype.itemsize if self.colored else 0
        return _DEPTH_BYTES[self.depth] + color + identity


@dataclass(frozen=True, kw_only=True)
class Layer:
    """Identities of one layer of a target, as a separate picture."""

    size: tuple[int, int]  #: W, H in pixels
    view: int  #: OpenGL name of a texture view of this layer

    def bind_identity(self, unit: int) -> None:
        """Bind the identities as a texture for a shader."""
        GL.glActiveTexture(GL.GL_TEXTURE0 + unit)
        GL.glBindTexture(GL.GL_TEXTURE_2D, self.view)


class LayeredTarget:
    """Framebuffer of W, H pixels with a layer for each hogel of a submission; reads are buffered.

    moderngl cannot wrap a layered framebuffer, so that this class owns all OpenGL objects, in the
    current context.
    """

    def __init__(self, size: tuple[int, int], layers: int, form: TargetFormat) -> None:
        self.size, self.layers = size, layers
        self._content, self._colored = form.content, form.colored
        formats = {
            GL.GL_COLOR_ATTACHMENT0 + number: form.attachments[number]
            for number in form.attachments
        }
        formats[GL.GL_DEPTH_ATTACHMENT] = INTERNAL_FORMAT[form.depth]
        self._textures = {attachment: self._store(formats[attachment]) for attachment in formats}
        outputs = [IDENTITY, COLOR] if form.colored else [IDENTITY]
        self._picture = framebuffer(self._textures, outputs)
        # Shaders that draw into `_radiance` read the identities, which therefore must not be
        # attached.
        self._radiance = (
            framebuffer(self._textures, [COLOR], depth=False) if form.colored else self._picture
        )
        per_pixel = {COLOR: 4 * self._content.color.dtype.itemsize} if form.colored else {}
        if self._content.ids:
            per_pixel[IDENTITY] = 4
        self._pack_bytes = {
            number: count * math.prod(size) * layers for number, count in per_pixel.items()
        }
        self._packs = {number: self._pack(self._pack_bytes[number]) for number in per_pixel}
        self._box = (0, 0, *size)
        self._views: list[int] = []

    def _store(self, internal: int) -> int:
        texture = int(GL.glGenTextures(1))
        GL.glBindTexture(GL.GL_TEXTURE_2D_ARRAY, texture)
        GL.glTexStorage3D(GL.GL_TEXTURE_2D_ARRAY, 1, internal, *self.size, self.layers)
        look_up_single_texels(GL.GL_TEXTURE_2D_ARRAY, texture)
        return texture

    def _pack(self, size: int) -> int:
        """Return a new pixel pack buffer of `size` bytes."""
        pack = int(GL.glGenBuffers(1))
        GL.glBindBuffer(GL.GL_PIXEL_PACK_BUFFER, pack)
        GL.glBufferData(GL.GL_PIXEL_PACK_BUFFER, size, None, GL.GL_STREAM_READ)
        GL.glBindBuffer(GL.GL_PIXEL_PACK_BUFFER, 0)
        return pack

    def begin(self, box: tuple[int, int, int, int] | None = None) -> None:
        """Make this the current target, with all layers cleared to number 0 and black.

        `box` is the part of the films that is drawn and read: first column, first row from the
        bottom, width and height; None for whole films. Pixels outside the box are read as black.
        """
        forget_history()
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._picture)
        GL.glViewport(0, 0, *self.size)
        self._box = (0, 0, *self.size) if box is None or not bool(GL.glGetTextureSubImage) else box
        # The scissor test limits clears and triangles to the box without moving the viewport.
        GL.glEnable(GL.GL_SCISSOR_TEST)
        GL.glScissor(*self._box)
        if self._colored:
            GL.glClearBufferfv(GL.GL_COLOR, COLOR, np.zeros(4, np.float32))
        if GL.GL_COLOR_ATTACHMENT0 + IDENTITY in self._textures:
            GL.glClearBufferuiv(GL.GL_COLOR, IDENTITY, np.zeros(4, np.uint32))

    def begin_reflection(self) -> None:
        """Bind only the color of this target for drawing, without clearing it."""
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._radiance)

    def bind_identity(self, unit: int) -> None:
        """Bind the identities as a texture for a shader."""
        GL.glActiveTexture(GL.GL_TEXTURE0 + unit)
        GL.glBindTexture(GL.GL_TEXTURE_2D_ARRAY, self._textures[GL.GL_COLOR_ATTACHMENT0 + IDENTITY])

    def layer(self, number: int) -> Layer:
        """Return the identities of one layer, valid until the next drawing into the layer."""
        while len(self._views) <= number:
            view = int(GL.glGenTextures(1))
            whole = self._textures[GL.GL_COLOR_ATTACHMENT0 + IDENTITY]
            GL.glTextureView(view, GL.GL_TEXTURE_2D, whole, GL.GL_RG32UI, 0, 1, len(self._views), 1)
            look_up_single_texels(GL.GL_TEXTURE_2D, view)
            self._views.append(view)
        return Layer(size=self.size, view=self._views[number])

    def clear_depth(self, value: float) -> None:
        """Set the depth of every pixel in every layer."""
        GL.glClearBufferfv(GL.GL_DEPTH, 0, np.array([value], dtype=np.float32))

    def start_reading(self) -> None:
        """Start the transfer of all pixels; asynchronous devices return at once."""
        if self._colored:
            self._start(COLOR, GL.GL_RGBA, _COLOR_READ[self._content.color])
        if self._content.ids:
            self._start(IDENTITY, GL.GL_RED_INTEGER, GL.GL_UNSIGNED_INT)

    def _start(self, attachment: int, layout: int, kind: int) -> None:
        GL.glBindBuffer(GL.GL_PIXEL_PACK_BUFFER, self._packs[attachment])
        GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
        texture = self._textures[GL.GL_COLOR_ATTACHMENT0 + attachment]
        GL.glBindTexture(GL.GL_TEXTURE_2D_ARRAY, texture)
        # With a pack buffer bound, this is an offset into the buffer, not an address.
        nowhere = ctypes.c_void_p(0)
        column, row, width, height = self._box
        if (width, height) == self.size:
            GL.glGetTexImage(GL.GL_TEXTURE_2D_ARRAY, 0, layout, kind, nowhere)
        else:
            corner, extent = (column, row, 0), (width, height, self.layers)
            room = self._pack_bytes[attachment]
            GL.glGetTextureSubImage(texture, 0, *corner, *extent, layout, kind, room, nowhere)
        GL.glBindBuffer(GL.GL_PIXEL_PACK_BUFFER, 0)

    def finish_color(self) -> NDArray[Any]:
        """Wait for the linear RGB of a colored target, (layers, H, W, 3), row 0 at the top."""
        return self._finish(COLOR, 4, self._content.color.dtype)[..., :3]

    def finish_triangle(self) -> Numbers | None:
        """Return triangle numbers, (layers, H, W), -1 for no surface; None without this channel."""
        if not self._content.ids:
            return None
        numbers: Numbers = self._finish(IDENTITY, 1, np.dtype(np.uint32))[..., 0].view(np.int32)
        numbers -= 1
        return numbers

    def _finish(self, attachment: int, channels: int, kind: np.dtype[Any]) -> NDArray[Any]:
        column, row, width, height = self._box
        shape = (self.layers, height, width, channels)
        # Read bytes, because PyOpenGL converts all other types.
        into = np.empty(math.prod(shape) * kind.itemsize, dtype=np.uint8)
        GL.glBindBuffer(GL.GL_PIXEL_PACK_BUFFER, self._packs[attachment])
        GL.glGetBufferSubData(GL.GL_PIXEL_PACK_BUFFER, 0, into.nbytes, into)
        GL.glBindBuffer(GL.GL_PIXEL_PACK_BUFFER, 0)
        read = into.view(kind).reshape(shape)
        if (width, height) != self.size:
            whole = np.zeros((self.layers, *self.size[::-1], channels), dtype=kind)
            whole[:, row : row + height, column : column + width] = read
            read = whole
        return read[:, ::-1]

    def release(self) -> None:
        """Free the framebuffers, textures and buffers."""
        frames = list({self._picture, self._radiance})
        GL.glDeleteFramebuffers(len(frames), frames)
        GL.glDeleteTextures([*self._views, *self._textures.values()])
        GL.glDeleteBuffers(len(self._packs), list(self._packs.values()))
