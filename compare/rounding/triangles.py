"""Cameras of a rasterizer, triangles on their films, and the pixels that show them.

Drawn surface points are in float32, with the error bounds stated here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.lines import PixelLines, RayBundle, cross_products
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.images import NOTHING
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import DepthFormat, DepthMapping

POSITION_ROUNDINGS = 16
"""Roundings of 2^-24 of a triangle's largest coordinate L in a drawn surface point.

Our own rasterizer computes the point in double precision and rounds x and z once each. Seen from an
aperture a, these are 1 + |x - a| / L roundings: 2 to 4 for usual plates and objects. Renderers that
interpolate the point as a varying need 16.

The stored vertex has one rounding. Perspective interpolation computes sum(b_i
p_i / w_i) / sum(b_i / w_i) from plane equations. Numerator and denominator each have one rounding
for a product p_i / w_i, two for the two gradients, and four for the steps along x and y. The
quotient has one: 1 + 2 (1 + 2 + 4) + 1 = 16.
"""

FLOAT32_ROUNDING = 2.0**-24

POSITION_TOLERANCE = POSITION_ROUNDINGS * FLOAT32_ROUNDING
"""Error bound of a drawn point, relative to the largest coordinate of its triangle."""


def position_tolerance(scene: Scene, triangle: Numbers, position: Floats) -> Floats:
    """Return the error bounds (N,) of drawn surface points (N, 3), scene units.

    `triangle` (N,) are the triangles of the points. Where it is `NOTHING`, the bound uses the
    coordinates of the point itself in place of its triangle's.
    """
    known = triangle != NOTHING
    if known.all():
        return POSITION_TOLERANCE * scene.largest_coordinates[triangle]
    largest: Floats = np.abs(position).max(axis=1, initial=0.0)
    largest[known] = scene.largest_coordinates[triangle[known]]
    return POSITION_TOLERANCE * largest


def largest_tolerance(scene: Scene) -> float:
    """Return the largest `position_tolerance` of a point on a scene's triangles, scene units."""
    return float(POSITION_TOLERANCE * scene.largest_coordinates.max(initial=0.0))


@dataclass(frozen=True, kw_only=True)
class Precision:
    """Precision with which a device draws."""

    device: DeviceModel
    depth: DepthFormat
    mapping: DepthMapping

    @property
    def snap_px(self) -> float:
        """Largest distance of a vertex from the nearest subpixel: half a step along each axis."""
        return math.sqrt(2) / 2 * 2 * self.device.half_step


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateFilm:
    """Exact camera with the lines of one pixel of every hogel in a tile; the tile is its film.

    Parallel lines have the homogeneous coordinate w = 1, and s = -z is linear on the film; lines
    through a point of the screen have w = s, and 1 / s is linear on it.
    """

    #: (3, 4) homogeneous film coordinates (x, y, w) of scene points (x, y, z, 1)
    film_from_scene: Floats
    resolution: tuple[int, int]  #: columns and rows of hogels
    #: Signed ends of s, as in `RayBundle`; for lines through a point, at the near and far plane
    s_range: tuple[float, float]
    parallel: bool

    @classmethod
    def from_lines(cls, lines: PixelLines, planes: tuple[float, float]) -> PlateFilm:
        """Return the camera of lines; `planes` are the distances of its near and far plane.

        The line through a on the plate and the screen's point M passes through p at s = M_z - p_z.
        There the line is M + (a - M) s / M_z, so that s a = M_z (p - M) + s M in x and y. Parallel
        lines have a = p + z d, and near and far planes at the ends of the reach.
        """
        matrix = np.zeros((3, 4))
        for axis, (at, slope) in enumerate(((lines.x, lines.dx), (lines.y, lines.dy))):
            middle, half = (at[0] + at[-1]) / 2, len(at) * lines.pitch[axis] / 2
            if lines.center is None:
                across, along, rest = 1.0, slope[0], -middle
            else:
                across = lines.center[2]
                along, rest = middle - lines.center[axis], -across * middle
            matrix[axis, [axis, 2, 3]] = across / half, along / half, rest / half
        if lines.center is None:
            matrix[2, 3], ends = 1.0, lines.s_range
        else:
            matrix[2, 2:] = -1.0, lines.center[2]
            near, far = planes
            ends = (near, far) if lines.center[2] > 0 else (-far, -near)
        return cls(
            film_from_scene=matrix,
            resolution=lines.resolution,
            s_range=ends,
            parallel=lines.center is None,
        )


