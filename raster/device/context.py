"""Creation of OpenGL contexts: moderngl over EGL, without a display."""

import ctypes
import os
import warnings
from abc import ABC, abstractmethod
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import moderngl
from OpenGL import EGL, GL, error, platform
from OpenGL.EGL.EXT.device_base import EGLDeviceEXT
from OpenGL.EGL.EXT.device_enumeration import eglQueryDevicesEXT
from OpenGL.EGL.EXT.device_query import eglQueryDeviceAttribEXT, eglQueryDeviceStringEXT
from OpenGL.EGL.NV.device_cuda import EGL_CUDA_DEVICE_NV
from OpenGL.platform.egl import EGLPlatform

from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.model.scene import Scene

#: OpenGL 4.5: the first version with clip control, which reversed depth needs for its precision
REQUIRED_VERSION = 450
#: OpenGL 3.3: the oldest version that moderngl supports
OLDEST_VERSION = 330

_HELP = (
    "install an EGL driver (Debian and Ubuntu: libegl1 and libgl1-mesa-dri, which draws in "
    "software), or run where there is one"
)


def open_context(version: int = REQUIRED_VERSION) -> moderngl.Context:
    """Return a new context with at least this OpenGL version; InputError if EGL has none.

    Warns with SoftwareWarning if the context draws on the CPU although the machine has a GPU.
    """
    if not isinstance(platform.PLATFORM, EGLPlatform):
        raise InputError(
            "PyOpenGL was imported for another platform before xfrustum.raster: import "
            "xfrustum.raster first, or set the environment variable PYOPENGL_PLATFORM=egl"
        )
    try:
        context = _context(version)
    except Exception as error:
        # If EGL lacks anything, glcontext raises Exception and moderngl its own Error.
        reason = " ".join(str(error).split())
        devices = [
            f"OpenGL {each.version} of {each.renderer}" for each in egl_devices() if each.renderer
        ]
        has = f"this machine has {', '.join(devices) or 'no OpenGL at all'}"
        helps = overlooked_card() or _HELP
        raise InputError(
            f"no OpenGL {version / 100:.1f} through EGL ({reason}); {has}: {helps}"
        ) from error
    renderer = context.info["GL_RENDERER"]
    if is_software(renderer) and (advice := overlooked_card()):
        warnings.warn(f"{renderer} draws in software: {advice}", SoftwareWarning, stacklevel=2)
    return context


class SoftwareWarning(UserWarning):
    """OpenGL draws on the CPU although the machine has a GPU."""


def _context(version: int, index: int = 0) -> moderngl.Context:
    """Return a context with at least this version; NVIDIA's driver returns exactly this version."""
    # moderngl annotates `backend` as a dictionary, but takes a name.
    backend: dict[str, Any] = {"backend": "egl", "device_index": index}
    return moderngl.create_context(require=version, standalone=True, **backend)


@dataclass(frozen=True, kw_only=True)
class EglDevice:
    """Device that EGL lists."""

    index: int
    renderer: str  #: OpenGL's name; empty if no context can be made on the device
    version: str  #: OpenGL version of the device, or the reason why it has no context


def egl_devices() -> tuple[EglDevice, ...]:
    """Return all devices that EGL lists, each with its newest OpenGL version."""
    devices = []
    for index in range(_device_count()):
        reason, context = "", None
        for version in (REQUIRED_VERSION, OLDEST_VERSION):
            try:
                context = _context(version, index)
                break
            except Exception as error:
                reason = " ".join(str(error).split())
        if context is None:
            devices.append(EglDevice(index=index, renderer="", version=reason))
            continue
        names = describe(context)
        devices.append(EglDevice(index=index, renderer=names["renderer"], version=names["version"]))
        context.release()
    return tuple(devices)


#: GPUs listed by NVIDIA's kernel driver, including GPUs that EGL does not list
NVIDIA_CARDS = Path("/proc/driver/nvidia/gpus")

VENDORS_ASKED = "__EGL_VENDOR_LIBRARY_FILENAMES"
VENDOR_FOLDERS = tuple(
    Path(folder) / "glvnd/egl_vendor.d" for folder in ("/etc", "/usr/share", "/usr/local/share")
)
#: Environment variables of Mesa that select a driver or the software renderer
SOFTWARE_ASKED = ("LIBGL_ALWAYS_SOFTWARE", "GALLIUM_DRIVER", "MESA_LOADER_DRIVER_OVERRIDE")


