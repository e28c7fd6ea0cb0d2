"""Print which of `atomic`, `opengl` and `llvm` are missing, one word per line.

Runs before anything is installed, and therefore uses only the standard library.
"""

from __future__ import annotations

import ctypes
import os
import re
import subprocess
from ctypes.util import find_library

EGL_PLATFORM_DEVICE = 0x313F
OLDEST_LLVM = 17
"""Oldest LLVM: with 15 and 16, Dr.Jit 1.5 aborts the process; 17, 18 and 19 work."""


def loads(library: str) -> bool:
    """Return whether a library can be loaded."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def has_opengl() -> bool:
    """Return whether an EGL device starts without a display; an installed library is not enough."""
    egl_name, gl_name = find_library("EGL"), find_library("GL")
    if not (egl_name and gl_name and loads(egl_name) and loads(gl_name)):
        return False
    egl = ctypes.CDLL(egl_name)
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    addresses = [
        egl.eglGetProcAddress(name) for name in (b"eglQueryDevicesEXT", b"eglGetPlatformDisplayEXT")
    ]
    if None in addresses:
        return False
    query = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(
        addresses[0]
    )
    open_display = ctypes.CFUNCTYPE(
        ctypes.c_void_p, ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p
    )(addresses[1])
    devices, count = (ctypes.c_void_p * 16)(), ctypes.c_int()
    if not query(len(devices), devices, ctypes.byref(count)):
        return False
    egl.eglInitialize.argtypes = [ctypes.c_void_p] * 3
    displays = (
        open_display(EGL_PLATFORM_DEVICE, device, None) for device in devices[: count.value]
    )
    return any(display and egl.eglInitialize(display, None, None) for display in displays)


def llvm_candidates() -> list[str]:
    """Return names of LLVM libraries for the loader; only DRJIT_LIBLLVM_PATH if it is set."""
    chosen = os.environ.get("DRJIT_LIBLLVM_PATH")
    if chosen:
        return [chosen]
    for ldconfig in ("/sbin/ldconfig", "ldconfig"):
        try:
            listing = subprocess.run(
                [ldconfig, "-p"], capture_output=True, text=True, check=True
            ).stdout
        except (OSError, subprocess.CalledProcessError):
            continue
        return sorted(set(re.findall(r"^\s*(libLLVM\S*)", listing, re.MULTILINE)))
    return [f"libLLVM.so.{version}.1" for version in (19, 18, 20)] + ["libLLVM-17.so.1"]


def llvm_version(name: str) -> int:
    """Return the major version of an LLVM library, 0 if it does not load or is older than 16."""
    if not loads(name):
        return 0
    library = ctypes.CDLL(name)
    if not hasattr(library, "LLVMGetVersion"):
        return 0
    major = ctypes.c_uint()
    library.LLVMGetVersion(ctypes.byref(major), None, None)
    return major.value


if __name__ == "__main__":
    if not loads("libatomic.so.1"):
        print("atomic")
    if not has_opengl():
        print("opengl")
    if not any(llvm_version(name) >= OLDEST_LLVM for name in llvm_candidates()):
        print("llvm")
