"""The loss on the way to an eye: the display's (A against B) and the renderer's (B against C).

Two eyes lose disparity besides: surface points are seen at other depths than their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from xfrustum.compare.metrics.radiance import perceptual_difference
from xfrustum.compare.rounding.positions import position_tolerance
from xfrustum.reference import SurfacePoints
from xfrustum.reference.eye.rays import hogel_lines
from xfrustum.reference.eye.view import EyeReference
from xfrustum.reference.lines.lines import pixel_places
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.eye import Eye, EyeImage, Replay
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook import Brief, digits

ARCMIN_PER_RADIAN = 60 * 180 / math.pi

MAX_PIXELS_PER_DEGREE = 10_000
"""Largest number of an eye's pixels in a degree: eyes resolve 60, and FLIP's filters grow with it."""


@dataclass(frozen=True, kw_only=True)
class Quantiles:
    """How a quantity is distributed over an eye's pixels."""

    p50: float
    p99: float
    max: float

    @classmethod
    def of(cls, values: Floats) -> Quantiles | None:
        """Return the quantiles of the finite ones of some values; None where there are none."""
        known = values[np.isfinite(values)]
        if not known.size:
            return None
        p50, p99 = np.percentile(known, [50, 99])
        return cls(p50=float(p50), p99=float(p99), max=float(known.max()))


@dataclass(frozen=True, kw_only=True)
class Loss:
    """How one view differs from the one that it stands for, in numbers.

    Attributes
    ----------
    judged
        Number of pixels that are judged: those that are no ties.
    wrong, fraction
        Number of judged pixels that show a wrong surface, and their share; None where the shown view does
        not say what it shows.
    displacement_arcmin
        Angle at the eye between where a surface point is shown and where it belongs.
    depth_error
        Distance in depth between the surface points that both views show along the same ray, where these
        belong to one object; scene units.
    flip
        Mean FLIP at the eye's pixels per degree; None where there are no colors.
    """

    judged: int
    wrong: int | None
    fraction: float | None
    displacement_arcmin: Quantiles | None
    depth_error: Quantiles | None
    flip: float | None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LossMaps(Brief):
    """The same pixel by pixel, (H, W).

    Attributes
    ----------
    judged, wrong
        Pixels that are judged, and those of them that show a wrong surface.
    displacement_arcmin, depth_error
        As in `Loss`; NaN where there is none.
    flip
        FLIP of each pixel; None where there are no colors.
    """

    judged: Mask
    wrong: Mask | None
    displacement_arcmin: Floats
    depth_error: Floats
    flip: Floats | None

    def numbers(self) -> Loss:
        """Return the maps in numbers."""
        judged = int(self.judged.sum())
        wrong = None if self.wrong is None else int(self.wrong.sum())
        return Loss(
            judged=judged,
            wrong=wrong,
            fraction=None if wrong is None else wrong / judged if judged else 0.0,
            displacement_arcmin=Quantiles.of(self.displacement_arcmin[self.judged]),
            depth_error=Quantiles.of(self.depth_error[self.judged]),
            flip=None if self.flip is None else float(self.flip.mean()),
        )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Views(Brief):
    """The three pictures of one eye.

    Attributes
    ----------
    true, replayed, drawn
        A, B and C: the true view, the replayed truth, and the replayed hogels of a renderer; None where no
        renderer is judged.
    taken
        The pixels of hogels that the eye is shown.
    """

    true: EyeImage
    replayed: EyeImage
    drawn: EyeImage | None
    taken: Replay

    @property
    def eye(self) -> Eye:
        """The eye."""
        return self.true.eye


def display_loss(reference: EyeReference, views: Views) -> LossMaps:
    """Return what a plate of true hogels loses against the scene itself (A against B).

    A pixel is wrong if only one of the views shows a surface there, if they show different objects, or if the
    eye could not see the point that is shown: something else is in front of it. Rays that meet no pixel of a
    hogel are shown black.
    """
    true, shown = views.true, views.replayed
    judged = _untied(true, shown)
    other, hidden = _other(true, shown), _hidden(reference, shown)
    rays = reference.pencil(views.eye).directions()
    direction = shown.position - np.array(views.eye.position)
    moved = _angle(rays, direction)
    return LossMaps(
        judged=judged,
        wrong=(other | hidden) & judged,
        displacement_arcmin=moved * ARCMIN_PER_RADIAN,
        depth_error=_depth_error(true, shown),
        flip=_flip(reference.scene, true, shown),
    )


