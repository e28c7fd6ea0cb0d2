"""The one place that makes an OpenGL context: moderngl over EGL, without a display."""

from __future__ import annotations

from abc import ABC, abstractmethod
from types import TracebackType
from typing import Any, Self

import moderngl
from OpenGL import GL, platform
from OpenGL.arrays import (  # noqa: F401 - PyOpenGL imports them anyway, while the first frame is drawn
    ctypesarrays,
    ctypesparameters,
    ctypespointers,
    lists,
    nones,
    numpymodule,
)
from OpenGL.platform.egl import EGLPlatform

from xfrustum.scenes.errors import InputError

REQUIRED_VERSION = 450
"""OpenGL 4.5: the first with clip control, without which reversed depth gains nothing."""

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
        # moderngl's own annotation asks for a dictionary where its code takes a name.
        backend: dict[str, Any] = {"backend": "egl"}
        context = moderngl.create_context(standalone=True, **backend)
    except Exception as error:
        # glcontext raises bare Exception, moderngl its own Error, for whatever EGL lacks.
        reason = " ".join(str(error).split())
        raise InputError(f"no OpenGL context through EGL ({reason}): {_HELP}") from error
    if context.version_code < REQUIRED_VERSION:
        found, device = context.version_code, context.info["GL_RENDERER"]
        context.release()
        raise InputError(
            f"OpenGL {found // 100}.{found // 10 % 10} of {device} is too old, 4.5 is needed: {_HELP}"
        )
    return context


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
