"""The one place that makes an OpenGL context: moderngl over EGL, without a display."""

from __future__ import annotations

import ctypes
from abc import ABC, abstractmethod
from collections.abc import Iterator
from types import TracebackType
from typing import Any, Self

import moderngl
from OpenGL import EGL, GL, error, platform
from OpenGL.arrays import (  # noqa: F401 - PyOpenGL imports them anyway, while the first frame is drawn
    ctypesarrays,
    ctypesparameters,
    ctypespointers,
    lists,
    nones,
    numpymodule,
)
from OpenGL.EGL.EXT.device_base import EGLDeviceEXT
from OpenGL.EGL.EXT.device_enumeration import eglQueryDevicesEXT
from OpenGL.EGL.EXT.device_query import eglQueryDeviceStringEXT
from OpenGL.platform.egl import EGLPlatform

from xfrustum.scenes.errors import InputError

REQUIRED_VERSION = 450
"""OpenGL 4.5: the first with clip control, without which reversed depth gains nothing."""

OLDEST_VERSION = 330
"""OpenGL 3.3: the oldest that moderngl can say anything about."""

_HELP = (
    "install an EGL driver (Debian and Ubuntu: libegl1 and libgl1-mesa-dri, which draws in software), "
    "or run where there is one"
)


def open_context() -> moderngl.Context:
    """Return a new OpenGL context of at least version 4.5, without a window.

    Raises
    ------
    InputError
        There is no EGL driver, or its OpenGL is too old.
    """
    if not isinstance(platform.PLATFORM, EGLPlatform):
        raise InputError(
            "PyOpenGL was imported for another platform before xfrustum.raster: import xfrustum.raster "
            "first, or set the environment variable PYOPENGL_PLATFORM=egl"
        )
    try:
        return _context(REQUIRED_VERSION)
    except Exception as error:
        # glcontext raises bare Exception, moderngl its own Error, for whatever EGL lacks.
        reason = " ".join(str(error).split())
        raise InputError(f"no OpenGL 4.5 through EGL ({reason}); {_found()}: {_HELP}") from error


def _context(version: int) -> moderngl.Context:
    """Return a context of at least some version: drivers such as NVIDIA's give exactly what is asked for."""
    # moderngl's own annotation asks for a dictionary where its code takes a name.
    backend: dict[str, Any] = {"backend": "egl"}
    return moderngl.create_context(require=version, standalone=True, **backend)


def _found() -> str:
    """Return in words what the machine has, where it lacks `REQUIRED_VERSION`."""
    try:
        context = _context(OLDEST_VERSION)
    except Exception:  # as above
        return "this machine has no OpenGL at all"
    info = context.info
    context.release()
    return f"this machine has OpenGL {info['GL_VERSION']} of {info['GL_RENDERER']}"


def describe(context: moderngl.Context) -> dict[str, str]:
    """Return the names of the device that draws: vendor, renderer, version and subpixel bits, for reports."""
    return {
        "vendor": str(context.info["GL_VENDOR"]),
        "renderer": str(context.info["GL_RENDERER"]),
        "version": str(context.info["GL_VERSION"]),
        "subpixel_bits": str(int(GL.glGetIntegerv(GL.GL_SUBPIXEL_BITS))),
    }


class ContextOwner(ABC):
    """An object with an OpenGL context of its own: a context manager that releases it at its end."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    @abstractmethod
    def release(self) -> None:
        """Free the context and everything in it."""


SOFTWARE = b"EGL_MESA_device_software"
"""Extension of devices that draw in software (registry of EGL, EGL_MESA_device_software)."""


def gpu_indices() -> tuple[int, ...]:
    """Return the indices of the EGL devices that are no software; none where EGL does not tell.

    No context is made. The order is that of eglQueryDevicesEXT, in which moderngl counts devices too.
    """
    if not isinstance(platform.PLATFORM, EGLPlatform):
        return ()
    try:
        return tuple(
            index for index, extensions in enumerate(_extensions()) if SOFTWARE not in extensions.split()
        )
    except error.Error:
        # The driver has no such extension: nobody can choose a device then.
        return ()


def _extensions() -> Iterator[bytes]:
    """Yield the extensions of every device, as one text each."""
    count = EGL.EGLint()
    eglQueryDevicesEXT(0, None, ctypes.byref(count))
    devices = (EGLDeviceEXT * count.value)()
    eglQueryDevicesEXT(count.value, devices, ctypes.byref(count))
    for device in devices[: count.value]:
        yield eglQueryDeviceStringEXT(device, EGL.EGL_EXTENSIONS) or b""