@dataclass(frozen=True, kw_only=True)
class RoundingCamera:
    """One camera of a renderer with rounding errors."""

    #: Exact lines of the camera, through the sampling points of the pixels. The ends of `s_range`
    #: are its near and far plane.
    bundle: RayBundle | PlateFilm
    precision: Precision
    #: Lowest and highest z of the surfaces that the camera draws; None for images without heights,
    #: in which this camera may have drawn any surface
    heights: tuple[float, float] | None = None
    #: Offset of the sampling points from the pixel centers, columns and rows, for a camera that may
    #: clip triangles at the borders of its film; None for a camera that does not clip there
    film_shift: tuple[float, float] | None = None
    #: flat number of the only pixel that the camera draws; None for a camera of whole images
    pixel: int | None = None

    def may_draw(self, height: NDArray[Any] | None, pixels: Indices) -> Mask:
        """Return the pixels (N,) that the camera may have drawn, by image heights (H, W)."""
        if self.pixel is not None:
            return np.asarray(pixels == self.pixel)
        if self.heights is None:
            return np.ones(len(pixels), dtype=np.bool_)
        assert height is not None, "several cameras draw by heights"
        # `take` would copy the whole array of heights, which is not contiguous.
        at, (low, high) = height.reshape(-1)[pixels], self.heights
        return np.asarray((at >= low) & (at <= high))


PixelIndex = tuple[Indices, Indices]  #: columns and rows of some pixels, (N,) each

NEXT, AFTER_NEXT = (1, 2, 0), (2, 0, 1)
"""For each of three corners or coordinates, the index of the next, and of the next but one."""

CLIPPED_VERTEX_ROUNDINGS = 16
"""Error bound of a float32 clip coordinate, in roundings of 2^-24 of its sum of absolute terms.

One is in the stored vertex, one in the matrix entry, four in products and sums: 6. Clipping at up
to three planes (near and two sides) makes new vertices with three more for each plane: 9. The
last is a reserve.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class FilmTriangles:
    """Triangles on the films of cameras with equal precision, one camera after the other."""

    precision: Precision
    resolution: tuple[int, int]  #: W, H of the films in pixels
    #: (2, T) ends of `s_range` of each triangle's camera, its near and far plane; negative for C*
    ends: Floats
    #: vertices, bound: (T, 3, 3) homogeneous film coordinates (x, y, s) of the corners, and their
    #: float32 error bounds. u = x / s and v = y / s on the film; s is the distance from the center
    #: along the axis, negative for C*. Parallel lines have 1 in place of s.
    vertices: Floats
    bound: Floats
    #: (2, T, 3) s of the corners on parallel lines, and its float32 error bounds; else None
    along: Floats | None = None

    @classmethod
    def from_corners(
        cls, corners: Floats, cameras: Sequence[RoundingCamera], drawn_by: Indices
    ) -> FilmTriangles:
        """Project corners (T, 3, 3); `drawn_by` (T,) is the index of each triangle's camera."""
        assert len({(camera.precision, camera.bundle.resolution) for camera in cameras}) == 1
        bundles = [camera.bundle for camera in cameras if isinstance(camera.bundle, RayBundle)]
        if not bundles:
            return cls._on_plate(corners, cameras, drawn_by)

        def of_each(values: Sequence[Sequence[float]]) -> Floats:
            return np.array(values).take(drawn_by, axis=0)[:, None, :]

        center = of_each([bundle.center for bundle in bundles])
        shear, half = (
            of_each([getattr(bundle, name) for bundle in bundles])
            for name in ("shear", "half_extent")
        )
        relative = corners - center
        s = -relative[..., 2:]
        lateral = (relative[..., :2] - shear * s) / half
        # Absolute values of the terms that the transform adds, without cancellation.
        terms = np.abs(corners[..., :2]) + np.abs(center[..., :2]) + np.abs(shear * s)
        bound = np.concatenate(
            (terms / half, np.abs(corners[..., 2:]) + np.abs(center[..., 2:])), axis=-1
        )
        return cls(
            precision=cameras[0].precision,
            resolution=bundles[0].resolution,
            ends=np.array([bundle.s_range for bundle in bundles]).T.take(drawn_by, axis=1),
            vertices=np.concatenate((lateral, s), axis=-1),
            bound=CLIPPED_VERTEX_ROUNDINGS * FLOAT32_ROUNDING * bound,
        )

    @classmethod
    def _on_plate(
        cls, corners: Floats, cameras: Sequence[RoundingCamera], drawn_by: Indices
    ) -> FilmTriangles:
        """Project corners (T, 3, 3) onto the plate, the film of all cameras."""
        films = [camera.bundle for camera in cameras if isinstance(camera.bundle, PlateFilm)]
        matrix = np.stack([film.film_from_scene.T for film in films]).take(drawn_by, axis=0)
        ends = np.array([film.s_range for film in films]).take(drawn_by, axis=0)
        points = np.concatenate((corners, np.ones((*corners.shape[:2], 1))), axis=-1)
        rounding = CLIPPED_VERTEX_ROUNDINGS * FLOAT32_ROUNDING
        z, along = corners[..., 2], None
        if films[0].parallel:
            # Clip depth is (first - z) / reach: float32 rounds each of the two terms.
            along = np.stack((-z, rounding * (np.abs(z) + np.abs(ends[:, :1]))))
        return cls(
            precision=cameras[0].precision,
            resolution=films[0].resolution,
            ends=ends.T,
            vertices=points @ matrix,
            bound=rounding * (np.abs(points) @ np.abs(matrix)),
            along=along,
        )

    @cached_property
    def orthoscopic(self) -> Mask:
        """(T,) mask of triangles drawn by C or by parallel lines; False for C*."""
        return np.asarray((self.ends[0] > 0) | (self.along is not None))

    @cached_property
    def planes(self) -> tuple[Floats, Floats]:
        """(T,) distances of the near and far plane from each triangle's camera.

        Parallel lines have no camera center: their planes are given by signed s from the plate.
        """
        near, far = self.ends if self.along is not None else np.sort(np.abs(self.ends), axis=0)
        return near, far

    @cached_property
    def lines(self) -> Floats:
        """(3, T, 3) edges as linear functions of (u, v, 1), from each corner to the next one."""
        following = self.vertices.take(NEXT, axis=1)
        edges = cross_products(self.vertices.reshape(-1, 3), following.reshape(-1, 3))
        return np.ascontiguousarray(edges.reshape(-1, 3, 3).transpose(1, 0, 2))

    @cached_property
    def plane(self) -> Floats:
        """(T, 3) sums of the edges; on the triangle, 1 / s = plane . (u, v, 1) / volume."""
        first, second, third = self.lines
        return np.asarray(first + second + third)

    @cached_property
    def volume(self) -> Floats:
        """(T,) determinants of the vertices."""
        return np.asarray(np.einsum("ij,ij->i", self.vertices[:, 0], self.lines[1]))


