"""Errors of each pixel: displacement, surface, triangle and height (docs/method.md).

A pixel can be wrong in three ways. It shows a surface where there is none, no surface where there
is one, or another object (`other_surfaces`); or the point that it shows belongs outside the film
(`outside_film`); or the point is hidden behind another surface (`hidden_pixels`). In
`surface_errors`, film and lines belong to the true frustum; in `xfrustum.compare.judging.judged`,
they belong to another renderer's cameras.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from xfrustum.compare.rounding.triangles import (
    POSITION_TOLERANCE,
    largest_tolerance,
    position_tolerance,
)
from xfrustum.reference import Reference, SurfacePoints
from xfrustum.reference.lines import RayBundle, places_off_center
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.images import NOTHING, Certainty, HogelCamera, HogelImage, SurfaceImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Cull
from xfrustum.scenes.representation import ShortRepr

#: function that returns a mask (N,) of occluded points
Occluded = Callable[[SurfacePoints], Mask]
FLOATING_SHARE, FLOATING_DOUBTS = 0.01, 10
"""Distance in front of a surface beyond which a point floats: a share of its depth.

Storage coarser than float32 moves points along their lines off slanted surfaces. A multiple of its
rounding is added."""
SNAPPED_PX = (
    0.25  #: bound on the displacement of an edge by snapping, pixels; 0.05 with 4 subpixel bits
)
Places = tuple[Floats, Floats]
"""Columns and rows (N,) of points on a film; centers of pixels are integers, rows count down."""


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Distribution of a quantity in pixels over an image."""

    rms: float
    p50: float
    p95: float
    p99: float
    max: float

    @classmethod
    def from_values(cls, values: Floats) -> Spread | None:
        """Return the spread of values of any shape, None if there are no values."""
        if values.size == 0:
            return None
        with np.errstate(invalid="ignore"):
            p50, p95, p99 = np.percentile(values, (50, 95, 99)).tolist()
        return cls(rms=root_mean_square(values), p50=p50, p95=p95, p99=p99, max=float(values.max()))


@dataclass(frozen=True, kw_only=True)
class HeightError:
    """Magnitude of raster minus true height, scene units, where both show the same triangle."""

    rms: float
    max: float


def root_mean_square(values: Floats) -> float:
    """Return the root mean square of at least one value; any shape."""
    largest = float(np.abs(values).max())
    # Values are scaled first: near the plate the squares of displacements may overflow.
    return (
        largest * float(np.sqrt(np.mean(np.square(values / largest))))
        if 0 < largest < np.inf
        else largest
    )


# Points and their places
# ---------------------------------------------------------------------------------


