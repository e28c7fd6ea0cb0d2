"""What drawing many hogels at once is measured against: one hogel after the other, all triangles twice."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray
from OpenGL import GL

from xfrustum.raster.cameras.depth_formats import MAPPINGS
from xfrustum.raster.cameras.passes import Pass, cameras_in_order, pass_of
from xfrustum.raster.device.capacity import check_room
from xfrustum.raster.device.context import ContextOwner, open_context
from xfrustum.raster.device.mesh import ATTRIBUTES, NORMALS, attribute_of, number_triangles
from xfrustum.raster.device.programs import picture_defines, program, set_camera, set_facing
from xfrustum.raster.light import Shading
from xfrustum.raster.plate.geometry import FORMATS, flat_attributes
from xfrustum.raster.plate.picture import (
    HOGEL,
    HOGELS_BINDING,
    hogel_block,
    many_defines,
)
from xfrustum.raster.plate.targets import LayeredTarget, TargetFormat
from xfrustum.scenes.model.effects import Effect, Question, needed
from xfrustum.scenes.model.plate_content import PlateContent, PlateHogel
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture


class PlainLoop(ContextOwner):
    """The loop that anybody would write first: every camera draws the whole scene, then pixels are read.

    It shades, but draws no reflections.

    Parameters
    ----------
    scene
        At least one triangle.
    settings, content
        As for `PlateRenderer`.
    numbered
        Whether triangles take their numbers from vertices, as in `PlateRenderer`, and not from
        `gl_PrimitiveID`. A bare loop that asks for no numbers is as fast as one with them in vertices.

    Raises
    ------
    InputError
        The device has no room for the scene or its images.
    """

    def __init__(
        self, scene: Scene, settings: DoubleFrustum, content: PlateContent, *, numbered: bool = False
    ) -> None:
        self.scene, self.settings = scene, settings
        effects = needed(scene, question=Question(settings=(settings,))) - {Effect.REFLECTION}
        self._cameras = cameras_in_order(scene, settings)
        self._mapping = MAPPINGS[settings.mapping]
        self._context = context = open_context()
        with context:
            check_room(scene, str(context.info["GL_RENDERER"]))
            self._target = LayeredTarget(
                scene.frustum.resolution, 1, TargetFormat(depth=settings.depth, content=content)
            )
            self._normals = context.buffer(scene.normals.astype(np.float32).tobytes())
            self._shading = Shading(context, scene, effects)
            faces = scene.faces.astype(np.uint32)
            defines = {**picture_defines(self._mapping, effects), **self._shading.defines}
            self._program = program(
                context, "hogel.frag", {**(many_defines(context, 1) if numbered else {}), **defines}
            )
            attributes: dict[str, NDArray[Any]] = {name: attribute_of(scene, name) for name in ATTRIBUTES}
            self._hogel: moderngl.Buffer | None = None
            content_of_vertices = []
            if numbered:
                mesh = number_triangles(scene.faces)
                faces = mesh.faces
                attributes = {name: values[mesh.source] for name, values in attributes.items()}
                attributes |= flat_attributes(scene, mesh, self._shading.surfaces)
                self._hogel = context.buffer(reserve=HOGEL.itemsize, dynamic=True)
                zero = context.buffer(np.zeros(1, np.uint32).tobytes())
                content_of_vertices.append((zero, "1u4/i", "in_hogel"))
            for name in (name for name in attributes if name in self._program):
                values = context.buffer(attributes[name].tobytes())
                content_of_vertices.append((values, FORMATS[name], name))
            self._mesh = context.vertex_array(
                self._program, content_of_vertices, index_buffer=context.buffer(faces.tobytes())
            )

    def release(self) -> None:
        """Free the context and everything in it."""
        with self._context:
            self._target.release()
        self._context.release()

    def hogels(self, apertures: Iterable[Aperture]) -> Iterator[PlateHogel]:
        """Draw apertures, read each back, and yield their images."""
        for aperture in apertures:
            with self._context:
                self._draw(aperture)
                self._target.start_reading()
                color, triangle = self._target.finish_color(), self._target.finish_triangle()
            yield PlateHogel(
                aperture=aperture, color=color[0], triangle=None if triangle is None else triangle[0]
            )

    def draw_only(self, apertures: Iterable[Aperture]) -> None:
        """Draw apertures and read nothing back."""
        with self._context:
            for aperture in apertures:
                self._draw(aperture)
                GL.glFlush()
            GL.glFinish()

    def _draw(self, aperture: Aperture) -> None:
        self._target.begin()
        self._context.enable_only(moderngl.DEPTH_TEST)
        GL.glClipControl(GL.GL_LOWER_LEFT, self._mapping.clip_control)
        self._normals.bind_to_storage_buffer(NORMALS)
        for number, camera in enumerate(self._cameras):
            drawn = pass_of(self.scene, aperture, self.settings, camera)
            self._target.clear_depth(drawn.test.clear)
            self._context.depth_func = drawn.test.function
            set_facing(self._context, drawn)
            set_camera(self._program, number, drawn, self._target.size)
            self._shading.bind(self._program)
            self._set_hogel(drawn)
            self._mesh.render()

    def _set_hogel(self, drawn: Pass) -> None:
        if self._hogel is not None:
            self._hogel.write(hogel_block([drawn]).tobytes())
            self._hogel.bind_to_uniform_block(HOGELS_BINDING)