@dataclass(frozen=True, kw_only=True, eq=False)
class PixelTriangles:
    """One triangle at each of some pixels; each triangle is projected once."""

    film: FilmTriangles  #: the triangles, projected for each camera that may have drawn them
    which: Indices  #: (N,) index in `film` of each pixel's triangle
    points: Floats  #: (N, 3) centers of the pixels, (u, v, 1)
    slots: Indices  #: (N,) places of the pixels in an array with the pixels of all cameras

    @classmethod
    def from_pixels(
        cls,
        triangles: Floats,
        cameras: Sequence[RoundingCamera],
        number: Indices,
        pixels: PixelIndex,
        slots: Indices,
    ) -> PixelTriangles:
        """Select the triangles of a scene (F, 3, 3) that each camera may have drawn.

        `number` (P,) are triangle numbers, and `pixels` (P,) are the pixels that show them. `slots`
        (N,) are the selected pairs: k P + p is pixel p drawn by camera k. Every selected triangle
        exists in the scene.
        """
        camera, place = np.divmod(slots, max(len(number), 1))
        drawn = camera * len(triangles) + number.take(place)
        distinct, which = np.unique(drawn, return_inverse=True)
        drawn_by, chosen = np.divmod(distinct, len(triangles))
        return cls(
            film=FilmTriangles.from_corners(triangles[chosen], cameras, drawn_by),
            which=which,
            points=film_points(cameras[0].bundle.resolution, pixels).take(place, axis=0),
            slots=slots,
        )

    def some(self, kept: Indices) -> PixelTriangles:
        """Return the pixels at indices (M,)."""
        return replace(
            self,
            which=self.which[kept],
            points=self.points.take(kept, axis=0),
            slots=self.slots[kept],
        )

    def each(self, values: Floats) -> Floats:
        """Return the value (..., N) of each pixel's triangle, from values (..., T) of triangles."""
        return values.take(self.which, axis=-1)

    def linear_at(self, functions: Floats, points: Floats) -> Floats:
        """Return linear functions (K, T, 3) of the triangles at points (u, v, 1), (K, N)."""
        taken = (function.take(self.which, axis=0) for function in functions)
        return np.stack([np.einsum("ij,ij->i", function, points) for function in taken])


def film_points(resolution: tuple[int, int], pixels: PixelIndex) -> Floats:
    """Return (u, v, 1) of pixel centers, (N, 3)."""
    width, height = resolution
    columns, rows = pixels
    u, v = (2 * columns + 1) / width - 1, 1 - (2 * rows + 1) / height
    return np.stack((u, v, np.ones(len(u))), axis=-1)
