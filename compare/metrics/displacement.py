"""Displacement: how far the picture moved, pixel by pixel (docs/method.md, "What is compared")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.rounding.positions import position_tolerance
from xfrustum.reference import SurfacePoints
from xfrustum.reference.lines.lines import Pencil, pixel_places, places_off_center
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING, HogelCamera, HogelImage
from xfrustum.scenes.model.scene import Scene


@dataclass(frozen=True, kw_only=True)
class Spread:
    """How a quantity in pixels is distributed over an image."""

    rms: float
    p50: float
    p95: float
    p99: float
    max: float

    @classmethod
    def of(cls, values: Floats) -> Spread | None:
        """Return the spread of values of any shape, None where there are no values."""
        if values.size == 0:
            return None
        with np.errstate(invalid="ignore"):
            p50, p95, p99 = np.percentile(values, (50, 95, 99)).tolist()
        return cls(rms=root_mean_square(values), p50=p50, p95=p95, p99=p99, max=float(values.max()))


def root_mean_square(values: Floats) -> float:
    """Return the root mean square of values of any shape, of which there is at least one."""
    largest = float(np.abs(values).max())
    if not 0 < largest < np.inf:
        return largest
    # Values are scaled first: near the plate the squares of displacements may overflow.
    return largest * float(np.sqrt(np.mean(np.square(values / largest))))


def shifts_at(raster: HogelImage, camera: HogelCamera, pixels: Indices) -> Floats:
    """Return the displacement at some pixels.

    Parameters
    ----------
    pixels
        (N,) flat numbers of pixels that show a surface off the plate.

    Returns
    -------
    (2, N) columns and rows by which the true place of each pixel's surface point lies off the pixel's center.
    """
    columns, rows = DrawnPoints.of(raster, pixels).places(true_lines(camera))
    row = pixels // camera.resolution[0]
    return np.stack((columns - (pixels - row * camera.resolution[0]), rows - row))


def film_shifts(raster: HogelImage, camera: HogelCamera) -> Floats:
    """Return the displacement of all pixels, (2, H W): `displacement`, coordinate by coordinate."""
    found = np.full((2, raster.triangle.size), np.nan)
    pixels = np.flatnonzero(raster.off_plate)
    found[:, pixels] = shifts_at(raster, camera, pixels)
    return found


def displacement(raster: HogelImage, camera: HogelCamera) -> Floats:
    """Return the place where each pixel's surface point belongs, minus the place where it was drawn.

    No optical flow is needed: the image says which surface point it shows, and the true frustum
    says where that point belongs.

    Returns
    -------
    (H, W, 2) columns and rows in pixels, rows counting down; NaN where no surface is shown and
    where it lies in the plate.
    """
    return np.moveaxis(film_shifts(raster, camera).reshape(2, *raster.triangle.shape), 0, -1)


def lengths(shift: Floats) -> Floats:
    """Return the lengths (...) of vectors (..., 2)."""
    return np.hypot(shift[..., 0], shift[..., 1])


def true_pixel(points: NDArray[np.floating], camera: HogelCamera) -> Floats:
    """Project surface points through the true frustum of an aperture.

    Parameters
    ----------
    points
        (..., 3) scene units.

    Returns
    -------
    (..., 2) column and row, where a pixel's center has whole numbers and rows count down; NaN for
    points in the plane of the plate, which have no place on the film.
    """
    return pixel_places(points, true_lines(camera))


def true_lines(camera: HogelCamera) -> Pencil:
    """Return the lines of the true frustum of the aperture that an image's camera names."""
    return Pencil(
        center=(camera.aperture.x, camera.aperture.y, 0.0),
        shear=camera.shear,
        half_extent=camera.half_extent,
        resolution=camera.resolution,
        s_range=(-camera.reach[0], camera.reach[1]),
    )


def pixel_centers(camera: HogelCamera) -> Floats:
    """Return column and row of every pixel, (H, W, 2)."""
    width, height = camera.resolution
    centers = np.empty((height, width, 2))
    centers[..., 0], centers[..., 1] = np.arange(width), np.arange(height)[:, None]
    return centers


def existing_triangles(numbers: Numbers, scene: Scene) -> Numbers:
    """Return triangle numbers of any shape; `NOTHING` where a number is not one of the scene's."""
    return np.where((numbers >= 0) & (numbers < len(scene.faces)), numbers, np.int32(NOTHING))


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnPoints:
    """Surface points that some pixels of an image show, coordinate by coordinate.

    Attributes
    ----------
    pixels
        (N,) flat numbers of the pixels.
    coordinates
        (3, N) x, y and z of the points in scene units.
    triangle
        (N,) triangle numbers, as the image has them.
    """

    pixels: Indices
    coordinates: Floats
    triangle: Numbers

    @classmethod
    def of(cls, image: HogelImage, pixels: Indices) -> DrawnPoints:
        """Return the points that an image shows at some pixels, given by their flat numbers (N,)."""
        return cls(
            pixels=pixels,
            coordinates=np.stack(
                [image.position[..., axis].reshape(-1)[pixels] for axis in range(3)], dtype=np.float64
            ),
            triangle=image.triangle.reshape(-1)[pixels],
        )

    def at(self, some: Indices) -> DrawnPoints:
        """Return some of the points, given by their places (M,) among these."""
        return DrawnPoints(
            pixels=self.pixels.take(some),
            coordinates=self.coordinates.take(some, axis=1),
            triangle=self.triangle.take(some),
        )

    def places(self, pencil: Pencil) -> tuple[Floats, Floats]:
        """Return column and row (N,) at which a pencil's film shows each point; see `pixel_places`."""
        x, y, z = self.coordinates
        return places_off_center(x, y, z, pencil)

    def surface_points(self, scene: Scene) -> SurfacePoints:
        """Return the points with how exactly they are known."""
        position, number = self.coordinates.T, existing_triangles(self.triangle, scene)
        return SurfacePoints(
            position=position, triangle=number, tolerance=position_tolerance(scene, number, position)
        )


def beyond_film(points: DrawnPoints, places: tuple[Floats, Floats], pencil: Pencil, scene: Scene) -> Mask:
    """Return which points (N,) belong outside a pencil's film, however they were rounded.

    A point that is known to within a tolerance is known on the film to within that over w t, with w its depth
    from the center of the lines: |z| for the true frustum.

    Parameters
    ----------
    places
        Columns and rows (N,) at which the film shows them.
    """
    sides = np.asarray(pencil.resolution, dtype=np.float64)
    outside = np.zeros(len(points.pixels), dtype=np.bool_)
    for place, side in zip(places, sides, strict=True):
        outside |= (place < -0.5) | (place > side - 0.5)
    # Few points lie there: only these are asked how exactly they are known.
    some = np.flatnonzero(outside)
    asked = points.at(some)
    tolerance = asked.surface_points(scene).tolerance
    per_length = sides / (2 * np.asarray(pencil.half_extent))
    depth = np.abs(asked.coordinates[2] - pencil.center[2])
    beyond = np.zeros(len(some), dtype=np.bool_)
    for place, side, share in zip(places, sides, per_length, strict=True):
        known_to = tolerance * share / depth
        beyond |= (place[some] < -0.5 - known_to) | (place[some] > side - 0.5 + known_to)
    outside[some] = beyond
    return outside
