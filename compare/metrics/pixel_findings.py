"""Findings of each pixel by formulas alone: all that is asked of an image before what hides its points.

The formulas are written once for NumPy and Dr.Jit; both do the same operations in the same order. Where a
foreign image is judged by another question than the truth, `surface` and `film` say the same of NumPy's
arrays: places are those of `places_off_center`, and points beyond the film those of `beyond_film`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.metrics.film import true_lines
from xfrustum.compare.rounding.positions import largest_tolerance, tolerance_by_size
from xfrustum.reference.devices.arithmetic import Arithmetic, Table
from xfrustum.reference.lane_formulas import evaluated
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.sight.clear import ClearTriangles
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty, HogelImage
from xfrustum.scenes.model.scene import Scene


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceFindings:
    """The surface errors that are known without asking what hides points; see `surface_errors`.

    Attributes
    ----------
    wrong, outside
        (N,) pixels that surely show the wrong surface, and those of them whose point belongs outside the true
        film.
    doubtful
        (N,) pixels that are right unless something hides their points.
    """

    wrong: Mask
    outside: Mask
    doubtful: Mask


@dataclass(frozen=True, kw_only=True, eq=False)
class PixelFindings:
    """Findings of each of the N pixels of an image, row by row.

    Attributes
    ----------
    off_plate
        (N,) pixels that show a point off the plate, which has a place on the true film.
    in_plate
        (N,) pixels that show a point in the plate.
    same
        (N,) judged pixels of one triangle in both images, whose height is known.
    moved
        (N,) distance of the point's place on the true film from that of the pixel, in pixels; 0 where the
        point is not off the plate.
    rise
        (N,) height of the image minus that of the truth, scene units; 0 where `same` does not hold.
    surface
        Surface errors; None where the scene is not at hand.
    """

    off_plate: Mask
    in_plate: Mask
    same: Mask
    moved: Floats
    rise: Floats
    surface: SurfaceFindings | None


def pixel_findings(
    truth: HogelImage, raster: HogelImage, scene: Scene | None, clear: ClearTriangles | None = None
) -> PixelFindings:
    """Return what formulas say of each pixel of an image.

    Parameters
    ----------
    truth, raster
        The true image, and the image that is judged by it.
    scene
        Scene of both; without it there are no surface errors.
    clear
        Triangles on which points are hidden by nothing, where they are known; see `Reference.clear`.
    """
    # What is known of another film says nothing of places on this one.
    known = clear if clear is not None and clear.pencil == true_lines(truth.camera) else None

    def formula(by: Arithmetic) -> Callable[[Any], Sequence[Any]]:
        pixel = _PixelFormula.of(by, truth, raster)
        surface = None if scene is None else _SurfaceFormula.of(by, scene, pixel.film, known)
        return lambda lane: _values(by, pixel.at(lane), surface)

    values = evaluated(formula, truth.triangle.size)
    return PixelFindings(
        **dict(zip(_OF_PIXELS, values, strict=False)),
        surface=None
        if scene is None
        else SurfaceFindings(**dict(zip(_OF_SURFACES, values[len(_OF_PIXELS) :], strict=True))),
    )


_OF_PIXELS = ("off_plate", "in_plate", "same", "moved", "rise")
_OF_SURFACES = ("wrong", "outside", "doubtful")


def _values(by: Arithmetic, pixel: _Pixel, surface: _SurfaceFormula | None) -> list[Any]:
    """Return the values of some lanes: those named in `_OF_PIXELS`, and then in `_OF_SURFACES`."""
    true, shown = pixel.true, pixel.shown
    same = (true.triangle == shown.triangle) & pixel.judged & true.covered & shown.has_height
    drawn_at, place = pixel.drawn_at, pixel.place
    found = [
        shown.off_plate,
        shown.in_plate,
        same,
        by.select(shown.off_plate, by.length(place[0] - drawn_at[0], place[1] - drawn_at[1]), 0.0),
        by.select(same, shown.point[2] - true.point[2], 0.0),
    ]
    return found if surface is None else [*found, *surface.errors(pixel)]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Shown:
    """What lanes of an image show: numbers and coordinates, and what follows from these alone."""

    triangle: Any
    object: Any
    point: Sequence[Any]
    has_height: Any
    covered: Any
    off_plate: Any
    in_plate: Any

    @classmethod
    def of(cls, by: Arithmetic, triangle: Any, number: Any, point: Sequence[Any]) -> _Shown:
        """Return it, as `HogelImage` says it of whole images."""
        x, y, z = point
        has_height = by.isfinite(z)
        covered = (triangle != NOTHING) | has_height
        off_plate = covered & by.isfinite(x) & by.isfinite(y) & has_height & (z != 0)
        return cls(
            triangle=triangle,
            object=number,
            point=point,
            has_height=has_height,
            covered=covered,
            off_plate=off_plate,
            in_plate=covered & ~off_plate & (z == 0),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Film:
    """The numbers of the true film where lanes read them."""

    center: Sequence[Any]
    shear: Sequence[Any]
    half_extent: Sequence[Any]
    sides: Sequence[Any]
    per_column: Any
    pixels_per_length: Sequence[Any]

    @classmethod
    def of(cls, by: Arithmetic, pencil: Pencil) -> _Film:
        """Return the numbers of a pencil's film."""
        return cls(
            center=by.constants(pencil.center),
            shear=by.constants(pencil.shear),
            half_extent=by.constants(pencil.half_extent),
            sides=by.constants([float(side) for side in pencil.resolution]),
            per_column=by.constants([1 / pencil.resolution[0]])[0],
            pixels_per_length=by.constants(
                [side / (2 * half) for side, half in zip(pencil.resolution, pencil.half_extent, strict=True)]
            ),
        )

    def place(self, point: Sequence[Any]) -> tuple[Any, Any]:
        """Return column and row of points; see `places_off_center`, which does the same."""
        depth = -(point[2] - self.center[2])
        across, down = (
            ((point[axis] - self.center[axis]) / depth - self.shear[axis]) / self.half_extent[axis]
            for axis in range(2)
        )
        width, height = self.sides
        return (across + 1) * width / 2 - 0.5, (1 - down) * height / 2 - 0.5

    def drawn_at(self, by: Arithmetic, lane: Any) -> tuple[Any, Any]:
        """Return column and row of the pixels themselves."""
        # A product with 1/W is off by less than the half that is added, and faster than a quotient.
        number = by.real(lane)
        row = by.floor((number + 0.5) * self.per_column)
        return number - row * self.sides[0], row


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pixel:
    """What lanes of both images show, which of them are judged or decided, and where points belong."""

    true: _Shown
    shown: _Shown
    judged: Any
    decided: Any
    place: tuple[Any, Any]
    drawn_at: tuple[Any, Any]


