"""True images: decisions of `certify` for each pixel, with points, normals and color.

Images are decided hogel by hogel, or direction by direction for all hogels of a tile. Both orders
give the same bits. By directions, one pixel of all hogels is certified at once
(`certify.directions`), so that the broad phase of the filter runs once for each pixel of a hogel,
and not once for each hogel. These results are stored by direction, and read by hogel.
`chosen_order` returns the order with fewer passes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property, lru_cache
from typing import Self

import numpy as np

from xfrustum.reference.backend import BAND_PIXELS, WHOLE_PIXELS, bands
from xfrustum.reference.certify.certify import Certifier, FirstSurfaces
from xfrustum.reference.certify.cone import Triangles
from xfrustum.reference.certify.occlusion import Occlusion, SurfacePoints
from xfrustum.reference.lines import (
    RayBundle,
    TileLines,
    crossed_frustum,
    drawn_triangles,
    model_cameras,
)
from xfrustum.reference.pictures import (
    AVERAGED_PIXELS,
    TOLERANCE,
    Converged,
    Pictures,
    averages,
    converged,
    mean_color,
    points_per_side,
)
from xfrustum.reference.proposals import SecondOpinion, uncertified
from xfrustum.reference.shading import Shader
from xfrustum.reference.tracers import (
    TRACERS,
    EmbreeTracer,
    MitsubaTracer,
    Tracer,
    embree_versions,
    mitsuba_versions,
)
from xfrustum.scenes.appearance import Sampling, sub_apertures
from xfrustum.scenes.arguments import InputError, one_of
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.effects import Effect, checked
from xfrustum.scenes.model.images import DirectionImage, HogelCamera, HogelImage, Rendering, stacked
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import (
    Aperture,
    ApertureBlocks,
    Cull,
    DoubleFrustum,
    Frustum,
    Plate,
    PlateTile,
)

#: Largest number of pixels of all hogels of a tile, decided at once. A pixel takes 13 bytes, and 16
#: more with gaps: 440 MB, or 970 MB.
TILE_PIXELS = 1 << 25

#: number of triangles through the plate whose boxes are compared with apertures at once
TOUCHING_AT_ONCE = 1 << 14


def tile_rows(frustum: Frustum, columns: int) -> int:
    """Return the number of whole rows of hogels in a tile, at least 1; see `TILE_PIXELS`."""
    return max(1, TILE_PIXELS // (math.prod(frustum.resolution) * columns))


@dataclass(frozen=True, kw_only=True, eq=False)
class HogelDecisions:
    """Decisions of one hogel, with the interface of a `Certifier` of its ray bundle."""

    first: FirstSurfaces
    #: (H, W) gaps to the next surface, and to the next with a smaller number; None if not decided,
    #: or if a surface may pass through the aperture
    behind: tuple[Floats, Floats] | None

    def decide(self, rows: range) -> FirstSurfaces:
        """Return the first surface of every pixel in some rows."""
        some, first = slice(rows.start, rows.stop), self.first
        tied = first.tied_triangles
        return replace(
            first,
            triangle=first.triangle[some],
            s=first.s[some],
            certainty=first.certainty[some],
            tied_triangles=tied[(tied[:, 0] >= rows.start) & (tied[:, 0] < rows.stop)],
        )

    def gaps(self, rows: range, numbers: Indices | None = None) -> Floats:
        """Return the gaps of some rows; `numbers` are the triangles of the first surfaces."""
        assert self.behind is not None, "the tile was decided with gaps"
        return self.behind[0 if numbers is None else 1][rows.start : rows.stop]


class TileDecisions:
    """Decisions of all hogels of a tile, with the bits of each hogel's own `Certifier`."""

    def __init__(
        self, triangles: Triangles, frustum: Frustum, tile: PlateTile, *, gaps: bool
    ) -> None:
        width, height = frustum.resolution
        self._shape = height, width
        columns, rows = tile.size
        places = [(row, column) for row in range(rows) for column in range(columns)]
        self._places = {
            crossed_frustum(frustum, tile.plate.aperture(tile.columns[column], tile.rows[row])): (
                row,
                column,
            )
            for row, column in places
        }
        stored = (height * width, rows, columns)
        self._triangle = np.empty(stored, dtype=np.int32)
        self._s, self._certainty = np.empty(stored), np.empty(stored, dtype=np.uint8)
        self._gaps = np.empty((2, *stored)) if gaps else None
        self._touched = _touched(triangles.corners, tile) if gaps else None
        self._tied: dict[tuple[int, int], list[tuple[int, int, int]]] = {}
        lines, every = TileLines(frustum, tile), range(rows)
        for number in range(height * width):
            row, column = divmod(number, width)
            grid = lines.of_pixel((column, row))
            certifier = Certifier(triangles, grid)
            decided = certifier.decide(every)
            # The grid of lines has the order of the tile, or the reverse order if `step` is -1.
            turned = (slice(None, None, grid.step),) * 2
            self._triangle[number] = decided.triangle[turned]
            self._s[number] = decided.s[turned]
            self._certainty[number] = decided.certainty[turned]
            for down, across, triangle in decided.tied_triangles.tolist():
                place = (down, across) if grid.step > 0 else (rows - 1 - down, columns - 1 - across)
                self._tied.setdefault(place, []).append((row, column, triangle))
            if self._gaps is not None:
                numbers = decided.triangle.astype(np.int64).reshape(-1)
                self._gaps[0, number] = certifier.gaps(every)[turned]
                self._gaps[1, number] = certifier.gaps(every, numbers)[turned]

    def of(self, bundle: RayBundle) -> HogelDecisions | None:
        """Return the decisions along the crossed frustum of a hogel; None for other lines."""
        place = self._places.get(bundle)
        if place is None:
            return None
        here = (slice(None), *place)
        shape, gaps = self._shape, self._gaps
        first = FirstSurfaces(
            triangle=self._triangle[here].reshape(shape),
            s=self._s[here].reshape(shape),
            certainty=self._certainty[here].reshape(shape),
            tied_triangles=np.array(self._tied.get(place, []), dtype=np.int64).reshape(-1, 3),
        )
        behind = None
        if gaps is not None and self._touched is not None and not self._touched[place]:
            behind = gaps[0][here].reshape(shape), gaps[1][here].reshape(shape)
        return HogelDecisions(first=first, behind=behind)


