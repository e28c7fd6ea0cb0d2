"""The EGL devices of this machine: which of them are GPUs, by the index that chooses a device."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator

from OpenGL import EGL, error, platform
from OpenGL.EGL.EXT.device_base import EGLDeviceEXT
from OpenGL.EGL.EXT.device_enumeration import eglQueryDevicesEXT
from OpenGL.EGL.EXT.device_query import eglQueryDeviceStringEXT
from OpenGL.platform.egl import EGLPlatform

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
