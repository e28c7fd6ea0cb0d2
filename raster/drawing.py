"""Materials, lights, textures and reflections on the GPU (paper, sections 3 and 6)."""

from collections.abc import Sequence
from functools import cached_property

import moderngl
import numpy as np
from numpy.typing import NDArray
from OpenGL import GL

from xfrustum.raster.cameras import MAPPINGS, Pass
from xfrustum.raster.device.mesh import (
    Identified,
    Mesh,
    assign,
    picture_defines,
    program,
    reflection_defines,
    set_camera,
    set_facing,
)
from xfrustum.raster.device.targets import Target
from xfrustum.scenes.appearance import Material
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Bytes, Singles
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import DepthMapping
from xfrustum.scenes.representation import decoded

#: bindings of storage blocks, as in texture.glsl
TEXELS, PLACES, DECODED = 9, 10, 11

#: bytes of a texel: red, green, blue and alpha, of 8 bits each
BYTES_PER_TEXEL = 4


class Textures:
    """All textures, (H, W, 4) uint8 sRGB, in one block on the GPU; InputError if too large."""

    def __init__(self, context: moderngl.Context, textures: Sequence[Bytes]) -> None:
        largest = int(GL.glGetIntegerv(GL.GL_MAX_SHADER_STORAGE_BLOCK_SIZE))
        counts = [texture.shape[0] * texture.shape[1] for texture in textures]
        needed = BYTES_PER_TEXEL * sum(counts)
        if needed > largest:
            raise InputError(
                f"the scene's {len(textures)} textures need {needed >> 20} MiB in one block, "
                f"{context.info['GL_RENDERER']} has {largest >> 20}; use smaller textures"
            )
        first = np.cumsum([0, *counts[:-1]])
        places = [(at, t.shape[1], t.shape[0], 0) for at, t in zip(first, textures, strict=False)]
        # A block cannot be empty: without textures it has one texel, to which no triangle refers.
        texels = np.concatenate(
            [t.reshape(-1, 4) for t in textures] or [np.zeros((1, 4), np.uint8)]
        )
        self._buffers = {
            TEXELS: context.buffer(np.ascontiguousarray(texels).tobytes()),
            PLACES: context.buffer(np.array(places or [(0, 1, 1, 0)], dtype=np.uint32).tobytes()),
            DECODED: context.buffer(decoded(np.arange(256) / 255).astype(np.float32).tobytes()),
        }

    def bind(self) -> None:
        """Bind the blocks for the shaders."""
        for binding, buffer in self._buffers.items():
            buffer.bind_to_storage_buffer(binding)


SURFACES, MATERIALS, LIGHTS = (
    6,
    7,
    8,
)  #: bindings of storage blocks, as in surface.glsl and phong.glsl

#: Bindings of uniform blocks, used for materials and lights that fit into them
UNIFORM_BINDINGS = {MATERIALS: 1, LIGHTS: 2}

#: Shader names of the lengths of the uniform blocks
COUNT_NAMES = {MATERIALS: "MATERIAL_COUNT", LIGHTS: "LIGHT_COUNT"}

#: Flags of a triangle, in the high bits of its material number, as in surface.glsl
IS_SMOOTH, IS_COLORED = np.uint32(1 << 31), np.uint32(1 << 30)


class Shading:
    """Materials, lights and, if `effects` include them, textures, uploaded once.

    `surfaces` has the material and texture of each triangle, `defines` the definitions for the
    shaders.
    """

    def __init__(self, context: moderngl.Context, scene: Scene, effects: frozenset[Effect]) -> None:
        lights = [light for light in scene.appearance.lights if max(light.color) > 0]
        self._light_count = len(lights)
        # A block cannot be empty: without lights it has a black light, which no shader reads.
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
        self._textures = (
            Textures(context, scene.surface.textures) if Effect.TEXTURES in effects else None
        )

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
    """Return a material in the layout of surface.glsl: four vectors of four numbers."""
    reflectance = [part * strength for part in material.reflectivity]
    specular = [*material.specular, material.exponent]
    return [*material.ambient, 0.0, *material.diffuse, 0.0, *specular, *reflectance, 0.0]


