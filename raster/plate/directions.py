"""Plates drawn by directions: one picture of a tile of the plate for each pixel of its hogels."""

from collections.abc import Iterable, Iterator

import moderngl
from OpenGL import GL

from xfrustum.raster.cameras.cameras import MAPPINGS
from xfrustum.raster.cameras.directions import direction_pass
from xfrustum.raster.device.context import ContextOwner, check_room, describe, open_context
from xfrustum.raster.plate.picture import (
    PICTURE,
    Batching,
    PictureStyle,
    PlatePicture,
    Slot,
    lets_vertices_choose_layers,
    make_rounds,
)
from xfrustum.raster.plate.renderer import groups
from xfrustum.raster.plate.targets import LayeredTarget, TargetFormat
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.effects import needed
from xfrustum.scenes.model.plate_content import PlateContent, PlateDirection
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping
from xfrustum.scenes.plate.plate import PlateTile

Pixel = tuple[int, int]  #: column and row of a pixel of every hogel


class DirectionRenderer(ContextOwner):
    """Scene on the GPU, uploaded once, drawn for pixels of all hogels of a tile."""

    def __init__(
        self,
        scene: Scene,
        tile: PlateTile,
        content: PlateContent,
        depth: DepthFormat = DepthFormat.D32F,
    ) -> None:
        self.scene, self.tile, self.content = scene, tile, content
        self.effects = needed(scene) if content.effects is None else content.effects
        first = direction_pass(scene, tile, (0, 0))
        self._context = open_context()
        try:
            with self._context:
                self.device = describe(self._context)
                check_room(scene, self.device["renderer"])
                form = TargetFormat(depth=depth, content=content)
                layered = lets_vertices_choose_layers(self._context)
                self._batching = Batching.from_size(tile.size, form, layered=layered)
                style = PictureStyle(
                    mapping=MAPPINGS[DepthMapping.STANDARD],
                    effects=self.effects,
                    hogels=self._batching.hogels,
                )
                self._picture = (
                    PlatePicture(self._context, scene, [first], style) if len(scene.faces) else None
                )
                self._rounds = make_rounds(
                    self._context,
                    self._batching,
                    lambda: LayeredTarget(tile.size, self._batching.hogels, form),
                    (1, 1),
                )
        except InputError:
            self._context.release()
            raise

    def release(self) -> None:
        """Free the context and everything in it."""
        with self._context:
            for slot in (slot for slots in self._rounds for slot in slots):
                slot.target.release()
        self._context.release()

    def images(self, pixels: Iterable[Pixel]) -> Iterator[PlateDirection]:
        """Draw pixels of all hogels, and yield their images in the same order."""
        waiting: list[tuple[Slot, list[Pixel]]] = []
        submissions = groups(pixels, self._batching.hogels)
        for number, submitted in enumerate(groups(submissions, self._batching.submissions)):
            drawn = list(zip(self._rounds[number % len(self._rounds)], submitted, strict=False))
            with self._context:
                for slot, group in drawn:
                    self._draw(slot, group)
                    GL.glFlush()
                for slot, _ in drawn:
                    slot.target.start_reading()
            yield from self._finish(waiting)
            waiting = drawn
        yield from self._finish(waiting)

    def _draw(self, slot: Slot, pixels: list[Pixel]) -> None:
        if self._picture is None:
            slot.target.begin()
            return
        self._picture.begin(slot, moderngl.DEPTH_TEST)
        passes = [direction_pass(self.scene, self.tile, pixel) for pixel in pixels]
        draws = self._picture.upload(slot, 0, passes)
        self._picture.draw(slot, 0, passes[0], draws[PICTURE])

    def _finish(self, waiting: list[tuple[Slot, list[Pixel]]]) -> Iterator[PlateDirection]:
        for slot, pixels in waiting:
            with self._context:
                color, triangle = slot.target.finish_color(), slot.target.finish_triangle()
            for layer, pixel in enumerate(pixels):
                yield PlateDirection(
                    pixel=pixel,
                    color=color[layer],
                    triangle=None if triangle is None else triangle[layer],
                )
