"""Hogels drawn one by one: with any sampling, as means over sub-apertures, or in a plain loop."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray
from OpenGL import GL

from xfrustum.raster.cameras.cameras import MAPPINGS, cameras_in_order, pass_of
from xfrustum.raster.device.context import ContextOwner, check_room, open_context
from xfrustum.raster.device.mesh import ATTRIBUTES, NORMALS, attribute_of, number_triangles
from xfrustum.raster.device.programs import picture_defines, program, set_camera, set_facing
from xfrustum.raster.drawing import Shading
from xfrustum.raster.plate.clusters import FORMATS, flat_attributes
from xfrustum.raster.plate.picture import HOGEL, HOGELS_BINDING, hogel_block, many_defines
from xfrustum.raster.plate.targets import LayeredTarget, TargetFormat
from xfrustum.raster.rasterizer import Rasterizer
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Singles
from xfrustum.scenes.model.effects import Effect, Question, needed
from xfrustum.scenes.model.images import (
    Channel,
    ColorType,
    DirectionImage,
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
