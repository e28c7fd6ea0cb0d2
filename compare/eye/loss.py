"""The loss on the way to an eye: the display's (A against B) and the renderer's (B against C).

Two eyes lose disparity besides: surface points are seen at other depths than their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

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

SAME_PLACE = 2.0
"""Distance between two surface points that count as one, in widths of what a pixel of the eye sees there and
of a hogel together: the point that one eye is shown lies between the pixels of the other."""


@dataclass(frozen=True)
class Quantiles:
    """How a quantity is distributed over an eye's pixels."""

    p50: float
    p99: float
    max: float

    @classmethod
    def of(cls, values: Floats) -> Self | None:
        """Return the quantiles of the finite ones of some values; None where there are none."""
        known = values[np.isfinite(values)]
        return cls(*map(float, np.percentile(known, [50, 99, 100]))) if known.size else None


@dataclass(frozen=True)
class DepthShift:
    """How a distance in depth, or what makes it, is distributed, with its sign."""

    p1: float
    p50: float
    p99: float

    @classmethod
    def of(cls, values: Floats) -> Self | None:
        """Return the distribution of the finite ones of some values; None where there are none."""
        known = values[np.isfinite(values)]
        return cls(*map(float, np.percentile(known, [1, 50, 99]))) if known.size else None


@dataclass(frozen=True, kw_only=True)
class Loss:
    """How one view differs from the one that it stands for, in numbers."""

    judged: int  #: pixels that are no ties, and of these
    wrong: int | None  #: those with a wrong surface; None where the shown view does not say what it shows
    fraction: float | None
    displacement_arcmin: Quantiles | None  #: angle between where a point is shown and where it belongs
    depth_error: Quantiles | None  #: distance in depth of points of one object on the same ray, scene units
    flip: float | None  #: mean FLIP at the eye's pixels per degree; None where there are no colors


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LossMaps(Brief):
    """The same pixel by pixel, (H, W); NaN where there is no such error."""

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
    """The pictures of one eye: A, the true view; B, the replayed truth; C, the replayed drawn hogels."""

    true: EyeImage
    replayed: EyeImage
    drawn: EyeImage | None  #: None where no renderer is judged
    taken: Replay  #: the pixels of hogels that the eye is shown

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
    wrong = (true.object != shown.object) | _hidden(reference, shown)
    rays = reference.pencil(views.eye).directions()
    moved = _angle(rays, shown.position - np.array(views.eye.position))
    return _maps(reference.scene, (true, shown), _untied(true, shown), wrong, moved)


def renderer_loss(reference: EyeReference, views: Views, *, numbered: bool) -> LossMaps:
    """Return what a renderer's hogels lose against true ones (B against C).

    A pixel is wrong as for `display_loss`, but points that true hogels show although the eye could not see
    them are not charged to the renderer. A displacement is the angle between the point that a hogel's pixel
    shows and the place on that pixel's line, at the same height, at which it shows it. So neither pitch nor
    pixels of hogels are in it. `numbered` says whether the drawn picture says what it shows.
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
    return _maps(reference.scene, (true, shown), _untied(true, shown) & met, wrong, moved)


def _maps(
    scene: Scene, pair: tuple[EyeImage, EyeImage], judged: Mask, wrong: Mask | None, moved: Floats
) -> LossMaps:
    """Return all maps of an expected and a shown view, given those in which the losses differ."""
    expected, shown = pair
    same = (expected.object == shown.object) & (expected.object != NOTHING)
    flip = None
    if expected.color is not None and shown.color is not None:
        per_degree = pixels_per_degree(scene, shown.eye)
        flip = perceptual_difference(expected.color, shown.color, per_degree).flip_map.astype(np.float64)
    return LossMaps(
        judged=judged,
        wrong=None if wrong is None else wrong & judged,
        displacement_arcmin=moved * ARCMIN_PER_RADIAN,
        depth_error=np.where(same, np.abs(shown.position[..., 2] - expected.position[..., 2]), np.nan),
        flip=flip,
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


def _hidden(reference: EyeReference, shown: EyeImage) -> Mask:
    """Return the pixels that show a point which the eye could not see, for something is in front of it."""
    known = np.isfinite(shown.position).all(axis=-1) & (shown.triangle != NOTHING)
    # Hogels do not know where the eye is: they show what lies beside it and behind it too.
    hidden: Mask = known & (shown.position[..., 2] >= shown.eye.position[2])
    asked = np.flatnonzero(known & ~hidden)
    position, number = shown.position.reshape(-1, 3)[asked], shown.triangle.ravel()[asked]
    tolerance = position_tolerance(reference.scene, number, position)
    points = SurfacePoints(position=position, triangle=number, tolerance=tolerance)
    hidden.flat[asked] = reference.hidden(shown.eye, points)
    return hidden


def _angle(a: Floats, b: Floats) -> Floats:
    """Return the angles between vectors (H, W, 3), radians, exact also where they are tiny."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.einsum("...i,...i", a, b)))


@dataclass(frozen=True, kw_only=True)
class Disparity:
    """How far off two eyes see surface points that both are shown."""

    matched: int  #: pixels of the left eye whose surface point the right eye is shown too
    disparity_arcmin: Quantiles | None  #: absolute error of the disparity
    depth: DepthShift | None  #: shown minus true distance from the eyes that follows, scene units
    change_arcsec: DepthShift | None = None  #: shown minus true disparity, negative where seen too far away


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

    def slope(views: Views, place: Floats, z: Floats) -> Floats:
        """Return the slope along x under which an eye sees places, taken at other points' heights."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray((place[..., 0] - views.eye.position[0]) / (height - z[..., 2]))

    by_display, by_renderer = [], []
    for views in (left, right):
        replayed, drawn = views.replayed, views.drawn
        own = slope(views, replayed.position, replayed.position)
        by_display.append((replayed, reference.pencil(views.eye).dx - own))
        if drawn is not None:
            at, own = (
                shown_at(reference.scene, views.taken, drawn),
                slope(views, drawn.position, drawn.position),
            )
            by_renderer.append((drawn, slope(views, at, drawn.position) - own))
    eyes = left.eye, right.eye
    lost = _disparity(reference, eyes, by_display)
    return lost, _disparity(reference, eyes, by_renderer) if len(by_renderer) == len(eyes) else None


def _disparity(
    reference: EyeReference, eyes: tuple[Eye, Eye], shown: list[tuple[EyeImage, Floats]]
) -> Disparity:
    """Return the disparity that the errors of slope of two shown views make."""
    (left, left_error), (right, right_error) = shown
    base, pencil = eyes[1].position[0] - eyes[0].position[0], reference.pencil(eyes[1])
    # Where the right eye has the pixel that truly shows each point of the left one.
    place = np.nan_to_num(pixel_places(left.position, pencil), nan=-1.0, posinf=-1.0, neginf=-1.0)
    column, row = (np.floor(np.clip(place[..., axis], -1.0, 1e6) + 0.5).astype(int) for axis in range(2))
    width, rows = eyes[1].resolution
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < rows)
    column, row = np.where(inside, column, 0), np.where(inside, row, 0)
    distance = eyes[0].position[2] - left.position[..., 2]
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
