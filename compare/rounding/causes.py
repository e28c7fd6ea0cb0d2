"""Classifier of the causes of wrong pixels: edge, order, lost, or unexplained.

A rasterizer rounds vertices and depths, and draws a surface only if its depth passes the test
against the clear value. At a pixel, a rasterized image may therefore show another triangle than
exact cameras show (docs/method.md, "The error budget"):

* edge: rounding may have moved an edge of one of the two triangles across the pixel's center.
  Clipping adds edges: cuts by the near plane and by the reach, the film's border, and seams. If
  only one of the two pictures shows a surface at the pixel and at all its neighbors, a snapped edge
  does not explain the difference;
* order: both triangles cover the pixel, and their stored depths differ by no more than the bound of
  the depth errors;
* lost: the stored depth of the expected surface differs from the clear value by no more than this
  bound, and the shown triangle covers the pixel.

A pixel with none of these causes is unexplained: one of the programs has a bug. The classifier does
not depend on settings or on models of renderers. Its input is cameras:
`xfrustum.compare.attribution` makes the cameras of our rasterizer, and
`xfrustum.compare.judging.judged` makes the cameras of other renderers.

**Images by direction** have one camera and no near offset. A drawn image by direction differs from
the truth only by rounding: vertices snap to subpixels in the plate's plane, and depth is quantized,
linearly in z for parallel lines. The cameras of `raster` are affine, or have their center in a
point of the screen. This module describes the same cameras by the lines of the reference.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.rounding.depth import depths
from xfrustum.compare.rounding.edges import (
    Placement,
    clipped,
    distance_to_border,
    distance_to_segments,
    placement,
    seams,
)
from xfrustum.compare.rounding.triangles import (
    PixelIndex,
    PixelTriangles,
    PlateFilm,
    Precision,
    RoundingCamera,
)
from xfrustum.raster.cameras import direction_pass
from xfrustum.reference import Reference
from xfrustum.reference.lines import RayBundle, TileLines
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.images import NOTHING, DirectionImage, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import DepthFormat, DepthMapping, Frustum, Plate, PlateTile
from xfrustum.scenes.representation import ShortRepr

HEADINGS = ("edge", "order", "lost", "unexplained")
"""Headings of `Causes`; pixels without a cause have the last one."""


class Surfaces(Protocol):
    """Triangles shown by an image, and their heights, which select the camera of each pixel."""

    @property
    def triangle(self) -> Numbers:
        """(H, W) triangle numbers, `NOTHING` at pixels without a surface."""

    @property
    def height(self) -> NDArray[Any] | None:
        """(H, W) heights above the plate; None in images of a single camera."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Causes(ShortRepr):
    """Pixels that show another triangle than expected, each under one heading.

    They are stored as a list, because wrong pixels are few.
    """

    shape: tuple[int, ...]  #: H, W
    pixels: Indices  #: (N,) flat numbers of the pixels
    heading: NDArray[np.int8]  #: (N,) place of each pixel's heading in `HEADINGS`

    @cached_property
    def masks(self) -> dict[str, Mask]:
        """The pixels under each heading, (H, W) masks that exclude each other."""
        return {
            name: scattered(self.shape, self.pixels, self.heading == place)
            for place, name in enumerate(HEADINGS)
        }

    @property
    def unexplained(self) -> Mask:
        """(H, W) pixels without a cause."""
        return self.masks["unexplained"]

    def counts(self) -> dict[str, int]:
        """Return the number of pixels under each heading."""
        numbers = np.bincount(self.heading, minlength=len(HEADINGS)).tolist()
        return dict(zip(HEADINGS, numbers, strict=True))

    def some(self, kept: Mask) -> Causes:
        """Return the causes of the pixels that a mask (N,) keeps."""
        return Causes(shape=self.shape, pixels=self.pixels[kept], heading=self.heading[kept])

    def joined(self, other: Causes) -> Causes:
        """Return the causes of these pixels and of the pixels of `other`."""
        return Causes(
            shape=self.shape,
            pixels=np.concatenate((self.pixels, other.pixels)),
            heading=np.concatenate((self.heading, other.heading)),
        )


