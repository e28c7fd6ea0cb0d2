"""Errors of each pixel: displacement, surface, triangle and height (docs/method.md, "What is compared").

A pixel can be wrong in three ways. It shows a surface where there is none, no surface where there
is one, or that of another object (`other_surfaces`); or the point that it shows belongs outside the
film (`outside_film`); or that point is hidden behind something else (`hidden_pixels`). The film and
the lines are here those of the true frustum, in `xfrustum.compare.judging.judged` those of a
renderer's own cameras.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from xfrustum.compare.rounding.positions import (
    POSITION_TOLERANCE,
    largest_tolerance,
    position_tolerance,
)
from xfrustum.reference import Reference, SurfacePoints
from xfrustum.reference.lines.lines import RayBundle, places_off_center
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.hogel_image import (
    NOTHING,
    Certainty,
    HogelCamera,
    HogelImage,
    SurfaceImage,
)
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook import ShortRepr
from xfrustum.scenes.plate.double_frustum import Cull

Occluded = Callable[[SurfacePoints], Mask]  #: function that returns which points (N,) are occluded
FLOATING_SHARE, FLOATING_DOUBTS = 0.01, 10
"""Share of its depth by which a point may float in front of every surface, and how many times it may float by
what storage coarser than float32 changes, which moves points off slanted surfaces along their lines."""
SNAPPED_PX = (
    0.25  #: pixels by which an edge may be drawn beside its place; 4 subpixel bits snap by 0.05
)
Places = tuple[Floats, Floats]
"""Columns and rows (N,) of points on a film, where a pixel's center has whole numbers and rows count down."""


@dataclass(frozen=True, kw_only=True)
class Spread:
    """How a quantity in pixels is distributed over an image."""

    rms: float
    p50: float
    p95: float
    p99: float
    max: float

    @classmethod
    def from_values(cls, values: Floats) -> Spread | None:
        """Return the spread of values of any shape, None where there are no values."""
        if values.size == 0:
            return None
        with np.errstate(invalid="ignore"):
            p50, p95, p99 = np.percentile(values, (50, 95, 99)).tolist()
        return cls(rms=root_mean_square(values), p50=p50, p95=p95, p99=p99, max=float(values.max()))


@dataclass(frozen=True, kw_only=True)
class HeightError:
    """Raster minus truth in scene units, where both show the same triangle."""

    rms: float
    max: float


def root_mean_square(values: Floats) -> float:
    """Return the root mean square of values of any shape, of which there is at least one."""
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
    """Return the lines of the true frustum of the aperture that an image's camera names."""
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
    """Return triangle numbers of any shape; `NOTHING` where a number is not one of the scene's."""
    return np.where((numbers >= 0) & (numbers < len(scene.faces)), numbers, np.int32(NOTHING))


def lengths(shift: Floats) -> Floats:
    """Return the lengths (...) of vectors (..., 2)."""
    return np.hypot(shift[..., 0], shift[..., 1])


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnPoints:
    """Surface points that some pixels of an image show, as a structure of arrays."""

    pixels: Indices  #: (N,) flat numbers
    coordinates: Floats  #: (3, N) scene units
    triangle: Numbers  #: (N,) as the image has them
    doubt: Floats | None = (
        None  #: (N, 3) how exactly the image's storage holds coordinates; None as float32
    )

    @classmethod
    def from_image(cls, image: SurfaceImage, pixels: Indices) -> DrawnPoints:
        """Return the points that an image shows at some pixels, given by their flat numbers (N,)."""
        axes = [image.position[..., axis].reshape(-1)[pixels] for axis in range(3)]
        triangle = image.triangle.reshape(-1)[pixels]
        coordinates = np.stack(axes, dtype=np.float64)
        doubt = None if image.uncertainty is None else image.uncertainty.reshape(-1, 3)[pixels]
        return cls(pixels=pixels, coordinates=coordinates, triangle=triangle, doubt=doubt)

    def at(self, some: Indices) -> DrawnPoints:
        """Return some of the points, given by their places (M,) among these."""
        coordinates, triangle = self.coordinates.take(some, axis=1), self.triangle.take(some)
        doubt = None if self.doubt is None else self.doubt.take(some, axis=0)
        pixels = self.pixels.take(some)
        return DrawnPoints(pixels=pixels, coordinates=coordinates, triangle=triangle, doubt=doubt)

    def places(self, bundle: RayBundle) -> Places:
        """Return where a pencil's film shows each point; see `pixel_places`."""
        x, y, z = self.coordinates
        return places_off_center(x, y, z, bundle)

    def surface_points(self, scene: Scene) -> SurfacePoints:
        """Return the points with how exactly they are known."""
        position, number = self.coordinates.T, existing_triangles(self.triangle, scene)
        tolerance = position_tolerance(scene, number, position)
        if self.doubt is not None:
            tolerance = np.maximum(tolerance, np.linalg.norm(self.doubt, axis=1))
        return SurfacePoints(position=position, triangle=number, tolerance=tolerance)


