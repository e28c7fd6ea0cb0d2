"""The way to an eye: pixels of hogels that it is shown, and what the display and the renderer lose on it.

The display's loss is that of the replayed truth against the true view (A against B), the renderer's
that of drawn hogels against true ones (B against C). Two eyes lose disparity besides: they see
surface points at other depths than their own.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from xfrustum.compare.metrics.error_maps import hidden_pixels
from xfrustum.compare.metrics.radiance import perceptual_difference
from xfrustum.compare.renderer_model.pictures import COLOR_TOLERANCE
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reference.eye.view import EyeReference, hogel_lines
from xfrustum.reference.lines.lines import model_cameras, pixel_places
from xfrustum.reference.lines.triangles import plane_places, triangle_normals
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.eye import Eye, EyeImage, HogelPixels, Replay
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty
from xfrustum.scenes.model.plate_content import ColorType, FilmPart
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook import ShortRepr, digits
from xfrustum.scenes.plate.double_frustum import DoubleFrustum

T = TypeVar("T")
Block = tuple[Indices, Indices]  #: rows (R, 1) and columns (1, C) of pixels of a picture

LEVELS = 255  #: value that stands for radiance one where color is stored in 8 bits

DEFAULT_COLOR = ColorType.FLOAT16
"""Type of color that hogels are drawn in: that of stored plates, so that both show the same pixels."""

HEIGHT_TOLERANCE = 2.0**-16
"""Distance beyond a camera's ends at which a point still counts as drawn by it, as a part of the reach: cuts
are made in float32, on slopes that make a rounding of 2^-24 some hundred times as large."""


def drawn_points(
    scene: Scene, settings: DoubleFrustum, pixels: HogelPixels, triangle: Numbers
) -> Floats:
    """Return surface points (H, W, 3) of triangle numbers (H, W), scene units; NaN where nothing is shown.

    Each lies where the line of the camera that drew it meets the plane of its triangle. Of several
    cameras between whose ends that is, the one drawn last shows.
    """
    found = np.full((*triangle.shape, 3), np.nan)
    rows, columns = np.nonzero(triangle != NOTHING)
    if not len(rows):
        return found
    corners = scene.triangles[triangle[rows, columns]]
    normals = triangle_normals(corners)
    slack = HEIGHT_TOLERANCE * scene.frustum.longest_reach
    points = np.full((len(rows), 3), np.nan)
    across = _camera_lines(scene, settings, pixels.hogel_column, pixels.film_column, 0)
    down = _camera_lines(scene, settings, pixels.hogel_row, pixels.film_row, 1)
    for (x, dx, height, ends), (y, dy, _, _) in zip(across, down, strict=True):
        center = np.stack((x[columns], y[rows], np.full(len(rows), height)), axis=-1)
        direction = np.stack((dx[columns], dy[rows], np.full(len(rows), -1.0)), axis=-1)
        with np.errstate(invalid="ignore", over="ignore"):
            met = center + plane_places(corners, normals, center, direction)[:, None] * direction
            drawn: Mask = (met[:, 2] >= ends[0] - slack) & (met[:, 2] <= ends[1] + slack)
        points[drawn] = met[drawn]
    found[rows, columns] = points
    return found


def _camera_lines(
    scene: Scene, settings: DoubleFrustum, hogel: Indices, pixel: Indices, axis: int
) -> list[tuple[Floats, Floats, float, tuple[float, float]]]:
    """Return for each camera in drawing order its place and slopes along an axis, its height and its ends."""
    used = np.unique(hogel[pixel >= 0]).tolist()
    lines: list[tuple[Floats, Floats, float, tuple[float, float]]] = []
    for number in used:
        aperture = scene.plate.aperture(*((number, 0) if axis == 0 else (0, number)))
        here = np.flatnonzero((hogel == number) & (pixel >= 0))
        for index, camera in enumerate(model_cameras(scene.frustum, aperture, settings)):
            bundle = camera.bundle
            if index == len(lines):
                none = np.full(len(hogel), np.nan)
                lines.append((none, none.copy(), bundle.center[2], camera.heights))
            lines[index][0][here] = bundle.center[axis]
            lines[index][1][here] = (bundle.dx, bundle.dy)[axis][pixel[here]]
    return lines


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnHogel:
    """The image of one hogel by any renderer; None for what it does not say."""

    index: tuple[int, int]  #: column and row on the plate
    color: NDArray[Any] | None = (
        None  #: (H, W, 3) linear RGB; integers of 8 bits are 255 times the radiance
    )
    triangle: Numbers | None = None
    object: Numbers | None = None
    position: NDArray[np.floating] | None = None  #: (H, W, 3) surface points, scene units


class Collector:
    """What one eye is shown of its pixels of hogels, filled in hogel by hogel.

    Pixels have their triangles' surface points by the cameras' settings, where these are known.
    """

    def __init__(
        self, scene: Scene, eye: Eye, taken: Replay, settings: DoubleFrustum | None
    ) -> None:
        self._scene, self._eye, self._taken, self._settings = scene, eye, taken, settings
        width, height = eye.resolution
        self._triangle = np.full((height, width), NOTHING, dtype=np.int32)
        self._object = self._triangle.copy()
        self._position = np.full((height, width, 3), np.nan)
        self._color = np.zeros((height, width, 3))
        self._colored = False
        self.numbered = False  # whether any hogel said which triangle or object its pixels show

    def add(self, hogel: DrawnHogel) -> None:
        """Take the pixels of a hogel that the eye is shown."""
        here, there = _blocks(self._taken.shown, hogel.index)
        if hogel.triangle is not None:
            self._triangle[here] = hogel.triangle[there]
            self.numbered = True
        if hogel.object is not None:
            self._object[here] = hogel.object[there]
            self.numbered = True
        if hogel.position is not None:
            self._position[here] = hogel.position[there]
        if hogel.color is not None:
            self._colored = True
            scale = 1 / LEVELS if hogel.color.dtype == np.uint8 else 1.0
            for pixels in self._taken.colors:
                here, there = _blocks(pixels, hogel.index)
                weight = pixels.row_weight[here[0]] * pixels.column_weight[here[1]]
                self._color[here] += (scale * weight)[..., None] * hogel.color[there].astype(
                    np.float64
                )

    def finish(self) -> EyeImage:
        """Return the picture of all hogels that were added."""
        named = self._triangle != NOTHING
        self._object[named] = self._scene.object_of_triangle[self._triangle[named]]
        position: Floats = self._position
        if self._settings is not None:
            points = drawn_points(self._scene, self._settings, self._taken.shown, self._triangle)
            position = np.where(np.isfinite(position), position, points)
        return EyeImage(
            eye=self._eye,
            triangle=self._triangle,
            object=self._object,
            position=position,
            color=self._color.astype(np.float32) if self._colored else None,
        )


def _blocks(pixels: HogelPixels, index: tuple[int, int]) -> tuple[Block, Block]:
    """Return the places of a hogel's pixels in the eye's picture, and in the hogel's."""
    rows = np.flatnonzero((pixels.hogel_row == index[1]) & (pixels.film_row >= 0))
    columns = np.flatnonzero((pixels.hogel_column == index[0]) & (pixels.film_column >= 0))
    return (rows[:, None], columns[None]), (
        pixels.film_row[rows][:, None],
        pixels.film_column[columns][None],
    )