def find_causes(
    triangles: Floats,
    cameras: Sequence[RoundingCamera],
    expected: Surfaces,
    shown: Surfaces,
    pixels: Indices,
    place: tuple[int, int] | None = None,
) -> Causes:
    """Find the cause of every wrong pixel.

    `pixels` (N,) are the flat numbers of the pixels at which the images differ; `place` is the
    column and row of all these pixels on the cameras' films, None if the images are films.
    `cameras` are all cameras that may have drawn the picture of `triangles` (F, 3, 3). `expected`
    is the picture without rounding, or with another depth buffer. Its ties need no special case,
    because tied triangles meet at an edge or have equal depths. `shown` may hold triangle numbers
    that the scene does not have.
    """
    shape = shown.triangle.shape
    if not len(pixels):
        return Causes(shape=shape, pixels=pixels, heading=np.zeros(0, dtype=np.int8))
    rows, columns = np.divmod(pixels, shape[1])
    images = (expected, shown)
    drawn = _drawn_by(triangles, cameras, images, pixels, place)
    before, after = _marks(drawn, cameras, images, pixels)
    edge = (before.near_edge | after.near_edge) & _beside_likeness(expected, shown, (columns, rows))
    edge |= before.near_moved | after.near_moved | _near_border(cameras, (columns, rows))
    # A depth test chooses only among triangles that cover the pixel. A center that lies inside a
    # triangle only after rounding is near an edge, and `edge` is its cause already.
    chosen = before.possible & after.possible & ~edge
    order, lost = np.zeros_like(edge), np.zeros_like(edge)
    if chosen.any():
        kept = drawn.some(np.flatnonzero(chosen[drawn.slots % len(chosen)]))
        first, second = depths(kept).at(kept.slots, (len(cameras), len(images), len(chosen)))
        order = np.asarray(first.indistinguishable_from(second).any(axis=0))
        lost = first.lost().any(axis=0) & ~order
    # With too small a near plane the far cut may run nearly anywhere, and seams are slow to
    # compute: far cuts and seams are tested only if nothing else explains the pixel.
    edge |= (before.near_cut | after.near_cut) & ~(order | lost)
    rest = np.flatnonzero(~(edge | order | lost))
    edge[rest] = _near_seam(triangles, cameras, images, (columns[rest], rows[rest]))
    # The marks exclude each other: a pixel without a mark gets the last heading.
    heading = np.full(len(pixels), HEADINGS.index("unexplained"), dtype=np.int8)
    for name, marked in (("edge", edge), ("order", order), ("lost", lost)):
        heading[marked] = HEADINGS.index(name)
    return Causes(shape=shape, pixels=pixels, heading=heading)


def misplaced_pixels(triangles: Floats, cameras: Sequence[RoundingCamera], shown: Surfaces) -> Mask:
    """Return the pixels (H, W) whose centers lie outside their triangles by more than rounding."""
    where: Mask = np.not_equal(shown.triangle, NOTHING)
    pixels = np.flatnonzero(where)
    drawn = _drawn_by(triangles, cameras, (shown,), pixels)
    (marks,) = _marks(drawn, cameras, (shown,), pixels)
    return scattered(where.shape, pixels, ~marks.possible)


def _drawn_by(
    triangles: Floats,
    cameras: Sequence[RoundingCamera],
    images: Sequence[Surfaces],
    pixels: Indices,
    place: tuple[int, int] | None = None,
) -> PixelTriangles:
    """Return the triangles at pixels (N,) that each camera may have drawn.

    At a cut, both cameras may have drawn a pixel. The result is one set of slots in an array
    (cameras, images, N), because per-call overhead dominates for small arrays.
    """
    number = np.concatenate([image.triangle.reshape(-1).take(pixels) for image in images])
    rows, columns = np.divmod(np.tile(pixels, len(images)), images[0].triangle.shape[1])
    exists = (number != NOTHING) & (number < len(triangles))
    # Heights are compared in the precision in which each image stores them.
    may_draw = np.concatenate(
        [camera.may_draw(image.height, pixels) for camera in cameras for image in images]
    )
    slots = np.flatnonzero(may_draw & np.tile(exists, len(cameras)))
    if place is not None:
        columns, rows = np.full_like(columns, place[0]), np.full_like(rows, place[1])
    # pyrefly: ignore [bad-argument-type] - indices of 32 bits serve as well, without a copy
    return PixelTriangles.from_pixels(triangles, cameras, number, (columns, rows), slots)


def _marks(
    drawn: PixelTriangles,
    cameras: Sequence[RoundingCamera],
    images: Sequence[Surfaces],
    pixels: Indices,
) -> list[Placement]:
    """Return the placements in each image at pixels (N,); empty pixels are always `possible`."""
    marks = np.zeros((4, len(cameras), len(images), len(pixels)), dtype=np.bool_)
    if len(drawn.slots):
        marks.reshape(4, -1)[:, drawn.slots] = placement(drawn)
    marks[0] |= [image.triangle.reshape(-1).take(pixels) == NOTHING for image in images]
    return [Placement(*of_image) for of_image in np.moveaxis(np.asarray(marks.any(axis=1)), 1, 0)]


