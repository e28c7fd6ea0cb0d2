"""What a device has room for, asked before anything is uploaded."""

from __future__ import annotations

from OpenGL import GL

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.scene import Scene

MAX_TRIANGLES = (1 << 31) // 3
"""Shaders index three values a triangle with signed 32-bit integers."""


def check_room(scene: Scene, device: str) -> None:
    """Raise InputError where a device draws no so large image, or has no so large block.

    Parameters
    ----------
    scene
        To be drawn in the current context.
    device
        Its name, for the message.
    """
    limit = int(GL.glGetIntegerv(GL.GL_MAX_TEXTURE_SIZE))
    width, height = scene.frustum.resolution
    if max(width, height) > limit:
        raise InputError(
            f"{device} draws at most {limit} x {limit} pixels, not {width} x {height}; "
            "choose a smaller frustum.resolution"
        )
    # Of each triangle three numbers of 32 bits: its normal, and its indices.
    block = min(int(GL.glGetIntegerv(GL.GL_MAX_SHADER_STORAGE_BLOCK_SIZE)), 4 * 3 * MAX_TRIANGLES)
    if 12 * len(scene.faces) > block:
        raise InputError(
            f"{scene.name}: {len(scene.faces):,} triangles need {12 * len(scene.faces) >> 20} MiB in one "
            f"block, {device} has {block >> 20}; draw a smaller mesh"
        )
