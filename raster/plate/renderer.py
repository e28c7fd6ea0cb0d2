"""Hogels of a whole plate with the paper's double frustum: a stream, several per submission.

The reasons are in docs/adr/0006. Images are equal to the images of `Rasterizer`, bit for bit.
`OneByOne` draws hogels with other sampling, `averaged` forms means over sub-apertures, and
`PlainLoop` is for benchmarks.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import moderngl
import numpy as np
from numpy.typing import NDArray
from OpenGL import GL

from xfrustum.raster.cameras import MAPPINGS, Pass, cameras_in_order, pass_of
from xfrustum.raster.device.context import (
    ContextOwner,
    check_room,
    describe,
    open_context,
)
from xfrustum.raster.device.mesh import (
    ATTRIBUTES,
    NORMALS,
    Positions,
    attribute_of,
    number_triangles,
    picture_defines,
    program,
    set_camera,
    set_facing,
)
from xfrustum.raster.device.targets import LayeredTarget, TargetFormat
from xfrustum.raster.drawing import Shading
from xfrustum.raster.plate.clusters import FORMATS, WHOLE_FILM, flat_attributes
from xfrustum.raster.plate.picture import (
    HOGEL,
    HOGELS_BINDING,
    PICTURE,
    REFLECTION,
    Batching,
    PictureStyle,
    PlatePicture,
    Rounds,
    Slot,
    groups,
    hogel_block,
    lets_vertices_choose_layers,
    many_defines,
    read_heights,
    reflective_triangles,
)
from xfrustum.raster.rasterizer import Rasterizer, normals_of
from xfrustum.scenes.appearance import Sampling, sub_apertures
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Floats, Singles
from xfrustum.scenes.model.effects import Effect, Question, needed
from xfrustum.scenes.model.images import (
    Channel,
    ColorType,
    DirectionImage,
    FilmPart,
    HogelImage,
    PlateContent,
    PlateDirection,
    PlateHogel,
)
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture, DoubleFrustum


def averaged(
    apertures: Iterable[Aperture],
    points: Callable[[Aperture], Sequence[Aperture]],
    draw: Callable[[Iterable[Aperture]], Iterator[PlateHogel]],
    content: PlateContent,
) -> Iterator[PlateHogel]:
    """Yield hogels with color averaged over images from several points of the aperture's area.

    The other channels are from one more image, drawn from the aperture's center. `points` returns
    points of an aperture's area. `draw` yields the image of each point, in order, with colors in
    float32.
    """
    waiting: deque[tuple[Aperture, int]] = deque()
    surfaces = content.channels != (Channel.COLOR,)

    def drawn() -> Iterator[Aperture]:
        for aperture in apertures:
            some = points(aperture)
            waiting.append((aperture, len(some)))
            if surfaces:
                yield aperture
            yield from some

    images = draw(drawn())
    for first in images:
        aperture, count = waiting.popleft()
        total = np.zeros(first.color.shape) if surfaces else first.color.astype(np.float64)
        for _ in range(count - (not surfaces)):
            total += next(images).color
        mean = (total / count).astype(np.float32)
        yield replace(first, aperture=aperture, color=stored(mean, content.color))


def stored(color: Singles, kind: ColorType) -> NDArray[Any]:
    """Return linear RGB in the stored type, with the device's rounding."""
    if kind is ColorType.UINT8:
        return np.asarray(np.rint(np.clip(color, 0.0, 1.0) * np.float32(255)), dtype=np.uint8)
    with np.errstate(over="ignore"):
        return np.asarray(color, dtype=kind.dtype)


def plate_hogel(image: HogelImage, content: PlateContent) -> PlateHogel:
    """Convert the images of a hogel to the types that a plate stores."""
    assert image.color is not None
    color = stored(image.color, content.color)
    surfaces = _surfaces(image, content.channels)
    return PlateHogel(aperture=image.camera.aperture, color=color, **surfaces)


def plate_direction(image: DirectionImage, content: PlateContent) -> PlateDirection:
    """Convert the images of a pixel of all hogels to the types that a plate stores."""
    color = None if image.color is None else stored(image.color, content.color)
    return PlateDirection(pixel=image.pixel, color=color, **_surfaces(image, content.channels))


def _surfaces(image: HogelImage | DirectionImage, channels: Sequence[Channel]) -> dict[str, Any]:
    normal = image.normal if Channel.NORMAL in channels else None
    return {
        "triangle": image.triangle if Channel.TRIANGLE in channels else None,
        "height": image.position[..., 2].astype("f4") if Channel.HEIGHT in channels else None,
        "normal": None if normal is None else normal.astype("f4"),
        "certainty": image.certainty if Channel.CERTAINTY in channels else None,
    }


