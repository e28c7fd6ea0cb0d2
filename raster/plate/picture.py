"""The pictures of several hogels: every camera's picture and, over them, every camera's reflections.

The programs are made of the same shaders as those that draw one hogel. A submission draws several hogels, and
owns its target and buffers until it is read back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import TypeVar

import moderngl
import numpy as np
from numpy.typing import NDArray
from OpenGL import GL

from xfrustum.raster.cameras.depth_formats import Mapping
from xfrustum.raster.cameras.passes import Pass, lines_of_pixels
from xfrustum.raster.device.programs import (
    Defines,
    picture_defines,
    program,
    reflection_defines,
    set_camera,
    set_facing,
)
from xfrustum.raster.light import Environment, Shading, reflecting
from xfrustum.raster.plate.clusters import WHOLE_FILM
from xfrustum.raster.plate.geometry import DRAW_COMMAND, FORMATS, PassGeometry, PlateGeometry
from xfrustum.raster.plate.targets import LayeredTarget, TargetFormat
from xfrustum.scenes.arrays import Floats, Mask, Singles
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.scene import Scene

HOGELS_BINDING = 0
"""Binding of the uniform block with the matrices of each hogel."""

LAYER_EXTENSIONS = frozenset({"GL_ARB_shader_viewport_layer_array"})
"""Extensions of OpenGL each of which lets a vertex shader choose the layer that is drawn on."""

HOGEL = np.dtype([("clip_from_scene", "f4", (4, 4)), ("line_of_pixel", "f4", (3, 4))])
"""Layout of one hogel in hogels.glsl: two matrices by columns, each column of four numbers."""


def picture_program(context: moderngl.Context, defines: Defines, hogels: int | None) -> moderngl.Program:
    """Return the program of hogel.vert and hogel.frag.

    Parameters
    ----------
    context
        The current context.
    defines
        Names that the shaders ask for, see `programs.picture_defines` and `Shading.defines`.
    hogels
        Largest number of hogels in one submission; None for the program that draws one.
    """
    many = {} if hogels is None else _many(context, hogels)
    return program(context, "hogel.frag", {**many, **defines})


def reflection_program(context: moderngl.Context, defines: Defines, hogels: int) -> moderngl.Program:
    """Return the program of hogel.vert and reflection.frag; parameters as for `picture_program`."""
    return program(context, "reflection.frag", {**_many(context, hogels), **defines})


def lets_vertices_choose_layers(context: moderngl.Context) -> bool:
    """Return whether one draw may reach many layers, which no version of OpenGL requires."""
    return bool(LAYER_EXTENSIONS & set(context.extensions))


def hogel_block(cameras: Sequence[Pass]) -> NDArray[np.void]:
    """Return the matrices of one camera for some hogels, in the layout of hogels.glsl."""
    clip = np.stack([camera.clip_from_scene for camera in cameras])
    block = np.zeros(len(cameras), dtype=HOGEL)
    block["clip_from_scene"] = clip.swapaxes(1, 2)
    block["line_of_pixel"][:, :, :3] = lines_of_pixels(clip).swapaxes(1, 2)
    return block


def _many(context: moderngl.Context, hogels: int) -> dict[str, str]:
    layers = {"WITH_LAYERS": "1"} if lets_vertices_choose_layers(context) else {}
    return {"MANY": str(hogels), **layers}


class PlateDrawing:
    """The triangles of a scene that one program draws.

    Parameters
    ----------
    context
        The current context.
    program
        Program made by `plate.program` for this number of hogels.
    geometry
        The scene on the GPU.
    cameras
        The triangles that each camera draws: all surfaces, or the reflective ones.
    hogels
        Largest number of hogels in one submission.
    """

    def __init__(
        self,
        context: moderngl.Context,
        program: moderngl.Program,
        geometry: PlateGeometry,
        cameras: Sequence[PassGeometry],
        hogels: int,
    ) -> None:
        self.program = program
        self._geometry, self._cameras = geometry, cameras
        numbers = np.arange(hogels, dtype=np.uint32)
        content = [
            (geometry.attribute(name), form, name) for name, form in FORMATS.items() if name in program
        ]
        # This attribute advances with the instance; every draw names its first instance.
        content.append((context.buffer(numbers.tobytes()), "1u4/i", "in_hogel"))
        self._mesh = context.vertex_array(program, content, index_buffer=geometry.indices)

    def triangles(self, number: int, matrices: Singles) -> int:
        """Return the number of triangles that a camera draws for some hogels."""
        return int(self._geometry.commands(self._cameras[number], matrices)["count"].sum()) // 3

    def upload(
        self, number: int, matrices: Singles, commands: moderngl.Buffer, windows: Floats = WHOLE_FILM
    ) -> int:
        """Write the draws of a camera for some hogels, and return their number.

        Parameters
        ----------
        number
            Number of the camera.
        matrices
            (L, 4, 4) clip-from-scene matrix of each hogel.
        commands
            Buffer that the draws are written to; it grows as needed.
        windows
            (L, 4) the part of each film that is wanted; see `clusters.clip_planes`.
        """
        draws = self._geometry.commands(self._cameras[number], matrices, windows)
        if len(draws):
            commands.orphan(max(commands.size, draws.nbytes))
            commands.write(draws.tobytes())
        return len(draws)

    def draw(self, hogels: moderngl.Buffer, commands: moderngl.Buffer, draws: int) -> None:
        """Draw what was uploaded.

        Parameters
        ----------
        hogels
            Buffer with the matrices of each hogel, see `program.hogel_block`.
        commands, draws
            The draws that `upload` wrote, and their number, which it returned.
        """
        if draws:
            hogels.bind_to_uniform_block(HOGELS_BINDING)
            self._mesh.render_indirect(commands, count=draws)


_Item = TypeVar("_Item")

SUBMISSION_BYTES = 1 << 20
"""Largest size of one submission's attachments, so that a software renderer finds them in its caches."""
ROUND_BYTES = 1 << 25
"""Largest size of the attachments of one round of submissions, which bounds the memory."""
MAX_HOGELS = 4
"""Largest number of hogels in a submission, and of submissions in a round; more do not save more time."""
ROUNDS = 2
"""Number of rounds: one is drawn while the one before it is read back."""


