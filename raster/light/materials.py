"""Materials, lights and textures on the GPU, and the material and texture of each triangle."""

from __future__ import annotations

import moderngl
import numpy as np
from numpy.typing import NDArray

from xfrustum.raster.device.programs import assign
from xfrustum.raster.device.textures import Textures
from xfrustum.scenes.appearance.material import Material
from xfrustum.scenes.arrays import Singles
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.scene import Scene

SURFACES, MATERIALS, LIGHTS = 6, 7, 8
"""Bindings of storage blocks, as in surface.glsl and phong.glsl."""

UNIFORM_BINDINGS = {MATERIALS: 1, LIGHTS: 2}
"""Bindings of uniform blocks, which hold materials and lights where they are large enough."""

COUNT_NAMES = {MATERIALS: "MATERIAL_COUNT", LIGHTS: "LIGHT_COUNT"}
"""Names by which the shaders know the length of a uniform block."""

IS_SMOOTH, IS_COLORED = np.uint32(1 << 31), np.uint32(1 << 30)
"""Flags of a triangle beside the number of its material, as in surface.glsl."""


class Shading:
    """Materials, lights and textures as the shaders read them, uploaded once.

    Parameters
    ----------
    context, scene
        The current context, and a scene with at least one triangle.
    effects
        Effects that are simulated; textures are uploaded only if they are among them.

    Attributes
    ----------
    surfaces
        (F, 2) the material and texture of each triangle, see the function `surfaces`.
    defines
        Names that the shaders need, see `programs`.

    Raises
    ------
    InputError
        Textures larger than the device's largest block.
    """

    def __init__(self, context: moderngl.Context, scene: Scene, effects: frozenset[Effect]) -> None:
        lights = [light for light in scene.appearance.lights if max(light.color) > 0]
        self._light_count = len(lights)
        # A block cannot be empty: without lights there is a black one, which no shader reads.
        shining = [[*light.direction, 0.0, *light.color, 0.0] for light in lights] or [[0.0] * 8]
        environment = scene.appearance.environment
        strength = 0.0 if environment is None else environment.strength
        materials = list(dict.fromkeys(scene.materials))
        blocks = {
            MATERIALS: single([description(m, strength) for m in materials]),
            LIGHTS: single(shining),
        }
        largest = int(context.info["GL_MAX_UNIFORM_BLOCK_SIZE"])
        few = [binding for binding, block in blocks.items() if block.nbytes <= largest]
        self.defines = {COUNT_NAMES[binding]: str(len(blocks[binding])) for binding in few}
        self.surfaces = surfaces(scene, materials)
        buffers = {binding: context.buffer(block.tobytes()) for binding, block in blocks.items()}
        self._uniform = {UNIFORM_BINDINGS[binding]: buffers.pop(binding) for binding in few}
        self._storage = {**buffers, SURFACES: context.buffer(self.surfaces.tobytes())}
        self._textures = Textures(context, scene.surface.textures) if Effect.TEXTURES in effects else None

    def bind(self, program: moderngl.Program) -> None:
        """Bind the blocks for a program."""
        for binding, buffer in self._storage.items():
            buffer.bind_to_storage_buffer(binding)
        for binding, buffer in self._uniform.items():
            buffer.bind_to_uniform_block(binding)
        if self._textures is not None:
            self._textures.bind()
        assign(program, light_count=self._light_count)


def description(material: Material, strength: float) -> list[float]:
    """Return a material as surface.glsl has it: four times four numbers."""
    reflectance = [part * strength for part in material.reflectivity]
    specular = [*material.specular, material.exponent]
    return [*material.ambient, 0.0, *material.diffuse, 0.0, *specular, *reflectance, 0.0]


def surfaces(scene: Scene, materials: list[Material]) -> NDArray[np.uint32]:
    """Return the numbers of each triangle's material, with flags, and of its texture, plus 1: (F, 2).

    Parameters
    ----------
    materials
        The scene's materials, each once; their order numbers them.
    """
    number = {material: index for index, material in enumerate(materials)}
    of_object = np.array([number[material] for material in scene.materials], dtype=np.uint32)
    found = np.zeros((len(scene.faces), 2), dtype=np.uint32)
    found[:, 0] = of_object[scene.object_of_triangle]
    surface = scene.surface
    if surface.vertex_normals is not None:
        has_normal = np.asarray(np.isfinite(surface.vertex_normals).all(axis=1))
        found[has_normal[scene.faces].all(axis=1), 0] |= IS_SMOOTH
    if surface.vertex_colors is not None:
        has_color = np.asarray((surface.vertex_colors != 1).any(axis=1))
        found[has_color[scene.faces].any(axis=1), 0] |= IS_COLORED
    if surface.texture_of_triangle is not None:
        found[:, 1] = surface.texture_of_triangle + 1
    return found


def single(values: list[list[float]]) -> Singles:
    """Return values as float32, clipped to finite ones, because zero times infinity would not be zero."""
    largest = float(np.finfo(np.float32).max)
    return np.clip(values, -largest, largest).astype(np.float32)
