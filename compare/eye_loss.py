"""Views replayed to an eye, and their losses.

The loss of a display is the difference of the replayed truth (B) from the true view (A). The loss
of a renderer is the difference of its replayed hogels (C) from the replayed truth (B).
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.comparison import perceptual_difference
from xfrustum.compare.error_maps import hidden_pixels
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reference.eye import EyeReference, hogel_lines
from xfrustum.reference.lines import model_cameras, plane_places, triangle_normals
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.eye import Eye, EyeImage, HogelPixels, Replay
from xfrustum.scenes.model.images import NOTHING, Certainty, ColorType, FilmPart
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import DoubleFrustum
from xfrustum.scenes.representation import ShortRepr, digits

#: rows (R, 1) and columns (1, C) of pixels of a picture
Block = tuple[Indices, ...]

#: requested part of each hogel's film, by column and row of the hogel
FilmParts = Mapping[tuple[int, int], FilmPart]

ARCMIN_PER_RADIAN = 60 * 180 / math.pi

LEVELS = 255  #: 8-bit value of radiance one

#: color type of drawn hogels; stored plates have the same type, so that both have equal pixels
DEFAULT_COLOR = ColorType.FLOAT16

#: Largest distance beyond a camera's range at which a point still counts as drawn by this camera,
#: as a part of the reach. Surfaces are cut in float32; steep surfaces multiply a rounding of 2^-24
#: by about a hundred.
HEIGHT_TOLERANCE = 2.0**-16

#: largest resolution of an eye, pixels a degree: eyes resolve 60, and larger numbers make the
#: filters of FLIP large
MAX_PIXELS_PER_DEGREE = 10_000


def drawn_points(
    scene: Scene, settings: DoubleFrustum, pixels: HogelPixels, triangle: Numbers
) -> Floats:
    """Return surface points (H, W, 3) of triangle numbers (H, W), scene units, else NaN.

    A point lies where the line of a camera meets the plane of the triangle. It is shown by the last
    camera, in drawing order, whose range of heights contains it.
    """
    rows, columns = np.nonzero(triangle != NOTHING)
    corners = scene.triangles[triangle[rows, columns]]
    normals, points = triangle_normals(corners), np.full(corners.shape[:2], np.nan)
    across = _camera_lines(scene, settings, pixels.hogel_column, pixels.film_column, 0)
    down = _camera_lines(scene, settings, pixels.hogel_row, pixels.film_row, 1)
    slack = HEIGHT_TOLERANCE * scene.frustum.longest_reach
    # Cameras have the same center height and depth range at all apertures.
    cameras = model_cameras(scene.frustum, scene.plate.middle, settings)
    for (x, dx), (y, dy), camera in zip(
        across[..., columns], down[..., rows], cameras, strict=True
    ):
        center = np.stack((x, y, np.full(len(rows), camera.bundle.center[2])), axis=-1)
        direction = np.stack((dx, dy, np.full(len(rows), -1.0)), axis=-1)
        low, high = camera.heights
        with np.errstate(invalid="ignore", over="ignore"):
            met = center + plane_places(corners, normals, center, direction)[:, None] * direction
            drawn: Mask = (met[:, 2] >= low - slack) & (met[:, 2] <= high + slack)
        points[drawn] = met[drawn]
    all_points = np.full((*triangle.shape, 3), np.nan)
    all_points[rows, columns] = points
    return all_points


def _camera_lines(
    scene: Scene, settings: DoubleFrustum, hogel: Indices, pixel: Indices, axis: int
) -> Floats:
    """Return (cameras, 2, N) centers and slopes along an axis of the lines of some pixels."""
    cameras = len(model_cameras(scene.frustum, scene.plate.middle, settings))
    lines = np.full((cameras, 2, len(hogel)), np.nan)
    for number in np.unique(hogel[pixel >= 0]).tolist():
        aperture = scene.plate.aperture(*((number, 0) if axis == 0 else (0, number)))
        here = np.flatnonzero((hogel == number) & (pixel >= 0))
        for line, camera in zip(
            lines, model_cameras(scene.frustum, aperture, settings), strict=True
        ):
            line[0, here] = camera.bundle.center[axis]
            line[1, here] = (camera.bundle.dx, camera.bundle.dy)[axis][pixel[here]]
    return lines


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnHogel:
    """Image of one hogel by any renderer; None for an unknown channel."""

    #: column and row on the plate
    index: tuple[int, int]
    #: (H, W, 3) linear RGB; integers of 8 bits are 255 times the radiance
    color: NDArray[Any] | None = None
    #: (H, W) triangle numbers, `NOTHING` without a surface
    triangle: Numbers | None = None
    #: (H, W) object numbers, `NOTHING` without a surface
    object: Numbers | None = None
    #: (H, W, 3) surface points, scene units
    position: NDArray[np.floating] | None = None


class Collector:
    """Picture of one eye, filled hogel by hogel.

    If the settings of the cameras are known, they give the surface points of named triangles.
    """

    def __init__(
        self, scene: Scene, eye: Eye, taken: Replay, settings: DoubleFrustum | None
    ) -> None:
        self._scene, self._eye, self._taken, self._settings = scene, eye, taken, settings
        width, height = eye.resolution
        self._triangle = np.full((height, width), NOTHING, dtype=np.int32)
        self._object = self._triangle.copy()
        self._position = np.full((height, width, 3), np.nan)
        self._color: Floats | None = None
        self.numbered = False  #: whether any hogel names the triangle or object of its pixels

    def add(self, hogel: DrawnHogel) -> None:
        """Copy the pixels of a hogel that the eye sees."""
        here, there = _blocks(self._taken.shown, hogel.index)
        for picture, values in (
            (self._triangle, hogel.triangle),
            (self._object, hogel.object),
            (self._position, hogel.position),
        ):
            if values is not None:
                picture[here] = values[there]
        self.numbered |= hogel.triangle is not None or hogel.object is not None
        if hogel.color is None:
            return
        if self._color is None:
            self._color = np.zeros(self._position.shape)
        scale = 1 / LEVELS if hogel.color.dtype == np.uint8 else 1.0
        for pixels in self._taken.colors:
            here, there = _blocks(pixels, hogel.index)
            weight = scale * pixels.row_weight[here[0]] * pixels.column_weight[here[1]]
            self._color[here] += weight[..., None] * hogel.color[there].astype(np.float64)

    def finish(self) -> EyeImage:
        """Return the picture of all hogels so far."""
        named = self._triangle != NOTHING
        self._object[named] = self._scene.object_of_triangle[self._triangle[named]]
        position = self._position
        if self._settings is not None:
            points = drawn_points(self._scene, self._settings, self._taken.shown, self._triangle)
            position = np.where(np.isfinite(position), position, points)
        return EyeImage(
            eye=self._eye,
            triangle=self._triangle,
            object=self._object,
            position=position,
            color=None if self._color is None else self._color.astype(np.float32),
        )


def _blocks(pixels: HogelPixels, index: tuple[int, int]) -> tuple[Block, Block]:
    """Return the places of a hogel's pixels in the eye's picture and in the hogel's image."""
    rows = np.flatnonzero((pixels.hogel_row == index[1]) & (pixels.film_row >= 0))
    columns = np.flatnonzero((pixels.hogel_column == index[0]) & (pixels.film_column >= 0))
    return np.ix_(rows, columns), np.ix_(pixels.film_row[rows], pixels.film_column[columns])