def _shifts(places: Places, pixels: Indices, camera: HogelCamera) -> Floats:
    """Return the displacement (2, N) of points whose true places are known from the pixels that show them."""
    row = pixels // camera.resolution[0]
    return np.stack((places[0] - (pixels - row * camera.resolution[0]), places[1] - row))


def film_shifts(raster: HogelImage, camera: HogelCamera) -> Floats:
    """Return the displacement of all pixels, (2, H W), NaN where no surface off the plate is shown."""
    # Whole arrays: to pick the pixels that show something would take longer than to compute all of
    # them.
    x, y, z = (np.asarray(raster.position[..., axis], dtype=np.float64) for axis in range(3))
    columns, rows = places_off_center(
        x, y, np.where(raster.off_plate, z, np.nan), true_lines(camera)
    )
    columns -= np.arange(columns.shape[1])
    rows -= np.arange(rows.shape[0])[:, None]
    return np.stack((columns, rows)).reshape(2, -1)


def displacement(raster: HogelImage, camera: HogelCamera) -> Floats:
    """Return the displacement of all pixels as an image (H, W, 2); see `film_shifts`."""
    return np.moveaxis(film_shifts(raster, camera).reshape(2, *raster.triangle.shape), 0, -1)


def beyond_storage(shift: Floats, image: HogelImage) -> Floats:
    """Return displacements (H, W, 2) without what the storage of an image's positions may have moved.

    Coordinates that are off by e, and heights by e_z, move a point's slope (x - a) / z by at most
    (e + e_z |x - a| / |z|) / |z|.
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
    return np.asarray(np.sign(shift) * np.maximum(np.abs(shift) - moved, 0.0))


# Wrong surfaces
# ------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceErrors:
    """Pixels (H, W) that show the wrong surface, and those of them whose point lies outside the film."""

    wrong: Mask
    outside: Mask


def surface_errors(
    truth: HogelImage,
    raster: HogelImage,
    reference: Reference,
    located: tuple[DrawnPoints, Places] | None = None,
) -> SurfaceErrors:
    """Return the pixels that show the wrong surface.

    A pixel is wrong where only one of truth and raster shows a surface, where they show different
    objects, where the point that it shows belongs outside the true film, and where something else
    is in front of that point on its own true line. The true frustum sees a point in the plate only
    in the aperture's center. The film ends half a pixel beyond the outermost pixels' centers, so
    that a picture displaced by less shows nothing from outside.

    `located` are the raster's points off the plate and their places on the true film, where they
    are known.
    """
    scene, bundle = reference.scene, true_lines(truth.camera)
    if located is None:
        points = DrawnPoints.from_image(raster, np.flatnonzero(raster.off_plate))
        located = points, points.places(bundle)
    points, places = located
    # Row by row in memory, whatever the order of the images' arrays is: pixels are marked by flat
    # numbers.
    wrong = np.ascontiguousarray(other_surfaces(truth, raster, scene))
    wrong |= in_plate(raster) & ~in_plate(truth)
    seen = _proven_seen(truth, points, scene) & ~wrong.reshape(-1)[points.pixels]
    beyond = _beyond_film(points, places, bundle, scene) & ~seen
    outside = np.zeros_like(wrong)
    outside.reshape(-1)[points.pixels[beyond]] = True
    wrong |= outside
    doubtful = points.at(np.flatnonzero(~seen & ~wrong.reshape(-1)[points.pixels]))
    hidden = reference.hidden(truth.camera.aperture, doubtful.surface_points(scene))
    wrong.reshape(-1)[doubtful.pixels[hidden]] = True
    return SurfaceErrors(wrong=wrong, outside=outside)


def in_plate(image: HogelImage) -> Mask:
    """Return the pixels that show a surface point in the plate, (H, W)."""
    return np.asarray(image.covered & (image.height == 0))


def covered_by(image: HogelImage) -> Mask:
    """Return the pixels that show a surface, by whichever number or position an image has."""
    return np.asarray(image.covered | (image.object != NOTHING))


def other_surfaces(expected: HogelImage, shown: HogelImage, scene: Scene) -> Mask:
    """Return the pixels (H, W) that show a surface where none is expected, none, or another object's.

    Where an image says neither object nor triangle, the expected object stands for its own.
    """
    objects = np.where(shown.object != NOTHING, shown.object, expected.object)
    unnamed = np.flatnonzero((shown.object == NOTHING) & (shown.triangle != NOTHING))
    number = existing_triangles(shown.triangle.ravel()[unnamed], scene)
    objects.flat[unnamed[number != NOTHING]] = scene.object_of_triangle[number[number != NOTHING]]
    wrong: Mask = expected.covered != covered_by(shown)
    wrong |= expected.covered & (expected.object != objects)
    return wrong


def _proven_seen(truth: HogelImage, points: DrawnPoints, scene: Scene) -> Mask:
    """Return which points (N,) are, within rounding, those of the truth: with a tiny near, most are."""
    found = np.zeros(len(points.pixels), dtype=np.bool_)
    if truth.certainty is None:
        return found
    same = points.triangle == truth.triangle.reshape(-1)[points.pixels]
    same &= (points.triangle >= 0) & (points.triangle < len(scene.faces))
    same &= truth.certainty.reshape(-1)[points.pixels] <= Certainty.EXACT
    # With a larger near hardly a point is left after its height alone.
    height = truth.height.reshape(-1)[points.pixels]
    some = np.flatnonzero(
        same & (np.abs(points.coordinates[2] - height) <= largest_tolerance(scene))
    )
    drawn = points.at(some)
    apart = drawn.coordinates - DrawnPoints.from_image(truth, drawn.pixels).coordinates
    tolerance = POSITION_TOLERANCE * scene.largest_coordinates[drawn.triangle]
    found[some] = np.square(apart).sum(axis=0) <= np.square(tolerance)
    return found


def _beyond_film(points: DrawnPoints, places: Places, bundle: RayBundle, scene: Scene) -> Mask:
    """Return which points (N,) at some places belong outside a pencil's film, however they were rounded.

    A point known to within a tolerance is known on the film to within that over w t, with w its
    depth from the center of the lines: |z| for the true frustum.
    """
    tolerance = points.surface_points(scene).tolerance / np.abs(
        points.coordinates[2] - bundle.center[2]
    )
    outside = np.zeros(len(tolerance), dtype=np.bool_)
    for place, side, half in zip(places, bundle.resolution, bundle.half_extent, strict=True):
        off = tolerance * side / (2 * half)
        outside |= (place < -0.5 - off) | (place > side - 0.5 + off)
    return outside


def outside_film(asked: Mask, shown: HogelImage, scene: Scene, bundle: RayBundle) -> Mask:
    """Return which of the asked pixels (H, W) show a point that belongs outside the film of a pencil."""
    points = DrawnPoints.from_image(shown, np.flatnonzero(asked))
    found = np.zeros_like(asked)
    found.flat[points.pixels] = _beyond_film(points, points.places(bundle), bundle, scene)
    return found


def hidden_pixels(asked: Mask, shown: SurfaceImage, scene: Scene, hides: Occluded) -> Mask:
    """Return which of the asked pixels (H, W), which show a surface off the plate, show a hidden point."""
    pixels = np.flatnonzero(asked)
    found = np.zeros_like(asked)
    found.flat[pixels] = hides(DrawnPoints.from_image(shown, pixels).surface_points(scene))
    return found


def floating_pixels(
    asked: Mask, answer: HogelImage, shown: HogelImage, lines: RayBundle, hides: Occluded
) -> Mask:
    """Return which of the asked pixels (H, W) show a point with no surface at it or close behind it.

    Positions in other units may lie on the right lines, in front of everything. A point is moved
    away along its line by `FLOATING_SHARE` of its depth: where nothing hides it there, nor
    `SNAPPED_PX` beside it, as rasterizers snap edges, it was on no surface. Points that close to
    the answer's are on one.
    """
    found = np.zeros_like(asked)
    points = DrawnPoints.from_image(shown, np.flatnonzero(asked))
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
    # s = -z about the center: lines run toward larger s on both sides of it.
    moved = offset * (1.0 - share[:, None] * np.sign(offset[:, 2:]))
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
    found.flat[points.pixels[far]] = True
    return found


def turned_away(truth: HogelImage) -> Mask:
    """Return the pixels (H, W) whose true surface shows its back: culling makes it the wrong surface."""
    assert truth.normal is not None, "the reference gives normals"
    directions = true_lines(truth.camera).directions()
    with np.errstate(invalid="ignore"):
        return np.asarray(np.einsum("hwi,hwi->hw", truth.normal, directions) > 0)


def culled_pixels(truth: HogelImage, raster: HogelImage) -> Mask | None:
    """Return the pixels (H, W) whose true surface the raster's cameras leave out; None where nothing is."""
    settings = raster.camera.settings
    if settings is None or settings.cull is Cull.NONE or truth.normal is None:
        return None
    return turned_away(truth)


