"""The claims of images: this pixel, of this file, shows this triangle; and by how much claims fail.

Whatever lies in front, a renderer shows a triangle only where the triangle projects to. Therefore the
conventions and the geometry of a renderer can be found without knowing which surface is visible: under the
right guess every claim holds, under a wrong one many fail, each by a distance in pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Fit, Pivot

# Size of the triangle that stands for a claimed point, relative to the point's largest coordinate: the
# rounding to float32, in which images store points.
POINT_SIZE = 2.0**-24

# Largest number of claims taken from one hogel, so that no hogel outvotes the others. Three hogels give more
# than `geometry_fit` ever uses (16,000).
MAX_HOGEL_CLAIMS = 6000

# Smallest depth at which a camera counts as seeing a surface, as a part of near: halfway between the near
# plane, where drawing ends, and the camera, where projection ends.
MIN_DEPTH_PER_NEAR = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Claims:
    """Pixels and the triangles that they claim to show.

    Claimed points, for which small triangles stand, lie in the scene as the renderer has it, moved or scaled;
    triangles lie in the scene as it was asked for.
    """

    hogel: Indices  # (N, 2) column and row of the aperture that the file is named after
    pixel: Indices  # (N, 2) column and row of the pixel in the file
    corners: Floats  # (N, 3, 3) corners of the triangles, scene units
    size: tuple[int, int]  # columns and rows of the images
    hogels: tuple[int, int]  # and of the plate
    of_points: bool = False

    def __len__(self) -> int:
        """Return the number of claims."""
        return len(self.hogel)

    def chosen(self, index: Indices | Mask) -> Claims:
        """Return some of the claims."""
        return replace(self, hogel=self.hogel[index], pixel=self.pixel[index], corners=self.corners[index])

    def thinned(self, count: int) -> Claims:
        """Return at most `count` claims, drawn at random with a fixed seed."""
        if len(self) <= count:
            return self
        return self.chosen(np.sort(np.random.default_rng(0).choice(len(self), count, replace=False)))


def claims_of(scene: Scene, images: Sequence[HogelImage]) -> Claims:
    """Collect the claims of images at the outlines of triangles, where a small move of the geometry shows.

    From an image that names no triangles the surface points are taken as claims.
    """
    hogel, pixel, corners, of_points = [], [], [], True
    for image in images:
        named = (image.triangle >= 0) & (image.triangle < len(scene.faces))
        points = not named.any()
        if points:
            asked = np.isfinite(image.position).all(axis=-1) & (image.height != 0)
        else:
            # Pixels that have a neighbor of another triangle or beyond the image's border.
            padded = np.pad(image.triangle, 1, constant_values=NOTHING - 1)
            beside = (padded[1:-1, :-2], padded[1:-1, 2:], padded[:-2, 1:-1], padded[2:, 1:-1])
            asked = named & np.any([image.triangle != other for other in beside], axis=0)
        rows, columns = np.nonzero(asked)
        if len(rows) > MAX_HOGEL_CLAIMS:
            some = np.random.default_rng(len(rows)).choice(len(rows), MAX_HOGEL_CLAIMS, replace=False)
            rows, columns = rows[np.sort(some)], columns[np.sort(some)]
        if points:
            there = image.position[rows, columns].astype(np.float64)
            size = POINT_SIZE * np.abs(there).max(axis=1, initial=0.0)
            around = np.array([[1.0, 0.0, 0.0], [-0.5, 0.75, 0.0], [-0.5, -0.75, 0.0]])
            corners.append(there[:, None] + size[:, None, None] * around)
        else:
            corners.append(scene.triangles[image.triangle[rows, columns]])
        of_points &= points
        hogel.append(np.tile(np.array(image.camera.aperture.index, dtype=np.int64), (len(rows), 1)))
        pixel.append(np.stack((columns, rows), axis=-1))
    return Claims(
        hogel=np.concatenate(hogel),
        pixel=np.concatenate(pixel),
        corners=np.concatenate(corners),
        size=scene.frustum.resolution,
        hogels=scene.plate.hogels,
        of_points=of_points,
    )


def outside_px(claims: Claims, scene: Scene, model: DrawnModel, cap: float) -> Floats:
    """Return the distance by which each pixel's center lies outside its triangle, at most `cap` px, (N,)."""
    _, outside = inside_px(claims, scene, model)
    return np.asarray(np.minimum(outside.min(axis=0), cap))


