"""Mirror-like surfaces of many hogels at once, in a pass of its own per camera (paper, section 6)."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl

from xfrustum.raster.cameras.passes import Pass
from xfrustum.raster.device.programs import set_camera, set_facing
from xfrustum.raster.light.materials import Shading
from xfrustum.raster.light.reflection import Environment
from xfrustum.raster.plate.drawing import PlateDrawing
from xfrustum.raster.plate.submissions import Slot


class Reflections:
    """The reflections of several hogels, drawn over their pictures.

    Parameters
    ----------
    context
        The current context.
    drawing
        Drawing of the reflective triangles.
    environment
        The environment that they reflect.
    """

    def __init__(self, context: moderngl.Context, drawing: PlateDrawing, environment: Environment) -> None:
        self._context, self.drawing, self._environment = context, drawing, environment

    def draw(
        self, slot: Slot, cameras: Sequence[Pass], draws: Sequence[int], drawing: int, shading: Shading
    ) -> None:
        """Add every camera's reflections, wherever its picture has stayed visible.

        Parameters
        ----------
        slot
            Slot whose target holds the pictures.
        cameras
            The cameras in drawing order, as any one of the hogels has them.
        draws
            Number of draws of each camera, which `upload` returned.
        drawing
            Place of the reflections in `Slot.commands`.
        shading
            The scene's materials.
        """
        self._context.blend_func = (moderngl.ONE, moderngl.ONE)
        slot.target.begin_reflection()
        self._environment.bind(slot.target)
        shading.bind(self.drawing.program)
        for number, camera in enumerate(cameras):
            set_facing(self._context, camera)
            set_camera(self.drawing.program, number, camera, slot.target.size)
            self.drawing.draw(slot.hogels[number], slot.commands[drawing][number], draws[number])
