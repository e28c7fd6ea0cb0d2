"""The largest images and meshes that a device has room for, asked before anything is uploaded."""

from bisect import bisect_left
from pathlib import Path

from OpenGL import GL

from xfrustum.raster.device.context import describe, open_context
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene

POSITION_BYTES = 24
"""Bytes of a vertex in double precision: `Positions` uploads three coordinates of 8 bytes each."""

MAX_TRIANGLES = (1 << 31) // 3
"""Largest number of triangles: shaders index three values of each with signed 32-bit integers."""

PIXEL_BYTES = 190
"""Bytes of memory that a pixel takes from the first drawing until its image is written: 28 on the device
(identities 8, color 16, depth 4), which a software renderer keeps in the same memory; the numbers, positions,
normals and colors that are read back; and the channels of the file. Measured with llvmpipe: 185 at
2048 x 2048."""

_TARGETS = (
    (GL.GL_RG32UI, GL.GL_RG_INTEGER, GL.GL_UNSIGNED_INT),
    (GL.GL_RGBA32F, GL.GL_RGBA, GL.GL_FLOAT),
    (GL.GL_DEPTH_COMPONENT32F, GL.GL_DEPTH_COMPONENT, GL.GL_FLOAT),
)
"""Internal format, layout and type of the textures that an image is drawn into (see `targets`)."""


def check_room(scene: Scene, device: str, *, vertex_bytes: int = 0) -> None:
    """Raise InputError where the device has no room for images, or for vertices in a block."""
    if len(scene.faces) > MAX_TRIANGLES:
        raise InputError(f"{scene.name}: {len(scene.faces)} triangles; at most {MAX_TRIANGLES} can be drawn")
    _check_image(scene.frustum.resolution, device)
    block = int(GL.glGetIntegerv(GL.GL_MAX_SHADER_STORAGE_BLOCK_SIZE))
    # Normals and indices of triangles are blocks of their own: three numbers of 32 bits a triangle.
    needed = max(vertex_bytes * len(scene.vertices), 12 * len(scene.faces))
    if needed > block:
        raise InputError(
            f"{scene.name}: {len(scene.faces):,} triangles on {len(scene.vertices):,} vertices need "
            f"{needed >> 20} MiB in one block, {device} has {block >> 20}; draw a smaller mesh"
        )


def _check_image(size: tuple[int, int], device: str) -> None:
    """Raise InputError where the device, or this machine's memory, has no room for an image."""
    width, height = size
    sides = (GL.GL_MAX_TEXTURE_SIZE, GL.GL_MAX_RENDERBUFFER_SIZE)
    limit = min(int(GL.glGetIntegerv(side)) for side in sides)
    if max(size) > limit or not _can_store(size):
        stores = range(limit, 0, -1)
        side = limit - bisect_left(stores, 1, key=lambda one: _can_store((one, one)))
        raise InputError(
            f"{device} draws at most {limit} pixels along a side, and {side} x {side} at once, "
            f"not {width} x {height}; choose a smaller frustum.resolution"
        )
    needed, free = PIXEL_BYTES * width * height, free_memory()
    if free is not None and needed > free:
        raise InputError(
            f"an image of {width} x {height} pixels needs about {needed / 2**30:.1f} GiB of memory, "
            f"{free / 2**30:.1f} GiB are free; choose a smaller frustum.resolution"
        )


def _can_store(size: tuple[int, int]) -> bool:
    """Return whether the current context's device can store the textures of an image; none is stored."""
    for internal, layout, kind in _TARGETS:
        GL.glTexImage2D(GL.GL_PROXY_TEXTURE_2D, 0, internal, *size, 0, layout, kind, None)
        if not int(GL.glGetTexLevelParameteriv(GL.GL_PROXY_TEXTURE_2D, 0, GL.GL_TEXTURE_WIDTH)):
            return False
    return True


def free_memory() -> int | None:
    """Return the bytes that a process can still take without swapping; None where the system does not say."""
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
    """Raise InputError where `Rasterizer` would: for commands that work long before they draw."""
    context = open_context()
    try:
        with context:
            check_room(scene, describe(context)["renderer"], vertex_bytes=POSITION_BYTES)
    finally:
        context.release()
