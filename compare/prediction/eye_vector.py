"""The line on which a surface point is seen, truly and by its camera (docs/method.md, "Light").

At one *pixel* the drawn line is parallel to the true one (pivot aperture, fit angle), and another
surface point is met. At one *surface point* the two lines differ: the eye vector bends.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.lines.lines import model_cameras
from xfrustum.reference.shading.interpolation import smooth_normals
from xfrustum.reference.shading.shading import Hits, Shader
from xfrustum.scenes.arrays import Floats, Numbers
from xfrustum.scenes.model.hogel_image import HogelCamera
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Aperture


def true_lines(position: NDArray[np.floating], aperture: Aperture) -> Floats:
    """Return d = (.., .., -1) of the true line through each surface point, (..., 3).

    NaN for points in the plate, through which no line in particular passes.
    """
    return _through(position, (aperture.x, aperture.y, 0.0))


def drawn_lines(
    position: NDArray[np.floating], frustum: Frustum, aperture: Aperture, settings: DoubleFrustum
) -> Floats:
    """Return d = (.., .., -1) of the line on which each surface point is drawn, (..., 3).

    NaN where no camera draws the point's height.
    """
    lines = np.full(position.shape, np.nan)
    for camera in model_cameras(frustum, aperture, settings):
        low, high = camera.heights
        # Where two slabs meet, the one drawn later covers the other.
        here = (position[..., 2] >= low) & (position[..., 2] <= high)
        lines[here] = _through(position[here], camera.pencil.center)
    return lines


def bend(position: NDArray[np.floating], camera: HogelCamera, near: float) -> Floats:
    """Return the drawn minus the true direction d of the line to each point, in closed form, (..., 3).

    A point that belongs at film coordinate u is drawn at u |z| / (|z| + n) (pivot aperture, fit angle),
    and pixels' lines have slope k + u t: the line bends by - u t n / (|z| + n) toward the middle of the film.
    """
    position = np.asarray(position, dtype=np.float64)
    d = true_lines(position, camera.aperture)
    from_axis = d[..., :2] - np.asarray(camera.shear)
    height = np.abs(position[..., 2:])
    bent = np.zeros_like(d)
    bent[..., :2] = -from_axis * near / (height + near)
    return bent


def radiance_along(
    scene: Scene, shader: Shader, triangle: Numbers, position: Floats, lines: Floats
) -> Floats:
    """Return linear RGB (N, 3), by the reference's shading, of surface points seen along any lines.

    Parameters
    ----------
    shader
        Shader of the scene.
    triangle, position
        (N,) numbers of the triangles that the points are on, and (N, 3) the points.
    lines
        (N, 3) direction d of a line through each point, from the viewer to the back.
    """
    hits = Hits(triangle=triangle, normal=scene.normals[triangle], position=position, direction=lines)
    return np.broadcast_to(shader.radiance(hits), position.shape)


def shading_normals(scene: Scene, triangle: Numbers, position: Floats, lines: Floats) -> Floats:
    """Return the unit normals that surface points are shaded with, turned to the viewer, (N, 3).

    Parameters as in `radiance_along`.
    """
    flat = scene.normals[triangle]
    back = np.einsum("ij,ij->i", flat, lines) > 0
    normal = flat
    if scene.surface.vertex_normals is not None:
        normal = smooth_normals(scene, triangle, position)
    return np.where(back[:, None], -normal, normal)


def _through(position: NDArray[np.floating], center: tuple[float, float, float]) -> Floats:
    offset = position.astype(np.float64) - center
    depth = -offset[..., 2:]
    return np.asarray(offset / np.where(depth == 0, np.nan, depth))
