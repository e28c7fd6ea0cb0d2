"""Light for many hogels at once, where it is decided what each pixel shows."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np

from xfrustum.raster.materials import Shading
from xfrustum.raster.mesh import NORMALS
from xfrustum.raster.passes import Pass
from xfrustum.raster.plate_program import HOGELS_BINDING, later_program
from xfrustum.raster.programs import defines_of, set_camera
from xfrustum.raster.reflection import IDENTITIES
from xfrustum.raster.submissions import Slot
from xfrustum.scenes.effects import Effect
from xfrustum.scenes.scene import Scene

INTERPOLATED = frozenset({Effect.SMOOTH_NORMALS, Effect.VERTEX_COLORS, Effect.TEXTURES})
"""What is known only while a triangle is drawn."""


class LateLight:
    """Shades pixels instead of triangles: of small triangles, most pixels meet many.

    Parameters
    ----------
    context
        The current context.
    scene
        At least one triangle.
    shading
        Its materials and lights.
    effects
        What is simulated, but for `INTERPOLATED`.
    hogels
        How many one submission may have.
    """

    def __init__(
        self,
        context: moderngl.Context,
        scene: Scene,
        shading: Shading,
        effects: frozenset[Effect],
        hogels: int,
    ) -> None:
        self._shading = shading
        defines = {"SHADED_LATER": "1", **defines_of(effects), **shading.defines}
        self._program = later_program(context, defines, hogels)
        self._film = context.vertex_array(self._program, [])
        self._normals = context.buffer(scene.normals.astype(np.float32).tobytes())

    def draw(self, slot: Slot, cameras: Sequence[Pass], hogels: int) -> None:
        """Shade what every camera drew.

        Parameters
        ----------
        slot
            With the identities.
        cameras
            In drawing order, those of any hogel.
        hogels
            How many were drawn.
        """
        slot.target.begin_color()
        slot.target.bind_identity(IDENTITIES)
        self._normals.bind_to_storage_buffer(NORMALS)
        self._shading.bind(self._program)
        for number, camera in enumerate(cameras):
            slot.hogels[number].bind_to_uniform_block(HOGELS_BINDING)
            set_camera(self._program, number, camera, slot.target.size)
            self._film.render(vertices=3, instances=hogels)