def _beside_likeness(expected: Surfaces, shown: Surfaces, pixels: PixelIndex) -> Mask:
    """Return pixels (N,) at or beside which both images are covered, or both are empty."""
    (columns, rows), around = pixels, np.arange(3)
    alike = np.pad((expected.triangle == NOTHING) == (shown.triangle == NOTHING), 1)
    near = alike[rows[:, None, None] + around[:, None], columns[:, None, None] + around]
    return np.asarray(near.any(axis=(1, 2)))


def _near_border(cameras: Sequence[RoundingCamera], pixels: PixelIndex) -> Mask:
    """Return the pixels (N,) with sampling points on the film's border, where clipping cuts.

    Only the outermost pixels can have such points, if sampling is shifted by half a pixel.
    """
    near = np.zeros(len(pixels[0]), dtype=np.bool_)
    for camera in cameras:
        if camera.film_shift is not None:
            points = _sampled(pixels, camera.film_shift)
            near |= distance_to_border(points, camera.bundle.resolution) <= camera.precision.snap_px
    return near


def _near_seam(
    triangles: Floats,
    cameras: Sequence[RoundingCamera],
    images: Sequence[Surfaces],
    pixels: PixelIndex,
) -> Mask:
    """Return the pixels (N,) with sampling points on a seam of a triangle of either image."""
    columns, rows = pixels
    near = np.zeros(len(rows), dtype=np.bool_)
    for camera in cameras:
        if camera.film_shift is None:
            continue
        assert isinstance(camera.bundle, RayBundle), "the plate is a film without borders"
        points = _sampled(pixels, camera.film_shift)
        for image in images:
            shown = image.triangle[rows, columns]
            numbers = np.unique(shown[(shown != NOTHING) & (shown < len(triangles))])
            cut = clipped(triangles[numbers], camera.bundle, camera.film_shift)
            for number in numbers[cut].tolist():
                here = shown == number
                split = seams(triangles[number], camera.bundle, camera.film_shift)
                near[here] |= distance_to_segments(points[here], split) <= camera.precision.snap_px
    return near


def _sampled(pixels: PixelIndex, shift: tuple[float, float]) -> Floats:
    """Return sampling points of pixels, (N, 2) in pixels from the film's left and upper border."""
    columns, rows = pixels
    return np.stack((columns + 0.5 + shift[0], rows + 0.5 + shift[1]), axis=1, dtype=np.float64)


def scattered(shape: tuple[int, ...], pixels: Indices, values: Mask | bool = True) -> Mask:
    """Return a mask of a shape, with values (N,) at pixels that are given by flat numbers."""
    mask = np.zeros(shape, dtype=np.bool_)
    mask.reshape(-1)[pixels] = values
    return mask


#: number of pixels that are explained together, each by its own camera
PIXELS_AT_ONCE = 64

Pixel = tuple[int, int]  #: column and row, of a pixel in its hogel or of a hogel on the plate


@dataclass(frozen=True, kw_only=True)
class _Shown:
    """Triangles (rows, columns) of an image by direction; one camera needs no heights."""

    triangle: Numbers
    height: None = None


def direction_camera(
    scene: Scene, tile: PlateTile, pixel: Pixel, precision: Precision
) -> RoundingCamera:
    """Return the camera that draws a pixel (column, row) of every hogel in a tile.

    The truth has the same lines. For a camera in a point of the screen, the rasterizer sets the
    distances of the near and far plane from this point.
    """
    lines = _tile_lines(scene.frustum, tile).of_pixel(pixel)
    planes = direction_pass(scene, tile, pixel).planes
    return RoundingCamera(bundle=PlateFilm.from_lines(lines, planes), precision=precision)


@lru_cache(maxsize=4)
def _tile_lines(frustum: Frustum, tile: PlateTile) -> TileLines:
    """Return the lines of a tile, with a cache, because neighboring hogels are in one tile."""
    return TileLines(frustum, tile)


def explain_direction(
    scene: Scene, truth: DirectionImage, triangle: Numbers, device: DeviceModel, depth: DepthFormat
) -> Causes:
    """Find the cause of every pixel at which the drawn triangle differs from the true triangle.

    `triangle` (rows, columns) is an image of `raster.plate.directions` with a depth buffer of the
    format `depth`.
    """
    camera = direction_camera(scene, truth.tile, truth.pixel, _precision(device, depth))
    pixels = np.flatnonzero(truth.triangle != triangle)
    expected, shown = _Shown(triangle=truth.triangle), _Shown(triangle=triangle)
    return find_causes(scene.triangles, [camera], expected, shown, pixels)