def collected(hogels: Iterable[DrawnHogel], collectors: Sequence[Collector]) -> list[EyeImage]:
    """Return the pictures of some eyes from one pass over the hogels."""
    for hogel in hogels:
        for collector in collectors:
            collector.add(hogel)
    return [collector.finish() for collector in collectors]


def film_parts(takes: Iterable[Replay]) -> dict[tuple[int, int], FilmPart]:
    """Return the smallest part of each hogel's film that contains its pixels in some views.

    Hogels, by column and row, are sorted row by row.
    """
    takes, ends = list(takes), (dict[int, tuple[int, int]](), dict[int, tuple[int, int]]())
    for pixels in (part for taken in takes for part in (taken.shown, *taken.colors)):
        across = pixels.hogel_column[pixels.columns], pixels.film_column[pixels.columns]
        down = pixels.hogel_row[pixels.rows], pixels.film_row[pixels.rows]
        for known, (hogel, pixel) in zip(ends, (across, down), strict=True):
            for number, place in zip(hogel.tolist(), pixel.tolist(), strict=True):
                low, high = known.get(number, (place, place))
                known[number] = min(low, place), max(high, place)
    hogels = {index for taken in takes for index in taken.hogels}
    return {
        (column, row): FilmPart(columns=ends[0][column], rows=ends[1][row])
        for column, row in sorted(hogels, key=lambda index: index[::-1])
    }


