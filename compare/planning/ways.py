"""Two ways to draw a plate: by hogels with two cameras each, or by directions, all hogels at once.

With two cameras, the time of a hogel is the same on every plate. A pass by directions processes the
vertices once for all hogels, so that passes are faster above some number of hogels
(`WaySpeeds.crossover`). Lines of a direction have no near plane, so that no surface is displaced,
and wrong surfaces appear only at edges that snapping moves.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from xfrustum.raster.plate.directions import DirectionRenderer
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reference import Reference
from xfrustum.scenes.appearance import Sampling
from xfrustum.scenes.arrays import Indices, Mask, Numbers
from xfrustum.scenes.model.effects import CAMERAS, needed
from xfrustum.scenes.model.images import NOTHING, DirectionImage, PlateContent
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture, DepthFormat, DoubleFrustum, Frustum, Plate, PlateTile

#: Hogels along the longer side of two plates whose passes are timed: with few hogels, vertices take
#: most of the time; with many hogels, their pixels do.
FEW_HOGELS, MANY_HOGELS = 64, 512
#: Numbers of passes, and of hogels, that are timed together: several submissions to the GPU.
TIMED_PASSES, TIMED_HOGELS = 8, 32
#: Number of timings of each quantity; the smallest is used, because other load only adds time.
TIMINGS = 4
#: Largest side, in hogels, of a tile whose images are compared with the truth; number of images.
COMPARED_SIDE, COMPARED_PASSES = 96, 16


class PlateWay(StrEnum):
    """Way to draw a plate."""

    TWO_CAMERAS = "two cameras"
    SLABS = "slabs"
    DIRECTIONS = "directions"

    @classmethod
    def from_settings(cls, settings: DoubleFrustum) -> PlateWay:
        """Return the way with two cameras: with slabs if settings cut the frusta."""
        return cls.SLABS if settings.slabs else cls.TWO_CAMERAS


def spread_pixels(frustum: Frustum, count: int) -> list[tuple[int, int]]:
    """Return at most `count` pixels (column, row) of a hogel, spread evenly, without randomness."""
    width, height = frustum.resolution
    if width * height <= count:
        return [(column, row) for row in range(height) for column in range(width)]
    # Steps of the golden section along one axis also fill the other axis evenly.
    places = np.arange(count) + 0.5
    columns = (width * (places * (math.sqrt(5) - 1) / 2 % 1)).astype(int)
    rows = (height * places / count).astype(int)
    return list(dict.fromkeys(zip(columns.tolist(), rows.tolist(), strict=True)))


@dataclass(frozen=True, kw_only=True)
class WaySpeeds:
    """Seconds that both ways to draw a plate take, measured on one machine for one scene."""

    pixels: int  #: pixels of a hogel; each pixel is a pass by directions
    pass_s: float  #: seconds of a pass without any hogel: vertices and calls
    cell_s: float  #: additional seconds of a pass for each hogel
    hogel_s: float  #: seconds of a hogel by two cameras, if many hogels are drawn together

    def directions_s(self, hogels: int, tiles: int = 1) -> float:
        """Return the predicted seconds of a plate by directions, drawn in `tiles` tiles."""
        return self.pixels * (tiles * self.pass_s + hogels * self.cell_s)

    def hogels_s(self, hogels: int) -> float:
        """Return the predicted seconds of a plate by hogels."""
        return hogels * self.hogel_s

    @property
    def crossover(self) -> float:
        """Number of hogels above which directions are faster, in one tile; infinite if never."""
        # W H (pass + N cell) = N hogel
        gained = self.hogel_s - self.pixels * self.cell_s
        return self.pixels * self.pass_s / gained if gained > 0 else math.inf


def _seconds(runs: Sequence[Callable[[], Iterable[object]]]) -> list[float]:
    """Return the shortest time, s, of iterating over each run; the first round only warms up.

    Runs take turns, so that other load slows down all of them.
    """
    taken: list[list[float]] = [[] for _ in runs]
    for _ in range(TIMINGS + 1):
        for run, seconds in zip(runs, taken, strict=True):
            begun = time.perf_counter()
            deque(run(), maxlen=0)
            seconds.append(time.perf_counter() - begun)
    return [min(seconds[1:]) for seconds in taken]


def with_hogels(scene: Scene, longest: int) -> Scene:
    """Return a scene whose plate has the same size, and `longest` hogels along its longer side."""
    columns, rows = (
        max(1, round(longest * side / max(scene.plate.size))) for side in scene.plate.size
    )
    return replace(scene, plate=Plate(size=scene.plate.size, hogels=(columns, rows)))


@dataclass(frozen=True, kw_only=True)
class TimedPlate:
    """Parts of a plate that are timed: some passes, and some hogels spread over the plate."""

    scene: Scene
    content: PlateContent

    def passes(self, stack: ExitStack, depth: DepthFormat) -> Callable[[], Iterable[object]]:
        """Open the renderer, and return the function that draws `TIMED_PASSES` passes."""
        tile, pixels = PlateTile.whole(self.scene.plate), self.pixels
        renderer = stack.enter_context(DirectionRenderer(self.scene, tile, self.content, depth))
        return lambda: renderer.images(pixels)

    def hogels(self, stack: ExitStack, settings: DoubleFrustum) -> Callable[[], Iterable[object]]:
        """Open the renderer, and return the function that draws `TIMED_HOGELS` hogels."""
        apertures = self.apertures
        renderer = stack.enter_context(PlateRenderer(self.scene, settings, self.content))
        return lambda: renderer.hogels(apertures)

    @property
    def pixels(self) -> list[tuple[int, int]]:
        """Pixels of the timed passes."""
        return spread_pixels(self.scene.frustum, TIMED_PASSES)

    @property
    def apertures(self) -> list[Aperture]:
        """Apertures of the timed hogels."""
        columns, rows = self.scene.plate.hogels
        places = np.linspace(0, columns * rows - 1, TIMED_HOGELS).astype(int).tolist()
        return [self.scene.plate.aperture(k % columns, k // columns) for k in dict.fromkeys(places)]


@dataclass(frozen=True, kw_only=True)
class PlateTimes:
    """Seconds of a whole plate, extrapolated from a part, and the speeds for other plates."""

    directions_s: float
    hogels_s: tuple[float, ...]  #: seconds by hogels, for each setting of two cameras
    speeds: WaySpeeds


def measure_plate(
    scene: Scene, settings: Sequence[DoubleFrustum], content: PlateContent
) -> PlateTimes:
    """Return the seconds of a plate by directions and by hogels with each setting, and the speeds.

    Passes are also timed over two plates of the scene's size, of few hogels and of many: a straight
    line through both times predicts passes over other plates. The time of a hogel with the first
    setting predicts plates by hogels. InputError if the scene cannot be drawn by directions, or
    without usable OpenGL.
    """
    plates = [with_hogels(scene, longest) for longest in (FEW_HOGELS, MANY_HOGELS)]
    timed = [TimedPlate(scene=each, content=content) for each in (*plates, scene)]
    own, pixels, hogels = timed[-1], math.prod(scene.frustum.resolution), scene.plate.hogels
    with ExitStack() as stack:
        runs = [each.passes(stack, settings[0].depth) for each in timed]
        runs += [own.hogels(stack, each) for each in settings]
        few, many, whole, *pairs = _seconds(runs)
    few, many, whole = (seconds / len(own.pixels) for seconds in (few, many, whole))
    pairs = [seconds / len(own.apertures) for seconds in pairs]
    least, most = (math.prod(each.plate.hogels) for each in plates)
    cell_s = max(many - few, 0.0) / (most - least)
    speeds = WaySpeeds(
        pixels=pixels, pass_s=max(few - least * cell_s, 0.0), cell_s=cell_s, hogel_s=pairs[0]
    )
    return PlateTimes(
        directions_s=pixels * whole,
        hogels_s=tuple(math.prod(hogels) * seconds for seconds in pairs),
        speeds=speeds,
    )


# Wrong surfaces by directions
# -------------------------------------------------------------------------------------------------


def tile_about(plate: Plate, aperture: Aperture, most: int) -> PlateTile:
    """Return a tile of at most `most` columns and rows of hogels about an aperture."""
    columns, rows = (
        range(first, first + min(most, count))
        for count, place in zip(plate.hogels, aperture.index, strict=True)
        for first in [max(0, min(place - most // 2, count - most))]
    )
    return PlateTile(plate=plate, columns=columns, rows=rows)


@dataclass(frozen=True, kw_only=True)
class DirectionErrors:
    """Pixels of images by direction that were compared with the truth; ties are left out."""

    judged: int
    wrong: int  #: judged pixels with a wrong surface

    @property
    def fraction(self) -> float:
        """Share of the judged pixels with a wrong surface."""
        return self.wrong / self.judged if self.judged else 0.0


def direction_errors(
    reference: Reference, tile: PlateTile, pixels: Iterable[tuple[int, int]], depth: DepthFormat
) -> DirectionErrors:
    """Draw and trace some pixels of all hogels of a tile, and count the wrong surfaces.

    InputError if the scene cannot be drawn by directions, or without usable OpenGL.
    """
    scene, requested, judged, wrong = reference.scene, list(pixels), 0, 0
    content = PlateContent(ids=True, effects=needed(scene) & CAMERAS)
    _, points = np.unique(scene.vertices, axis=0, return_inverse=True)
    corners = points.reshape(-1)[scene.faces]
    truths = reference.by_directions(tile, requested, normals=False, colored=False)
    with DirectionRenderer(replace(scene, sampling=Sampling()), tile, content, depth) as renderer:
        for truth, drawn in zip(truths, renderer.images(requested), strict=True):
            assert drawn.triangle is not None
            known = np.ones(truth.triangle.shape, dtype=np.bool_)
            known[truth.tied_triangles[:, 0], truth.tied_triangles[:, 1]] = False
            judged += int(np.count_nonzero(known))
            hidden = _wrong_surfaces(truth, drawn.triangle, scene, corners)
            wrong += int(np.count_nonzero(known & hidden))
    return DirectionErrors(judged=judged, wrong=wrong)


def _wrong_surfaces(truth: DirectionImage, drawn: Numbers, scene: Scene, corners: Indices) -> Mask:
    """Return the pixels with another object, or with a hidden part of the same object.

    If true and drawn triangle share a corner, snapping may have moved their edge, and the drawn
    point counts as visible. All other triangles of the same object count as hidden, so that the
    number of wrong pixels is an upper bound. `corners` are numbers of the points of each triangle;
    equal points have equal numbers.
    """
    wrong: Mask = (truth.triangle == NOTHING) != (drawn == NOTHING)
    both = np.nonzero((truth.triangle != drawn) & ~wrong)
    ours, theirs = truth.triangle[both], drawn[both]
    joined = (corners[ours][:, :, None] == corners[theirs][:, None, :]).any(axis=(1, 2))
    same = scene.object_of_triangle[ours] == scene.object_of_triangle[theirs]
    wrong[both] = ~(joined & same)
    return wrong