# All errors
# ----------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ErrorMaps(ShortRepr):
    """Each error as an image; errors are raster minus truth."""

    judged: Mask  #: (H, W) pixels whose truth is no tie
    surface: (
        Mask | None
    )  #: pixels that show the wrong surface; None where the scene was not at hand
    outside: Mask | None  #: of these, the ones whose point belongs outside the true film
    triangle: Mask  #: pixels that show another triangle number
    displacement: Floats  #: (H, W, 2) columns and rows in pixels, NaN where undefined
    height: Floats  #: (H, W), NaN where they do not show the same triangle
    radiance: (
        Floats | None
    )  #: (H, W, 3), NaN where it is not judged; None where it was not compared


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PixelErrors(ShortRepr):
    """The errors of an image: numbers of displacement and height, and which pixels are wrong.

    Masks are those of `ErrorMaps`.
    """

    truth: HogelImage
    raster: HogelImage
    judged: Mask
    surface: Mask | None
    outside: Mask | None
    triangle: Mask
    spread: Spread | None
    height_error: HeightError | None

    @property
    def at_plate(self) -> int:
        """Number of the image's pixels that show a surface in the plate, where displacement is undefined."""
        return int(np.count_nonzero(in_plate(self.raster)))

    @cached_property
    def moved(self) -> Floats:
        """Lengths (H, W) of the displacement in pixels, NaN where it is undefined."""
        return np.asarray(
            np.hypot(*film_shifts(self.raster, self.truth.camera)).reshape(self.judged.shape)
        )

    @cached_property
    def height(self) -> Floats:
        """Raster minus truth (H, W), NaN where judged pixels do not show the same triangle."""
        found = np.full(self.judged.shape, np.nan)
        pixels, rise = _rise(self.truth, self.raster, self.judged)
        found.reshape(-1)[pixels] = rise
        return found

    def find_maps(self) -> None:
        """Find the maps beside which other images are judged, in the thread of the caller."""
        _ = self.moved, self.height

    @cached_property
    def maps(self) -> ErrorMaps:
        """Each error as an image, without that of radiance."""
        masks = {name: getattr(self, name) for name in ("judged", "surface", "outside", "triangle")}
        moved = displacement(self.raster, self.truth.camera)
        return ErrorMaps(**masks, displacement=moved, height=self.height, radiance=None)


