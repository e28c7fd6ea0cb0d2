"""The distance of a pixel's center from the projection of the triangle that it claims to show.

Whatever lies in front, a renderer shows a triangle only where the triangle projects to. Therefore the
conventions and the geometry of a renderer can be found without knowing which surface is visible: under the
right guess every claim holds, under a wrong one many fail, each by a distance in pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.compare.diagnosis.claims import Claims
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Fit, Pivot

MIN_DEPTH_PER_NEAR = 0.5
"""Smallest depth at which a camera counts as seeing a surface, as a part of near: halfway between the near
plane, where drawing ends, and the camera, where projection ends."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Films:
    """The places of claimed pixels on their films.

    Attributes
    ----------
    points
        (N, 2) film coordinates u, v of the points that the pixels sample.
    places
        (N, 2) x and y of the apertures, scene units.
    shear
        (N, 2) shears of the apertures' lines, where they are sheared as they must be.
    half
        (2,) half-extent of the film.
    per_px
        (2,) film coordinates per pixel.
    """

    points: Floats
    places: Floats
    shear: Floats
    half: Floats
    per_px: Floats


def inside_px(claims: Claims, scene: Scene, model: DrawnModel) -> tuple[Floats, Floats]:
    """Return the distances of claimed pixels from their triangles' edges under a guess.

    Returns
    -------
    distances
        (2, N, 3) signed distances from the three edges, px, positive inside; first in C's projection, then in
        C*'s.
    outside
        (2, N) distances by which the centers lie outside, px; infinite behind the camera.
    """
    # Step 1: the apertures as the guess has them, and the scene.
    places = claims.apertures(model.order, scene.plate.size) * np.asarray(model.pitch)
    places = places + np.asarray(model.aperture_offset)
    corners = claims.corners * model.scene_scale + np.asarray(model.scene_offset)
    # Step 2: the film of each camera, and the scene on it.
    both = []
    for side in (1, -1):
        films = _films(claims, scene, model.camera(side), places)
        both.append(_one_camera(corners, films, model.camera(side), side))
    return np.stack([one[0] for one in both]), np.stack([one[1] for one in both])


def _films(claims: Claims, scene: Scene, camera: DrawnModel, places: Floats) -> _Films:
    """Return the films of one camera; one that is mirrored shows its picture at the mirrored point."""
    film, one = claims.film(camera.orientation), camera.one_camera
    per_px = 2 / np.asarray(claims.size, dtype=np.float64)
    sampled = film + np.asarray(camera.shift) * per_px * (1, -1)
    if one is not None:
        sampled = sampled * (-1.0 if one.flip_x else 1.0, -1.0 if one.flip_y else 1.0)
    shear, half = _windows(scene, places, camera)
    return _Films(points=sampled, places=places, shear=shear, half=half, per_px=per_px)


def outside_px(claims: Claims, scene: Scene, model: DrawnModel, cap: float) -> Floats:
    """Return the distance by which each pixel's center lies outside its triangle, at most `cap` px, (N,)."""
    _, outside = inside_px(claims, scene, model)
    return np.asarray(np.minimum(outside.min(axis=0), cap))


def _windows(scene: Scene, places: Floats, model: DrawnModel) -> tuple[Floats, Floats]:
    """Return shear (N, 2) and half-extent (2,) of the films of apertures at some places, by a guess."""
    frustum = model.frustum(scene)
    if frustum.screen is None:
        assert frustum.fov is not None
        return np.zeros_like(places), np.tan(np.asarray(frustum.fov) / 2) * model.fov
    behind = -frustum.screen.height
    half = np.asarray(frustum.screen.size) / 2 / abs(behind) * model.fov
    if model.fit is Fit.SCREEN:
        half = half * abs(behind) / (abs(behind) + model.near)
    return (np.asarray(frustum.screen.center) - places) / behind, half


def _one_camera(corners: Floats, films: _Films, model: DrawnModel, side: int) -> tuple[Floats, Floats]:
    """Return `distances` (N, 3) and `outside` (N,) of `inside_px` for C (side 1) or C* (side -1)."""
    # Step 1: homogeneous film coordinates of the corners. Coordinate and corner come first, the claim last,
    # so that everything below works on whole arrays.
    offset = side * model.near if model.pivot is Pivot.CAMERA else 0.0
    px, py, z = corners.transpose(2, 1, 0)
    w = model.near - side * z
    kx, ky = films.shear.T * model.recentering.factor(side)
    # In coordinates sheared about the aperture both cameras look straight (CONVENTIONS.md).
    x = (px - films.places[:, 0] + kx * (z - offset)) * (side / films.half[0])
    y = (py - films.places[:, 1] + ky * (z - offset)) * (side / films.half[1])
    # Step 2: the three edges as lines on the film, by cross products of corners; `values` is each line's
    # equation at the sampled point, and `volume` the determinant of the corners.
    following = [1, 2, 0]
    line_x = y * w[following] - w * y[following]
    line_y = w * x[following] - x * w[following]
    line_1 = x * y[following] - y * x[following]
    values = line_x * films.points[:, 0] + line_y * films.points[:, 1] + line_1
    volume = line_x[0] * x[2] + line_y[0] * y[2] + line_1[0] * w[2]
    # Step 3: divide by the gradient, for a distance in pixels. The depth of the triangle's plane at the point
    # follows from the same quantities. The determinant's sign says which side of the edges is inside.
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = values / np.hypot(line_x * films.per_px[0], line_y * films.per_px[1])
        depth = volume / values.sum(axis=0)
    distance *= np.sign(volume)
    outside = np.maximum(0.0, -distance.min(axis=0))
    seen = np.isfinite(outside) & (depth > MIN_DEPTH_PER_NEAR * model.near)
    return distance.T, np.where(seen, outside, np.inf)