def renderer_loss(reference: EyeReference, views: Views, *, numbered: bool) -> LossMaps:
    """Return what a renderer's hogels lose against true ones (B against C).

    A pixel is wrong as for `display_loss`, but points that true hogels show although the eye could not see
    them are not charged to the renderer. A displacement is the angle between the point that a hogel's pixel
    shows and the place on that pixel's line, at the same height, at which it shows it. So neither pitch nor
    pixels of hogels are in it.

    Parameters
    ----------
    reference
        Truth of the scene.
    views
        All three pictures.
    numbered
        Whether the drawn picture says which triangle or object it shows.
    """
    true, shown = views.replayed, views.drawn
    assert shown is not None
    met = np.zeros(true.triangle.shape, dtype=np.bool_)
    met[np.ix_(views.taken.shown.rows, views.taken.shown.columns)] = True
    judged = _untied(true, shown) & met
    wrong = None
    if numbered:
        hidden = _hidden(reference, shown) & ~_hidden(reference, true)
        wrong = (_other(true, shown) | hidden) & judged
    eye = np.array(views.eye.position)
    at = shown_at(reference.scene, views.taken, shown)
    moved = _angle(at - eye, shown.position - eye)
    return LossMaps(
        judged=judged,
        wrong=wrong,
        displacement_arcmin=moved * ARCMIN_PER_RADIAN,
        depth_error=_depth_error(true, shown),
        flip=_flip(reference.scene, true, shown),
    )


def shown_at(scene: Scene, taken: Replay, shown: EyeImage) -> Floats:
    """Return the places (H, W, 3) on the replayed lines at the heights of the points that they show."""
    grid = hogel_lines(scene, taken.shown)
    here = np.ix_(taken.shown.rows, taken.shown.columns)
    places = np.full(shown.position.shape, np.nan)
    places[here] = grid.points() - shown.position[here][..., 2:] * grid.directions()
    return places


def pixels_per_degree(scene: Scene, eye: Eye) -> float:
    """Return how many of an eye's pixels a degree of its view holds, in the middle of the plate's width.

    Raises
    ------
    InputError
        The eye sees the plate under so small an angle that there are more than `MAX_PIXELS_PER_DEGREE`.
    """
    x, _, height = eye.position
    half = scene.plate.size[0] / 2
    seen = math.degrees(math.atan2(half - x, height) + math.atan2(half + x, height))
    if not seen * MAX_PIXELS_PER_DEGREE >= eye.resolution[0]:
        raise InputError(
            f"the eye at {','.join(map(digits, eye.position))} sees the plate's width under {digits(seen)} "
            f"degrees, with more than {MAX_PIXELS_PER_DEGREE:,} pixels a degree: bring it nearer"
        )
    return eye.resolution[0] / seen


def _untied(one: EyeImage, other: EyeImage) -> Mask:
    untied = np.ones(one.triangle.shape, dtype=np.bool_)
    for image in (one, other):
        if image.certainty is not None:
            untied &= image.certainty != Certainty.TIE
    return untied


def _other(expected: EyeImage, shown: EyeImage) -> Mask:
    """Return the pixels that show a surface where none is expected, none, or another object's."""
    return np.asarray(expected.object != shown.object)


def _hidden(reference: EyeReference, shown: EyeImage) -> Mask:
    """Return the pixels that show a point which the eye could not see, for something is in front of it."""
    hidden = np.zeros(shown.triangle.shape, dtype=np.bool_)
    known = np.isfinite(shown.position).all(axis=-1) & (shown.triangle != NOTHING)
    # Hogels do not know where the eye is: they show what lies beside it and behind it too.
    behind = known & (shown.position[..., 2] >= shown.eye.position[2])
    hidden[behind] = True
    asked = np.flatnonzero(known & ~behind)
    position = shown.position.reshape(-1, 3)[asked]
    number = shown.triangle.ravel()[asked]
    tolerance = position_tolerance(reference.scene, number, position)
    points = SurfacePoints(position=position, triangle=number, tolerance=tolerance)
    hidden.flat[asked] = reference.hidden(shown.eye, points)
    return hidden


def _depth_error(expected: EyeImage, shown: EyeImage) -> Floats:
    same = (expected.object == shown.object) & (expected.object != NOTHING)
    return np.where(same, np.abs(shown.position[..., 2] - expected.position[..., 2]), np.nan)