def overlooked_card() -> str | None:
    """Return advice about a GPU that EGL does not use; None if there is no such GPU."""
    models = [_card_name(card) for card in sorted(NVIDIA_CARDS.glob("*/information"))]
    if gpu_indices():
        set_by_user = [name for name in SOFTWARE_ASKED if os.environ.get(name)]
        return (
            f"this machine has a GPU, and {set_by_user[0]} hides it from EGL; unset the variable"
            if set_by_user
            else None
        )
    if not models:
        return None
    named = os.environ.get(VENDORS_ASKED, "")
    files = [Path(name) for name in named.split(os.pathsep)] if named else []
    if not named:
        files = [file for folder in VENDOR_FOLDERS for file in sorted(folder.glob("*nvidia*.json"))]
    if any(file.is_file() and "nvidia" in file.name for file in files):
        return f"this machine has {models[0]}, and EGL does not list it; check its libraries"
    return (
        f"this machine has {models[0]}, which is not registered with EGL: put 10_nvidia.json, with "
        '{"file_format_version": "1.0.0", "ICD": {"library_path": "libEGL_nvidia.so.0"}}, into '
        f"{VENDOR_FOLDERS[1]}, or set {VENDORS_ASKED} to it"
    )


def _card_name(information: Path) -> str:
    lines = information.read_text(errors="replace").splitlines()
    model = next(
        (line.partition(":")[2].strip() for line in lines if line.startswith("Model:")), ""
    )
    return model or "an NVIDIA card"


def is_software(renderer: str) -> bool:
    """Return whether the renderer of this name draws on the CPU."""
    return any(name in renderer for name in ("llvmpipe", "softpipe", "SwiftShader", "swr"))


def describe(context: moderngl.Context) -> dict[str, str]:
    """Return vendor, renderer, version and subpixel bits of the device, for reports."""
    return {
        "vendor": str(context.info["GL_VENDOR"]),
        "renderer": str(context.info["GL_RENDERER"]),
        "version": str(context.info["GL_VERSION"]),
        "subpixel_bits": str(int(GL.glGetIntegerv(GL.GL_SUBPIXEL_BITS))),
    }


class ContextOwner(ABC):
    """Owner of an OpenGL context; as a context manager it releases the context on exit."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.release()

    @abstractmethod
    def release(self) -> None:
        """Free the context and everything in it."""


#: Extension of devices that draw in software (EGL registry, EGL_MESA_device_software)
SOFTWARE = b"EGL_MESA_device_software"


def gpu_indices() -> tuple[int, ...]:
    """Return the indices of EGL's hardware devices; empty if EGL cannot list devices.

    No context is created. Indices are positions in the list of eglQueryDevicesEXT, as in moderngl.
    """
    if not isinstance(platform.PLATFORM, EGLPlatform):
        return ()
    try:
        return tuple(
            index
            for index, extensions in enumerate(_extensions())
            if SOFTWARE not in extensions.split()
        )
    except error.Error:
        # The driver lacks the extension, so that devices cannot be selected.
        return ()


def cuda_index(device: int) -> int | None:
    """Return the CUDA number of an EGL device; None if it has none.

    CUDA and EGL number GPUs in different orders (EGL registry, EGL_NV_device_cuda).
    """
    number = EGL.EGLAttrib()
    try:
        known = eglQueryDeviceAttribEXT(
            _devices()[device], EGL_CUDA_DEVICE_NV, ctypes.byref(number)
        )
    except (error.Error, IndexError):
        return None
    return int(number.value) if known else None


def _device_count() -> int:
    """Return the number of devices that EGL lists; 1 if EGL cannot list devices."""
    try:
        return len(_devices())
    except error.Error:
        return 1


def _devices() -> list[Any]:
    """Return the devices that EGL lists."""
    count = EGL.EGLint()
    eglQueryDevicesEXT(0, None, ctypes.byref(count))
    devices = (EGLDeviceEXT * count.value)()
    eglQueryDevicesEXT(count.value, devices, ctypes.byref(count))
    return list(devices[: count.value])


def _extensions() -> Iterator[bytes]:
    """Yield the extensions of every device, one string per device."""
    for device in _devices():
        yield eglQueryDeviceStringEXT(device, EGL.EGL_EXTENSIONS) or b""


#: unit of OpenGL's timestamps, seconds
NANOSECOND = 1e-9


class GpuClock:
    """GPU time of a `with` block in the current context, from two timestamps in the GPU's queue.

    The GPU may execute the block later; only `seconds` waits for it.
    """

    def __enter__(self) -> Self:
        self._queries = [int(query) for query in GL.glGenQueries(2)]
        GL.glQueryCounter(self._queries[0], GL.GL_TIMESTAMP)
        return self

    def __exit__(self, *_: object) -> None:
        GL.glQueryCounter(self._queries[1], GL.GL_TIMESTAMP)

    def seconds(self) -> float:
        """Return the time between the timestamps."""
        # PyOpenGL cannot allocate a 64-bit result by itself.
        results = [ctypes.c_uint64(), ctypes.c_uint64()]
        for query, result in zip(self._queries, results, strict=True):
            GL.glGetQueryObjectui64v(query, GL.GL_QUERY_RESULT, ctypes.byref(result))
        GL.glDeleteQueries(2, self._queries)
        return max(results[1].value - results[0].value, 0) * NANOSECOND


#: Bytes of a vertex in double precision: three coordinates of 8 bytes, uploaded by `Positions`
POSITION_BYTES = 24

#: Largest number of triangles: shaders index three values per triangle with int32
MAX_TRIANGLES = (1 << 31) // 3

#: Peak memory per pixel, in bytes, from drawing to writing the image. The device needs 28 bytes
#: (identities 8, color 16, depth 4); a software renderer takes them from main memory. Main memory
#: also holds the numbers, positions, normals and colors that are read back, and the channels of the
#: file. llvmpipe needs 185 bytes in all at 2048 x 2048 (measured).
PIXEL_BYTES = 190

#: Internal format, layout and type of the textures of an image (see `targets`)
_TARGETS = (
    (GL.GL_RG32UI, GL.GL_RG_INTEGER, GL.GL_UNSIGNED_INT),
    (GL.GL_RGBA32F, GL.GL_RGBA, GL.GL_FLOAT),
    (GL.GL_DEPTH_COMPONENT32F, GL.GL_DEPTH_COMPONENT, GL.GL_FLOAT),
)


def check_room(scene: Scene, device: str, *, vertex_bytes: int = 0) -> None:
    """Raise InputError if images, or the vertices in one block, do not fit the device's memory."""
    if len(scene.faces) > MAX_TRIANGLES:
        raise InputError(
            f"{scene.name}: {len(scene.faces)} triangles; at most {MAX_TRIANGLES} can be drawn"
        )
    _check_image(scene.frustum.resolution, device)
    block = int(GL.glGetIntegerv(GL.GL_MAX_SHADER_STORAGE_BLOCK_SIZE))
    # Normals and indices of triangles have a block each, with three 32-bit numbers per triangle.
    needed = max(vertex_bytes * len(scene.vertices), 12 * len(scene.faces))
    if needed > block:
        raise InputError(
            f"{scene.name}: {len(scene.faces):,} triangles on {len(scene.vertices):,} vertices "
            f"need {needed >> 20} MiB in one block, {device} has {block >> 20}; draw a smaller mesh"
        )


