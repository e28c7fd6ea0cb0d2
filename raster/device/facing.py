"""Which way faces are turned, as OpenGL is told for a camera, and which of them it leaves out."""

from __future__ import annotations

import moderngl

from xfrustum.raster.cameras.passes import Pass


def set_facing(context: moderngl.Context, camera: Pass) -> None:
    """Tell OpenGL which winding faces a camera, and which faces are left out."""
    context.front_face = camera.front_face
    if camera.culled_face is None:
        context.disable(moderngl.CULL_FACE)
    else:
        context.cull_face = camera.culled_face
        context.enable(moderngl.CULL_FACE)