def _angle(a: Floats, b: Floats) -> Floats:
    """Return the angles between vectors (H, W, 3), radians, exact also where they are tiny."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.einsum("...i,...i", a, b)))


def _flip(scene: Scene, expected: EyeImage, shown: EyeImage) -> Floats | None:
    if expected.color is None or shown.color is None:
        return None
    per_degree = pixels_per_degree(scene, shown.eye)
    return perceptual_difference(expected.color, shown.color, per_degree).flip_map.astype(np.float64)


SAME_PLACE = 2.0
"""Distance between two surface points that count as one, in widths of what a pixel of the eye sees there and
of a hogel together: the point that one eye is shown lies between the pixels of the other."""


@dataclass(frozen=True, kw_only=True)
class Disparity:
    """How far off two eyes see surface points that both are shown.

    Attributes
    ----------
    matched
        Number of pixels of the left eye whose surface point the right eye is shown too.
    disparity_arcmin
        Absolute error of the disparity.
    depth
        Shown minus true distance from the eyes that the disparity makes, scene units: positive where a point
        is seen too far away.
    change_arcsec
        Shown minus true disparity, arc seconds: negative where a point is seen too far away.
    """

    matched: int
    disparity_arcmin: Quantiles | None
    depth: DepthShift | None
    change_arcsec: DepthShift | None = None


@dataclass(frozen=True, kw_only=True)
class DepthShift:
    """How a distance in depth, or what makes it, is distributed, with its sign."""

    p1: float
    p50: float
    p99: float

    @classmethod
    def of(cls, values: Floats) -> DepthShift | None:
        """Return the distribution of the finite ones of some values; None where there are none."""
        known = values[np.isfinite(values)]
        if not known.size:
            return None
        p1, p50, p99 = np.percentile(known, [1, 50, 99])
        return cls(p1=float(p1), p50=float(p50), p99=float(p99))


def disparity(reference: EyeReference, left: Views, right: Views) -> tuple[Disparity, Disparity | None]:
    """Return what the display and what the renderer does to the disparity of two eyes.

    The error of one eye is the slope under which it is shown a point minus that of the point itself; for the
    renderer it is measured along the lines of hogels' pixels, so that pitch and pixels are not in it. The
    difference of both eyes' errors is that of disparity.

    Raises
    ------
    InputError
        The eyes are not side by side: at one height, and at different x.
    """
    (x, y, height), other = left.eye.position, right.eye.position
    if not (x < other[0] and y == other[1] and height == other[2]):
        raise InputError(
            "two eyes need positions side by side: the left one first, the same Y and the same Z"
        )
    display = _disparity(reference, (left, right), [_ray_error(reference, one) for one in (left, right)])
    drawn = None
    if left.drawn is not None and right.drawn is not None:
        drawn = _disparity(
            reference,
            (left, right),
            [_line_error(reference, one, image) for one, image in ((left, left.drawn), (right, right.drawn))],
        )
    return display, drawn


def _ray_error(reference: EyeReference, views: Views) -> tuple[EyeImage, Floats]:
    """Return a replayed view, and the slope of its rays minus those of the points that it shows."""
    image = views.replayed
    return image, reference.pencil(views.eye).dx - _slope(views, image.position, image.position)


def _line_error(reference: EyeReference, views: Views, image: EyeImage) -> tuple[EyeImage, Floats]:
    """Return a drawn view, and the slopes of where its lines show points minus those of the points."""
    at = shown_at(reference.scene, views.taken, image)
    return image, _slope(views, at, image.position) - _slope(views, image.position, image.position)


def _slope(views: Views, place: Floats, height_of: Floats) -> Floats:
    x, _, height = views.eye.position
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((place[..., 0] - x) / (height - height_of[..., 2]))


def _disparity(
    reference: EyeReference, views: tuple[Views, Views], shown: list[tuple[EyeImage, Floats]]
) -> Disparity:
    (left, left_error), (right, right_error) = shown
    base = views[1].eye.position[0] - views[0].eye.position[0]
    height = views[0].eye.position[2]
    pencil = reference.pencil(views[1].eye)
    # Where the right eye has the pixel that truly shows each point of the left one.
    place = np.nan_to_num(pixel_places(left.position, pencil), nan=-1.0, posinf=-1.0, neginf=-1.0)
    column, row = (np.floor(np.clip(place[..., axis], -1.0, 1e6) + 0.5).astype(int) for axis in range(2))
    width, rows = views[1].eye.resolution
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < rows)
    column, row = np.where(inside, column, 0), np.where(inside, row, 0)
    distance = height - left.position[..., 2]
    pitch = reference.scene.plate.size[0] / reference.scene.plate.hogels[0]
    near = SAME_PLACE * (distance * 2 * pencil.half_extent[0] / width + pitch)
    apart = np.linalg.norm(left.position - right.position[row, column], axis=-1)
    same = inside & (left.object != NOTHING) & (left.object == right.object[row, column]) & (apart <= near)
    error = np.where(same, left_error - right_error[row, column], np.nan)
    # Disparity is base / distance; the shown one belongs to another distance.
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = base / (base / distance + error)
    return Disparity(
        matched=int(np.isfinite(error).sum()),
        disparity_arcmin=Quantiles.of(np.abs(error) * ARCMIN_PER_RADIAN),
        depth=DepthShift.of(np.where(seen > 0, seen - distance, np.nan)),
        change_arcsec=DepthShift.of(60 * ARCMIN_PER_RADIAN * error),
    )