@dataclass(frozen=True, kw_only=True, eq=False)
class _PixelFormula:
    """The two images where lanes look them up, and the true film."""

    by: Arithmetic
    true: Callable[[Any], _Shown]
    shown: Callable[[Any], _Shown]
    certainty: Table | None
    film: _Film

    @classmethod
    def of(cls, by: Arithmetic, truth: HogelImage, raster: HogelImage) -> _PixelFormula:
        """Return the formula of two images of one size."""
        true = _TrueLanes.of(by, truth)
        return cls(
            by=by,
            true=true.shown,
            shown=_lanes(by, raster),
            certainty=true.certainty,
            film=_Film.of(by, true_lines(truth.camera)),
        )

    def at(self, lane: Any) -> _Pixel:
        """Return what some lanes show."""
        true, shown = self.true(lane), self.shown(lane)
        certainty = None if self.certainty is None else self.certainty(lane)[0]
        return _Pixel(
            true=true,
            shown=shown,
            judged=True if certainty is None else certainty != int(Certainty.TIE),
            decided=None if certainty is None else certainty <= int(Certainty.EXACT),
            place=self.film.place(shown.point),
            drawn_at=self.film.drawn_at(self.by, lane),
        )


def _lanes(by: Arithmetic, image: HogelImage) -> Callable[[Any], _Shown]:
    """Return the function from lanes to what an image shows in their pixels."""
    numbers = [by.own(array.reshape(-1)) for array in (image.triangle, image.object)]
    position = by.own(image.position.reshape(-1, 3))

    def at(lane: Any) -> _Shown:
        (triangle,), (number,) = (table(lane) for table in numbers)
        return _Shown.of(by, triangle, number, [by.real(value) for value in position(lane)])

    return at


@dataclass(frozen=True, kw_only=True, eq=False)
class _TrueLanes:
    """A true image where lanes find their pixels."""

    by: Arithmetic
    shown: Callable[[Any], _Shown]
    certainty: Table | None

    @classmethod
    def of(cls, by: Arithmetic, truth: HogelImage) -> _TrueLanes:
        """Return it, as it is kept for as long as there is the image: many are judged by one truth."""
        found = _TRUE_LANES.get(truth)
        if found is None or found.by is not by:
            certainty = None if truth.certainty is None else by.own(truth.certainty.reshape(-1))
            found = _TRUE_LANES[truth] = cls(by=by, shown=_lanes(by, truth), certainty=certainty)
        return found


_TRUE_LANES: WeakKeyDictionary[HogelImage, _TrueLanes] = WeakKeyDictionary()
"""Lanes of the true images that are there."""


