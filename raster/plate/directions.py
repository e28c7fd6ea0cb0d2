"""Plates drawn by directions: one picture of a plate tile for each pixel of the hogels.

A picture has a pixel for each hogel. A plate with more hogels than pixels per hogel therefore needs
fewer passes by directions than by hogels. These passes need no near offset and no second camera
(`cameras`).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import moderngl

from xfrustum.raster.cameras import MAPPINGS, Pass, direction_pass
from xfrustum.raster.device.context import ContextOwner, check_room, describe, open_context
from xfrustum.raster.device.mesh import Positions
from xfrustum.raster.device.targets import LayeredTarget, TargetFormat
from xfrustum.raster.plate.picture import (
    PICTURE,
    REFLECTION,
    Batching,
    PictureStyle,
    PlatePicture,
    Rounds,
    Slot,
    lets_vertices_choose_layers,
    read_heights,
    reflective_triangles,
)
from xfrustum.raster.rasterizer import normals_of
from xfrustum.scenes.appearance import Sampling
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Singles
from xfrustum.scenes.model.effects import CAMERAS, needed
from xfrustum.scenes.model.images import Channel, PlateContent, PlateDirection
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import DepthFormat, DepthMapping, PlateTile

Pixel = tuple[int, int]  #: column and row of a pixel of every hogel


class DirectionRenderer(ContextOwner):
    """Scene on the GPU, uploaded once, drawn for pixels of all hogels of a tile.

    It is a context manager. `content` selects the images that are read back, and the simulated
    effects. Depth is linear in z between the ends of the reach for parallel lines, and linear in
    1 / w for lines through a point of the screen. Raises InputError if colors are means over
    several samples, if the effects leave out one side of the plate, if surfaces reach the screen of
    a recentered frustum, or if the device cannot draw the scene.
    """

    def __init__(
        self,
        scene: Scene,
        tile: PlateTile,
        content: PlateContent,
        depth: DepthFormat = DepthFormat.D32F,
    ) -> None:
        self.scene, self.tile, self.content, self.depth = scene, tile, content, depth
        necessary = needed(scene)
        self.effects = necessary if content.effects is None else content.effects
        self._colored = Channel.COLOR in content.channels
        if self._colored and scene.sampling != Sampling():
            raise InputError(
                f"{scene.name}: has several samples a pixel, and images by direction have one; "
                "draw the plate by hogels"
            )
        if missing := sorted((CAMERAS & necessary) - self.effects):
            raise InputError(
                f"effects without {', '.join(missing)}: an image by direction has one camera for "
                "both sides of the plate; draw the plate by hogels"
            )
        first = direction_pass(scene, tile, (0, 0))
        self._context = open_context()
        try:
            with self._context:
                self.device = describe(self._context)
                check_room(scene, self.device["renderer"])
                self._prepare(first)
        except InputError:
            self._context.release()
            raise

    def _prepare(self, first: Pass) -> None:
        scene, size, channels = self.scene, self.tile.size, self.content.channels
        solid, measured = len(scene.faces) > 0, Channel.HEIGHT in channels
        mirrors = self._colored and bool(reflective_triangles(scene, self.effects).any())
        # Normals are looked up by triangle numbers.
        content = replace(self.content, ids=True) if Channel.NORMAL in channels else self.content
        form = TargetFormat(
            depth=self.depth, content=content, identified=measured or mirrors, colored=self._colored
        )
        layered = lets_vertices_choose_layers(self._context)
        self._batching = Batching.from_size(size, form, layered=layered)
        self._positions = Positions(self._context, scene) if solid and measured else None
        self._picture: PlatePicture | None = None
        if solid:
            style = PictureStyle(
                mapping=MAPPINGS[DepthMapping.STANDARD],
                effects=self.effects,
                hogels=self._batching.hogels,
                colored=self._colored,
            )
            # Triangles are culled by the range of depth, which is the same for all pixels.
            self._picture = PlatePicture(self._context, scene, [first], style)
        self._rounds = Rounds(
            self._context,
            self._batching,
            lambda: LayeredTarget(size, self._batching.hogels, form),
            (0 if self._picture is None else len(self._picture.drawings), 1),
        )

    def release(self) -> None:
        """Free the context and everything in it."""
        with self._context:
            self._rounds.release()
        self._context.release()

    def images(self, pixels: Iterable[Pixel]) -> Iterator[PlateDirection]:
        """Draw the image of each pixel over all hogels, and yield the images in the same order."""
        return self._rounds.stream(pixels, self._draw, self._finish)

    def _draw(self, slot: Slot, pixels: Sequence[Pixel]) -> None:
        picture = self._picture
        if picture is None:
            slot.target.begin()
            return
        picture.begin(slot, moderngl.DEPTH_TEST)
        passes = [direction_pass(self.scene, self.tile, pixel) for pixel in pixels]
        draws = picture.upload(slot, 0, passes)
        picture.draw(slot, 0, passes[0], draws[PICTURE])
        if picture.environment is not None:
            picture.reflect(slot, passes[:1], [draws[REFLECTION]], moderngl.DEPTH_TEST)

    def _finish(self, slot: Slot, pixels: Sequence[Pixel]) -> Iterator[PlateDirection]:
        normals = Channel.NORMAL in self.content.channels
        with self._context:
            color = slot.target.finish_color() if self._colored else None
            triangle = slot.target.finish_triangle()
            heights = [self._height(slot, layer, pixel) for layer, pixel in enumerate(pixels)]
        for layer, pixel in enumerate(pixels):
            numbers = None if triangle is None else triangle[layer]
            yield PlateDirection(
                pixel=pixel,
                color=None if color is None else color[layer],
                triangle=numbers if self.content.ids else None,
                height=heights[layer],
                normal=None if numbers is None or not normals else normals_of(self.scene, numbers),
            )

    def _height(self, slot: Slot, layer: int, pixel: Pixel) -> Singles | None:
        """Return the heights (rows, columns) of an image; None if they are not a channel."""
        if Channel.HEIGHT not in self.content.channels:
            return None
        camera = direction_pass(self.scene, self.tile, pixel)
        return read_heights(slot, layer, self._positions, [camera])