def _precision(device: DeviceModel, depth: DepthFormat) -> Precision:
    return Precision(device=device, depth=depth, mapping=DepthMapping.STANDARD)


@dataclass(frozen=True, kw_only=True, eq=False)
class DirectionPlate:
    """Stored plate that was drawn by directions."""

    #: format of the depth buffer
    depth: DepthFormat
    #: columns and rows of hogels of a tile, fewer at the ends of the plate
    tile: tuple[int, int]
    #: function that returns the stored triangles (rows, columns) of one pixel in a tile of hogels
    shown: Callable[[PlateTile, Pixel], Numbers]

    def explain(
        self,
        reference: Reference,
        device: DeviceModel,
        images: tuple[HogelImage, HogelImage],
        pixels: Indices,
    ) -> Causes:
        """Find the cause of each wrong pixel (N,) of a hogel, with the camera of its direction.

        `images` are the true and the stored image. The film of a camera is the whole tile that was
        drawn. Only the hogel and its neighbors are compared.
        """
        scene, index = reference.scene, images[0].camera.aperture.index
        tile, precision = self._tile_of(scene.plate, index), _precision(device, self.depth)
        place = index[0] - tile.columns[0], index[1] - tile.rows[0]
        true, drawn = (image.triangle.reshape(-1)[pixels] for image in images)
        heading = np.zeros(len(pixels), dtype=np.int8)
        for start in range(0, len(pixels), PIXELS_AT_ONCE):
            part = slice(start, start + PIXELS_AT_ONCE)
            cameras = [
                replace(
                    direction_camera(scene, tile, _pixel(scene, number), precision), pixel=2 * k
                )
                for k, number in enumerate(pixels[part].tolist())
            ]
            # An empty pixel follows each pixel in both images, so that all pixels pass
            # `_beside_likeness`.
            expected, shown = (
                _Shown(
                    triangle=np.stack((some, np.full_like(some, NOTHING)), axis=1).reshape(1, -1)
                )
                for some in (true[part], drawn[part])
            )
            own = 2 * np.arange(len(cameras))
            causes = find_causes(scene.triangles, cameras, expected, shown, own, place)
            heading[part] = causes.heading
        # If only one image is covered, an edge is the cause only if the hogel or a neighbor is
        # covered in both images, or empty in both: find the cause again, with the neighbors.
        edge = (heading == HEADINGS.index("edge")) & ((true == NOTHING) != (drawn == NOTHING))
        for number in np.flatnonzero(edge).tolist():
            pixel = _pixel(scene, int(pixels[number]))
            camera = direction_camera(scene, tile, pixel, precision)
            heading[number] = self._beside_others(reference, camera, (tile, index, pixel))
        return Causes(shape=images[0].triangle.shape, pixels=pixels, heading=heading)

    def _beside_others(
        self, reference: Reference, camera: RoundingCamera, where: tuple[PlateTile, Pixel, Pixel]
    ) -> int:
        """Return the heading of a hogel's pixel, from images of the hogel and its neighbors."""
        tile, index, pixel = where
        part = _cut(tile, index)
        (view,) = reference.by_directions(part, [pixel], normals=False, colored=False)
        expected = _Shown(triangle=view.triangle)
        shown = _Shown(triangle=self.shown(part, pixel))
        here = part.rows.index(index[1]) * len(part.columns) + part.columns.index(index[0])
        place = index[0] - tile.columns[0], index[1] - tile.rows[0]
        triangles = reference.scene.triangles
        causes = find_causes(triangles, [camera], expected, shown, np.array([here]), place)
        return int(causes.heading[0])

    def _tile_of(self, plate: Plate, index: Pixel) -> PlateTile:
        """Return the tile of a hogel (column, row)."""
        columns, rows = (
            range(first := at // side * side, min(first + side, count))
            for at, side, count in zip(index, self.tile, plate.hogels, strict=True)
        )
        return PlateTile(plate=plate, columns=columns, rows=rows)


def _pixel(scene: Scene, number: int) -> Pixel:
    """Return the column and row of a pixel by its flat number."""
    row, column = divmod(number, scene.frustum.resolution[0])
    return column, row


def _cut(tile: PlateTile, index: Pixel) -> PlateTile:
    """Return the part of a tile with a hogel (column, row) and its neighbors."""
    columns, rows = (
        range(max(at - 1, cells.start), min(at + 2, cells.stop))
        for at, cells in zip(index, (tile.columns, tile.rows), strict=True)
    )
    return PlateTile(plate=tile.plate, columns=columns, rows=rows)
