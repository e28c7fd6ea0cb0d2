"""A scene on the GPU, drawn by the passes of an image into a target (paper, sections 3 and 6)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import moderngl
from OpenGL import GL

from xfrustum.raster.cameras.depth_formats import MAPPINGS
from xfrustum.raster.cameras.passes import Pass
from xfrustum.raster.device.mesh import Mesh
from xfrustum.raster.device.programs import (
    assign,
    picture_defines,
    program,
    reflection_defines,
    set_camera,
    set_facing,
)
from xfrustum.raster.device.targets import Target
from xfrustum.raster.light import Environment, Shading
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthMapping

NUMBERS_ALONE = {"NUMBERED": "1"}
"""Names that hogel.vert and hogel.frag ask for where a picture has no color."""

ProgramKey = tuple[str, tuple[tuple[str, str], ...]]
"""Fragment shader of a program, and the names that are defined in it."""

ProgramWithMesh = tuple[moderngl.Program, moderngl.VertexArray | None]
"""A program, and the mesh with the attributes that it reads; None where no triangle is to be drawn."""


class Drawing:
    """A scene's mesh and, once a picture in color is asked for, its materials and lights on the GPU.

    Parameters
    ----------
    context
        The context that is current now, and whenever something is drawn.
    scene
        Scene with at least one triangle.
    """

    def __init__(self, context: moderngl.Context, scene: Scene) -> None:
        self._context = context
        self._scene = scene
        self._shadings: dict[bool, Shading] = {}
        self._mesh = Mesh(context, scene)
        self._programs: dict[ProgramKey, moderngl.Program] = {}
        self._meshes: dict[tuple[ProgramKey, int | None], moderngl.VertexArray | None] = {}

    def _shading(self, effects: frozenset[Effect]) -> Shading:
        """Return materials and lights, with textures only where effects have them."""
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
        """Draw an image: every camera's picture, then every camera's reflections over it.

        Parameters
        ----------
        target
            Target that is cleared and drawn into.
        passes
            The cameras, from the back.
        mapping
            Depth mapping.
        effects
            Effects that are simulated: the shaders contain these alone.
        color
            Whether to shade; triangle numbers are always drawn.
        """
        # Each aperture is drawn by itself here; `plate.renderer` draws many at once.
        target.begin(color=color)
        for number, camera in enumerate(passes):
            target.clear_depth(camera.test.clear)
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
        defines = picture_defines(how, effects) | (NUMBERS_ALONE if shading is None else shading.defines)
        shaders, mesh = self._drawn(
            "hogel.frag", defines, None if shading else self._mesh.side_of(camera.heights)
        )
        if mesh is None:
            return
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.depth_func = camera.test.function
        GL.glClipControl(GL.GL_LOWER_LEFT, how.clip_control)
        self._look(target, number, camera, shaders)
        if shading is not None:
            shading.bind(shaders)
        mesh.render()

    def _reflect(self, target: Target, number: int, camera: Pass, effects: frozenset[Effect]) -> None:
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
        """Set what pictures and reflections alike must know of a camera."""
        set_facing(self._context, camera)
        self._mesh.bind()
        set_camera(shaders, number, camera, target.size)

    def _drawn(self, fragment: str, defines: dict[str, str], side: int | None = None) -> ProgramWithMesh:
        """Return a program and the mesh for it: with numbers of its own for some side, if one is given."""
        key = (fragment, tuple(sorted(defines.items())))
        if key not in self._programs:
            self._programs[key] = program(self._context, fragment, defines)
        made = self._programs[key]
        if (key, side) not in self._meshes:
            mesh = self._mesh.drawn_by(made) if side is None else self._mesh.numbered(made, side)
            self._meshes[key, side] = mesh
        return made, self._meshes[key, side]
