"""The programs that draw many hogels at once: the same shaders as for one."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray

from xfrustum.raster.cameras.passes import Pass, lines_of_pixels
from xfrustum.raster.device.programs import Defines, program

HOGELS_BINDING = 0
"""Of the uniform block with what differs from hogel to hogel."""

LAYER_EXTENSIONS = frozenset({"GL_ARB_shader_viewport_layer_array"})

HOGEL = np.dtype([("clip_from_scene", "f4", (4, 4)), ("line_of_pixel", "f4", (3, 4))])
"""One hogel in hogels.glsl: matrices by columns, each of four numbers."""


def picture_program(context: moderngl.Context, defines: Defines, hogels: int | None) -> moderngl.Program:
    """Return the program of hogel.vert and hogel.frag.

    Parameters
    ----------
    context
        The current context.
    defines
        See `programs.picture_defines` and `Shading.defines`.
    hogels
        How many one submission may have; None for the program that draws one.
    """
    many = {} if hogels is None else _many(context, hogels)
    return program(context, "hogel.frag", {**many, **defines})


def reflection_program(context: moderngl.Context, defines: Defines, hogels: int) -> moderngl.Program:
    """Return the program of hogel.vert and reflection.frag, likewise."""
    return program(context, "reflection.frag", {**_many(context, hogels), **defines})


def lets_vertices_choose_layers(context: moderngl.Context) -> bool:
    """Return whether one draw may reach many layers; no version of OpenGL promises it."""
    return bool(LAYER_EXTENSIONS & set(context.extensions))


def hogel_block(cameras: Sequence[Pass]) -> NDArray[np.void]:
    """Return what differs between some hogels' shares of one camera, as hogels.glsl has it."""
    clip = np.stack([camera.clip_from_scene for camera in cameras])
    block = np.zeros(len(cameras), dtype=HOGEL)
    block["clip_from_scene"] = clip.swapaxes(1, 2)
    block["line_of_pixel"][:, :, :3] = lines_of_pixels(clip).swapaxes(1, 2)
    return block


def _many(context: moderngl.Context, hogels: int) -> dict[str, str]:
    layers = {"WITH_LAYERS": "1"} if lets_vertices_choose_layers(context) else {}
    return {"MANY": str(hogels), **layers}
