"""The paper's double frustum: C, with C* drawn over it (paper, sections 3 to 6).

Images with color averaged over the pixel's area and over the aperture are drawn in tiles.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from OpenGL import GL

from xfrustum.raster.cameras import FilmWindow, Pass, drawing_order
from xfrustum.raster.device.context import (
    POSITION_BYTES,
    ContextOwner,
    GpuClock,
    check_room,
    describe,
    open_context,
)
from xfrustum.raster.device.mesh import Positions
from xfrustum.raster.device.targets import Target, most_samples
from xfrustum.raster.drawing import Drawing
from xfrustum.scenes.appearance import Sampling, sub_apertures
from xfrustum.scenes.arguments import InputError, one_of
from xfrustum.scenes.arrays import Numbers, Singles
from xfrustum.scenes.model.device_model import DeviceModel, model_of
from xfrustum.scenes.model.effects import Effect, Question, checked, needed
from xfrustum.scenes.model.images import NOTHING, HogelCamera, HogelImage, Rendering
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.model.visibility import loses_far_plane
from xfrustum.scenes.plate import Aperture, DepthFormat, DoubleFrustum

#: Largest number of sample points drawn at once. It bounds a target's memory, 28 bytes for each
#: coverage sample of a point.
POINTS_AT_ONCE = 1 << 21


@dataclass(frozen=True, kw_only=True)
class Tile:
    """Part of the film, drawn at once with several points per pixel."""

    film: tuple[int, int]  #: W, H of the whole film in pixels
    corner: tuple[
        int, int
    ]  #: Column and row of the tile's first pixel, from the top left of the film
    extent: tuple[int, int]  #: Columns and rows of pixels; they may extend beyond the film
    supersample: int  #: Points along each side of a pixel

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows of points."""
        return self.extent[0] * self.supersample, self.extent[1] * self.supersample

    def seen_by(self, camera: Pass) -> Pass:
        """Return a camera whose whole image is this part of the film of `camera`."""
        (width, height), (column, row), (columns, rows) = self.film, self.corner, self.extent
        center = ((2 * column + columns) / width - 1, 1 - (2 * row + rows) / height)
        matrix = np.eye(4)
        for axis, part in enumerate((columns / width, rows / height)):
            matrix[axis, axis] = 1 / part
            matrix[axis, 3] = -center[axis] / part
        return replace(camera, clip_from_scene=matrix @ camera.clip_from_scene)


