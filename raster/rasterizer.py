"""The paper's double frustum: C, then C* over it (paper, sections 3 to 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from OpenGL import GL

from xfrustum.raster.accumulate import Mean, check_sampling, largest_image, tiles
from xfrustum.raster.cameras.cameras import FilmWindow
from xfrustum.raster.cameras.passes import Pass, drawing_order
from xfrustum.raster.device.capacity import POSITION_BYTES, check_room
from xfrustum.raster.device.context import ContextOwner, describe, open_context
from xfrustum.raster.device.positions import DrawnBy, Positions
from xfrustum.raster.device.targets import Target
from xfrustum.raster.device.timer import GpuTimer, StageTime
from xfrustum.raster.drawing import Drawing
from xfrustum.scenes.appearance.sampling import Sampling, sub_apertures
from xfrustum.scenes.arguments import one_of
from xfrustum.scenes.arrays import Numbers, Singles
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.effects import Effect, Question, checked, needed
from xfrustum.scenes.model.hogel_image import NOTHING, HogelCamera, HogelImage, Rendering
from xfrustum.scenes.model.region import loses_far_plane
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthFormat, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

SINGLE_SAMPLE = Sampling()
"""The sampling with one point a pixel, seen through the middle of the aperture."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawn:
    """An image, and the time of each stage of drawing it.

    The stages are `draw`, and `read`: read-back with the positions that it computes, and means of color.
    """

    image: HogelImage
    times: dict[str, StageTime]


