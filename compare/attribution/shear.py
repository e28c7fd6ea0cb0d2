"""The shear error alone: how far a shear about the cameras moves each point, measured and in closed form."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from xfrustum.compare.metrics.displacement import lengths, pixel_centers
from xfrustum.reference.lines.lines import film_window, model_cameras, pixel_places
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import Offset, Pivot
from xfrustum.scenes.plate.frustum import Frustum


@dataclass(frozen=True, kw_only=True)
class ShearNumbers:
    """How far surface points are drawn from where cameras that are sheared about the aperture draw them.

    Attributes
    ----------
    pixels
        Number of pixels that show a surface off the plate, all of which are measured.
    rms_px, closed_form_rms_px
        Root mean square of these distances as traced, and of -k n/((|z| + n) t) at the same points.
    mean_px, closed_form_mean_px
        Means of the same shifts: columns to the right and rows down.
    largest_difference_px
        Largest distance between a traced shift and its closed form.
    """

    pixels: int
    rms_px: float
    closed_form_rms_px: float
    mean_px: tuple[float, float]
    closed_form_mean_px: tuple[float, float]
    largest_difference_px: float


def shear_numbers(model: HogelImage, frustum: Frustum) -> ShearNumbers | None:
    """Measure the shear of a traced model whose cameras are sheared about their own centers.

    Each pixel shows a surface point, and the cameras of the paper, sheared about the aperture, would draw
    this point elsewhere: the distance is what the pivot alone does to the point. Points are compared with
    themselves, so that nothing depends on which surfaces come into sight.

    Parameters
    ----------
    model
        Image T2 of a chain: with near offset and pivot, fit angle, and without cuts.

    Returns
    -------
    None where there is no such shear: another pivot, no offset, or a centered frustum; and where no surface
    off the plate is shown.
    """
    settings = model.camera.settings
    assert settings is not None, "a model says whose cameras it shows"
    shown = model.off_plate
    sheared = settings.pivot is Pivot.CAMERA and settings.offset is Offset.PLATE and frustum.recentered
    if not sheared or not shown.any():
        return None
    points = model.position[shown].astype(np.float64)
    moved = pixel_centers(model.camera)[shown] - _places_about_aperture(points, model, frustum)
    expected = _closed_form(points[:, 2], model, frustum, settings.near)
    columns, rows = moved.mean(axis=0)
    expected_columns, expected_rows = expected.mean(axis=0)
    return ShearNumbers(
        pixels=len(points),
        rms_px=_rms(moved),
        closed_form_rms_px=_rms(expected),
        mean_px=(float(columns), float(rows)),
        closed_form_mean_px=(float(expected_columns), float(expected_rows)),
        largest_difference_px=float(lengths(moved - expected).max()),
    )


def _places_about_aperture(points: Floats, model: HogelImage, frustum: Frustum) -> Floats:
    """Return the columns and rows (N, 2) at which cameras sheared about the aperture draw points (N, 3)."""
    assert model.camera.settings is not None
    settings = replace(model.camera.settings, pivot=Pivot.APERTURE)
    places = np.empty((len(points), 2))
    for camera in model_cameras(frustum, model.camera.aperture, settings):
        side: Mask = (points[:, 2] < 0) == camera.orthoscopic
        places[side] = pixel_places(points[side], camera.pencil)
    return places


def _closed_form(heights: Floats, model: HogelImage, frustum: Frustum, near: float) -> Floats:
    """Return the shift -k n/((|z| + n) t) of points at some heights (N,), as columns and rows (N, 2)."""
    shear, half_extent = (np.asarray(pair) for pair in film_window(frustum, model.camera.aperture))
    width, rows = model.camera.resolution
    pixels_per_film = np.array([width / 2, -rows / 2])
    share = near / (np.abs(heights) + near)
    return np.asarray(-share[:, None] * (shear / half_extent * pixels_per_film))


def _rms(shifts: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(lengths(shifts)))))
