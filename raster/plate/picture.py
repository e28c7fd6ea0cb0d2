"""Pictures of several hogels per submission: surfaces, then the reflections of every camera.

The programs use the same shaders as the drawing of a single hogel. A submission draws several
hogels, and owns its target and buffers until it is read back.
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

from xfrustum.raster.cameras import Mapping, Pass, lines_of_pixels
from xfrustum.raster.device.mesh import (
    Defines,
    Positions,
    picture_defines,
    program,
    reflection_defines,
    set_camera,
    set_facing,
)
from xfrustum.raster.device.targets import LayeredTarget, TargetFormat
from xfrustum.raster.drawing import NUMBERS_ALONE, Environment, Shading, reflecting
from xfrustum.raster.plate.clusters import (
    DRAW_COMMAND,
    FORMATS,
    WHOLE_FILM,
    PassGeometry,
    PlateGeometry,
)
from xfrustum.scenes.arrays import Floats, Mask, Singles
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.scene import Scene

#: binding of the uniform block with the matrices of each hogel
HOGELS_BINDING = 0

#: Layout of one hogel in hogels.glsl: two matrices by columns, each column of four numbers
HOGEL = np.dtype([("clip_from_scene", "f4", (4, 4)), ("line_of_pixel", "f4", (3, 4))])

#: Largest size of one submission's attachments, so that they fit the caches of a software renderer
SUBMISSION_BYTES = 1 << 20
#: largest size of the attachments of one round of submissions; it bounds the memory
ROUND_BYTES = 1 << 25
#: Largest number of hogels in a submission, and of submissions in a round; more are not faster
MAX_HOGELS = 4
#: number of rounds: one is drawn while the previous round is read back
ROUNDS = 2

PICTURE, REFLECTION = (
    0,
    1,
)  #: indices of the two drawings in `PlatePicture.drawings` and in `Slot.commands`


def lets_vertices_choose_layers(context: moderngl.Context) -> bool:
    """Return whether vertex shaders can select layers; no OpenGL version requires this."""
    return "GL_ARB_shader_viewport_layer_array" in context.extensions


def many_defines(context: moderngl.Context, hogels: int) -> dict[str, str]:
    """Return the definitions of shaders that draw up to `hogels` hogels in a submission."""
    layers = {"WITH_LAYERS": "1"} if lets_vertices_choose_layers(context) else {}
    return {"MANY": str(hogels), **layers}


def hogel_block(cameras: Sequence[Pass]) -> NDArray[np.void]:
    """Return the matrices of one camera for several hogels, in the layout of hogels.glsl."""
    clip = np.stack([camera.clip_from_scene for camera in cameras])
    block = np.zeros(len(cameras), dtype=HOGEL)
    block["clip_from_scene"] = clip.swapaxes(1, 2)
    block["line_of_pixel"][:, :, :3] = lines_of_pixels(clip).swapaxes(1, 2)
    return block


# Submissions and rounds


@dataclass(frozen=True, kw_only=True)
class Batching:
    """Numbers of hogels per submission and of submissions per round.

    The hogels of a submission share clears and draws. The submissions of a round are drawn one
    after the other, then read back together.
    """

    hogels: int
    submissions: int

    @classmethod
    def from_size(cls, size: tuple[int, int], form: TargetFormat, *, layered: bool) -> Batching:
        """Return the batching of images of W, H pixels, with or without layered draws."""
        hogel_bytes = form.bytes_per_pixel * size[0] * size[1]

        def within(number: int) -> int:
            return max(1, min(MAX_HOGELS, number))

        hogels = within(SUBMISSION_BYTES // hogel_bytes) if layered else 1
        return cls(hogels=hogels, submissions=within(ROUND_BYTES // (hogels * hogel_bytes)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Slot:
    """Target and buffers that one submission owns until it has been read.

    The target has a layer for each hogel. `hogels` are buffers with the matrices of the hogels, one
    buffer for each camera (`hogel_block`). `commands` are buffers with the draws, by drawing and
    camera.
    """

    target: LayeredTarget
    hogels: list[moderngl.Buffer]
    commands: list[list[moderngl.Buffer]]


Item = TypeVar("Item")
Drawn = TypeVar("Drawn")


def groups(items: Iterable[Item], size: int) -> Iterator[list[Item]]:
    """Yield consecutive items, `size` at a time."""
    rest = iter(items)
    while group := list(islice(rest, size)):
        yield group


class Rounds:
    """Rounds of submissions: each round is drawn while the previous round is read back."""

    def __init__(
        self,
        context: moderngl.Context,
        batching: Batching,
        make_target: Callable[[], LayeredTarget],
        counts: tuple[int, int],
    ) -> None:
        """Make the slots of every round; `counts` are the numbers of drawings and cameras."""
        self._context, self._batching = context, batching
        drawings, cameras = counts

        def buffers(reserve: int) -> list[moderngl.Buffer]:
            return [context.buffer(reserve=reserve, dynamic=True) for _ in range(cameras)]

        def slot() -> Slot:
            # These buffers grow as needed.
            commands = [buffers(DRAW_COMMAND.itemsize) for _ in range(drawings)]
            return Slot(
                target=make_target(),
                hogels=buffers(HOGEL.itemsize * batching.hogels),
                commands=commands,
            )

        self.slots = [[slot() for _ in range(batching.submissions)] for _ in range(ROUNDS)]

    def stream(
        self,
        items: Iterable[Item],
        draw: Callable[[Slot, list[Item]], object],
        finish: Callable[[Slot, list[Item]], Iterable[Drawn]],
    ) -> Iterator[Drawn]:
        """Draw items, each into a layer, and yield the results of `finish` in the same order.

        The context is current while `draw` runs.
        """
        waiting: list[tuple[Slot, list[Item]]] = []
        submissions = groups(items, self._batching.hogels)
        for number, submitted in enumerate(groups(submissions, self._batching.submissions)):
            drawn = list(zip(self.slots[number % ROUNDS], submitted, strict=False))
            # OpenGL draws in the current context, and the caller may have made another context
            # current.
            with self._context:
                for slot, group in drawn:
                    draw(slot, group)
                    # Flush, so that the device fills these pixels while it transforms the next
                    # submission.
                    GL.glFlush()
                # Read after all draws, because a software driver finishes all pending draws before
                # a read.
                for slot, _ in drawn:
                    slot.target.start_reading()
            for slot, group in waiting:
                yield from finish(slot, group)
            waiting = drawn
        for slot, group in waiting:
            yield from finish(slot, group)

    def release(self) -> None:
        """Free the targets; the context must be current."""
        for slot in (slot for slots in self.slots for slot in slots):
            slot.target.release()


def read_heights(
    slot: Slot, layer: int, positions: Positions | None, passes: Sequence[Pass]
) -> Singles:
    """Return the heights (H, W) of one layer, NaN without a surface; needs a current context."""
    width, height = slot.target.size
    if positions is None or not passes:
        return np.full((height, width), np.nan, dtype=np.float32)
    points = positions.read(slot.target.layer(layer), passes, np.arange(height * width))
    # Copy the heights, so that the memory of the other two coordinates is freed.
    return np.array(points[2].reshape(height, width))


# Drawing


@dataclass(frozen=True, kw_only=True)
class PictureStyle:
    """Depth mapping and effects of a plate, and the largest number of hogels in a submission."""

    mapping: Mapping
    effects: frozenset[Effect]
    hogels: int
    #: False for pictures with only triangle numbers
    colored: bool = True


class PlateDrawing:
    """Triangles that one program draws for each camera: all, or only the reflective triangles."""

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
        content = [
            (geometry.attribute(name), form, name)
            for name, form in FORMATS.items()
            if name in program
        ]
        # `in_hogel` advances per instance; the base instance of every draw is the number of its
        # hogel.
        numbers = np.arange(hogels, dtype=np.uint32)
        content.append((context.buffer(numbers.tobytes()), "1u4/i", "in_hogel"))
        self._mesh = context.vertex_array(program, content, index_buffer=geometry.indices)

    def commands(
        self, number: int, matrices: Singles, windows: Floats = WHOLE_FILM
    ) -> NDArray[np.void]:
        """Return the draws of a camera for hogels; see `PlateGeometry.commands`."""
        return self._geometry.commands(self._cameras[number], matrices, windows)

    def draw(self, hogels: moderngl.Buffer, commands: moderngl.Buffer, draws: int) -> None:
        """Execute the first `draws` commands for hogels with matrices in a buffer."""
        if draws:
            hogels.bind_to_uniform_block(HOGELS_BINDING)
            self._mesh.render_indirect(commands, count=draws)


class PlatePicture:
    """Triangles, materials and lights of a scene on the GPU, and the programs that draw it.

    The context must be current during drawing. `passes` are the cameras of any aperture. Raises
    InputError if textures or the environment map are larger than the device allows.
    """

    def __init__(
        self, context: moderngl.Context, scene: Scene, passes: Sequence[Pass], style: PictureStyle
    ) -> None:
        self._context, self._mapping = context, style.mapping
        mirrors = reflective_triangles(scene, style.effects)
        self._shading = Shading(context, scene, style.effects)
        geometry = PlateGeometry(
            context, scene, passes, style.mapping.clip_control, (self._shading.surfaces, mirrors)
        )

        def drawing(
            fragment: str, defines: Defines, cameras: Sequence[PassGeometry]
        ) -> PlateDrawing:
            many = many_defines(context, style.hogels)
            made = program(context, fragment, {**many, **defines, **self._shading.defines})
            return PlateDrawing(context, made, geometry, cameras, style.hogels)

        self.drawings = [
            drawing(
                "hogel.frag",
                picture_defines(style.mapping, style.effects)
                if style.colored
                else {**picture_defines(style.mapping, None), **NUMBERS_ALONE},
                geometry.surfaces,
            )
        ]
        self.environment: Environment | None = None
        if mirrors.any() and style.colored:
            self.environment = Environment(context, scene)
            defines = reflection_defines(style.effects)
            self.drawings.append(drawing("reflection.frag", defines, geometry.reflections))

    def begin(self, slot: Slot, enabled: int, box: tuple[int, int, int, int] | None = None) -> None:
        """Clear a slot's target and make it current; see `LayeredTarget.begin`."""
        slot.target.begin(box)
        # Set this after `begin`, which disables all states, including RASTERIZER_DISCARD.
        self._context.enable_only(enabled)
        GL.glClipControl(GL.GL_LOWER_LEFT, self._mapping.clip_control)

    def upload(
        self, slot: Slot, number: int, hogels: Sequence[Pass], windows: Floats = WHOLE_FILM
    ) -> list[int]:
        """Upload the draws of a camera for hogels; return their number in each drawing."""
        block = hogel_block(hogels)
        slot.hogels[number].write(block.tobytes())
        matrices = np.ascontiguousarray(block["clip_from_scene"].swapaxes(1, 2))
        counts = []
        for drawing, buffers in zip(self.drawings, slot.commands, strict=True):
            draws, buffer = drawing.commands(number, matrices, windows), buffers[number]
            if len(draws):
                buffer.orphan(max(buffer.size, draws.nbytes))
                buffer.write(draws.tobytes())
            counts.append(len(draws))
        return counts

    def draw(self, slot: Slot, number: int, camera: Pass, draws: int) -> None:
        """Draw the picture of one camera over the pictures of the cameras before it."""
        slot.target.clear_depth(camera.clear)
        self._context.depth_func = camera.depth_function
        self._shading.bind(self.drawings[PICTURE].program)
        self._draw(PICTURE, slot, number, camera, draws)

    def reflect(
        self, slot: Slot, cameras: Sequence[Pass], draws: Sequence[int], enabled: int
    ) -> None:
        """Add the reflections of every camera at pixels where that camera's picture is visible."""
        if self.environment is None:
            return
        self._context.enable_only(enabled & ~moderngl.DEPTH_TEST | moderngl.BLEND)
        self._context.blend_func = (moderngl.ONE, moderngl.ONE)
        slot.target.begin_reflection()
        self.environment.bind(slot.target)
        self._shading.bind(self.drawings[REFLECTION].program)
        for number, camera in enumerate(cameras):
            self._draw(REFLECTION, slot, number, camera, draws[number])

    def _draw(self, kind: int, slot: Slot, number: int, camera: Pass, draws: int) -> None:
        drawing = self.drawings[kind]
        set_facing(self._context, camera)
        set_camera(drawing.program, number, camera, slot.target.size)
        drawing.draw(slot.hogels[number], slot.commands[kind][number], draws)


def reflective_triangles(scene: Scene, effects: frozenset[Effect]) -> Mask:
    """Return the mask (F,) of triangles that are drawn again for their reflections."""
    mask = np.zeros(len(scene.faces), dtype=np.bool_)
    if Effect.REFLECTION in effects:
        for first, count in reflecting(scene):
            mask[first : first + count] = True
    return mask