def collected(hogels: Iterable[DrawnHogel], collectors: Sequence[Collector]) -> list[EyeImage]:
    """Return the pictures of some eyes, each hogel looked at once."""
    for hogel in hogels:
        for collector in collectors:
            collector.add(hogel)
    return [collector.finish() for collector in collectors]


def hogels_of(takes: Iterable[Replay]) -> list[tuple[int, int]]:
    """Return column and row of all hogels that any of some eyes is shown, row by row."""
    every = {index for taken in takes for index in taken.hogels}
    return sorted(every, key=lambda index: (index[1], index[0]))


def film_parts(takes: Iterable[Replay]) -> dict[tuple[int, int], FilmPart]:
    """Return the part of each hogel's film that holds all pixels that some eyes are shown."""
    columns, rows = dict[int, list[int]](), dict[int, list[int]]()
    every = list(takes)
    for one in (pixels for taken in every for pixels in (taken.shown, *taken.colors)):
        for known, hogel, pixel in (
            (columns, one.hogel_column[one.columns], one.film_column[one.columns]),
            (rows, one.hogel_row[one.rows], one.film_row[one.rows]),
        ):
            for number in np.unique(hogel).tolist():
                known.setdefault(number, []).extend(pixel[hogel == number].tolist())

    def ends(pixels: list[int]) -> tuple[int, int]:
        return min(pixels), max(pixels)

    return {
        (i, j): FilmPart(columns=ends(columns[i]), rows=ends(rows[j])) for i, j in hogels_of(every)
    }