@dataclass(frozen=True, kw_only=True)
class Batching:
    """The division of a stream of hogels into submissions and rounds.

    Attributes
    ----------
    hogels
        Hogels of one submission, which share clears and draws and have a layer each.
    submissions
        Submissions of one round, which are drawn one after the other, then read back together.
    """

    hogels: int
    submissions: int

    @classmethod
    def of(cls, size: tuple[int, int], form: TargetFormat, *, layered: bool) -> Batching:
        """Return the batching of images of some size.

        Parameters
        ----------
        size
            W, H in pixels.
        form
            The buffers of each pixel.
        layered
            Whether the device can draw on several layers at once.
        """
        hogel_bytes = form.bytes_per_pixel * size[0] * size[1]
        hogels = _within(MAX_HOGELS, SUBMISSION_BYTES // hogel_bytes) if layered else 1
        return cls(hogels=hogels, submissions=_within(MAX_HOGELS, ROUND_BYTES // (hogels * hogel_bytes)))

    @property
    def hogels_in_memory(self) -> int:
        """Largest number of hogels that are being drawn or read back at any time."""
        return ROUNDS * self.submissions * self.hogels


@dataclass(frozen=True, kw_only=True, eq=False)
class Slot:
    """The target and buffers that one submission owns until it has been read.

    Attributes
    ----------
    target
        Target with a layer for each hogel.
    hogels
        Buffers with the matrices of the hogels, one for each camera; see `program.hogel_block`.
    commands
        Buffers with the draws, by drawing and camera.
    """

    target: LayeredTarget
    hogels: list[moderngl.Buffer]
    commands: list[list[moderngl.Buffer]]


def make_rounds(
    context: moderngl.Context,
    batching: Batching,
    make_target: Callable[[], LayeredTarget],
    counts: tuple[int, int],
) -> list[list[Slot]]:
    """Return the slots of every round.

    Parameters
    ----------
    context
        The current context.
    batching
        Number of hogels and submissions.
    make_target
        Makes the target of one slot.
    counts
        Number of drawings and of cameras.
    """
    drawings, cameras = counts

    def buffers(reserve: int) -> list[moderngl.Buffer]:
        return [context.buffer(reserve=reserve, dynamic=True) for _ in range(cameras)]

    def slot() -> Slot:
        # These buffers grow as needed.
        commands = [buffers(DRAW_COMMAND.itemsize) for _ in range(drawings)]
        return Slot(target=make_target(), hogels=buffers(HOGEL.itemsize * batching.hogels), commands=commands)

    return [[slot() for _ in range(batching.submissions)] for _ in range(ROUNDS)]


def groups(items: Iterable[_Item], size: int) -> Iterator[list[_Item]]:
    """Yield consecutive items, `size` at a time."""
    rest = iter(items)
    while group := list(islice(rest, size)):
        yield group


def _within(most: int, wanted: int) -> int:
    return max(1, min(most, wanted))


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