def _touched(corners: Floats, tile: PlateTile) -> Mask:
    """Return the hogels (rows, columns) whose apertures lie in the boxes of triangles.

    All lines of a hogel meet a triangle through its aperture at exactly s = 0. Parallel lines meet
    it within rounding, which does not bound a gap.
    """
    plate, (columns, rows) = tile.plate, tile.size
    x = np.array([plate.aperture(number, tile.rows[0]).x for number in tile.columns])
    y = np.array([plate.aperture(tile.columns[0], number).y for number in tile.rows])
    low, high = corners.min(axis=1), corners.max(axis=1)
    crossing = np.flatnonzero((low[:, 2] <= 0) & (high[:, 2] >= 0))
    touched = np.zeros((rows, columns), dtype=np.bool_)
    for start in range(0, len(crossing), TOUCHING_AT_ONCE):
        some = crossing[start : start + TOUCHING_AT_ONCE]
        across = (low[some, 0, None] <= x) & (x <= high[some, 0, None])
        down = (low[some, 1, None] <= y) & (y <= high[some, 1, None])
        touched |= down.T.astype(np.float32) @ across.astype(np.float32) > 0
    return touched


class Reference:
    """The ground truth of a scene: the true images of its crossed frusta.

    `tracer`, one of `TRACERS`, gives a second opinion on every pixel; decisions are always made by
    `certify`. `effects` are the evaluated effects of light; None selects all effects that the scene
    needs. Raises InputError for an unknown tracer or effect.
    """

    def __init__(
        self, scene: Scene, tracer: str = "embree", effects: frozenset[Effect] | None = None
    ) -> None:
        one_of(scene, Scene, "scene")
        if tracer not in TRACERS:
            raise InputError(f"tracer must be one of {', '.join(TRACERS)}, not {tracer!r}")
        self.scene = scene
        self.tracer_name = tracer
        self._shader = Shader(scene, None if effects is None else checked(effects))
        self._pictures = Pictures(scene, self._shader)
        self._tile: TileDecisions | None = None

    @cached_property
    def tracer(self) -> Tracer:
        """The tracer, built when first needed."""
        return (
            MitsubaTracer(self.scene) if self.tracer_name == "mitsuba" else EmbreeTracer(self.scene)
        )

    def build_tracer(self) -> Tracer:
        """Build the acceleration structures now, so that no picture's time includes them."""
        return self.tracer

    @cached_property
    def _triangles(self) -> Triangles:
        return Triangles(self.scene.triangles)

    @cached_property
    def _occlusion(self) -> Occlusion:
        return Occlusion(self._triangles)

    @cached_property
    def _certifiers(self) -> Callable[[RayBundle], Certifier]:
        # An image and its gaps share their boxes: for few pixels, boxes are most of the work.
        return lru_cache(maxsize=2)(lambda bundle: Certifier(self._triangles, bundle))

    def _certifier(self, bundle: RayBundle, *, gaps: bool = False) -> Certifier | HogelDecisions:
        """Return the decisions along the lines of a bundle, from the tile if it has them."""
        known = None if self._tile is None else self._tile.of(bundle)
        if known is None or (gaps and known.behind is None):
            return self._certifiers(bundle)
        return known

    def with_tile(self, tile: PlateTile, *, gaps: bool = False) -> Self:
        """Return a reference that has decided all hogels of a tile, with the same bits.

        Directions are decided one by one. The decisions take some 13 bytes for each pixel of each
        hogel, and 16 more with `gaps`, which predictions of depth errors need.
        """
        # Compute cached properties first, so that the copy shares them.
        _ = self._triangles, self._occlusion, self._certifiers
        other = copy(self)
        other._tile = TileDecisions(self._triangles, self.scene.frustum, tile, gaps=gaps)
        return other

    def first_surfaces(self, bundle: RayBundle) -> FirstSurfaces:
        """Decide the first surface of every pixel of a bundle's image at once."""
        return self._certifier(bundle).decide(range(bundle.resolution[1]))

    @property
    def decided_by(self) -> str:
        """Name of the decision method of this reference; see `alone.DECISIONS`."""
        return "certified"

    @property
    def versions(self) -> dict[str, str]:
        """Names and versions of the libraries that compute the truth, for reports."""
        # Do not build the tracer only for its name.
        return mitsuba_versions() if self.tracer_name == "mitsuba" else embree_versions()

    def trace(
        self, aperture: Aperture, sampling: Sampling | None = None, *, colored: bool = True
    ) -> HogelImage:
        """Return the true image of an aperture (paper, section 3: one frustum that crosses itself).

        `sampling` are the points over which color is averaged, None for the scene's own. An image
        without color (`colored`) is made faster.
        """
        one_of(aperture, Aperture, "aperture")
        # Averaged color needs smaller bands, because all samples of a band are in memory.
        if colored and averages(self.scene.sampling if sampling is None else sampling):
            image = stacked(list(self.trace_bands(aperture, sampling)))
        else:
            image = stacked(list(self._bands(aperture, WHOLE_PIXELS, colored=colored)))
        return replace(image, rendering=self.rendering(sampling) if colored else None)

    def trace_bands(
        self, aperture: Aperture, sampling: Sampling | None = None
    ) -> Iterator[HogelImage]:
        """Yield the true image in bands of rows, from the top, in bounded memory; see `trace`."""
        one_of(aperture, Aperture, "aperture")
        sampling = self.scene.sampling if sampling is None else sampling
        if not averages(sampling):
            yield from self._bands(aperture, BAND_PIXELS)
            return
        # Color is averaged over pixels' boxes and over the aperture (paper, section 6).
        apertures = sub_apertures(self.scene.plate, aperture, sampling.aperture)
        row, side = 0, points_per_side(sampling)
        # Surfaces are decided only at pixel centers, through the middle of the aperture.
        for band in self._bands(aperture, AVERAGED_PIXELS, colored=False):
            rows = range(row, row := row + len(band.triangle))
            color = mean_color(self.scene, self._triangles, self._shader, apertures, side, rows)
            yield replace(band, color=color.astype(np.float32))

    def stream(
        self, apertures: Iterable[Aperture], *, colored: bool = True
    ) -> Iterator[HogelImage]:
        """Yield the true images of many apertures in order, as `trace` returns them."""
        for aperture in apertures:
            yield self.trace(aperture, colored=colored)

    def by_directions(
        self,
        tile: PlateTile,
        pixels: Iterable[tuple[int, int]],
        *,
        normals: bool = True,
        colored: bool = True,
    ) -> Iterator[DirectionImage]:
        """Yield the true images by direction of some pixels (column, row) of all hogels of a tile.

        Each pixel has the bits that `trace` returns with one sample a pixel. The lines of one
        direction are parallel, or pass through a point of the screen, so that boxes and planes of
        triangles serve all hogels (docs/truth.md, "By directions"). InputError if the scene
        averages colors over samples.
        """
        if averages(self.scene.sampling) and colored:
            raise InputError(
                f"{self.scene.name}: has several samples a pixel, and images by direction have "
                "one; trace hogel by hogel"
            )
        lines = TileLines(self.scene.frustum, tile)
        for pixel in pixels:
            grid = lines.of_pixel(pixel)
            decided = Certifier(self._triangles, grid).decide(range(grid.resolution[1]))
            yield self._pictures.by_direction(
                tile, pixel, (grid, decided), normals=normals, colored=colored
            )

    def _bands(
        self, aperture: Aperture, pixels: int, *, colored: bool = True
    ) -> Iterator[HogelImage]:
        """Yield the true image in bands of about `pixels` pixels, with one sample a pixel."""
        bundle = crossed_frustum(self.scene.frustum, aperture)
        certifier = self._certifier(bundle)
        for rows in bands(bundle.resolution[0], range(bundle.resolution[1]), pixels):
            decided = certifier.decide(rows)
            image = self._pictures.image(
                self.camera(aperture), rows, [(bundle, decided)], colored=colored
            )
            opinion = SecondOpinion(
                tracer=lambda: self.tracer,
                scene=self.scene,
                bundle=bundle,
                rows=rows,
                triangle=decided.triangle,
                certainty=decided.certainty,
            )
            yield replace(image, second_opinion=opinion)

    def propose(self, aperture: Aperture, *, colored: bool = True) -> HogelImage:
        """Return the image that the float32 tracer proposes; none of its pixels is certified."""
        bundle = crossed_frustum(self.scene.frustum, aperture)
        proposal = uncertified(self.tracer, self.scene, bundle, rows := range(bundle.resolution[1]))
        return self._pictures.image(
            self.camera(aperture), rows, [(bundle, proposal)], colored=colored
        )

    def converged(
        self,
        aperture: Aperture,
        tolerance: float = TOLERANCE,
        sampling: Sampling | None = None,
        seed: int = 0,
    ) -> Converged:
        """Return the color averaged over the whole area of an aperture (paper, section 6).

        The tolerance is the largest root mean square of the standard error over pixels and
        channels, in radiance; `Converged.error` is the error reached. `sampling` sets the points in
        each pixel, None for the scene's own; its number of sub-apertures is not used. A different
        seed gives independent points.
        """
        side = points_per_side(self.scene.sampling if sampling is None else sampling)
        rows = range(self.scene.frustum.resolution[1])

        def mean(apertures: Sequence[Aperture]) -> Floats:
            return mean_color(self.scene, self._triangles, self._shader, apertures, side, rows)

        return converged(mean, self.scene.plate, aperture, tolerance, seed)

    def decide(self, aperture: Aperture) -> Iterator[FirstSurfaces]:
        """Yield the first surfaces, without points or color, in bands of rows from the top."""
        bundle = crossed_frustum(self.scene.frustum, aperture)
        certifier = self._certifier(bundle)
        for rows in bands(bundle.resolution[0], range(bundle.resolution[1])):
            yield certifier.decide(rows)

    def trace_model(
        self, aperture: Aperture, settings: DoubleFrustum, *, shaded: bool = True
    ) -> HogelImage:
        """Return the image that the cameras of settings draw without rounding; faster unshaded."""
        settings.check_against(self.scene.frustum)
        width, height = self.scene.frustum.resolution
        cameras = model_cameras(self.scene.frustum, aperture, settings)
        camera = self._pictures.camera(aperture, settings)
        rows = list(bands(width, range(height), WHOLE_PIXELS))
        # One certifier per camera serves all bands: its boxes are computed once.
        decided = [self._decided(each.bundle, settings.cull, rows) for each in cameras]
        return stacked(
            [
                self._pictures.image(
                    camera,
                    band,
                    [
                        (each.bundle, next(surfaces))
                        for each, surfaces in zip(cameras, decided, strict=True)
                    ],
                    normals=shaded,
                    colored=shaded,
                )
                for band in rows
            ]
        )

    def _decided(
        self, bundle: RayBundle, cull: Cull, rows: Sequence[range]
    ) -> Iterator[FirstSurfaces]:
        """Yield the first surfaces of a camera, which may cull faces, in bands of rows."""
        if cull is Cull.NONE:
            yield from map(Certifier(self._triangles, bundle).decide, rows)
            return
        # Culled triangles are dropped before the decision, so that surfaces behind them show.
        some = drawn_triangles(self.scene.triangles, bundle, cull)
        certifier = Certifier(Triangles(self.scene.triangles[some]), bundle)
        for band in rows:
            yield certifier.decide(band).renumbered(some)

    def gaps(self, aperture: Aperture, before: HogelImage | None = None) -> Floats:
        """Return the gap from each pixel's first surface to the next on its side, (H, W).

        A gap is a difference of |z|, in scene units. C keeps the nearest surface behind the plate,
        and its gap is to the second nearest; C* keeps the farthest in front of the plate, and its
        gap is to the second farthest. The gap is infinite if there is no second surface. With
        `before`, the true image, a surface counts as next only if it is drawn before the first
        surface; triangles are drawn in the order of their numbers.

        Gaps come from the filter of the truth. A triangle is never left out if a line surely meets
        it, and the error of a gap is at most the rounding bounds of its two surfaces: some 1e-15 of
        |z| unless a surface is seen edge-on. Closer surfaces count as one, so that a point shared
        by two triangles is not behind itself. If a line passes an edge within rounding, it counts
        as missing the triangle.
        """
        bundle = crossed_frustum(self.scene.frustum, aperture)
        certifier = self._certifier(bundle, gaps=True)
        width, height = bundle.resolution
        numbers = None if before is None else before.triangle.astype(np.int64)
        return np.concatenate(
            [
                certifier.gaps(
                    rows, None if numbers is None else numbers[rows.start : rows.stop].reshape(-1)
                )
                for rows in bands(width, range(height))
            ]
        )

    def hidden(self, aperture: Aperture, points: SurfacePoints) -> Mask:
        """Return a mask (N,) of points that are hidden from the true frustum of an aperture."""
        return self.hidden_from(crossed_frustum(self.scene.frustum, aperture), points)

    def hidden_from(self, bundle: RayBundle, points: SurfacePoints) -> Mask:
        """Return the points (N,) hidden from the center of a ray bundle; see `Occlusion`."""
        return self._occlusion.hidden(bundle, points)

    def rendering(self, sampling: Sampling | None = None) -> Rendering:
        """Return the effects and samples of a true image's color; sampling as for `trace`."""
        return Rendering.from_effects(
            self._shader.effects, self.scene.sampling if sampling is None else sampling
        )

    def camera(self, aperture: Aperture) -> HogelCamera:
        """Return the true frustum of an aperture, as the aperture's image stores it."""
        return self._pictures.camera(aperture)