def drawn_hogels(
    renderer: PlateRenderer, parts: Mapping[tuple[int, int], FilmPart]
) -> Iterator[DrawnHogel]:
    """Draw parts of hogels and yield them in order; pixels outside of the parts mean nothing."""
    plate = renderer.scene.plate
    for hogel in renderer.hogels((plate.aperture(*index) for index in parts), parts):
        yield DrawnHogel(index=hogel.aperture.index, color=hogel.color, triangle=hogel.triangle)


ARCMIN_PER_RADIAN = 60 * 180 / math.pi

MAX_PIXELS_PER_DEGREE = 10_000
"""Largest number of an eye's pixels in a degree: eyes resolve 60, and FLIP's filters grow with it."""

SAME_PLACE = 2.0
"""Distance between two surface points that count as one, in widths of what a pixel of the eye sees there and
of a hogel together: the point that one eye is shown lies between the pixels of the other."""


@dataclass(frozen=True)
class Quantiles:
    """How a quantity is distributed over an eye's pixels."""

    p50: float
    p99: float
    max: float


@dataclass(frozen=True)
class DepthShift:
    """How a distance in depth, or what makes it, is distributed, with its sign."""

    p1: float
    p50: float
    p99: float


def _spread(kind: type[T], values: Floats, *percents: float) -> T | None:
    """Return percentiles of the finite ones of some values; None where there are none."""
    known = values[np.isfinite(values)]
    return kind(*map(float, np.percentile(known, percents))) if known.size else None


@dataclass(frozen=True, kw_only=True)
class Loss:
    """How one view differs from the one that it stands for, in numbers."""

    judged: int  #: pixels that are no ties, and of these
    wrong: (
        int | None
    )  #: those with a wrong surface; None where the shown view does not say what it shows
    fraction: float | None
    displacement_arcmin: (
        Quantiles | None
    )  #: angle between where a point is shown and where it belongs
    depth_error: (
        Quantiles | None
    )  #: distance in depth of points of one object on the same ray, scene units
    flip: float | None  #: mean FLIP at the eye's pixels per degree; None where there are no colors
    color_fraction: float | None  #: share of the judged pixels whose color differs
    #: Of these the share whose color is nowhere within `SHIFT_PX`: other shading, for nothing has
    #: moved there
    shading: float | None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LossMaps(ShortRepr):
    """The same pixel by pixel, (H, W); NaN where there is no such error."""

    judged: Mask
    wrong: Mask | None
    displacement_arcmin: Floats
    depth_error: Floats
    flip: Floats | None
    recolored: tuple[Mask, Mask] | None  #: see `_recolored`

    def numbers(self) -> Loss:
        """Return the maps in numbers."""
        judged, differ, shaded = int(self.judged.sum()), 0, 0
        if self.recolored:
            differ, shaded = (int((one & self.judged).sum()) for one in self.recolored)
        wrong = None if self.wrong is None else int(self.wrong.sum())
        return Loss(
            judged=judged,
            wrong=wrong,
            fraction=None if wrong is None else wrong / judged if judged else 0.0,
            displacement_arcmin=_spread(
                Quantiles, self.displacement_arcmin[self.judged], 50, 99, 100
            ),
            depth_error=_spread(Quantiles, self.depth_error[self.judged], 50, 99, 100),
            flip=None if self.flip is None else float(self.flip.mean()),
            color_fraction=None if self.recolored is None else differ / max(judged, 1),
            shading=shaded / differ if differ else None,
        )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Views(ShortRepr):
    """The pictures of one eye: A, the true view; B, the replayed truth; C, the replayed drawn hogels."""

    true: EyeImage
    replayed: EyeImage
    drawn: EyeImage | None  #: None where no renderer is judged
    taken: Replay  #: the pixels of hogels that the eye is shown

    @property
    def eye(self) -> Eye:
        """The eye."""
        return self.true.eye


Pair = tuple[EyeImage, EyeImage]  #: an expected and a shown view


def display_loss(reference: EyeReference, views: Views) -> LossMaps:
    """Return what a plate of true hogels loses against the scene itself (A against B).

    A pixel is wrong if only one of the views shows a surface there, if they show different objects,
    or if the eye could not see the point that is shown: something else is in front of it. Rays that
    meet no pixel of a hogel are shown black.
    """
    true, shown = views.true, views.replayed
    wrong = (true.object != shown.object) | _hidden(reference, shown)
    rays = reference.bundle(views.eye).directions()
    moved = _angle(rays, shown.position - np.array(views.eye.position))
    return _maps(reference.scene, (true, shown), np.ones_like(wrong), wrong, moved)


