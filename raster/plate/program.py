"""The programs that draw many hogels at once, made of the same shaders as those that draw one."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray

from xfrustum.raster.cameras.passes import Pass, lines_of_pixels
from xfrustum.raster.device.programs import Defines, program

HOGELS_BINDING = 0
"""Binding of the uniform block with the matrices of each hogel."""

LAYER_EXTENSIONS = frozenset({"GL_ARB_shader_viewport_layer_array"})
"""Extensions of OpenGL each of which lets a vertex shader choose the layer that is drawn on."""

HOGEL = np.dtype([("clip_from_scene", "f4", (4, 4)), ("line_of_pixel", "f4", (3, 4))])
"""Layout of one hogel in hogels.glsl: two matrices by columns, each column of four numbers."""


def picture_program(context: moderngl.Context, defines: Defines, hogels: int | None) -> moderngl.Program:
    """Return the program of hogel.vert and hogel.frag.

    Parameters
    ----------
    context
        The current context.
    defines
        Names that the shaders ask for, see `programs.picture_defines` and `Shading.defines`.
    hogels
        Largest number of hogels in one submission; None for the program that draws one.
    """
    many = {} if hogels is None else _many(context, hogels)
    return program(context, "hogel.frag", {**many, **defines})


def reflection_program(context: moderngl.Context, defines: Defines, hogels: int) -> moderngl.Program:
    """Return the program of hogel.vert and reflection.frag; parameters as for `picture_program`."""
    return program(context, "reflection.frag", {**_many(context, hogels), **defines})


def lets_vertices_choose_layers(context: moderngl.Context) -> bool:
    """Return whether one draw may reach many layers, which no version of OpenGL requires."""
    return bool(LAYER_EXTENSIONS & set(context.extensions))


def hogel_block(cameras: Sequence[Pass]) -> NDArray[np.void]:
    """Return the matrices of one camera for some hogels, in the layout of hogels.glsl."""
    clip = np.stack([camera.clip_from_scene for camera in cameras])
    block = np.zeros(len(cameras), dtype=HOGEL)
    block["clip_from_scene"] = clip.swapaxes(1, 2)
    block["line_of_pixel"][:, :, :3] = lines_of_pixels(clip).swapaxes(1, 2)
    return block


def _many(context: moderngl.Context, hogels: int) -> dict[str, str]:
    layers = {"WITH_LAYERS": "1"} if lets_vertices_choose_layers(context) else {}
    return {"MANY": str(hogels), **layers}