class TruthBy(StrEnum):
    """Order in which the pixels of truths are decided."""

    AUTO = "auto"
    """The order with fewer passes over the scene."""
    DIRECTIONS = "directions"
    """A pass for each pixel of a hogel, over all hogels of a tile."""
    HOGELS = "hogels"
    """A pass for each hogel."""


def chosen_order(
    order: TruthBy, scene: Scene, *, refusal: str = "", rows: int | None = None
) -> TruthBy:
    """Return the order, directions or hogels, for a plate that is judged in tiles of whole rows.

    `refusal` is the reason why hogels must be judged one by one, if there is one; `rows` is the
    caller's limit of rows in a tile. Raises InputError if `order` is DIRECTIONS and there is a
    refusal, or a row of hogels exceeds a tile.
    """
    columns, plate_rows = scene.plate.hogels
    pixels = math.prod(scene.frustum.resolution)
    if order is TruthBy.DIRECTIONS:
        if refusal:
            raise InputError(f"--truth-by directions {refusal}")
        if columns * pixels > TILE_PIXELS:
            raise InputError(
                f"--truth-by directions decides whole rows of hogels: {columns:,} hogels of "
                f"{pixels:,} pixels are more than the {TILE_PIXELS:,} pixels that are held at "
                "once; use hogels, or fewer pixels"
            )
    if refusal or columns * pixels > TILE_PIXELS:
        return TruthBy.HOGELS
    if order is not TruthBy.AUTO:
        return order
    rows = min(tile_rows(scene.frustum, columns), plate_rows, rows or plate_rows)
    # A tile takes a pass for each pixel of a hogel, or one for each of its hogels.
    return TruthBy.DIRECTIONS if rows * columns >= pixels else TruthBy.HOGELS


def row_tile(plate: Plate, first: int, stop: int) -> PlateTile:
    """Return the tile of whole rows of a plate, from `first` to before `stop`."""
    return PlateTile(plate=plate, columns=range(plate.hogels[0]), rows=range(first, stop))


def with_references(
    reference: Reference, order: TruthBy, apertures: Iterable[Aperture]
) -> Iterator[tuple[Aperture, Reference]]:
    """Yield apertures, each with its reference; by directions, all apertures of the plate."""
    if order is not TruthBy.DIRECTIONS:
        yield from ((aperture, reference) for aperture in apertures)
        return
    plate = reference.scene.plate
    size = tile_rows(reference.scene.frustum, plate.hogels[0])
    for first in range(0, plate.hogels[1], size):
        tile = row_tile(plate, first, min(first + size, plate.hogels[1]))
        decided = reference.with_tile(tile)
        for aperture in ApertureBlocks(plate, ((tile.columns, tile.rows),)):
            yield aperture, decided