def inside_px(claims: Claims, scene: Scene, model: DrawnModel) -> tuple[Floats, Floats]:
    """Return how far claimed pixels' centers lie inside and outside their triangles under a guess.

    The first result are signed distances (2, N, 3) from the three edges, px, positive inside, in C's
    projection and in C*'s; the second distances (2, N) outside, infinite behind the camera.
    """
    (columns, rows), (sx, sy) = claims.hogels, scene.plate.size
    column, row = model.order.cells(claims.hogel[:, 0], claims.hogel[:, 1], claims.hogels)
    places = np.stack(((column + 0.5) * sx / columns - sx / 2, sy / 2 - (row + 0.5) * sy / rows), axis=-1)
    places = places * np.asarray(model.pitch) + np.asarray(model.aperture_offset)
    corners = claims.corners * model.scene_scale + np.asarray(model.scene_offset)
    both = [_on_film(corners, claims, scene, model, places, side) for side in (1, -1)]
    return np.stack([one[0] for one in both]), np.stack([one[1] for one in both])


def _on_film(
    corners: Floats, claims: Claims, scene: Scene, model: DrawnModel, places: Floats, side: int
) -> tuple[Floats, Floats]:
    """Return distances (N, 3) and those outside (N,) as `inside_px` for C (side 1) or C* (side -1)."""
    # Step 1: film coordinates of the points that the claimed pixels sample. A film that is mirrored shows its
    # picture at the mirrored point.
    camera, (width, height) = model.camera(side), claims.size
    column, row = camera.orientation.cells(claims.pixel[:, 0], claims.pixel[:, 1], claims.size)
    u, v = 2 * (column + camera.shift[0]) + 1, 2 * (row + camera.shift[1]) + 1
    u, v, one = u / width - 1, 1 - v / height, camera.one_camera
    u, v = -u if one and one.flip_x else u, -v if one and one.flip_y else v
    # Step 2: shear (2, N) and half-extent (2,) of the films of the apertures.
    frustum = camera.frustum(scene)
    if frustum.screen is None:
        assert frustum.fov is not None
        shear, half = np.zeros_like(places).T, np.tan(np.asarray(frustum.fov) / 2) * camera.fov
    else:
        behind = -frustum.screen.height
        half = np.asarray(frustum.screen.size) / 2 / abs(behind) * camera.fov
        if camera.fit is Fit.SCREEN:
            half = half * abs(behind) / (abs(behind) + camera.near)
        shear = ((np.asarray(frustum.screen.center) - places) / behind).T
    # Step 3: homogeneous film coordinates of the corners, sheared about the aperture, where both cameras look
    # straight (CONVENTIONS.md). Coordinate and corner come first, the claim last: all below is whole arrays.
    offset = side * camera.near if model.pivot is Pivot.CAMERA else 0.0
    px, py, z = corners.transpose(2, 1, 0)
    w = camera.near - side * z
    kx, ky = shear * model.recentering.factor(side)
    x = (px - places[:, 0] + kx * (z - offset)) * (side / half[0])
    y = (py - places[:, 1] + ky * (z - offset)) * (side / half[1])
    # Step 4: the three edges as lines on the film, by cross products of corners; `values` is each line's
    # equation at the sampled point, and `volume` the determinant of the corners.
    following = [1, 2, 0]
    line_x = y * w[following] - w * y[following]
    line_y = w * x[following] - x * w[following]
    line_1 = x * y[following] - y * x[following]
    values = line_x * u + line_y * v + line_1
    volume = line_x[0] * x[2] + line_y[0] * y[2] + line_1[0] * w[2]
    # Step 5: divide by the gradient, for a distance in pixels. The depth of the triangle's plane at the point
    # follows from the same quantities. The determinant's sign says which side of the edges is inside.
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = values / np.hypot(line_x * 2 / width, line_y * 2 / height)
        depth = volume / values.sum(axis=0)
    distance *= np.sign(volume)
    outside = np.maximum(0.0, -distance.min(axis=0))
    seen = np.isfinite(outside) & (depth > MIN_DEPTH_PER_NEAR * camera.near)
    return distance.T, np.where(seen, outside, np.inf)