def drawn_hogels(renderer: PlateRenderer, parts: FilmParts) -> Iterator[DrawnHogel]:
    """Draw parts of hogels and yield them in order; pixels outside of the parts are undefined."""
    plate = renderer.scene.plate
    for hogel in renderer.hogels((plate.aperture(*index) for index in parts), parts):
        yield DrawnHogel(index=hogel.aperture.index, color=hogel.color, triangle=hogel.triangle)


@dataclass(frozen=True)
class Quantiles:
    """Distribution of a quantity over the pixels of an eye."""

    p50: float
    p99: float
    max: float


def _quantiles(values: Floats) -> Quantiles | None:
    """Return quantiles of the finite values; None without finite values."""
    known = values[np.isfinite(values)]
    return Quantiles(*np.percentile(known, (50, 99, 100)).tolist()) if known.size else None


@dataclass(frozen=True, kw_only=True)
class Loss:
    """Difference of a view from its expected view, in numbers."""

    #: number of pixels without a tie
    judged: int
    #: judged pixels with a wrong surface; None if the view names no surfaces
    wrong: int | None
    #: `wrong` divided by `judged`
    fraction: float | None
    #: angle between the shown and the true place of a point
    displacement_arcmin: Quantiles | None
    #: difference in z of the shown and the expected point where both are on one object, scene units
    depth_error: Quantiles | None
    #: mean FLIP, 0 to 1, at the eye's resolution in pixels per degree; None for images without
    #: colors
    flip: float | None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LossMaps(ShortRepr):
    """Difference of a view from its expected view by pixel, (H, W); NaN for no error."""

    judged: Mask
    wrong: Mask | None
    displacement_arcmin: Floats
    depth_error: Floats
    flip: Floats | None

    def numbers(self) -> Loss:
        """Return the loss in numbers, from the maps."""
        judged = int(self.judged.sum())
        wrong = None if self.wrong is None else int(self.wrong.sum())
        moved, depth = self.displacement_arcmin[self.judged], self.depth_error[self.judged]
        return Loss(
            judged=judged,
            wrong=wrong,
            fraction=None if wrong is None else wrong / max(judged, 1),
            displacement_arcmin=_quantiles(moved),
            depth_error=_quantiles(depth),
            flip=None if self.flip is None else float(self.flip.mean()),
        )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Views(ShortRepr):
    """Pictures of one eye: true view (A), replayed truth (B), replayed drawn hogels (C)."""

    true: EyeImage
    replayed: EyeImage
    #: None without a renderer
    drawn: EyeImage | None
    #: the pixels of hogels that B and C show
    taken: Replay

    @property
    def eye(self) -> Eye:
        """The eye."""
        return self.true.eye


def display_loss(reference: EyeReference, views: Views) -> LossMaps:
    """Return the loss of a plate of true hogels against the scene itself (A against B).

    A pixel is wrong if only one of the two views shows a surface there, if the views show different
    objects, or if a surface hides the shown point from the eye. Rays that meet no pixel of a hogel
    are black.
    """
    true, replayed = views.true, views.replayed
    wrong = (true.object != replayed.object) | _hidden(reference, replayed)
    rays = reference.bundle(views.eye).directions()
    return _maps(reference.scene, (true, replayed), np.ones_like(wrong), wrong, rays)


