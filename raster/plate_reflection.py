"""Mirror-like surfaces of many hogels at once: a pass of its own per camera (paper, section 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from xfrustum.raster.cameras import SlabCamera
from xfrustum.raster.plate_drawing import PlateDrawing
from xfrustum.raster.plate_geometry import PlateGeometry
from xfrustum.raster.plate_program import reflection_program
from xfrustum.raster.submissions import Slot

IDENTITIES, ENVIRONMENT = 0, 1
"""Texture units, as in plate_reflection.frag."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reflective:
    """Which triangles reflect, and what.

    Attributes
    ----------
    triangles
        (F,) whether each is reflective.
    environment
        (H, W, 3) float32 radiance by latitude and longitude, row 0 upward, the middle behind the plate.
    """

    triangles: NDArray[np.bool_]
    environment: NDArray[np.float32]


class Reflections:
    """What draws the reflections of several hogels over their pictures.

    Parameters
    ----------
    context
        The current context.
    geometry
        The scene, with its reflective triangles.
    reflective
        What they reflect.
    hogels
        How many one submission may have.
    """

    def __init__(
        self, context: moderngl.Context, geometry: PlateGeometry, reflective: Reflective, hogels: int
    ) -> None:
        self._context = context
        program = reflection_program(context, hogels)
        self.drawing = PlateDrawing(context, program, geometry, geometry.reflections, hogels)
        height, width = reflective.environment.shape[:2]
        radiance = reflective.environment.astype(np.float32)
        self._environment = context.texture((width, height), 3, radiance.tobytes(), dtype="f4")
        self._environment.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self._environment.repeat_y = False

    def draw(self, slot: Slot, cameras: Sequence[SlabCamera], draws: Sequence[int], drawing: int) -> None:
        """Add every camera's reflections, wherever its picture has stayed visible.

        Parameters
        ----------
        slot
            With the pictures.
        cameras
            In drawing order.
        draws
            Of each camera, as uploaded.
        drawing
            The number of this one in the slot.
        """
        self._context.blend_func = (moderngl.ONE, moderngl.ONE)
        slot.target.begin_reflection(IDENTITIES)
        self._environment.use(ENVIRONMENT)
        program = self.drawing.program
        program["pixels"] = tuple(float(n) for n in slot.target.size)
        for number, camera in enumerate(cameras):
            program["camera"] = number
            program["conjugate"] = 1.0 if camera.orthoscopic else -1.0
            self.drawing.draw(slot.hogels[number], slot.commands[drawing][number], draws[number])