def _column(by: Arithmetic, values: NDArray[Any]) -> Callable[[Any], Any]:
    """Return the function that looks up one number by its place."""
    table = by.table(values)
    return lambda place: table(place)[0]


def _scene_tables(by: Arithmetic, scene: Scene) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
    """Return the functions from triangles to their objects and to their largest coordinates."""
    # Where there is no triangle, none is looked up, but there must be a place.
    numbers, sizes = scene.object_of_triangle, scene.largest_coordinates
    if not len(scene.faces):
        numbers, sizes = np.zeros(1, dtype=np.int32), np.zeros(1)
    return _column(by, numbers), _column(by, sizes)


_SCENE_TABLES: WeakKeyDictionary[Scene, tuple[Arithmetic, Callable[[Any], Any], Callable[[Any], Any]]] = (
    WeakKeyDictionary()
)
"""Tables of the scenes that are there, by the scene, for many images are judged of one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _SurfaceFormula:
    """Triangles of a scene where lanes look them up, and the true film."""

    by: Arithmetic
    film: _Film
    count: Any
    object_of: Callable[[Any], Any]
    size_of: Callable[[Any], Any]
    largest_tolerance: Any
    clear: Callable[[Any, Sequence[Any], Any, Any], Any] | None

    @classmethod
    def of(cls, by: Arithmetic, scene: Scene, film: _Film, clear: ClearTriangles | None) -> _SurfaceFormula:
        """Return the formula of a scene, and of the triangles that nothing hides where they are known."""
        known = _SCENE_TABLES.get(scene)
        if known is None or known[0] is not by:
            known = _SCENE_TABLES[scene] = (by, *_scene_tables(by, scene))
        count, largest = by.constants((float(len(scene.faces)), largest_tolerance(scene)))
        return cls(
            by=by,
            film=film,
            count=count,
            object_of=known[1],
            size_of=known[2],
            largest_tolerance=largest,
            clear=None if clear is None else clear.seen(by),
        )

    def errors(self, pixel: _Pixel) -> tuple[Any, Any, Any]:
        """Return the values named in `_OF_SURFACES`."""
        select, shown = self.by.select, pixel.shown
        exists = (shown.triangle >= 0) & (shown.triangle < self.count)
        triangle = select(exists, shown.triangle, 0)
        wrong = self._other_surface(pixel, exists, triangle)
        x, y, z = shown.point
        size = select(
            exists, self.size_of(triangle), self.by.maximum(self.by.maximum(abs(x), abs(y)), abs(z))
        )
        tolerance = tolerance_by_size(size)
        open_points = shown.off_plate
        if pixel.decided is not None:
            open_points = open_points & ~(pixel.decided & exists & ~wrong & self._is_true(pixel, tolerance))
        outside = open_points & self._beyond(pixel, tolerance)
        doubtful = open_points & ~wrong & ~outside
        if self.clear is not None:
            depth = self.film.center[2] - shown.point[2]
            doubtful = doubtful & ~(exists & self.clear(triangle, pixel.place, depth, tolerance))
        return wrong | outside, outside, doubtful

    def _other_surface(self, pixel: _Pixel, exists: Any, triangle: Any) -> Any:
        """Return where a surface is shown instead of none, none, another object's, or a point in the plate.

        The true frustum sees a point in the plate only in the aperture's center, where all lines meet.
        """
        true, shown = pixel.true, pixel.shown
        named = shown.object != NOTHING
        found = self.by.select(named, shown.object, true.object)
        found = self.by.select(~named & exists, self.object_of(triangle), found)
        wrong = true.covered != (shown.covered | named)
        wrong = wrong | (true.covered & (true.object != found))
        return wrong | (shown.in_plate & ~(true.covered & (true.point[2] == 0)))

    def _is_true(self, pixel: _Pixel, tolerance: Any) -> Any:
        """Return where the point is, within rounding, that of the truth, which has proven that it is seen.

        With a tiny near that is so at most pixels.
        """
        true, shown = pixel.true, pixel.shown
        x, y, z = (one - other for one, other in zip(shown.point, true.point, strict=True))
        near = (shown.triangle == true.triangle) & (abs(z) <= self.largest_tolerance)
        return near & (x * x + y * y + z * z <= tolerance * tolerance)

    def _beyond(self, pixel: _Pixel, tolerance: Any) -> Any:
        """Return where the point belongs outside the film, however it was rounded; see `beyond_film`."""
        depth = abs(pixel.shown.point[2] - self.film.center[2])
        beyond = None
        film = self.film
        for place, side, share in zip(pixel.place, film.sides, film.pixels_per_length, strict=True):
            known_to = tolerance * share / depth
            off = (place < -0.5 - known_to) | (place > side - 0.5 + known_to)
            beyond = off if beyond is None else beyond | off
        return beyond