def surfaces(scene: Scene, materials: list[Material]) -> NDArray[np.uint32]:
    """Return (F, 2) for each triangle: material number with flags, and texture number + 1."""
    number = {material: index for index, material in enumerate(materials)}
    of_object = np.array([number[material] for material in scene.materials], dtype=np.uint32)
    numbers = np.zeros((len(scene.faces), 2), dtype=np.uint32)
    numbers[:, 0] = of_object[scene.object_of_triangle]
    surface = scene.surface
    if surface.vertex_normals is not None:
        has_normal = np.asarray(np.isfinite(surface.vertex_normals).all(axis=1))
        numbers[has_normal[scene.faces].all(axis=1), 0] |= IS_SMOOTH
    if surface.vertex_colors is not None:
        has_color = np.asarray((surface.vertex_colors != 1).any(axis=1))
        numbers[has_color[scene.faces].any(axis=1), 0] |= IS_COLORED
    if surface.texture_of_triangle is not None:
        numbers[:, 1] = surface.texture_of_triangle + 1
    return numbers


def single(values: list[list[float]]) -> Singles:
    """Return values as finite float32, because zero times infinity is not zero."""
    largest = float(np.finfo(np.float32).max)
    return np.clip(values, -largest, largest).astype(np.float32)


#: texture units, as in reflection.frag and environment.glsl
IDENTITIES, ENVIRONMENT = 0, 1


class Environment:
    """Environment map on the GPU (black if none), and reflective triangles.

    Raises InputError if the map is too large for the device.
    """

    def __init__(self, context: moderngl.Context, scene: Scene) -> None:
        environment = scene.appearance.environment
        radiance = np.zeros((1, 1, 3), np.float32) if environment is None else environment.radiance
        height, width = radiance.shape[:2]
        limit = int(context.info["GL_MAX_TEXTURE_SIZE"])
        if max(width, height) > limit:
            raise InputError(
                f"{context.info['GL_RENDERER']} holds environment maps of at most {limit} x "
                f"{limit}, not {width} x {height}; use a smaller one"
            )
        # Row 0 is the top row: the shader fetches texels by number and counts rows from the top.
        self._map = context.texture((width, height), 3, radiance.tobytes(), dtype="f4", alignment=4)
        self._map.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self.reflecting = reflecting(scene)

    def bind(self, target: Identified) -> None:
        """Bind the map and the target's identities for the shader."""
        target.bind_identity(IDENTITIES)
        self._map.use(ENVIRONMENT)


def reflecting(scene: Scene) -> list[tuple[int, int]]:
    """Return the first triangle and the length of each run of reflective triangles."""
    mirrors = np.array(
        [max(material.reflectivity) > 0 for material in scene.materials], dtype=np.bool_
    )
    reflects = np.concatenate(([False], mirrors[scene.object_of_triangle], [False]))
    (changes,) = np.nonzero(reflects[1:] != reflects[:-1])
    return [(int(start), int(end - start)) for start, end in changes.reshape(-1, 2)]


#: Names of hogel.vert and hogel.frag for a picture without color
NUMBERS_ALONE = {"NUMBERED": "1"}

#: Fragment shader of a program, and its definitions
ProgramKey = tuple[str, tuple[tuple[str, str], ...]]

#: Program, and mesh with the attributes that the program reads (None without triangles)
ProgramWithMesh = tuple[moderngl.Program, moderngl.VertexArray | None]


