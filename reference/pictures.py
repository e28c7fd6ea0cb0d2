"""Images of an aperture from decisions along its lines, and means of color.

**Images** have points, normals, objects and light. There is one lane of Dr.Jit for each pixel.
Layers are the images of single cameras; later layers are drawn over earlier layers.

**Means** of color are over boxes of pixels and over apertures, on request until they converge. The
integral over a hogel's aperture (paper, section 6: band limiting) is then estimated with scrambled
Sobol points (Owen, 1997). Each scrambling gives an unbiased estimate. The scatter of several
estimates therefore measures the error of their mean, for any picture. The error of N points falls
as N^-1.5 where a pixel changes smoothly with the point, and as N^-0.75 where an edge passes over
it; independent random points would give N^-0.5.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import Any

import numpy as np
import scipy

from xfrustum.reference.backend import (
    BAND_PIXELS,
    Float32,
    Float64,
    Int32,
    Table,
    UInt32,
    bands,
    constants,
    dr,
    interleaved,
    on_device,
    product,
    recording,
    table,
)
from xfrustum.reference.certify.certify import Certifier, FirstSurfaces
from xfrustum.reference.certify.cone import Triangles
from xfrustum.reference.lines import LineGrid, PixelLines, RayBundle, crossed_frustum
from xfrustum.reference.shading import Shader, ShadowedShader
from xfrustum.scenes.appearance import MAX_SAMPLES, Sampling
from xfrustum.scenes.arrays import Bytes, Floats, Indices, Numbers
from xfrustum.scenes.model.images import NOTHING, DirectionImage, HogelCamera, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture, DoubleFrustum, Plate, PlateTile


@dataclass(frozen=True, kw_only=True, eq=False)
class Layer:
    """Surfaces of one camera in all rows of an image, or of several cameras overlaid.

    The fields are triangle numbers (H, W), `NOTHING` for none, their `Certainty`, tied triangles
    (N, 3) as in `FirstSurfaces`, and surface points (H, W, 3) in scene units, NaN for none.
    """

    triangle: Numbers
    certainty: Bytes
    tied_triangles: Indices
    position: Floats

    @classmethod
    def from_surfaces(cls, bundle: RayBundle, decided: FirstSurfaces) -> Layer:
        """Return the surfaces along a ray bundle."""
        return cls(
            triangle=decided.triangle,
            certainty=decided.certainty,
            tied_triangles=decided.tied_triangles,
            position=np.asarray(bundle.center) + decided.s[..., None] * bundle.directions(),
        )


def overlaid(layers: Sequence[Layer]) -> Layer:
    """Combine layers of the same image into one layer, the last on top."""
    below, *others = layers
    for upper in others:
        covers = upper.triangle != NOTHING
        certainty, tied_triangles = _overlaid(below, upper, 0)
        below = Layer(
            triangle=np.where(covers, upper.triangle, below.triangle),
            certainty=certainty,
            tied_triangles=tied_triangles,
            position=np.where(covers[..., None], upper.position, below.position),
        )
    return below


def overlaid_certainty(decided: Sequence[FirstSurfaces], first_row: int) -> tuple[Bytes, Indices]:
    """Return certainty and tied triangles of decisions of the same rows, the last on top."""

    def on_top(below: FirstSurfaces, upper: FirstSurfaces) -> FirstSurfaces:
        certainty, tied_triangles = _overlaid(below, upper, first_row)
        return replace(below, certainty=certainty, tied_triangles=tied_triangles)

    top = reduce(on_top, decided)
    return top.certainty, top.tied_triangles


def _overlaid(
    below: Layer | FirstSurfaces, upper: Layer | FirstSurfaces, first_row: int
) -> tuple[Bytes, Indices]:
    covers = upper.triangle != NOTHING
    # Covered ties are dropped.
    row, column, _ = below.tied_triangles.T
    visible = below.tied_triangles[~covers[row - first_row, column]]
    # If the upper layer is empty, the certainty depends on both layers.
    certainty = np.where(covers, upper.certainty, np.maximum(below.certainty, upper.certainty))
    return certainty, np.concatenate((visible, upper.tied_triangles))


#: lines of a camera, and first surfaces along some rows
Decided = tuple[RayBundle, FirstSurfaces]


def pixel_directions(bundle: RayBundle | LineGrid, rows: range) -> list[Any]:
    """Return the coordinates of d of every pixel in some rows; see `RayBundle.directions`."""
    lane = dr.arange(UInt32, len(rows) * bundle.resolution[0])
    width, start = dr.opaque(UInt32, bundle.resolution[0]), dr.opaque(UInt32, rows.start)
    # Divide in doubles: this is faster than in integers, and the added half exceeds the error.
    row = UInt32(dr.floor((Float64(lane) + 0.5) / Float64(width)))
    dx, dy = on_device(bundle.dx), on_device(bundle.dy)
    return [
        dr.gather(Float64, dx, lane - row * width),
        dr.gather(Float64, dy, row + start),
        Float64(-1.0),
    ]


class Pictures:
    """Composer of a scene's images from decisions."""

    def __init__(self, scene: Scene, shader: Shader) -> None:
        self._scene, self._shader = scene, shader

    @cached_property
    def _normals(self) -> Table:
        return table(self._scene.normals)

    @cached_property
    def _objects(self) -> Table:
        return table(self._scene.object_of_triangle)

    def camera(self, aperture: Aperture, settings: DoubleFrustum | None = None) -> HogelCamera:
        """Return the true frustum of an aperture, with the settings of offset cameras if given."""
        bundle = crossed_frustum(self._scene.frustum, aperture)
        return HogelCamera(
            aperture=aperture,
            resolution=bundle.resolution,
            shear=bundle.shear,
            half_extent=bundle.half_extent,
            reach=self._scene.frustum.reach,
            scene=self._scene.source,
            scene_hash=self._scene.content_hash,
            renderer="reference" if settings is None else "reference, offset cameras",
            settings=settings,
        )

    def image(
        self,
        camera: HogelCamera,
        rows: range,
        layers: Sequence[Decided],
        *,
        normals: bool = True,
        colored: bool = True,
    ) -> HogelImage:
        """Compose an image from decided layers of some rows, in drawing order, the last on top."""
        certainty, tied_triangles = overlaid_certainty(
            [decided for _, decided in layers], rows.start
        )
        shape = len(rows), layers[0][0].resolution[0]
        points = (*shape, 3)
        if not len(self._scene.faces):
            return HogelImage(
                camera=camera,
                triangle=np.full(shape, NOTHING, dtype=np.int32),
                object=np.full(shape, NOTHING, dtype=np.int32),
                position=np.full(points, np.nan),
                normal=np.full(points, np.nan) if normals else None,
                color=np.zeros(points, dtype=np.float32) if colored else None,
                certainty=certainty,
                tied_triangles=tied_triangles,
            )
        with recording():
            number: Any = Int32(NOTHING)
            # Layers are overlaid within one kernel: no array of a layer is stored.
            position: list[Any] = [Float64(np.nan)] * 3
            direction: list[Any] = []
            lines: dict[object, list[Any]] = {}
            for bundle, decided in layers:
                # Cameras that were not fitted to a height have the same directions, from different
                # centers.
                film = bundle.shear, bundle.half_extent
                own = lines[film] = lines.get(film) or pixel_directions(bundle, rows)
                triangle, s = decided.device or (on_device(decided.triangle), on_device(decided.s))
                covers = triangle != NOTHING
                number = dr.select(covers, triangle, number)
                here = [
                    at + product(s, along)
                    for at, along in zip(constants(bundle.center), own, strict=True)
                ]
                position = [dr.select(covers, *both) for both in zip(here, position, strict=True)]
                direction = [
                    dr.select(covers, *both) for both in zip(own, direction or own, strict=True)
                ]
            return HogelImage(
                camera=camera,
                **self._looks(number, position, direction, points, (normals, colored)),
                certainty=certainty,
                tied_triangles=tied_triangles,
            )

    def by_direction(
        self,
        tile: PlateTile,
        pixel: tuple[int, int],
        layer: tuple[PixelLines, FirstSurfaces],
        *,
        normals: bool = True,
        colored: bool = True,
    ) -> DirectionImage:
        """Compose the image by direction of a pixel from its lines and their first surfaces."""
        lines, decided = layer
        width, height = lines.resolution
        points = (height, width, 3)
        if not len(self._scene.faces):
            return DirectionImage(
                tile=tile,
                pixel=pixel,
                triangle=np.full(points[:2], NOTHING, dtype=np.int32),
                position=np.full(points, np.nan),
                normal=np.full(points, np.nan) if normals else None,
                color=np.zeros(points, dtype=np.float32) if colored else None,
                certainty=decided.certainty,
                tied_triangles=decided.tied_triangles,
            )
        with recording():
            direction = pixel_directions(lines, range(height))
            triangle, s = decided.device or (on_device(decided.triangle), on_device(decided.s))
            lane = dr.arange(UInt32, width * height)
            row = UInt32(dr.floor((Float64(lane) + 0.5) / dr.opaque(Float64, width)))
            column = lane - row * dr.opaque(UInt32, width)
            x, y = on_device(lines.x), on_device(lines.y)
            # Add a zero that is not a literal: Dr.Jit would remove the sum with a literal zero, and
            # a product of -0.0 would keep its sign.
            (plate,) = constants((0.0,))
            apertures = dr.gather(Float64, x, column), dr.gather(Float64, y, row), plate
            position = [
                dr.select(triangle != NOTHING, at + product(s, along), np.nan)
                for at, along in zip(apertures, direction, strict=True)
            ]
            looks = self._looks(triangle, position, direction, points, (normals, colored))
        # The grid of lines has the order of the tile, or the reverse order if `step` is -1.
        turned = (slice(None, None, lines.step),) * 2
        tied = decided.tied_triangles.copy()
        if lines.step < 0:
            tied[:, :2] = [height - 1, width - 1] - tied[:, :2]
        return DirectionImage(
            tile=tile,
            pixel=pixel,
            triangle=looks["triangle"][turned],
            position=looks["position"][turned],
            normal=looks["normal"][turned] if normals else None,
            color=looks["color"][turned] if colored else None,
            certainty=decided.certainty[turned],
            tied_triangles=tied,
        )

    def _looks(
        self,
        number: Any,
        position: list[Any],
        direction: list[Any],
        points: tuple[int, int, int],
        chosen: tuple[bool, bool],
    ) -> dict[str, Any]:
        """Return the images of surfaces by name; the last parameter requests normals and color."""
        shape = points[:2]
        normals, colored = chosen
        covered, known = number != NOTHING, dr.maximum(number, 0)
        # Pixels without a surface look up triangle 0, and are masked afterwards.
        (of_triangle,) = self._objects(known)
        objects = dr.select(covered, of_triangle, NOTHING)
        normal = (
            [dr.select(covered, part, np.nan) for part in self._normals(known)] if normals else []
        )
        light: list[Any] = []
        if colored:
            channels = self._shader.model.radiance(known, position, direction)
            light = [Float32(dr.select(covered, part, 0.0)) for part in channels]
        # Evaluate all in one kernel: they share the positions of the points.
        dr.eval(number, objects, position, normal, light)
        return {
            "triangle": number.numpy().reshape(shape),
            "object": objects.numpy().reshape(shape),
            "position": interleaved(position, points),
            "normal": interleaved(normal, points) if normals else None,
            # Gray images have one channel.
            "color": interleaved(light if len(light) == 3 else light * 3, points)
            if colored
            else None,
        }


