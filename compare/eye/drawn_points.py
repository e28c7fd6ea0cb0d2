"""The surface point that each pixel of a drawn view shows, from its triangle and its camera's line."""

from __future__ import annotations

import numpy as np

from xfrustum.reference.lines.lines import model_cameras
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.eye import HogelPixels
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum

HEIGHT_TOLERANCE = 2.0**-16
"""Distance beyond a camera's ends at which a point still counts as drawn by it, as a part of the reach: cuts
are made in float32, on slopes that make a rounding of 2^-24 some hundred times as large."""


def drawn_points(scene: Scene, settings: DoubleFrustum, pixels: HogelPixels, triangle: Numbers) -> Floats:
    """Return surface points (H, W, 3), scene units; NaN where nothing is shown.

    Each lies where the line of the camera that drew it meets the plane of its triangle. Of several cameras
    between whose ends that is, the one drawn last shows.

    Parameters
    ----------
    scene, settings
        Scene that is drawn, and settings of its cameras.
    pixels
        The hogels' pixels that are shown.
    triangle
        (H, W) triangle numbers.
    """
    found = np.full((*triangle.shape, 3), np.nan)
    rows, columns = np.nonzero(triangle != NOTHING)
    if not len(rows):
        return found
    corners = scene.triangles[triangle[rows, columns]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    slack = HEIGHT_TOLERANCE * scene.frustum.longest_reach
    points = np.full((len(rows), 3), np.nan)
    across = _camera_lines(scene, settings, pixels.hogel_column, pixels.film_column, 0)
    down = _camera_lines(scene, settings, pixels.hogel_row, pixels.film_row, 1)
    for (x, dx, height, ends), (y, dy, _, _) in zip(across, down, strict=True):
        center = np.stack((x[columns], y[rows], np.full(len(rows), height)), axis=-1)
        direction = np.stack((dx[columns], dy[rows], np.full(len(rows), -1.0)), axis=-1)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            s = np.einsum("ij,ij->i", corners[:, 0] - center, normal)
            s /= np.einsum("ij,ij->i", direction, normal)
            met = center + s[:, None] * direction
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
            pencil = camera.pencil
            if index == len(lines):
                none = np.full(len(hogel), np.nan)
                lines.append((none, none.copy(), pencil.center[2], camera.heights))
            lines[index][0][here] = pencil.center[axis]
            lines[index][1][here] = (pencil.dx, pencil.dy)[axis][pixel[here]]
    return lines
