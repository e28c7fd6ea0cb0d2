"""The pictures of several hogels: every camera's picture and, over them, every camera's reflections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import moderngl
import numpy as np
from OpenGL import GL

from xfrustum.raster.cameras.depth_formats import Mapping
from xfrustum.raster.cameras.passes import Pass
from xfrustum.raster.device.programs import picture_defines, reflection_defines, set_camera, set_facing
from xfrustum.raster.light.materials import Shading
from xfrustum.raster.light.reflection import Environment, reflecting
from xfrustum.raster.plate.clusters import WHOLE_FILM
from xfrustum.raster.plate.drawing import PlateDrawing
from xfrustum.raster.plate.geometry import PlateGeometry
from xfrustum.raster.plate.program import hogel_block, picture_program, reflection_program
from xfrustum.raster.plate.reflection import Reflections
from xfrustum.raster.plate.submissions import Slot
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.scene import Scene

PICTURE, REFLECTION = 0, 1
"""Places of the two drawings in `PlatePicture.drawings` and in `Slot.commands`."""


@dataclass(frozen=True, kw_only=True)
class Look:
    """The way in which a plate is drawn.

    Attributes
    ----------
    mapping
        Depth mapping.
    effects
        Effects that are simulated.
    hogels
        Largest number of hogels in one submission.
    """

    mapping: Mapping
    effects: frozenset[Effect]
    hogels: int


class PlatePicture:
    """A scene on the GPU with its materials and lights, and the programs that draw it.

    Parameters
    ----------
    context, scene
        The context that is current now and whenever something is drawn, and a scene with triangles.
    passes
        The cameras as they are for any one aperture; at least one.
    look
        Way in which the plate is drawn.

    Raises
    ------
    InputError
        Textures or the environment map are larger than the device allows.
    """

    def __init__(self, context: moderngl.Context, scene: Scene, passes: Sequence[Pass], look: Look) -> None:
        self._context, self._mapping = context, look.mapping
        effects, hogels = look.effects, look.hogels
        mirrors = reflective_triangles(scene, effects)
        self._shading = Shading(context, scene, effects)
        self._geometry = PlateGeometry(
            context, scene, passes, look.mapping.clip_control, (self._shading.surfaces, mirrors)
        )
        defines = {**picture_defines(look.mapping, effects), **self._shading.defines}
        program = picture_program(context, defines, hogels)
        picture = PlateDrawing(context, program, self._geometry, self._geometry.surfaces, hogels)
        self.drawings, self._reflections = [picture], None
        if mirrors.any():
            defines = {**reflection_defines(effects), **self._shading.defines}
            program = reflection_program(context, defines, hogels)
            drawing = PlateDrawing(context, program, self._geometry, self._geometry.reflections, hogels)
            self._reflections = Reflections(context, drawing, Environment(context, scene))
            self.drawings.append(self._reflections.drawing)

    @property
    def triangles_of_cameras(self) -> list[int]:
        """Largest number of triangles that each camera draws."""
        return [part.count for part in self._geometry.surfaces]

    @property
    def reflects(self) -> bool:
        """Whether any triangle is drawn once more for its reflection."""
        return self._reflections is not None

    def begin(self, slot: Slot, enabled: int, box: tuple[int, int, int, int] | None = None) -> None:
        """Clear a slot's target and draw into it from now on.

        Parameters
        ----------
        slot
            Slot that is drawn into.
        enabled
            moderngl's flags of what is enabled while pictures are drawn.
        box
            Part of the films that is drawn; see `LayeredTarget.begin`.
        """
        self._context.enable_only(enabled)
        GL.glClipControl(GL.GL_LOWER_LEFT, self._mapping.clip_control)
        slot.target.begin(box)

    def upload(
        self, slot: Slot, number: int, hogels: Sequence[Pass], windows: Floats = WHOLE_FILM
    ) -> list[int]:
        """Upload what a camera draws for the hogels, and return the number of draws of each drawing.

        Parameters
        ----------
        slot
            Slot that is drawn into.
        number, hogels
            The camera, and what it is for each hogel.
        windows
            (L, 4) the part of each hogel's film that is wanted; see `clusters.clip_planes`.
        """
        block = hogel_block(hogels)
        slot.hogels[number].write(block.tobytes())
        matrices = np.ascontiguousarray(block["clip_from_scene"].swapaxes(1, 2))
        return [
            drawing.upload(number, matrices, commands[number], windows)
            for drawing, commands in zip(self.drawings, slot.commands, strict=True)
        ]

    def draw(self, slot: Slot, number: int, camera: Pass, draws: int) -> None:
        """Draw one camera's picture for the hogels, over those of the cameras before it.

        Parameters
        ----------
        slot
            Slot that is drawn into.
        number, camera
            The camera, as any one of the hogels has it.
        draws
            Number of draws, which `upload` returned.
        """
        drawing = self.drawings[PICTURE]
        slot.target.clear_depth(camera.test.clear)
        self._context.depth_func = camera.test.function
        set_facing(self._context, camera)
        set_camera(drawing.program, number, camera, slot.target.size)
        self._shading.bind(drawing.program)
        drawing.draw(slot.hogels[number], slot.commands[PICTURE][number], draws)

    def reflect(self, slot: Slot, cameras: Sequence[Pass], draws: Sequence[int], enabled: int) -> None:
        """Draw every camera's reflections over the picture, if anything reflects; see `Reflections.draw`.

        `enabled` holds the flags of the context with which the pictures were drawn.
        """
        if self._reflections is not None:
            self._context.enable_only(enabled & ~moderngl.DEPTH_TEST | moderngl.BLEND)
            self._reflections.draw(slot, cameras, draws, REFLECTION, self._shading)


def reflective_triangles(scene: Scene, effects: frozenset[Effect]) -> Mask:
    """Return (F,) which triangles are drawn once more for their reflections."""
    found = np.zeros(len(scene.faces), dtype=np.bool_)
    if Effect.REFLECTION in effects:
        for first, count in reflecting(scene):
            found[first : first + count] = True
    return found
