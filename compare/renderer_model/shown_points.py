"""The surface point that a pixel shows, when an image says only which triangle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.reference.lines.lines import Pencil, pixel_places
from xfrustum.reference.lines.planes import distance_to_triangles, plane_places, triangle_normals
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene

CAMERA_DISTANCE_PER_REACH = 1e-6
"""Smallest distance from a camera's own plane at which points of triangles are looked for, as a part of the
reach: in that plane they have no place on the film."""

TRIANGLE_TOLERANCE_PER_REACH = 1e-9
"""Largest distance from a triangle of a point that is on it, as a part of the reach: a million roundings of
doubles, and a thousandth of what a pixel of 1000 sees at a thousandth of the reach."""


def shown_points(scene: Scene, model: DrawnModel, image: HogelImage) -> Floats:
    """Return the surface points (H, W, 3) that an image as found shows, NaN where it says nothing.

    They are the image's own where it has them; else they lie where the line that a pixel has by a model
    meets the triangle that it names. Where the line misses that triangle, the pixel shows no point of it
    that can be known; the one that the model draws nearest to the pixel's center is taken. A displacement is
    then at least what it is found to be, and it is not zero.
    """
    if np.isfinite(image.position[..., :2]).any():
        return np.asarray(image.position, dtype=np.float64)
    upright = model.orientation.upright(image.triangle)
    aperture = model.answers(scene, image.camera.aperture)
    points = np.full((*upright.shape, 3), np.nan)
    rows, columns = np.nonzero((upright >= 0) & (upright < len(scene.faces)))
    corners = scene.triangles[upright[rows, columns]]
    best, off = np.full((len(rows), 3), np.nan), np.full(len(rows), np.inf)
    for side in (1, -1):
        pencil = model.pencil(scene, aperture, side)
        directions, center = pencil.directions()[rows, columns], np.asarray(pencil.center)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = plane_places(corners, triangle_normals(corners), center, directions)
            met: Floats = center + s[:, None] * directions
        ahead = np.isfinite(met).all(axis=1) & (side * (met[:, 2] - model.plate_height) <= 0)
        distance = np.full(len(rows), np.inf)
        distance[ahead] = distance_to_triangles(met[ahead], corners[ahead])
        nearer = distance < off
        best[nearer], off[nearer] = met[nearer], distance[nearer]
    # The scene's own lengths: where a guess has it larger, the reach is so much shorter in them.
    reach = scene.frustum.longest_reach / model.scene_scale
    missed = np.flatnonzero(off > TRIANGLE_TOLERANCE_PER_REACH * reach)
    cells = np.stack((columns[missed], rows[missed]), axis=1).astype(np.float64)
    pencils = [model.pencil(scene, aperture, side) for side in (1, -1)]
    best[missed] = _drawn_nearest(corners[missed], pencils, cells, reach)
    points[rows, columns] = best
    return np.asarray(model.orientation.applied(points))


def _drawn_nearest(corners: Floats, pencils: Sequence[Pencil], cells: Floats, reach: float) -> Floats:
    """Return the points (N, 3) of triangles' edges drawn nearest to pixels' centers; NaN where none is drawn.

    Parameters
    ----------
    corners
        (N, 3, 3) corners of triangles that the pixels' lines miss.
    cells
        (N, 2) column and row of the pixels.
    """
    best, least = np.full((len(corners), 3), np.nan), np.full(len(corners), np.inf)
    for side, pencil in zip((1, -1), pencils, strict=True):
        for first in range(3):
            ends = corners[:, [first, (first + 1) % 3]]
            with np.errstate(divide="ignore", invalid="ignore"):
                point, apart = _nearest_of_edge(ends, pencil, side, cells, CAMERA_DISTANCE_PER_REACH * reach)
            nearer = apart < least
            best[nearer], least[nearer] = point[nearer], apart[nearer]
    return best


def _nearest_of_edge(
    ends: Floats, pencil: Pencil, side: int, cells: Floats, closest: float
) -> tuple[Floats, Floats]:
    """Return the points (N, 3) of edges (N, 2, 3) drawn nearest to cells, and their distances in pixels."""
    center = np.asarray(pencil.center)
    ahead = side * (center[2] - ends[..., 2])
    # The part of the edge behind the camera is cut off.
    t = np.clip((closest - ahead[:, 0]) / (ahead[:, 1] - ahead[:, 0]), 0.0, 1.0)
    cut = ends[:, 0] + t[:, None] * (ends[:, 1] - ends[:, 0])
    kept = np.where((ahead < closest)[..., None], cut[:, None], ends)
    s = center[2] - kept[..., 2]
    drawn = pixel_places(kept, pencil)
    along = drawn[:, 1] - drawn[:, 0]
    part = np.einsum("ij,ij->i", cells - drawn[:, 0], along) / np.einsum("ij,ij->i", along, along)
    part = np.clip(np.nan_to_num(part), 0.0, 1.0)[:, None]
    # On the film 1/s runs evenly, and so do coordinates over s.
    weights = (1 - part) / s[:, :1], part / s[:, 1:]
    point = (weights[0] * kept[:, 0] + weights[1] * kept[:, 1]) / (weights[0] + weights[1])
    apart = np.linalg.norm(drawn[:, 0] + part * along - cells, axis=1)
    seen = (ahead >= closest).any(axis=1) & np.isfinite(apart)
    return point, np.where(seen, apart, np.inf)