#: Number of points along each side of a pixel that represent its multisampling. The error for a
#: straight edge along the rows or columns of points is at most half a row, 1/16 of the pixel; for
#: other edges it is less.
BOX_SIDE = 8

#: pixels whose sums are held at once, which bounds memory: 24 bytes a pixel
AVERAGED_PIXELS = 1 << 22


def averages(sampling: Sampling) -> bool:
    """Return whether the color of a pixel is a mean over several points."""
    return sampling != Sampling()


def points_per_side(sampling: Sampling) -> int:
    """Return the number of color samples along each side of a pixel, also for multisampling."""
    return (
        sampling.supersample if sampling.multisample == 1 else max(sampling.supersample, BOX_SIDE)
    )


def mean_color(
    scene: Scene,
    triangles: Triangles,
    shader: Shader | ShadowedShader,
    apertures: Sequence[Aperture],
    side: int,
    rows: range,
) -> Floats:
    """Return mean linear RGB (rows, W, 3) over apertures and side x side points of each pixel."""
    width, height = scene.frustum.resolution
    total = np.zeros((len(rows), width, 3))
    for aperture in apertures:
        fine = replace(
            crossed_frustum(scene.frustum, aperture), resolution=(width * side, height * side)
        )
        certifier = Certifier(triangles, fine)
        for some in bands(width, rows, BAND_PIXELS // side**2):
            lines = range(some.start * side, some.stop * side)
            decided, directions = (
                certifier.decide(lines),
                fine.directions(slice(lines.start, lines.stop)),
            )
            position = np.asarray(fine.center) + decided.s[..., None] * directions
            color = shader.picture(decided.triangle, position, directions)
            # Sum row by row, so that the result does not depend on the division into bands.
            for row, line in zip(
                lines, color.reshape(len(lines), width, side, 3).sum(axis=2), strict=True
            ):
                total[row // side - rows.start] += line
    return total / (len(apertures) * side * side)


#: Number of independent estimates. Eight determine the standard error of a pixel to one part in
#: sqrt(2 (8 - 1)), and its root mean square over the pixels of a picture far better.
SCRAMBLINGS = 8

#: Initial number of points of each scrambling: with fewer, all estimates may miss an edge
FIRST_POINTS = 4

#: Default standard error, radiance: a quarter of an 8-bit step of full scale
TOLERANCE = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Converged:
    """Integral over an aperture, linear RGB (H, W, 3), its standard error and number of points."""

    color: Floats
    standard_error: Floats
    points: int

    @property
    def error(self) -> float:
        """Root mean square of the standard error over all pixels and channels."""
        return float(np.sqrt(np.mean(self.standard_error**2)))


def converged(
    mean: Callable[[Sequence[Aperture]], Floats],
    plate: Plate,
    aperture: Aperture,
    tolerance: float,
    seed: int = 0,
) -> Converged:
    """Double the number of points until the error is within the tolerance, in radiance.

    `mean` returns the picture (H, W, 3), averaged over some apertures; the aperture is as large as
    the plate's pitch. After `MAX_SAMPLES` points the picture is returned with the error reached.
    """
    engines = [
        scipy.stats.qmc.Sobol(2, rng=seed * SCRAMBLINGS + index) for index in range(SCRAMBLINGS)
    ]
    sums, count, more = [np.zeros(())] * SCRAMBLINGS, 0, FIRST_POINTS
    while True:
        # Doubling keeps all points so far, because a longer Sobol sequence begins with them.
        for index, engine in enumerate(engines):
            points = _spread(plate, aperture, engine.random(more))
            sums[index] = sums[index] + more * mean(points)
        count += more
        # The scatter of independent scramblings estimates the error of their mean.
        estimates = np.stack(sums) / count
        estimate = Converged(
            color=estimates.mean(axis=0),
            standard_error=estimates.std(axis=0, ddof=1) / np.sqrt(SCRAMBLINGS),
            points=count * SCRAMBLINGS,
        )
        if estimate.error <= tolerance or 2 * estimate.points > MAX_SAMPLES:
            return estimate
        more = count


def _spread(plate: Plate, aperture: Aperture, points: Floats) -> list[Aperture]:
    """Return apertures at points of the unit square, stretched over one hogel pitch."""
    (width, height), (columns, rows) = plate.size, plate.hogels
    return [
        replace(aperture, x=aperture.x + x * width / columns, y=aperture.y + y * height / rows)
        for x, y in (points - 0.5).tolist()
    ]