def pixel_errors(
    truth: HogelImage,
    raster: HogelImage,
    reference: Reference | None,
    cached_errors: PixelErrors | None = None,
) -> PixelErrors:
    """Return the errors of an image; pixels that show the same as one `beside` it are not judged again."""
    if cached_errors is not None:
        return _errors_beside(truth, raster, reference, cached_errors)
    judged = judged_pixels(truth)
    points = DrawnPoints.from_image(raster, np.flatnonzero(raster.off_plate))
    places = points.places(true_lines(truth.camera))
    # Without the scene at hand nobody knows what occludes a point.
    errors = surface_errors(truth, raster, reference, (points, places)) if reference else None
    return PixelErrors(
        truth=truth,
        raster=raster,
        judged=judged,
        surface=errors.wrong & judged if errors else None,
        outside=errors.outside & judged if errors else None,
        triangle=(truth.triangle != raster.triangle) & judged & names_triangles(raster),
        spread=Spread.from_values(np.hypot(*_shifts(places, points.pixels, truth.camera))),
        height_error=_height_error(_rise(truth, raster, judged)[1]),
    )


def _errors_beside(
    truth: HogelImage, raster: HogelImage, reference: Reference | None, cached_errors: PixelErrors
) -> PixelErrors:
    """Return the errors of an image, judged again only where it differs from one that was judged."""
    pixels = differing_pixels(cached_errors.raster, raster)
    if not pixels.size:
        found = replace(cached_errors, raster=raster)
        vars(found).update(moved=cached_errors.moved, height=cached_errors.height)
        return found
    before, after, judged = (
        truth.at(pixels),
        raster.at(pixels),
        cached_errors.judged.reshape(-1)[pixels][None],
    )
    points = DrawnPoints.from_image(after, np.flatnonzero(after.off_plate))
    places, shown = points.places(true_lines(truth.camera)), pixels[points.pixels]
    errors = surface_errors(before, after, reference, (points, places)) if reference else None
    moved = _with(cached_errors.moved, pixels, np.nan)
    moved.reshape(-1)[shown] = np.hypot(*_shifts(places, shown, truth.camera))
    height = _with(cached_errors.height, pixels, np.nan)
    same, rise = _rise(before, after, judged)
    height.reshape(-1)[pixels[same]] = rise
    found = replace(
        cached_errors,
        raster=raster,
        surface=_with(cached_errors.surface, pixels, errors.wrong & judged) if errors else None,
        outside=_with(cached_errors.outside, pixels, errors.outside & judged) if errors else None,
        triangle=_with(
            cached_errors.triangle, pixels, (before.triangle != after.triangle) & judged
        ),
        spread=Spread.from_values(moved[raster.off_plate]),
        height_error=_height_error(height[~np.isnan(height)]),
    )
    # The maps are there already.
    vars(found).update(moved=moved, height=height)
    return found