class OneByOne(ContextOwner):
    """Stream of hogels as from `PlateRenderer`; sampling and InputErrors are as in `Rasterizer`."""

    def __init__(self, scene: Scene, settings: DoubleFrustum, content: PlateContent) -> None:
        settings.check_against(scene.frustum)
        self.scene, self.settings, self.content = scene, settings, content
        self._rasterizer = Rasterizer(scene, self.content.effects)
        self.device = self._rasterizer.device
        try:
            self._rasterizer.check_sampling(scene.sampling)
        except InputError:
            self._rasterizer.release()
            raise
        self.effects = self._rasterizer.effects_for(settings)

    def release(self) -> None:
        """Free the rasterizer."""
        self._rasterizer.release()

    def hogels(self, apertures: Iterable[Aperture]) -> Iterator[PlateHogel]:
        """Draw apertures and yield their images in the same order."""
        normals = Channel.NORMAL in self.content.channels
        for aperture in apertures:
            yield plate_hogel(
                self._rasterizer.render(aperture, self.settings, normals=normals), self.content
            )


class PlainLoop(ContextOwner):
    """Plain loop over hogels: the baseline for drawing many hogels at once.

    Every camera draws the whole scene, without reflections; then pixels are read. With `numbered`,
    triangle numbers are vertex numbers, as in `PlateRenderer`; this takes no extra time.
    """

    def __init__(
        self,
        scene: Scene,
        settings: DoubleFrustum,
        content: PlateContent,
        *,
        numbered: bool = False,
    ) -> None:
        self.scene, self.settings = scene, settings
        effects = needed(scene, Question(settings=(settings,))) - {Effect.REFLECTION}
        self._cameras = cameras_in_order(scene, settings)
        self._mapping = MAPPINGS[settings.mapping]
        self._context = context = open_context()
        with context:
            check_room(scene, str(context.info["GL_RENDERER"]))
            form = TargetFormat(depth=settings.depth, content=content)
            self._target = LayeredTarget(scene.frustum.resolution, 1, form)
            self._normals = context.buffer(scene.normals.astype(np.float32).tobytes())
            self._shading = Shading(context, scene, effects)
            many = many_defines(context, 1) if numbered else {}
            defines = {**many, **picture_defines(self._mapping, effects), **self._shading.defines}
            self._program = program(context, "hogel.frag", defines)
            faces = scene.faces.astype(np.uint32)
            attributes: dict[str, NDArray[Any]] = {
                name: attribute_of(scene, name) for name in ATTRIBUTES
            }
            self._hogel: moderngl.Buffer | None = None
            of_vertices = []
            if numbered:
                mesh = number_triangles(scene.faces)
                faces = mesh.faces
                attributes = {name: values[mesh.source] for name, values in attributes.items()}
                attributes |= flat_attributes(scene, mesh, self._shading.surfaces)
                self._hogel = context.buffer(reserve=HOGEL.itemsize, dynamic=True)
                of_vertices.append(
                    (context.buffer(np.zeros(1, np.uint32).tobytes()), "1u4/i", "in_hogel")
                )
            of_vertices += [
                (context.buffer(values.tobytes()), FORMATS[name], name)
                for name, values in attributes.items()
                if name in self._program
            ]
            indices = context.buffer(faces.tobytes())
            self._mesh = context.vertex_array(self._program, of_vertices, index_buffer=indices)

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
            number = None if triangle is None else triangle[0]
            yield PlateHogel(aperture=aperture, color=color[0], triangle=number)

    def draw_only(self, apertures: Iterable[Aperture]) -> None:
        """Draw apertures without reading them back."""
        with self._context:
            for aperture in apertures:
                self._draw(aperture)
                GL.glFlush()
            GL.glFinish()

    def read_only(self, count: int) -> None:
        """Read back the last images `count` times, without drawing."""
        with self._context:
            for _ in range(count):
                self._target.start_reading()
                self._target.finish_color()
                self._target.finish_triangle()

    def _draw(self, aperture: Aperture) -> None:
        self._target.begin()
        self._context.enable_only(moderngl.DEPTH_TEST)
        GL.glClipControl(GL.GL_LOWER_LEFT, self._mapping.clip_control)
        self._normals.bind_to_storage_buffer(NORMALS)
        for number, camera in enumerate(self._cameras):
            drawn = pass_of(self.scene, aperture, self.settings, camera)
            self._target.clear_depth(drawn.clear)
            self._context.depth_func = drawn.depth_function
            set_facing(self._context, drawn)
            set_camera(self._program, number, drawn, self._target.size)
            self._shading.bind(self._program)
            if self._hogel is not None:
                self._hogel.write(hogel_block([drawn]).tobytes())
                self._hogel.bind_to_uniform_block(HOGELS_BINDING)
            self._mesh.render()