def true_lines(camera: HogelCamera) -> RayBundle:
    """Return the true frustum's lines through the aperture of an image's camera."""
    return RayBundle(
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
    """Return triangle numbers of any shape, `NOTHING` in place of numbers beyond the scene's."""
    return np.where((numbers >= 0) & (numbers < len(scene.faces)), numbers, np.int32(NOTHING))


def lengths(shift: Floats) -> Floats:
    """Return the lengths (...) of vectors (..., 2)."""
    return np.hypot(shift[..., 0], shift[..., 1])


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnPoints:
    """Surface points that some pixels of an image show, as a structure of arrays."""

    #: (N,) flat numbers
    pixels: Indices
    #: (3, N) scene units
    coordinates: Floats
    #: (N,) triangle numbers of the image
    triangle: Numbers
    #: (N, 3) error bounds of the stored coordinates; None for storage as float32
    doubt: Floats | None = None

    @classmethod
    def from_image(cls, image: SurfaceImage, pixels: Indices) -> DrawnPoints:
        """Return the points at some pixels of an image, given by their flat numbers (N,)."""
        axes = [image.position[..., axis].reshape(-1)[pixels] for axis in range(3)]
        triangle = image.triangle.reshape(-1)[pixels]
        coordinates = np.stack(axes, dtype=np.float64)
        doubt = None if image.uncertainty is None else image.uncertainty.reshape(-1, 3)[pixels]
        return cls(pixels=pixels, coordinates=coordinates, triangle=triangle, doubt=doubt)

    def at(self, some: Indices) -> DrawnPoints:
        """Return some of the points, given by their indices (M,)."""
        coordinates, triangle = self.coordinates.take(some, axis=1), self.triangle.take(some)
        doubt = None if self.doubt is None else self.doubt.take(some, axis=0)
        pixels = self.pixels.take(some)
        return DrawnPoints(pixels=pixels, coordinates=coordinates, triangle=triangle, doubt=doubt)

    def places(self, bundle: RayBundle) -> Places:
        """Return the position of each point on the film of a ray bundle; see `pixel_places`."""
        x, y, z = self.coordinates
        return places_off_center(x, y, z, bundle)

    def surface_points(self, scene: Scene) -> SurfacePoints:
        """Return the points with their error bounds."""
        position, number = self.coordinates.T, existing_triangles(self.triangle, scene)
        tolerance = position_tolerance(scene, number, position)
        if self.doubt is not None:
            tolerance = np.maximum(tolerance, np.linalg.norm(self.doubt, axis=1))
        return SurfacePoints(position=position, triangle=number, tolerance=tolerance)


def film_places(image: HogelImage, camera: HogelCamera) -> Floats:
    """Return column and row of every shown point on the true film, (2, H, W); NaN in the plate."""
    # Selecting covered pixels first would take longer than computing the whole film.
    x, y, z = (np.asarray(image.position[..., axis], dtype=np.float64) for axis in range(3))
    z = np.where(image.off_plate, z, np.nan)
    return np.stack(places_off_center(x, y, z, true_lines(camera)))


def _less_centers(places: Floats) -> Floats:
    """Return places (2, H, W) relative to the centers of the pixels that show them."""
    shift = places.copy()
    shift[0] -= np.arange(places.shape[2])
    shift[1] -= np.arange(places.shape[1])[:, None]
    return shift


def film_shifts(image: HogelImage, camera: HogelCamera) -> Floats:
    """Return true minus drawn place of every pixel, (2, H, W) pixels; NaN in the plate."""
    return _less_centers(film_places(image, camera))


def displacement(image: HogelImage, camera: HogelCamera) -> Floats:
    """Return the displacement of every pixel, (H, W, 2): columns to the right, rows down."""
    return np.moveaxis(film_shifts(image, camera), 0, -1)


def beyond_storage(shift: Floats, image: HogelImage) -> Floats:
    """Return displacements (H, W, 2) less the error bounds of the stored positions.

    An error e of a coordinate and an error e_z of the height change a point's slope (x - a) / z by
    at most (e + e_z |x - a| / |z|) / |z|.
    """
    if image.uncertainty is None:
        return shift
    camera, height, doubt = image.camera, np.abs(image.height), image.uncertainty
    moved = np.empty_like(shift)
    for axis, center in enumerate((camera.aperture.x, camera.aperture.y)):
        pixels_per_slope = camera.resolution[axis] / (2 * camera.half_extent[axis])
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.abs(image.position[..., axis] - center) / height
            moved[..., axis] = (
                pixels_per_slope * (doubt[..., axis] + doubt[..., 2] * slope) / height
            )
    # A displacement within the rounding of storage counts as 0.
    return np.asarray(np.sign(shift) * np.maximum(np.abs(shift) - moved, 0.0))


# Wrong surfaces
# ------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceErrors:
    """Pixels (H, W) with the wrong surface, and among them pixels with a point outside the film."""

    wrong: Mask
    outside: Mask


def surface_errors(
    truth: HogelImage, raster: HogelImage, reference: Reference, places: Floats | None = None
) -> SurfaceErrors:
    """Return the pixels that show the wrong surface.

    A pixel is wrong if only truth or raster shows a surface, if they show different objects, if its
    point belongs outside the true film, or if another surface is in front of this point on the
    point's own true line. In the true frustum, a point in the plate is visible only at the
    aperture's center. The film ends half a pixel beyond the outermost pixels' centers, so that a
    picture displaced by less than half a pixel shows no point from outside. `places` are the
    `film_places` of the raster, if already computed.
    """
    scene, bundle = reference.scene, true_lines(truth.camera)
    points = DrawnPoints.from_image(raster, np.flatnonzero(raster.off_plate))
    if places is None:
        located = points.places(bundle)
    else:
        columns, rows = (axis.reshape(-1)[points.pixels] for axis in places)
        located = columns, rows
    # Flat numbers need rows that are contiguous in memory.
    wrong = np.ascontiguousarray(other_surfaces(truth, raster, scene))
    # A point in the plate does not determine a line: it is right only if the truth also shows a
    # point in the plate.
    wrong |= in_plate(raster) & ~in_plate(truth)
    # The occlusion test traces a line per point. Points that equal the certified truth are visible
    # without a test.
    seen = _proven_seen(truth, points, scene) & ~wrong.reshape(-1)[points.pixels]
    # A certified point lies on the film by construction, in spite of its rounding.
    beyond = _beyond_film(points, located, bundle, scene) & ~seen
    outside = np.zeros_like(wrong)
    outside.reshape(-1)[points.pixels[beyond]] = True
    wrong |= outside
    doubtful = points.at(np.flatnonzero(~seen & ~wrong.reshape(-1)[points.pixels]))
    # Each doubtful point is traced on its own true line, not on the line of the pixel that shows
    # it.
    hidden = reference.hidden(truth.camera.aperture, doubtful.surface_points(scene))
    wrong.reshape(-1)[doubtful.pixels[hidden]] = True
    return SurfaceErrors(wrong=wrong, outside=outside)


def in_plate(image: HogelImage) -> Mask:
    """Return the pixels that show a surface point in the plate, (H, W)."""
    return np.asarray(image.covered & (image.height == 0))


def covered_by(image: HogelImage) -> Mask:
    """Return the pixels that show a surface, by the numbers or positions of an image."""
    return np.asarray(image.covered | (image.object != NOTHING))


def other_surfaces(expected: HogelImage, shown: HogelImage, scene: Scene) -> Mask:
    """Return the pixels (H, W) with an unexpected, a missing or another object's surface.

    If an image names neither object nor triangle, it is taken to show the expected object.
    """
    # Without numbers the expected object is assumed, so that only hits and misses are compared.
    objects = np.where(shown.object != NOTHING, shown.object, expected.object)
    unnamed = np.flatnonzero((shown.object == NOTHING) & (shown.triangle != NOTHING))
    number = existing_triangles(shown.triangle.ravel()[unnamed], scene)
    objects.flat[unnamed[number != NOTHING]] = scene.object_of_triangle[number[number != NOTHING]]
    wrong: Mask = expected.covered != covered_by(shown)
    wrong |= expected.covered & (expected.object != objects)
    return wrong


def _proven_seen(truth: HogelImage, points: DrawnPoints, scene: Scene) -> Mask:
    """Return a mask (N,) of the points that equal the truth within rounding."""
    seen = np.zeros(len(points.pixels), dtype=np.bool_)
    if truth.certainty is None:
        return seen
    same = points.triangle == truth.triangle.reshape(-1)[points.pixels]
    same &= (points.triangle >= 0) & (points.triangle < len(scene.faces))
    same &= truth.certainty.reshape(-1)[points.pixels] <= Certainty.EXACT
    # With a tiny near, most points equal the truth. With a larger near, this test of heights
    # excludes nearly all points, at little cost.
    height = truth.height.reshape(-1)[points.pixels]
    some = np.flatnonzero(
        same & (np.abs(points.coordinates[2] - height) <= largest_tolerance(scene))
    )
    drawn = points.at(some)
    apart = drawn.coordinates - DrawnPoints.from_image(truth, drawn.pixels).coordinates
    tolerance = POSITION_TOLERANCE * scene.largest_coordinates[drawn.triangle]
    seen[some] = np.square(apart).sum(axis=0) <= np.square(tolerance)
    return seen


def _beyond_film(points: DrawnPoints, places: Places, bundle: RayBundle, scene: Scene) -> Mask:
    """Return the points (N,) that belong outside the film of a ray bundle, beyond rounding.

    On the film, the error bound of a point is divided by w t. Here w is the depth from the center
    of the lines, |z| for the true frustum, and t is the half-extent of the film.
    """
    # Projection divides by the depth: an error e of a point moves it by e / (w t) film units.
    tolerance = points.surface_points(scene).tolerance / np.abs(
        points.coordinates[2] - bundle.center[2]
    )
    outside = np.zeros(len(tolerance), dtype=np.bool_)
    for place, side, half in zip(places, bundle.resolution, bundle.half_extent, strict=True):
        off = tolerance * side / (2 * half)
        outside |= (place < -0.5 - off) | (place > side - 0.5 + off)
    return outside


def outside_film(mask: Mask, shown: HogelImage, scene: Scene, bundle: RayBundle) -> Mask:
    """Return the pixels of a mask (H, W) with a point that belongs outside the film of a bundle."""
    points = DrawnPoints.from_image(shown, np.flatnonzero(mask))
    outside = np.zeros_like(mask)
    outside.flat[points.pixels] = _beyond_film(points, points.places(bundle), bundle, scene)
    return outside


def hidden_pixels(mask: Mask, shown: SurfaceImage, scene: Scene, hides: Occluded) -> Mask:
    """Return the pixels, of a mask (H, W) of surfaces off the plate, that show a hidden point."""
    pixels = np.flatnonzero(mask)
    hidden = np.zeros_like(mask)
    hidden.flat[pixels] = hides(DrawnPoints.from_image(shown, pixels).surface_points(scene))
    return hidden


def floating_pixels(
    mask: Mask, answer: HogelImage, shown: HogelImage, lines: RayBundle, hides: Occluded
) -> Mask:
    """Return the pixels of a mask (H, W) whose points float in front of all surfaces.

    Positions in wrong units may be on the right lines, in front of every surface. A point is moved
    away along its line by `FLOATING_SHARE` of its depth. If no surface hides it there, or
    `SNAPPED_PX` to the side (because rasterizers snap edges), it was not on a surface. A point
    within this distance of the expected point is not tested.
    """
    floating = np.zeros_like(mask)
    points = DrawnPoints.from_image(shown, np.flatnonzero(mask))
    position, true = (
        points.coordinates.T,
        DrawnPoints.from_image(answer, points.pixels).coordinates.T,
    )
    offset = position - lines.center
    share = np.full(len(offset), FLOATING_SHARE)
    if points.doubt is not None:
        with np.errstate(divide="ignore", invalid="ignore"):
            doubt = np.linalg.norm(points.doubt, axis=1) / np.abs(offset[:, 2])
        share += FLOATING_DOUBTS * np.nan_to_num(doubt)
    room = share * np.abs(offset[:, 2])
    far = np.flatnonzero(~(np.abs(position - true).max(axis=1, initial=0.0) <= room))
    # s is -z relative to the center. Lines run toward larger s on both sides of the center.
    moved = offset * (1.0 - share[:, None] * np.sign(offset[:, 2:]))
    # An edge may be snapped past the point, so that positions to the side are tested too.
    for across, up in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
        if len(far):
            pixels = np.multiply(2 * SNAPPED_PX, lines.half_extent) / lines.resolution
            aside = (*np.multiply((across, up), pixels), 0.0)
            there = moved[far] + np.abs(moved[far, 2:]) * aside + lines.center
            nameless = np.full(len(far), NOTHING, dtype=np.int32)
            points_there = SurfacePoints(
                position=there, triangle=nameless, tolerance=np.zeros(len(far))
            )
            far = far[~hides(points_there)]
    floating.flat[points.pixels[far]] = True
    return floating


def turned_away(truth: HogelImage) -> Mask:
    """Return the pixels (H, W) whose true surface shows its back, and is removed by culling."""
    assert truth.normal is not None, "the reference gives normals"
    directions = true_lines(truth.camera).directions()
    with np.errstate(invalid="ignore"):
        return np.asarray(np.einsum("hwi,hwi->hw", truth.normal, directions) > 0)


def culled_pixels(truth: HogelImage, raster: HogelImage) -> Mask | None:
    """Return the pixels (H, W) whose true surface is culled; None without culling."""
    settings = raster.camera.settings
    # Foreign images have no settings: culling by other renderers is a defect, not a choice.
    if settings is None or settings.cull is Cull.NONE or truth.normal is None:
        return None
    return turned_away(truth)


# All errors
# ----------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ErrorMaps(ShortRepr):
    """Each error as an image; errors are raster minus truth."""

    #: (H, W) pixels whose truth is not a tie
    judged: Mask
    #: pixels that show the wrong surface; None without the scene
    surface: Mask | None
    #: pixels of `surface` whose point belongs outside the true film
    outside: Mask | None
    #: pixels that show another triangle number
    triangle: Mask
    #: (H, W, 2) columns and rows in pixels, NaN where undefined
    displacement: Floats
    #: (H, W), NaN where the triangles differ
    height: Floats
    #: (H, W, 3), NaN where not judged; None if not compared
    radiance: Floats | None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PixelErrors(ShortRepr):
    """Errors of an image except color: maps, and numbers of displacement and height."""

    truth: HogelImage
    raster: HogelImage
    #: judged, surface, outside, triangle: the masks of `ErrorMaps`
    judged: Mask
    surface: Mask | None
    outside: Mask | None
    triangle: Mask
    #: (2, H, W) true minus drawn place, columns and rows; NaN where undefined
    shift: Floats
    #: (H, W) length of `shift`
    moved: Floats
    #: (H, W) raster minus truth, NaN where the triangles differ
    height: Floats
    spread: Spread | None
    height_error: HeightError | None

    @property
    def at_plate(self) -> int:
        """Number of pixels that show a surface in the plate, where displacement is undefined."""
        return int(np.count_nonzero(in_plate(self.raster)))

    @property
    def maps(self) -> ErrorMaps:
        """Errors as images, without radiance."""
        masks = {name: getattr(self, name) for name in ("judged", "surface", "outside", "triangle")}
        moved = np.moveaxis(self.shift, 0, -1)
        return ErrorMaps(**masks, displacement=moved, height=self.height, radiance=None)


def pixel_errors(
    truth: HogelImage,
    raster: HogelImage,
    reference: Reference | None,
    cached_errors: PixelErrors | None = None,
) -> PixelErrors:
    """Return the errors of an image.

    `cached_errors` belong to another image by the same truth; pixels that are equal in both images
    are not judged again.
    """
    if cached_errors is not None:
        return _updated_errors(truth, raster, reference, cached_errors)
    judged = judged_pixels(truth)
    places = film_places(raster, truth.camera)
    # Occlusion cannot be decided without the scene.
    errors = surface_errors(truth, raster, reference, places) if reference else None
    shift = _less_centers(places)
    moved = np.hypot(*shift)
    height = _rise(truth, raster, judged)
    return PixelErrors(
        truth=truth,
        raster=raster,
        judged=judged,
        surface=errors.wrong & judged if errors else None,
        outside=errors.outside & judged if errors else None,
        triangle=(truth.triangle != raster.triangle) & judged & names_triangles(raster),
        shift=shift,
        moved=moved,
        height=height,
        spread=Spread.from_values(moved[raster.off_plate]),
        height_error=_height_error(height),
    )


def _updated_errors(
    truth: HogelImage, raster: HogelImage, reference: Reference | None, cached: PixelErrors
) -> PixelErrors:
    """Return the errors of an image, judged only where it differs from the cached image."""
    pixels = differing_pixels(cached.raster, raster)
    if not pixels.size:
        return replace(cached, raster=raster)
    # Treat the differing pixels as images of one row.
    before, after = truth.at(pixels), raster.at(pixels)
    judged = cached.judged.reshape(-1)[pixels][None]
    places = film_places(after, truth.camera)
    errors = surface_errors(before, after, reference, places) if reference else None
    # The places refer to the whole film; the images have single rows of pixels.
    row, column = np.divmod(pixels, cached.judged.shape[1])
    shift = cached.shift.copy()
    shift.reshape(2, -1)[:, pixels] = places[:, 0] - (column, row)
    moved = cached.moved.copy()
    moved.reshape(-1)[pixels] = np.hypot(*shift.reshape(2, -1)[:, pixels])
    height = _with(cached.height, pixels, _rise(before, after, judged))
    triangle = (before.triangle != after.triangle) & judged
    return replace(
        cached,
        raster=raster,
        surface=_with(cached.surface, pixels, errors.wrong & judged) if errors else None,
        outside=_with(cached.outside, pixels, errors.outside & judged) if errors else None,
        triangle=_with(cached.triangle, pixels, triangle),
        shift=shift,
        moved=moved,
        height=height,
        spread=Spread.from_values(moved[raster.off_plate]),
        height_error=_height_error(height),
    )


def _with(whole: NDArray[Any] | None, pixels: Indices, values: NDArray[Any]) -> Any:
    """Return a map (H, W) with new values at some pixels, given by their flat numbers."""
    assert whole is not None, "both images were judged with the scene at hand"
    updated = whole.copy()
    updated.reshape(-1)[pixels] = values.reshape(-1)
    return updated


def _height_error(height: Floats) -> HeightError | None:
    error = height[~np.isnan(height)]
    if not error.size:
        return None
    return HeightError(rms=root_mean_square(error), max=float(np.abs(error).max()))


def _rise(truth: HogelImage, raster: HogelImage, judged: Mask) -> Floats:
    """Return raster minus truth of heights (H, W); NaN where not judged or the triangles differ."""
    same = (truth.triangle == raster.triangle) & judged & truth.covered & np.isfinite(raster.height)
    return np.where(same, raster.height.astype(np.float64) - truth.height, np.nan)


def names_triangles(image: HogelImage) -> bool:
    """Return whether an image names triangles, or shows nothing."""
    return bool((image.triangle != NOTHING).any()) or not image.covered.any()


def differing_pixels(first: HogelImage, second: HogelImage) -> Indices:
    """Return the flat numbers of the pixels at which two images differ."""
    differs = (first.triangle != second.triangle) | (first.object != second.object)
    if first.position.dtype == second.position.dtype == np.float32:
        # Compare bit by bit, because NaN must equal NaN here. Zeros of different sign count as
        # different, which only costs time.
        for axis in range(3):
            mine, its = (image.position[..., axis].view(np.int32) for image in (first, second))
            differs |= mine != its
    else:
        equal = np.isclose(first.position, second.position, rtol=0, atol=0, equal_nan=True)
        differs |= ~equal.all(axis=-1)
    return np.flatnonzero(differs)


def judged_pixels(truth: HogelImage) -> Mask:
    """Return the pixels whose truth is not a tie, (H, W)."""
    if truth.certainty is None:
        return np.ones(truth.triangle.shape, dtype=np.bool_)
    return np.not_equal(truth.certainty, Certainty.TIE)


# Pairs of pictures
# ---------------------------------------------------------------------------------------


CONFIDENCE = 0.95  #: probability that no comparison of pictures finds a difference by chance


@dataclass(frozen=True, kw_only=True)
class PixelSet:
    """Set of pixels of a film: their number, and a compressed bit mask."""

    count: int
    packed: bytes = field(repr=False)

    @classmethod
    def from_mask(cls, mask: Mask) -> PixelSet:
        """Return the pixels where a mask is set."""
        return cls(
            count=int(mask.sum()), packed=zlib.compress(np.packbits(mask).tobytes(), level=1)
        )

    def shared_with(self, other: PixelSet) -> int:
        """Return the number of pixels in both sets of one film."""
        mine, its = (
            np.frombuffer(zlib.decompress(each.packed), np.uint8) for each in (self, other)
        )
        return int(np.bitwise_count(mine & its).sum())


def is_worse(only_here: int, only_there: int, comparisons: int = 1) -> bool:
    """Return whether more pixels are wrong in one picture than in another, beyond chance.

    This is the exact test of McNemar (1947): pixels wrong in both pictures, or in neither, do not
    count; if neither picture were worse, each other pixel would be wrong in either picture with
    equal chances. Pixels along one contour change together, so that the test detects differences
    too soon: callers therefore also require a smallest difference. `CONFIDENCE` holds for all
    `comparisons` with the other picture together (Bonferroni).
    """
    if only_here <= only_there:
        return False
    # The upper tail of the binomial distribution. Loading scipy.stats for it would take a second.
    by_chance = scipy.special.bdtrc(only_here - 1, only_here + only_there, 0.5)
    return bool(by_chance < (1 - CONFIDENCE) / comparisons)