def tiles(film: tuple[int, int], supersample: int, largest: int) -> Iterator[Tile]:
    """Yield tiles of equal size, at most `largest` points wide, over a film of W, H pixels."""
    width, height = film
    columns = min(width, max(1, min(largest, POINTS_AT_ONCE // supersample) // supersample))
    at_once = max(1, POINTS_AT_ONCE // (columns * supersample**2))
    rows = min(height, at_once, largest // supersample)
    for row in range(0, height, rows):
        for column in range(0, width, columns):
            yield Tile(
                film=film, corner=(column, row), extent=(columns, rows), supersample=supersample
            )


class Mean:
    """Mean color of images of W, H pixels drawn in tiles, summed in double precision."""

    def __init__(self, film: tuple[int, int]) -> None:
        self._sum = np.zeros((film[1], film[0], 3))

    def add(self, tile: Tile, color: Singles) -> None:
        """Add the points of one tile, (rows, columns, 3), row 0 at the top."""
        (columns, rows), (column, row), n = tile.extent, tile.corner, tile.supersample
        boxes = color.reshape(rows, n, columns, n, 3)
        mean = boxes.mean(axis=(1, 3), dtype=np.float64)
        there = self._sum[row : row + rows, column : column + columns]
        there += mean[: there.shape[0], : there.shape[1]]

    def over(self, count: int) -> Singles:
        """Return the mean over `count` whole images, (H, W, 3)."""
        return (self._sum / count).astype(np.float32)


def largest_image() -> int:
    """Return the largest width and height of an image on the current context's device."""
    return int(GL.glGetIntegerv(GL.GL_MAX_TEXTURE_SIZE))


#: number of camera pairs with cached points: a sweep starts the next pair before it is done with
#: the previous pair
SHOWN_CAMERAS = 2

#: sampling with one point per pixel, seen from the aperture's center
SINGLE_SAMPLE = Sampling()


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawn:
    """Hogel image with the time of its drawing."""

    image: HogelImage
    gpu_s: float  #: drawing time by the GPU's clock, s
    read_s: float  #: wall time of read-back, positions, and means of color, s


class Rasterizer(ContextOwner):
    """Scene on the GPU, uploaded once in float32, drawn for any aperture and settings.

    It is a context manager that frees the OpenGL context on exit. `effects` are the simulated
    effects; None selects the effects that the scene needs. A tiny near, at which surfaces beyond
    the reach appear, may need more effects. `model` is the model of the device; None selects the
    recorded model. Raises InputError if OpenGL is not usable, if the scene is too large for the
    device, or if an effect is unknown.
    """

    def __init__(
        self,
        scene: Scene,
        effects: frozenset[Effect] | None = None,
        model: DeviceModel | None = None,
    ) -> None:
        one_of(scene, Scene, "scene")
        self.scene = scene
        self.effects = needed(scene) if effects is None else checked(effects)
        self._automatic = effects is None
        self._beyond_reach: frozenset[Effect] | None = None
        self._context = open_context()
        self.device = describe(self._context)
        self.model = model or model_of(self.device)
        self._targets: dict[tuple[tuple[int, int], DepthFormat, int], Target] = {}
        #: Identities and points of the latest pictures, by cameras; the newest is last.
        self._shown: dict[tuple[object, ...], tuple[NDArray[np.uint64], Singles]] = {}
        try:
            check_room(scene, self.device["renderer"], vertex_bytes=POSITION_BYTES)
        except InputError:
            self._context.release()
            raise
        # A buffer cannot be empty, so that a scene without triangles has no buffers.
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
        """Raise InputError if the device does not support the number of samples."""
        if sampling == SINGLE_SAMPLE:
            return  # every device supports one sample
        device = self.device["renderer"]
        with self._context:
            coverage, largest = most_samples(), largest_image()
        if sampling.multisample > coverage:
            raise InputError(
                f"multisample {sampling.multisample} is too fine for {device}, which has at most "
                f"{coverage} coverage samples; choose fewer, or supersample"
            )
        if sampling.supersample > largest:
            raise InputError(
                f"supersample {sampling.supersample} is too fine for {device}, which draws at most "
                f"{largest} points in a row; choose fewer"
            )

    def effects_for(self, settings: DoubleFrustum) -> frozenset[Effect]:
        """Return the effects of pictures drawn with these settings."""
        if not self._automatic or not loses_far_plane(self.scene, settings):
            return self.effects
        if self._beyond_reach is None:
            # Without a working far plane, depth is unlimited: all such settings need the same
            # effects.
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

        An image without `normals` or `color` takes less time. `sampling` applies to color; None
        selects the scene's sampling. Triangles and positions are always at the pixel's center, seen
        from the aperture's center. Raises InputError if near is not smaller than the reach, or if
        the device does not support the number of samples.
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
        self._check(aperture, settings)
        sampling = self.scene.sampling if sampling is None else sampling
        self.check_sampling(sampling)
        # OpenGL draws in the current context, which another Rasterizer may have changed.
        with self._context:
            target = self._target(self.scene.frustum.resolution, settings.depth)
            effects = self.effects_for(settings)
            passes = drawing_order(self.scene, aperture, settings, effects)
            clock = GpuClock()
            with clock:
                # A software renderer reads the clock once per tile and batch, while it processes
                # the tile. The flush puts the two queries into different batches.
                GL.glFlush()
                self._draw(target, passes, settings, color=color and sampling == SINGLE_SAMPLE)
            start = time.perf_counter()
            identity = target.read_identity()
            # The identity is zero where nothing was drawn.
            triangle = np.asarray(identity[..., 0].view(np.int32) - 1)
            position = self._position(target, passes, identity)
            seen = self._color(target, aperture, settings, sampling) if color else None
            read_s, gpu_s = time.perf_counter() - start, clock.seconds()
        image = HogelImage(
            camera=self._camera(aperture, settings),
            triangle=triangle,
            object=np.asarray(self.scene.object_of_number[triangle]),
            position=position,
            normal=normals_of(self.scene, triangle) if normals else None,
            color=seen,
            rendering=Rendering.from_effects(effects, sampling) if color else None,
        )
        return Drawn(image=image, gpu_s=gpu_s, read_s=read_s)

    def render_color(
        self, aperture: Aperture, settings: DoubleFrustum, sampling: Sampling = SINGLE_SAMPLE
    ) -> Singles:
        """Return only the color of `render`, (H, W, 3) linear RGB, in less time."""
        self._check(aperture, settings)
        self.check_sampling(sampling)
        with self._context:
            target = self._target(self.scene.frustum.resolution, settings.depth)
            if sampling == SINGLE_SAMPLE:
                passes = drawing_order(self.scene, aperture, settings, self.effects_for(settings))
                self._draw(target, passes, settings, color=True)
            return self._color(target, aperture, settings, sampling)

    def _check(self, aperture: Aperture, settings: DoubleFrustum) -> None:
        one_of(aperture, Aperture, "aperture")
        one_of(settings, DoubleFrustum, "settings")
        settings.check_against(self.scene.frustum)

    def _position(
        self, target: Target, passes: Sequence[Pass], identity: NDArray[np.uint32]
    ) -> Singles:
        """Return the surface points (H, W, 3) of a picture, NaN without a surface.

        If only the depth buffer differs from a cached picture, few pixels change: the points of all
        other pixels are copied from that picture.
        """
        position = np.full((*identity.shape[:2], 3), np.nan, dtype=np.float32)
        if self._positions is None or not passes:
            return position
        # The depth row of the matrices does not matter here.
        cameras = tuple(
            (camera.clip_from_scene[[0, 1, 3]].tobytes(), camera.heights) for camera in passes
        )
        # Compare triangle and camera as one 64-bit number: this is 25 times as fast.
        both = identity.view(np.uint64)[..., 0]
        changed = both != 0
        if before := self._shown.pop(cameras, None):
            position, changed = before[1].copy(), both != before[0]
        pixels = np.flatnonzero(changed)
        position.reshape(-1, 3)[pixels] = self._positions.read(target, passes, pixels).T
        self._shown[cameras] = both, position
        if len(self._shown) > SHOWN_CAMERAS:
            del self._shown[next(iter(self._shown))]
        return position

    def _color(
        self, target: Target, aperture: Aperture, settings: DoubleFrustum, sampling: Sampling
    ) -> Singles:
        """Return the color of the target; with several samples, their mean."""
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
        self, target: Target, passes: Sequence[Pass], settings: DoubleFrustum, *, color: bool
    ) -> None:
        if self._drawing is None:
            target.begin()
        else:
            self._drawing.draw(
                target, passes, settings.mapping, self.effects_for(settings), color=color
            )

    def _target(self, size: tuple[int, int], depth: DepthFormat, samples: int = 1) -> Target:
        if (size, depth, samples) not in self._targets:
            self._targets[size, depth, samples] = Target(size, depth, samples)
        return self._targets[size, depth, samples]

    def _camera(self, aperture: Aperture, settings: DoubleFrustum) -> HogelCamera:
        window = FilmWindow.from_frustum(self.scene.frustum, aperture)
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


def normals_of(scene: Scene, triangle: Numbers) -> Singles:
    """Return the unit normals (H, W, 3) of triangles by their numbers; NaN without a triangle."""
    normals = np.full((*triangle.shape, 3), np.nan, dtype=np.float32)
    covered = triangle != NOTHING
    normals[covered] = scene.normals[triangle[covered]]
    return normals