#: requested part of each film by column and row of the hogel
FilmParts = Mapping[tuple[int, int], FilmPart]


@dataclass(frozen=True, kw_only=True, eq=False)
class FilmWindows:
    """Drawn windows of the films of one submission."""

    #: (L, 4) smallest and largest u and v of each part, at the borders of its outer pixels; see
    #: `clusters.clip_planes`
    windows: Floats
    #: Box that contains all parts: first column, first row from the bottom, width and height in
    #: pixels; None for whole films
    box: tuple[int, int, int, int] | None

    @classmethod
    def from_apertures(
        cls, apertures: Sequence[Aperture], parts: FilmParts | None, size: tuple[int, int]
    ) -> Self:
        """Return the windows of hogels with films of W, H pixels; whole films without `parts`."""
        if parts is None:
            return cls(windows=WHOLE_FILM, box=None)
        width, height = size
        windows = np.empty((len(apertures), 4))
        columns: list[int] = []
        rows: list[int] = []
        for window, aperture in zip(windows, apertures, strict=True):
            part = parts[aperture.index]
            (left, right), (top, bottom) = part.columns, part.rows
            window[:2] = 2 * left / width - 1, 2 * (right + 1) / width - 1
            window[2:] = 1 - 2 * (bottom + 1) / height, 1 - 2 * top / height
            columns += part.columns
            rows += part.rows
        box = (
            min(columns),
            height - 1 - max(rows),
            max(columns) - min(columns) + 1,
            max(rows) - min(rows) + 1,
        )
        return cls(windows=windows, box=box)


#: whole films
WHOLE = FilmWindows(windows=WHOLE_FILM, box=None)


