"""Mirror-like surfaces of many hogels at once: a pass of its own per camera (paper, section 6)."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl

from xfrustum.raster.materials import Shading
from xfrustum.raster.passes import Pass
from xfrustum.raster.plate_drawing import PlateDrawing
from xfrustum.raster.plate_geometry import PlateGeometry
from xfrustum.raster.plate_program import reflection_program
from xfrustum.raster.programs import set_camera
from xfrustum.raster.reflection import Environment
from xfrustum.raster.submissions import Slot
from xfrustum.scenes.effects import Effect


class Reflections:
    """What draws the reflections of several hogels over their pictures.

    Parameters
    ----------
    context
        The current context.
    geometry
        The scene, with its reflective triangles.
    environment
        What they reflect.
    effects
        What is simulated.
    hogels
        How many one submission may have.
    """

    def __init__(
        self,
        context: moderngl.Context,
        geometry: PlateGeometry,
        environment: Environment,
        effects: frozenset[Effect],
        hogels: int,
    ) -> None:
        self._context = context
        self._environment = environment
        program = reflection_program(context, effects, hogels)
        self.drawing = PlateDrawing(context, program, geometry, geometry.reflections, hogels)

    def draw(
        self, slot: Slot, cameras: Sequence[Pass], draws: Sequence[int], drawing: int, shading: Shading
    ) -> None:
        """Add every camera's reflections, wherever its picture has stayed visible.

        Parameters
        ----------
        slot
            With the pictures.
        cameras
            In drawing order, those of any hogel.
        draws
            Of each camera, as uploaded.
        drawing
            The number of this one in the slot.
        shading
            The scene's materials.
        """
        self._context.blend_func = (moderngl.ONE, moderngl.ONE)
        slot.target.begin_reflection()
        self._environment.bind(slot.target)
        shading.bind(self.drawing.program)
        for number, camera in enumerate(cameras):
            self._context.front_face = camera.front_face
            set_camera(self.drawing.program, number, camera, slot.target.size)
            self.drawing.draw(slot.hogels[number], slot.commands[drawing][number], draws[number])