def _with(whole: NDArray[Any] | None, pixels: Indices, values: Any) -> Any:
    """Return a map (H, W) with other values at some pixels, given by their flat numbers."""
    assert whole is not None, "both images were judged with the scene at hand"
    found = whole.copy()
    found.reshape(-1)[pixels] = values
    return found


def _height_error(error: Floats) -> HeightError | None:
    if not error.size:
        return None
    return HeightError(rms=root_mean_square(error), max=float(np.abs(error).max()))


def _rise(truth: HogelImage, raster: HogelImage, judged: Mask) -> tuple[Indices, Floats]:
    """Return the judged pixels (N,) that show the same triangle, and raster minus truth of their heights."""
    same = (truth.triangle == raster.triangle) & judged & truth.covered & np.isfinite(raster.height)
    pixels = np.flatnonzero(same)
    drawn, true = (image.height.reshape(-1)[pixels] for image in (raster, truth))
    return pixels, drawn.astype(np.float64) - true


def names_triangles(image: HogelImage) -> bool:
    """Return whether an image names triangles, or shows nothing."""
    return bool((image.triangle != NOTHING).any()) or not image.covered.any()


def differing_pixels(one: HogelImage, other: HogelImage) -> Indices:
    """Return the flat numbers of the pixels at which two images show different things."""
    differs = (one.triangle != other.triangle) | (one.object != other.object)
    for axis in range(3):
        mine, its = one.position[..., axis], other.position[..., axis]
        # A position that is not a number equals no other.
        differs |= (mine != its) & ~(np.isnan(mine) & np.isnan(its))
    return np.flatnonzero(differs)


def judged_pixels(truth: HogelImage) -> Mask:
    """Return the pixels whose truth is no tie, (H, W)."""
    if truth.certainty is None:
        return np.ones(truth.triangle.shape, dtype=np.bool_)
    return np.not_equal(truth.certainty, Certainty.TIE)


# Pairs of pictures
# ---------------------------------------------------------------------------------------


CONFIDENCE = (
    0.95  #: probability that no picture among those compared is called worse than another by chance
)


@dataclass(frozen=True, kw_only=True)
class PixelSet:
    """A set of pixels of a film: their number, and one bit for each pixel of the film, compressed."""

    count: int
    packed: bytes = field(repr=False)

    @classmethod
    def from_mask(cls, mask: Mask) -> PixelSet:
        """Return the pixels where a mask is set."""
        return cls(
            count=int(mask.sum()), packed=zlib.compress(np.packbits(mask).tobytes(), level=1)
        )

    def shared_with(self, other: PixelSet) -> int:
        """Return how many pixels are in both sets, of one film."""
        one, two = (np.frombuffer(zlib.decompress(each.packed), np.uint8) for each in (self, other))
        return int(np.bitwise_count(one & two).sum())


def is_worse(only_here: int, only_there: int, comparisons: int = 1) -> bool:
    """Return whether more pixels are wrong in one picture than in another, beyond chance.

    This is the exact test of McNemar (1947): pixels wrong in both pictures, or in neither, say
    nothing; if neither picture were worse, each other pixel would be wrong in the one or the other
    with equal chances. Pixels along one contour change together, so that the test sees differences
    too soon: callers ask for a smallest difference besides. `CONFIDENCE` holds for all
    `comparisons` with the other picture together (Bonferroni).
    """
    if only_here <= only_there:
        return False
    by_chance = scipy.special.bdtrc(only_here - 1, only_here + only_there, 0.5)
    return bool(by_chance < (1 - CONFIDENCE) / comparisons)