class Rasterizer(ContextOwner):
    """A scene on the GPU, ready to be drawn for any aperture and any settings.

    A context manager: leaving it frees the context and everything in it.

    Parameters
    ----------
    scene
        Scene that is uploaded, once, in float32.
    effects
        Effects that are simulated; None for those that the scene calls for. More effects do not
        change the picture.

    Attributes
    ----------
    effects
        Effects that are simulated. Where the scene decided, settings whose near is so tiny that pictures show
        surfaces beyond the reach have those of these surfaces too, see `effects_for`.

    Raises
    ------
    InputError
        There is no usable OpenGL (see `context.open_context`), the scene is too large for it, or an
        effect is not one.
    """

    def __init__(self, scene: Scene, effects: frozenset[Effect] | None = None) -> None:
        one_of(scene, Scene, "scene")
        self.scene = scene
        self.effects = needed(scene) if effects is None else checked(effects)
        self._automatic = effects is None
        self._beyond_reach: frozenset[Effect] | None = None
        self._context = open_context()
        self.device = describe(self._context)
        self._targets: dict[tuple[tuple[int, int], DepthFormat, int], Target] = {}
        self._object_of_number = np.append(scene.object_of_triangle, np.int32(NOTHING))
        try:
            check_room(scene, self.device["renderer"], vertex_bytes=POSITION_BYTES)
        except InputError:
            self._context.release()
            raise
        # A buffer cannot be empty: a scene without triangles has nothing on the GPU.
        solid = len(scene.faces) > 0
        self._drawing = Drawing(self._context, scene) if solid else None
        self._positions = Positions(self._context, scene) if solid else None

    def release(self) -> None:
        """Free the context and everything in it."""
        with self._context:
            for target in self._targets.values():
                target.release()
        self._targets.clear()
        self._context.release()

    def check_sampling(self, sampling: Sampling) -> None:
        """Raise InputError where the device cannot sample so finely."""
        with self._context:
            check_sampling(sampling, self.device["renderer"])

    def effects_for(self, settings: DoubleFrustum) -> frozenset[Effect]:
        """Return the effects that pictures with these settings are drawn with."""
        if not self._automatic or not loses_far_plane(self.scene, settings):
            return self.effects
        if self._beyond_reach is None:
            # A picture that loses the far plane has no end in depth: all such settings call for the same.
            self._beyond_reach = needed(self.scene, question=Question(settings=(settings,)))
        return self._beyond_reach

    def render(
        self,
        aperture: Aperture,
        settings: DoubleFrustum,
        *,
        normals: bool = True,
        color: bool = True,
        sampling: Sampling | None = None,
    ) -> HogelImage:
        """Return the hogel image of an aperture.

        Parameters
        ----------
        aperture
            Aperture in which the frusta cross.
        settings
            Near plane, depth buffer and cameras.
        normals, color
            Whether the image has these arrays; without them it is drawn faster.
        sampling
            Sampling of color; None for that of the scene. Triangles and positions are always those
            at the pixel's center, seen through the middle of the aperture.

        Raises
        ------
        InputError
            near is not smaller than the reach, or the device cannot sample so finely.
        """
        return self.draw(aperture, settings, normals=normals, color=color, sampling=sampling).image

    def draw(
        self,
        aperture: Aperture,
        settings: DoubleFrustum,
        *,
        normals: bool = True,
        color: bool = True,
        sampling: Sampling | None = None,
    ) -> Drawn:
        """Return the hogel image of an aperture and the time that it took; see `render`."""
        one_of(aperture, Aperture, "aperture")
        one_of(settings, DoubleFrustum, "settings")
        settings.check_against(self.scene.frustum)
        sampling = self.scene.sampling if sampling is None else sampling
        # OpenGL draws in whichever context is current: another Rasterizer may have been opened since.
        with self._context:
            check_sampling(sampling, self.device["renderer"])
            target = self._target(self.scene.frustum.resolution, settings.depth)
            effects = self.effects_for(settings)
            passes = drawing_order(self.scene, aperture, settings, effects)
            timer = GpuTimer()
            with timer.stage("draw"):
                # A software renderer reads the clock once for each tile, when it works on that tile. The
                # flush keeps the query that begins the stage out of the batch with the one that ends it.
                GL.glFlush()
                self._draw(target, passes, settings, color=color and sampling == SINGLE_SAMPLE)
            with timer.stage("read"):
                identity = target.read_identity()
                triangle = _triangle_of(identity)
                position = self._read_position(target, passes)
                seen = self._color(target, aperture, settings, sampling) if color else None
            times = timer.collect()
        image = HogelImage(
            camera=self._camera(aperture, settings),
            triangle=triangle,
            object=self._objects(triangle),
            position=position,
            normal=normals_of(self.scene, triangle) if normals else None,
            color=seen,
            rendering=Rendering.of(effects, sampling) if color else None,
        )
        return Drawn(image=image, times=times)

    def draw_only(self, aperture: Aperture, settings: DoubleFrustum) -> None:
        """Draw the picture of `render` without color, wait for the device, and read nothing back.

        This is to measure what reading costs.
        """
        settings.check_against(self.scene.frustum)
        with self._context:
            target = self._target(self.scene.frustum.resolution, settings.depth)
            passes = drawing_order(self.scene, aperture, settings, self.effects_for(settings))
            self._draw(target, passes, settings, color=False)
            GL.glFinish()

    def render_color(
        self, aperture: Aperture, settings: DoubleFrustum, sampling: Sampling = SINGLE_SAMPLE
    ) -> Singles:
        """Return the color of an aperture alone, (H, W, 3) linear RGB; see `render`.

        These are the colors of `render`, in less time: triangles and positions are neither read nor, where
        there are several samples, drawn.
        """
        one_of(aperture, Aperture, "aperture")
        one_of(settings, DoubleFrustum, "settings")
        settings.check_against(self.scene.frustum)
        with self._context:
            check_sampling(sampling, self.device["renderer"])
            target = self._target(self.scene.frustum.resolution, settings.depth)
            if sampling == SINGLE_SAMPLE:
                passes = drawing_order(self.scene, aperture, settings, self.effects_for(settings))
                self._draw(target, passes, settings, color=True)
            return self._color(target, aperture, settings, sampling)

    def _color(
        self, target: Target, aperture: Aperture, settings: DoubleFrustum, sampling: Sampling
    ) -> Singles:
        """Return the color that the target shows or, where more samples are asked for, their mean."""
        if sampling == SINGLE_SAMPLE:
            return target.read_color()
        film = self.scene.frustum.resolution
        mean = Mean(film)
        places = sub_apertures(self.scene.plate, aperture, sampling.aperture)
        for place in places:
            passes = drawing_order(self.scene, place, settings, self.effects_for(settings))
            for tile in tiles(film, sampling.supersample, largest_image()):
                part = self._target(tile.size, settings.depth, sampling.multisample)
                self._draw(part, [tile.seen_by(camera) for camera in passes], settings, color=True)
                mean.add(tile, part.read_color())
        return mean.over(len(places))

    def _draw(
        self,
        target: Target,
        passes: Sequence[Pass],
        settings: DoubleFrustum,
        *,
        color: bool,
    ) -> None:
        if self._drawing is None:
            target.begin()
        else:
            effects = self.effects_for(settings)
            drawing, mapping = self._drawing, settings.mapping
            drawing.draw(target, passes, mapping, effects, color=color)

    def _objects(self, triangle: Numbers) -> Numbers:
        """Return the numbers of triangles' objects (H, W)."""
        # `NOTHING`, which is -1, finds the last entry, `NOTHING`.
        return np.asarray(self._object_of_number[triangle])

    def _read_position(self, target: Target, passes: Sequence[Pass]) -> Singles:
        """Return the surface points."""
        if self._positions is None or not passes:
            return np.full((*target.size[::-1], 3), np.nan, dtype=np.float32)
        return self._positions.read(target, _drawn_by(passes))

    def _target(self, size: tuple[int, int], depth: DepthFormat, samples: int = 1) -> Target:
        if (size, depth, samples) not in self._targets:
            self._targets[size, depth, samples] = Target(size, depth, samples)
        return self._targets[size, depth, samples]

    def _camera(self, aperture: Aperture, settings: DoubleFrustum) -> HogelCamera:
        window = FilmWindow.of(self.scene.frustum, aperture)
        return HogelCamera(
            aperture=aperture,
            resolution=self.scene.frustum.resolution,
            # k is the slope of the axis per unit of depth, away from the viewer.
            shear=(-window.axis[0], -window.axis[1]),
            half_extent=(window.half_width, window.half_height),
            reach=self.scene.frustum.reach,
            scene=self.scene.source,
            scene_hash=self.scene.content_hash,
            renderer=f"raster, {self.device['renderer']}",
            settings=settings,
        )


def _drawn_by(passes: Sequence[Pass]) -> tuple[DrawnBy, ...]:
    return tuple(DrawnBy(clip_from_scene=p.clip_from_scene, heights=p.heights) for p in passes)


def _triangle_of(identity: NDArray[np.uint32]) -> Numbers:
    """Return triangle numbers (H, W), -1 where nothing was drawn."""
    return np.asarray(identity[..., 0].view(np.int32) - 1)


def normals_of(scene: Scene, triangle: Numbers) -> Singles:
    """Return the unit normals (H, W, 3) of triangles by their numbers, NaN where there is none."""
    normals = np.full((*triangle.shape, 3), np.nan, dtype=np.float32)
    covered = triangle != NOTHING
    normals[covered] = scene.normals[triangle[covered]]
    return normals