def renderer_loss(reference: EyeReference, views: Views, *, numbered: bool) -> LossMaps:
    """Return what a renderer's hogels lose against true ones (B against C).

    A pixel is wrong as for `display_loss`, but points that true hogels show although the eye could
    not see them are not charged to the renderer. A displacement is the angle between the point that
    a hogel's pixel shows and the place on that pixel's line, at the same height, at which it shows
    it. So neither pitch nor pixels of hogels are in it. `numbered` says whether the drawn picture
    says what it shows.
    """
    true, shown = views.replayed, views.drawn
    assert shown is not None
    met = np.zeros(true.triangle.shape, dtype=np.bool_)
    met[np.ix_(views.taken.shown.rows, views.taken.shown.columns)] = True
    wrong = None
    if numbered:
        hidden = _hidden(reference, shown) & ~_hidden(reference, true)
        wrong = (true.object != shown.object) | hidden
    eye, at = np.array(views.eye.position), shown_at(reference.scene, views.taken, shown)
    moved = _angle(at - eye, shown.position - eye)
    return _maps(reference.scene, (true, shown), met, wrong, moved)


def _maps(scene: Scene, pair: Pair, asked: Mask, wrong: Mask | None, moved: Floats) -> LossMaps:
    """Return all maps of two views; pixels that are asked for are judged unless they are ties."""
    (expected, shown), judged = pair, asked
    for one in pair:
        judged = judged if one.certainty is None else judged & (one.certainty != Certainty.TIE)
    same = (expected.object == shown.object) & (expected.object != NOTHING)
    flip = recolored = None
    if expected.color is not None and shown.color is not None:
        per_degree = pixels_per_degree(scene, shown.eye)
        flip = perceptual_difference(expected.color, shown.color, per_degree).flip_map.astype(
            np.float64
        )
        recolored = _recolored(expected.color, shown.color)
    return LossMaps(
        judged=judged,
        wrong=None if wrong is None else wrong & judged,
        displacement_arcmin=moved * ARCMIN_PER_RADIAN,
        depth_error=np.where(
            same, np.abs(shown.position[..., 2] - expected.position[..., 2]), np.nan
        ),
        flip=flip,
        recolored=recolored,
    )


SHIFT_PX = 2  #: displacement on an eye's film, of which a color tells nothing of shading


def _recolored(expected: ArrayLike, shown: ArrayLike) -> tuple[Mask, Mask]:
    """Return which pixels (H, W) have another color than expected, and which of them by other shading.

    The color of the latter lies outside the colors that are expected up to `SHIFT_PX` away. Near
    outlines these reach from one surface to the other, so that there all may be displacement.
    """
    true, found = (
        np.clip(np.asarray(one, dtype=np.float64), 0.0, 1.0) for one in (expected, shown)
    )
    size = (2 * SHIFT_PX + 1, 2 * SHIFT_PX + 1, 1)
    low, high = minimum_filter(true, size), maximum_filter(true, size)
    differ = np.abs(found - true).max(axis=-1) > COLOR_TOLERANCE
    beyond = np.maximum(found - high, low - found).max(axis=-1) > COLOR_TOLERANCE
    return differ, differ & beyond


def shown_at(scene: Scene, taken: Replay, shown: EyeImage) -> Floats:
    """Return the places (H, W, 3) on the replayed lines at the heights of the points that they show."""
    grid = hogel_lines(scene, taken.shown)
    here = np.ix_(taken.shown.rows, taken.shown.columns)
    places = np.full(shown.position.shape, np.nan)
    places[here] = grid.points() - shown.position[here][..., 2:] * grid.directions()
    return places


def pixels_per_degree(scene: Scene, eye: Eye) -> float:
    """Return the pixels in a degree at the middle of an eye's view; InputError where it is seen too small."""
    x, _, height = eye.position
    half = scene.plate.size[0] / 2
    seen = math.degrees(math.atan2(half - x, height) + math.atan2(half + x, height))
    if not seen * MAX_PIXELS_PER_DEGREE >= eye.resolution[0]:
        raise InputError(
            f"the eye at {','.join(map(digits, eye.position))} sees the plate's width under {digits(seen)} "
            f"degrees, with more than {MAX_PIXELS_PER_DEGREE:,} pixels a degree: bring it nearer"
        )
    return eye.resolution[0] / seen


def _hidden(reference: EyeReference, shown: EyeImage) -> Mask:
    """Return the pixels that show a point which the eye could not see, for something is in front of it."""
    known = np.isfinite(shown.position).all(axis=-1) & (shown.triangle != NOTHING)
    # Hogels do not know where the eye is: they show what lies beside it and behind it too.
    behind: Mask = known & (shown.position[..., 2] >= shown.eye.position[2])
    occluded = partial(reference.hidden, shown.eye)
    return behind | hidden_pixels(known & ~behind, shown, reference.scene, occluded)


