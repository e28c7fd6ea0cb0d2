"""What a device has room for, asked before anything is uploaded."""

from __future__ import annotations

from OpenGL import GL

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.scene import Scene

MAX_TRIANGLES = (1 << 31) // 3
"""Shaders index three values a triangle with signed 32-bit integers."""


def check_room(scene: Scene, device: str, *, vertex_bytes: int = 0) -> None:
    """Raise InputError where a device draws no so large image, or has no so large block.

    Parameters
    ----------
    scene
        To be drawn in the current context.
    device
        Its name, for the message.
    vertex_bytes
        Of each vertex, what shaders read from a block.
    """
    if len(scene.faces) > MAX_TRIANGLES:
        raise InputError(f"{scene.name}: {len(scene.faces)} triangles; at most {MAX_TRIANGLES} can be drawn")
    limit = int(GL.glGetIntegerv(GL.GL_MAX_TEXTURE_SIZE))
    width, height = scene.frustum.resolution
    if max(width, height) > limit:
        raise InputError(
            f"{device} draws at most {limit} x {limit} pixels, not {width} x {height}; "
            "choose a smaller frustum.resolution"
        )
    block = int(GL.glGetIntegerv(GL.GL_MAX_SHADER_STORAGE_BLOCK_SIZE))
    # Of each triangle three numbers of 32 bits: its normal, and its indices.
    needed = max(vertex_bytes * len(scene.vertices), 12 * len(scene.faces))
    if needed > block:
        raise InputError(
            f"{scene.name}: {len(scene.faces):,} triangles on {len(scene.vertices):,} vertices need "
            f"{needed >> 20} MiB in one block, {device} has {block >> 20}; draw a smaller mesh"
        )