def _check_image(size: tuple[int, int], device: str) -> None:
    """Raise InputError if the device, or this machine's memory, has no room for an image."""
    width, height = size
    sides = (GL.GL_MAX_TEXTURE_SIZE, GL.GL_MAX_RENDERBUFFER_SIZE)
    limit = min(int(GL.glGetIntegerv(side)) for side in sides)
    if max(size) > limit or not _can_store(size):
        stores = range(limit, 0, -1)
        side = limit - bisect_left(stores, 1, key=lambda n: _can_store((n, n)))
        raise InputError(
            f"{device} draws at most {limit} pixels along a side, and {side} x {side} at once, "
            f"not {width} x {height}; choose a smaller frustum.resolution"
        )
    needed, free = PIXEL_BYTES * width * height, free_memory()
    if free is not None and needed > free:
        raise InputError(
            f"an image of {width} x {height} pixels needs about {needed / 2**30:.1f} GiB of "
            f"memory, {free / 2**30:.1f} GiB are free; choose a smaller frustum.resolution"
        )


def _can_store(size: tuple[int, int]) -> bool:
    """Return whether the device of the current context can store the textures of an image."""
    for internal, layout, kind in _TARGETS:
        GL.glTexImage2D(GL.GL_PROXY_TEXTURE_2D, 0, internal, *size, 0, layout, kind, None)
        if not int(GL.glGetTexLevelParameteriv(GL.GL_PROXY_TEXTURE_2D, 0, GL.GL_TEXTURE_WIDTH)):
            return False
    return True


def free_memory() -> int | None:
    """Return the bytes available without swapping; None if the system does not report them."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    for line in lines:
        name, _, amount = line.partition(":")
        if name == "MemAvailable":
            return 1024 * int(amount.split()[0])
    return None


def require_room(scene: Scene) -> None:
    """Raise the InputErrors of `Rasterizer` early, before the long computation of a command."""
    context = open_context()
    try:
        with context:
            check_room(scene, describe(context)["renderer"], vertex_bytes=POSITION_BYTES)
    finally:
        context.release()