def _angle(a: Floats, b: Floats) -> Floats:
    """Return the angles between vectors (H, W, 3), radians, exact also where they are tiny."""
    return np.asarray(
        np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.einsum("...i,...i", a, b))
    )


Sloped = list[
    tuple[EyeImage, Floats]
]  #: the shown view of each eye, with its errors of slope (H, W)


@dataclass(frozen=True, kw_only=True)
class Disparity:
    """How far off two eyes see surface points that both are shown."""

    matched: int  #: pixels of the left eye whose surface point the right eye is shown too
    disparity_arcmin: Quantiles | None  #: absolute error of the disparity
    depth: DepthShift | None  #: shown minus true distance from the eyes that follows, scene units
    change_arcsec: DepthShift | None = (
        None  #: shown minus true disparity, negative where seen too far away
    )


def disparity(
    reference: EyeReference, left: Views, right: Views
) -> tuple[Disparity, Disparity | None]:
    """Return what the display and what the renderer does to the disparity of two eyes.

    The error of one eye is the slope under which it is shown a point minus that of the point
    itself; for the renderer it is measured along the lines of hogels' pixels, so that pitch and
    pixels are not in it. The difference of both eyes' errors is that of disparity. InputError where
    the eyes are not side by side: at one height, and at different x.
    """
    (x, y, height), other = left.eye.position, right.eye.position
    if not (x < other[0] and y == other[1] and height == other[2]):
        told = "two eyes need positions side by side: the left one first, the same Y and the same Z"
        raise InputError(told)

    def slope(views: Views, place: Floats, z: Floats) -> Floats:
        """Return the slope along x under which an eye sees places, taken at other points' heights."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray((place[..., 0] - views.eye.position[0]) / (height - z[..., 2]))

    by_display, by_renderer = Sloped(), Sloped()
    for views in (left, right):
        replayed, drawn = views.replayed, views.drawn
        own = slope(views, replayed.position, replayed.position)
        by_display.append((replayed, reference.bundle(views.eye).dx - own))
        if drawn is not None:
            at, own = shown_at(reference.scene, views.taken, drawn), drawn.position
            by_renderer.append((drawn, slope(views, at, own) - slope(views, own, own)))
    eyes = left.eye, right.eye
    lost = _disparity(reference, eyes, by_display)
    return lost, _disparity(reference, eyes, by_renderer) if len(by_renderer) == len(eyes) else None


def _disparity(reference: EyeReference, eyes: tuple[Eye, Eye], shown: Sloped) -> Disparity:
    """Return the disparity that the errors of slope of two shown views make."""
    (left, left_error), (right, right_error) = shown
    base, bundle = eyes[1].position[0] - eyes[0].position[0], reference.bundle(eyes[1])
    # Where the right eye has the pixel that truly shows each point of the left one.
    place = np.nan_to_num(pixel_places(left.position, bundle), nan=-1.0, posinf=-1.0, neginf=-1.0)
    column, row = (
        np.floor(np.clip(place[..., axis], -1.0, 1e6) + 0.5).astype(int) for axis in range(2)
    )
    width, rows = eyes[1].resolution
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < rows)
    column, row = np.where(inside, column, 0), np.where(inside, row, 0)
    distance = eyes[0].position[2] - left.position[..., 2]
    pitch = reference.scene.plate.size[0] / reference.scene.plate.hogels[0]
    near = SAME_PLACE * (distance * 2 * bundle.half_extent[0] / width + pitch)
    apart = np.linalg.norm(left.position - right.position[row, column], axis=-1)
    same = (
        inside
        & (left.object != NOTHING)
        & (left.object == right.object[row, column])
        & (apart <= near)
    )
    error = np.where(same, left_error - right_error[row, column], np.nan)
    # Disparity is base / distance; the shown one belongs to another distance.
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = base / (base / distance + error)
    return Disparity(
        matched=int(np.isfinite(error).sum()),
        disparity_arcmin=_spread(Quantiles, np.abs(error) * ARCMIN_PER_RADIAN, 50, 99, 100),
        depth=_spread(DepthShift, np.where(seen > 0, seen - distance, np.nan), 1, 50, 99),
        change_arcsec=_spread(DepthShift, 60 * ARCMIN_PER_RADIAN * error, 1, 50, 99),
    )