def renderer_loss(reference: EyeReference, views: Views, *, numbered: bool) -> LossMaps:
    """Return the loss of a renderer's hogels against true hogels (B against C).

    Pixels are wrong by the rules of `display_loss`, except for hidden points that true hogels show
    as well. The displacement is the angle between the surface point of a hogel's pixel and the
    point at the same height on the pixel's line. It depends neither on the pitch nor on the pixels
    of hogels. `numbered` is true if the drawn picture names surfaces.
    """
    true, drawn = views.replayed, views.drawn
    assert drawn is not None
    met = np.zeros(true.triangle.shape, dtype=np.bool_)
    met[np.ix_(views.taken.shown.rows, views.taken.shown.columns)] = True
    wrong = None
    if numbered:
        hidden = _hidden(reference, drawn) & ~_hidden(reference, true)
        wrong = (true.object != drawn.object) | hidden
    rays = shown_at(reference.scene, views.taken, drawn) - views.eye.position
    return _maps(reference.scene, (true, drawn), met, wrong, rays)


def _maps(
    scene: Scene, pair: tuple[EyeImage, EyeImage], judged: Mask, wrong: Mask | None, rays: Floats
) -> LossMaps:
    """Return all maps of an expected and a shown view; ties are not judged.

    `rays` (H, W, 3) point from the eye to the true places of the shown points.
    """
    expected, shown = pair
    for image in pair:
        if image.certainty is not None:
            judged = judged & (image.certainty != Certainty.TIE)
    same = (expected.object == shown.object) & (expected.object != NOTHING)
    depth = np.abs(shown.position[..., 2] - expected.position[..., 2])
    seen = shown.position - shown.eye.position
    # The arctangent is exact also for tiny angles.
    angle = np.arctan2(
        np.linalg.norm(np.cross(rays, seen), axis=-1), np.einsum("...i,...i", rays, seen)
    )
    flip = None
    if expected.color is not None and shown.color is not None:
        sharpness = pixels_per_degree(scene, shown.eye)
        difference = perceptual_difference(expected.color, shown.color, sharpness)
        flip = difference.flip_map.astype(np.float64)
    return LossMaps(
        judged=judged,
        wrong=None if wrong is None else wrong & judged,
        displacement_arcmin=angle * ARCMIN_PER_RADIAN,
        depth_error=np.where(same, depth, np.nan),
        flip=flip,
    )


def shown_at(scene: Scene, taken: Replay, shown: EyeImage) -> Floats:
    """Return the places (H, W, 3) on the replayed lines at the heights of the shown points."""
    grid = hogel_lines(scene, taken.shown)
    here = np.ix_(taken.shown.rows, taken.shown.columns)
    places = np.full(shown.position.shape, np.nan)
    places[here] = grid.points() - shown.position[here][..., 2:] * grid.directions()
    return places


def pixels_per_degree(scene: Scene, eye: Eye) -> float:
    """Return the resolution at the middle of an eye's view; InputError if the view is too small."""
    x, _, height = eye.position
    half = scene.plate.size[0] / 2
    degrees = math.degrees(math.atan2(half - x, height) + math.atan2(half + x, height))
    if not degrees * MAX_PIXELS_PER_DEGREE >= eye.resolution[0]:
        raise InputError(
            f"the eye at {','.join(map(digits, eye.position))} sees the plate's width under "
            f"{digits(degrees)} degrees, with more than {MAX_PIXELS_PER_DEGREE:,} pixels a degree: "
            "bring it nearer"
        )
    return eye.resolution[0] / degrees


def _hidden(reference: EyeReference, shown: EyeImage) -> Mask:
    """Return the pixels whose shown point is hidden from the eye."""
    known = np.isfinite(shown.position).all(axis=-1) & (shown.triangle != NOTHING)
    # A hogel is drawn for all eyes: it also shows surfaces at and above the height of this eye.
    behind: Mask = known & (shown.position[..., 2] >= shown.eye.position[2])
    occluded = partial(reference.hidden, shown.eye)
    return behind | hidden_pixels(known & ~behind, shown, reference.scene, occluded)