class PlateRenderer(ContextOwner):
    """Scene on the GPU, uploaded once, drawn from many apertures with the same settings.

    It is a context manager. `content` selects the images that are read back, and the simulated
    effects. Raises InputError if the settings do not fit the frustum, if the scene has more than
    one sample per pixel (not counting sub-apertures), or if the device cannot draw the scene.
    """

    def __init__(
        self, scene: Scene, settings: DoubleFrustum, content: PlateContent | None = None
    ) -> None:
        settings.check_against(scene.frustum)
        if scene.sampling != Sampling(aperture=scene.sampling.aperture):
            raise InputError(
                f"{scene.name}: has several samples a pixel, and a plate is drawn with one; "
                "give --supersample 1 --multisample 1, or draw its hogels with raster"
            )
        self.scene, self.settings, self.content = scene, settings, content or PlateContent()
        effects = self.content.effects
        self.effects = needed(scene, Question(settings=(settings,))) if effects is None else effects
        self._cameras = cameras_in_order(scene, settings, self.effects)
        self._context = open_context()
        try:
            with self._context:
                self.device = describe(self._context)
                check_room(scene, self.device["renderer"])
                self._prepare()
        except InputError:
            self._context.release()
            raise

    def _prepare(self) -> None:
        channels = self.content.channels
        measured = Channel.HEIGHT in channels
        identified = measured or bool(reflective_triangles(self.scene, self.effects).any())
        # The mean over sub-apertures uses unrounded colors, as `Rasterizer` does, and is rounded
        # once.
        single = self.scene.sampling.aperture == 1
        content = self.content if single else replace(self.content, color=ColorType.FLOAT32)
        if Channel.NORMAL in channels:
            content = replace(content, ids=True)
        solid = len(self.scene.faces) > 0
        self._positions = Positions(self._context, self.scene) if solid and measured else None
        form = TargetFormat(depth=self.settings.depth, content=content, identified=identified)
        size = self.scene.frustum.resolution
        self.batching = Batching.from_size(
            size, form, layered=lets_vertices_choose_layers(self._context)
        )
        self._picture: PlatePicture | None = None
        if self._cameras:
            style = PictureStyle(
                mapping=MAPPINGS[self.settings.mapping],
                effects=self.effects,
                hogels=self.batching.hogels,
            )
            passes = self._passes(self.scene.plate.middle)
            self._picture = PlatePicture(self._context, self.scene, passes, style)
        drawings = 0 if self._picture is None else len(self._picture.drawings)
        self._rounds = Rounds(
            self._context,
            self.batching,
            lambda: LayeredTarget(size, self.batching.hogels, form),
            (drawings, len(self._cameras)),
        )

    def release(self) -> None:
        """Free the context and everything in it."""
        with self._context:
            self._rounds.release()
        self._context.release()

    def hogels(
        self, apertures: Iterable[Aperture], parts: FilmParts | None = None
    ) -> Iterator[PlateHogel]:
        """Draw apertures and yield their images in the same order, in bounded memory.

        While one round of submissions is drawn, the previous round is read back. If the scene has
        sub-apertures, each is drawn as a separate hogel, and color is the mean. `parts` are the
        requested parts of the films, by column and row of the hogel. Parts take less time, and
        their pixels are equal to the pixels of whole films, bit for bit; pixels outside the parts
        are undefined.
        """
        plate, count = self.scene.plate, self.scene.sampling.aperture
        if count == 1:
            return self._stream(apertures, parts)
        return averaged(
            apertures,
            lambda aperture: sub_apertures(plate, aperture, count),
            self._stream,
            self.content,
        )

    def _stream(
        self, apertures: Iterable[Aperture], parts: FilmParts | None = None
    ) -> Iterator[PlateHogel]:
        size = self.scene.frustum.resolution

        def draw(slot: Slot, group: list[Aperture]) -> None:
            self._draw(slot, group, FilmWindows.from_apertures(group, parts, size))

        return self._rounds.stream(apertures, draw, self._finish)

    def draw_only(self, apertures: Iterable[Aperture], *, rasterize: bool = True) -> None:
        """Draw as `hogels` does, without reading back, to measure the time of reading.

        Without `rasterize`, OpenGL discards triangles before rasterization, and does not clear
        depth.
        """
        enabled = moderngl.DEPTH_TEST | (0 if rasterize else moderngl.RASTERIZER_DISCARD)
        with self._context:
            for number, group in enumerate(groups(apertures, self.batching.hogels)):
                slot = self._rounds.slots[0][number % self.batching.submissions]
                self._draw(slot, group, enabled=enabled)
                GL.glFlush()
            GL.glFinish()

    def drawn_triangles(self, apertures: Iterable[Aperture]) -> int:
        """Count the triangles submitted for some apertures, after culling outside the frusta."""
        total = 0
        drawings = [] if self._picture is None else self._picture.drawings
        for aperture in apertures:
            for number, camera in enumerate(self._passes(aperture)):
                matrices = camera.clip_from_scene.astype(np.float32)[None]
                draws = (drawing.commands(number, matrices)["count"] for drawing in drawings)
                total += sum(int(count.sum()) // 3 for count in draws)
        return total

    def _passes(self, aperture: Aperture) -> list[Pass]:
        return [pass_of(self.scene, aperture, self.settings, camera) for camera in self._cameras]

    def _draw(
        self,
        slot: Slot,
        apertures: Sequence[Aperture],
        request: FilmWindows = WHOLE,
        enabled: int = moderngl.DEPTH_TEST,
    ) -> None:
        picture = self._picture
        if picture is None:
            slot.target.begin(request.box)
            return
        picture.begin(slot, enabled, request.box)
        draws = []
        # Draw one camera for all hogels, then the next camera, so that shared state is set once per
        # camera.
        cameras = list(zip(*(self._passes(aperture) for aperture in apertures), strict=True))
        for number, hogels in enumerate(cameras):
            draws.append(picture.upload(slot, number, hogels, request.windows))
            picture.draw(slot, number, hogels[0], draws[-1][PICTURE])
        if picture.environment is not None:
            drawn = [counts[REFLECTION] for counts in draws]
            picture.reflect(slot, [hogels[0] for hogels in cameras], drawn, enabled)

    def _finish(self, slot: Slot, apertures: Sequence[Aperture]) -> Iterator[PlateHogel]:
        normals = Channel.NORMAL in self.content.channels
        with self._context:
            color, triangle = slot.target.finish_color(), slot.target.finish_triangle()
            heights = [
                self._height(slot, layer, aperture) for layer, aperture in enumerate(apertures)
            ]
        for layer, aperture in enumerate(apertures):
            numbers = None if triangle is None else triangle[layer]
            yield PlateHogel(
                aperture=aperture,
                color=color[layer],
                triangle=numbers if self.content.ids else None,
                height=heights[layer],
                normal=None if numbers is None or not normals else normals_of(self.scene, numbers),
            )

    def _height(self, slot: Slot, layer: int, aperture: Aperture) -> Singles | None:
        """Return the heights (H, W) of a hogel; None if they are not a channel."""
        measured = Channel.HEIGHT in self.content.channels
        # Sub-apertures contribute only color.
        if not measured or aperture != self.scene.plate.aperture(*aperture.index):
            return None
        return read_heights(slot, layer, self._positions, self._passes(aperture))
