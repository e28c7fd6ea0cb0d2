"""The programs that draw many hogels at once: the same shaders as for one."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files

import moderngl
import numpy as np
from numpy.typing import NDArray

from xfrustum.raster.cameras import Matrix
from xfrustum.raster.depth_formats import Mapping
from xfrustum.raster.passes import Pass
from xfrustum.scenes.light import DEFAULT_LIGHT

HOGELS_BINDING = 0
"""Of the uniform block with what differs from hogel to hogel."""
NORMALS_BINDING = 0
"""Of the storage block with a normal for each triangle."""

LAYER_EXTENSIONS = frozenset({"GL_ARB_shader_viewport_layer_array"})

HOGEL = np.dtype([("clip_from_scene", "f4", (4, 4)), ("line_of_pixel", "f4", (3, 4))])
"""One hogel in hogels.glsl: matrices by columns, each of four numbers."""


def picture_program(context: moderngl.Context, mapping: Mapping, hogels: int | None) -> moderngl.Program:
    """Return the program of hogel.vert and hogel.frag.

    Parameters
    ----------
    context
        The current context.
    mapping
        Of depth.
    hogels
        How many one submission may have; None for the program that draws one.
    """
    defines = {} if hogels is None else _many(context, hogels)
    if mapping.fragment_depth:
        defines["FRAGMENT_DEPTH"] = f"({mapping.fragment_depth})"
    program = _program(context, "hogel.frag", defines)
    program["albedo"] = DEFAULT_LIGHT.albedo
    program["ambient"] = DEFAULT_LIGHT.ambient
    return program


def reflection_program(context: moderngl.Context, hogels: int) -> moderngl.Program:
    """Return the program of hogel.vert and plate_reflection.frag."""
    return _program(context, "plate_reflection.frag", _many(context, hogels))


def lets_vertices_choose_layers(context: moderngl.Context) -> bool:
    """Return whether one draw may reach many layers; no version of OpenGL promises it."""
    return bool(LAYER_EXTENSIONS & set(context.extensions))


def set_camera(program: moderngl.Program, number: int, camera: Pass, mapping: Mapping) -> None:
    """Set what all hogels' pictures have in common in one pass."""
    program["light"] = camera.light
    program["camera"] = number
    if mapping.fragment_depth:
        program["near"], program["far"] = camera.planes


def hogel_block(cameras: Sequence[Pass]) -> NDArray[np.void]:
    """Return what differs between some hogels' shares of one camera, as hogels.glsl has it."""
    clip = np.stack([camera.clip_from_scene for camera in cameras])
    block = np.zeros(len(cameras), dtype=HOGEL)
    block["clip_from_scene"] = clip.swapaxes(1, 2)
    block["line_of_pixel"][:, :, :3] = lines_of_pixels(clip).swapaxes(1, 2)
    return block


def lines_of_pixels(clip_from_scene: Matrix) -> Matrix:
    """Return (.., 3, 3) directions away from cameras, scene axes, of film coordinates (u, v, 1) upward.

    A camera's position is the point without x, y and w in clip coordinates, and what lies at
    depth w along a direction d from it has w (u, v, 1): d is what the matrix makes (u, v, 1) of.
    """
    return np.asarray(np.linalg.inv(clip_from_scene[..., (0, 1, 3), :3]), np.float64)


def _many(context: moderngl.Context, hogels: int) -> dict[str, str]:
    layers = {"WITH_LAYERS": "1"} if lets_vertices_choose_layers(context) else {}
    return {"MANY": str(hogels), **layers}


def _program(context: moderngl.Context, fragment: str, defines: dict[str, str]) -> moderngl.Program:
    return context.program(
        vertex_shader=_defined(_shader("hogel.vert"), defines),
        fragment_shader=_defined(_shader(fragment), defines),
    )


def _shader(name: str) -> str:
    """Return a file of the folder `shaders`, files that it includes put in."""
    lines = []
    for line in (files("xfrustum.raster") / "shaders" / name).read_text().splitlines():
        word, _, included = line.partition(" ")
        lines.append(_shader(included.strip('"')) if word == "#include" else line)
    return "\n".join(lines) + "\n"


def _defined(source: str, defines: dict[str, str]) -> str:
    """Return a shader with names defined after its first line, which is the version of GLSL."""
    version, rest = source.split("\n", 1)
    return "\n".join((version, *(f"#define {name} {value}" for name, value in defines.items()), rest))
