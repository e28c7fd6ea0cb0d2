"""Two eyes: how far the disparity of surface points is off, and at which depth they are therefore seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.compare.eye.loss import ARCMIN_PER_RADIAN, Quantiles, Views, shown_at
from xfrustum.reference.eye.view import EyeReference
from xfrustum.reference.lines.lines import pixel_places
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.eye_image import EyeImage
from xfrustum.scenes.model.hogel_image import NOTHING

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