class Drawing:
    """Mesh of a scene on the GPU; the first picture in color uploads materials and lights.

    The scene must have at least one triangle. The context must be current here and in `draw`.
    """

    def __init__(self, context: moderngl.Context, scene: Scene) -> None:
        self._context = context
        self._scene = scene
        self._shadings: dict[bool, Shading] = {}
        self._mesh = Mesh(context, scene)
        self._programs: dict[ProgramKey, moderngl.Program] = {}
        self._meshes: dict[tuple[ProgramKey, int | None], moderngl.VertexArray | None] = {}

    def _shading(self, effects: frozenset[Effect]) -> Shading:
        """Return materials and lights, with textures only if `effects` include them."""
        textured = Effect.TEXTURES in effects
        if textured not in self._shadings:
            self._shadings[textured] = Shading(self._context, self._scene, effects)
        return self._shadings[textured]

    @cached_property
    def _environment(self) -> Environment:
        return Environment(self._context, self._scene)

    def draw(
        self,
        target: Target,
        passes: Sequence[Pass],
        mapping: DepthMapping,
        effects: frozenset[Effect],
        *,
        color: bool,
    ) -> None:
        """Draw the passes from back to front, then their reflections, into a cleared target.

        Shaders contain only the simulated effects. Without `color`, only triangle numbers are
        drawn.
        """
        # This draws one aperture; `plate.renderer` draws many at once.
        target.begin(color=color)
        for number, camera in enumerate(passes):
            target.clear_depth(camera.clear)
            self._picture(target, number, camera, mapping, effects if color else None)
        if color and Effect.REFLECTION in effects and passes:
            target.begin_reflection()
            for number, camera in enumerate(passes):
                self._reflect(target, number, camera, effects)

    def _picture(
        self,
        target: Target,
        number: int,
        camera: Pass,
        mapping: DepthMapping,
        effects: frozenset[Effect] | None,
    ) -> None:
        how = MAPPINGS[mapping]
        shading = None if effects is None else self._shading(effects)
        defines = picture_defines(how, effects) | (
            NUMBERS_ALONE if shading is None else shading.defines
        )
        shaders, mesh = self._drawn(
            "hogel.frag", defines, None if shading else self._mesh.side_of(camera.heights)
        )
        if mesh is None:
            return
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.depth_func = camera.depth_function
        GL.glClipControl(GL.GL_LOWER_LEFT, how.clip_control)
        self._look(target, number, camera, shaders)
        if shading is not None:
            shading.bind(shaders)
        mesh.render()

    def _reflect(
        self, target: Target, number: int, camera: Pass, effects: frozenset[Effect]
    ) -> None:
        shading = self._shading(effects)
        samples = {"MULTISAMPLED": "1"} if target.samples > 1 else {}
        defines = {**samples, **reflection_defines(effects), **shading.defines}
        shaders, mesh = self._drawn("reflection.frag", defines)
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = (moderngl.ONE, moderngl.ONE)
        self._environment.bind(target)
        self._look(target, number, camera, shaders)
        shading.bind(shaders)
        assign(shaders, sample_count=target.samples)
        for first, count in self._environment.reflecting:
            assign(shaders, first_triangle=first)
            assert mesh is not None, "it has the triangles that reflect"
            mesh.render(first=3 * first, vertices=3 * count)

    def _look(self, target: Target, number: int, camera: Pass, shaders: moderngl.Program) -> None:
        """Set the camera uniforms of pictures and reflections."""
        set_facing(self._context, camera)
        self._mesh.bind()
        set_camera(shaders, number, camera, target.size)

    def _drawn(
        self, fragment: str, defines: dict[str, str], side: int | None = None
    ) -> ProgramWithMesh:
        """Return a program and its mesh, restricted to a `side` of the plate if given."""
        key = (fragment, tuple(sorted(defines.items())))
        if key not in self._programs:
            self._programs[key] = program(self._context, fragment, defines)
        made = self._programs[key]
        if (key, side) not in self._meshes:
            mesh = self._mesh.drawn_by(made) if side is None else self._mesh.numbered(made, side)
            self._meshes[key, side] = mesh
        return made, self._meshes[key, side]
