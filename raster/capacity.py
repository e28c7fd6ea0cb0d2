"""Whether this machine can draw a scene, asked before any work is done."""

from __future__ import annotations

from xfrustum.raster.device.capacity import check_room
from xfrustum.raster.device.context import describe, open_context
from xfrustum.raster.rasterizer import POSITION_BYTES
from xfrustum.scenes.model.scene import Scene


def require_room(scene: Scene) -> None:
    """Refuse a scene whose images or triangles `Rasterizer` would refuse, without uploading any.

    For commands that work for long before they draw.

    Raises
    ------
    InputError
        There is no usable OpenGL, or the device or the memory has no room for the image or the mesh.
    """
    context = open_context()
    try:
        with context:
            check_room(scene, describe(context)["renderer"], vertex_bytes=POSITION_BYTES)
    finally:
        context.release()
