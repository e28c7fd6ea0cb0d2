"""A scene on the GPU, drawn by the passes of an image into a target (paper, sections 3 and 6)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import moderngl
from OpenGL import GL

from xfrustum.raster.depth_formats import MAPPINGS
from xfrustum.raster.materials import Shading
from xfrustum.raster.mesh import Mesh
from xfrustum.raster.passes import Pass
from xfrustum.raster.programs import assign, defines_of, program
from xfrustum.raster.reflection import Environment
from xfrustum.raster.targets import Target
from xfrustum.scenes.double_frustum import DepthMapping
from xfrustum.scenes.effects import Effect
from xfrustum.scenes.scene import Scene

Drawn = tuple[moderngl.Program, moderngl.VertexArray]
"""A program, and the mesh for it."""


class Drawing:
    """A scene's mesh and, once a picture in color is asked for, its materials and lights on the GPU.

    Parameters
    ----------
    context
        The current context, also whenever something is drawn.
    scene
        At least one triangle.
    effects
        What is simulated: the shaders are made of these alone.
    """

    def __init__(self, context: moderngl.Context, scene: Scene, effects: frozenset[Effect]) -> None:
        self._context = context
        self._scene = scene
        self._effects = effects
        self._mesh = Mesh(context, scene)
        self._programs: dict[tuple[str, tuple[tuple[str, str], ...]], Drawn] = {}

    @cached_property
    def _shading(self) -> Shading:
        return Shading(self._context, self._scene, self._effects)

    @cached_property
    def _environment(self) -> Environment:
        return Environment(self._context, self._scene)

    def draw(self, target: Target, passes: Sequence[Pass], mapping: DepthMapping, *, color: bool) -> None:
        """Draw an image: every camera's picture, then every camera's reflections over it.

        Parameters
        ----------
        target
            Into which.
        passes
            The cameras, from the back.
        mapping
            Of depth.
        color
            Whether to shade; identities are drawn always.
        """
        # Every aperture of a plate comes through here alone. Many of them could be drawn at once, with
        # matrices by instance and a layer each: small images are bound by their vertices.
        target.begin()
        for number, camera in enumerate(passes):
            target.clear_depth(camera.test.clear)
            self._picture(target, number, camera, mapping, color=color)
        if color and Effect.REFLECTION in self._effects and passes:
            target.begin_reflection()
            for number, camera in enumerate(passes):
                self._reflect(target, number, camera)

    def _picture(
        self, target: Target, number: int, camera: Pass, mapping: DepthMapping, *, color: bool
    ) -> None:
        how = MAPPINGS[mapping]
        defines = {"SHADED": "1", **defines_of(self._effects)} if color else {}
        if how.fragment_depth:
            defines["FRAGMENT_DEPTH"] = f"({how.fragment_depth})"
        shaders, mesh = self._drawn("hogel.frag", defines)
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.depth_func = camera.test.function
        GL.glClipControl(GL.GL_LOWER_LEFT, how.clip_control)
        near, far = camera.planes
        assign(shaders, near=near, far=far)
        self._look(target, number, camera, shaders)
        if color:
            self._shading.bind(shaders)
        mesh.render()

    def _reflect(self, target: Target, number: int, camera: Pass) -> None:
        defines = {"MULTISAMPLED": "1"} if target.samples > 1 else {}
        if Effect.SMOOTH_NORMALS in self._effects:
            defines |= defines_of([Effect.SMOOTH_NORMALS])
        shaders, mesh = self._drawn("reflection.frag", defines)
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = (moderngl.ONE, moderngl.ONE)
        self._environment.bind(target)
        self._look(target, number, camera, shaders)
        self._shading.bind(shaders)
        assign(shaders, sample_count=target.samples)
        for first, count in self._environment.reflecting:
            assign(shaders, first_triangle=first)
            mesh.render(vertices=3 * count, first=3 * first)

    def _look(self, target: Target, number: int, camera: Pass, shaders: moderngl.Program) -> None:
        """Set what both kinds of passes must know of a camera."""
        self._context.front_face = camera.front_face
        self._mesh.bind()
        assign(
            shaders,
            clip_from_scene=tuple(camera.clip_from_scene.T.ravel().tolist()),
            line_of_pixel=tuple(camera.line_of_pixel.T.ravel().tolist()),
            conjugate=1.0 if camera.orthoscopic else -1.0,
            pixels=tuple(float(n) for n in target.size),
            camera=number,
        )

    def _drawn(self, fragment: str, defines: dict[str, str]) -> Drawn:
        key = (fragment, tuple(sorted(defines.items())))
        if key not in self._programs:
            made = program(self._context, fragment, defines)
            self._programs[key] = (made, self._mesh.drawn_by(made))
        return self._programs[key]
