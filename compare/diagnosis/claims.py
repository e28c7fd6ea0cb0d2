"""Claims: pixels of images, the triangles that they name, and the distances of failed claims."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from xfrustum.compare.renderer_model.drawn_model import EVEN, RendererModel
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.images import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture

# Size of the triangle that represents a claimed point, relative to the point's largest coordinate.
# It equals the float32 rounding of stored points.
POINT_SIZE = 2.0**-24

# Largest number of claims taken from one hogel, so that no hogel dominates the fit. Three hogels
# give more than `MAX_BOUNDING_CLAIMS`.
MAX_HOGEL_CLAIMS = 6000

# Smallest depth of a visible surface, as a fraction of near: halfway between the near plane, where
# drawing begins, and the camera, where projection is undefined.
MIN_DEPTH_PER_NEAR = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class PixelClaims:
    """Pixels and the triangles that they claim to show.

    Small triangles represent claimed points. Claimed points are in the renderer's scene, which may
    be moved or scaled; claimed triangles are in the nominal scene.
    """

    scene: Scene
    hogel: Indices  # (N, 2) column and row of the aperture in the file's name
    pixel: Indices  # (N, 2) column and row of the pixel in the file
    corners: Floats  # (N, 3, 3) corners of the triangles, scene units
    of_points: bool

    def __len__(self) -> int:
        """Return the number of claims."""
        return len(self.hogel)

    def chosen(self, index: Indices | Mask) -> PixelClaims:
        """Return the claims at these indices."""
        names = ("hogel", "pixel", "corners")
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    def thinned(self, count: int) -> PixelClaims:
        """Return at most `count` claims, drawn at random with a fixed seed."""
        if len(self) <= count:
            return self
        some = np.random.default_rng(0).choice(len(self), count, replace=False)
        return self.chosen(np.sort(some))


def claims_of(scene: Scene, images: Sequence[HogelImage]) -> PixelClaims:
    """Collect claims at the outlines of triangles, because outlines reveal small displacements.

    If an image names no triangles, its surface points are the claims.
    """
    hogels, pixels, corners, of_points = [], [], [], True
    for image in images:
        named = (image.triangle >= 0) & (image.triangle < len(scene.faces))
        points = not named.any()
        if points:
            stated = np.isfinite(image.position).all(axis=-1) & (image.height != 0)
        else:
            # Pixels next to another triangle or to the image's border.
            padded = np.pad(image.triangle, 1, constant_values=NOTHING - 1)
            neighbors = (padded[1:-1, :-2], padded[1:-1, 2:], padded[:-2, 1:-1], padded[2:, 1:-1])
            stated = named & np.any([image.triangle != other for other in neighbors], axis=0)
        places = np.argwhere(stated)
        if (count := len(places)) > MAX_HOGEL_CLAIMS:
            some = np.random.default_rng(count).choice(count, MAX_HOGEL_CLAIMS, replace=False)
            places = places[np.sort(some)]
        rows, columns = places.T
        if points:
            there = image.position[rows, columns].astype(np.float64)
            size = POINT_SIZE * np.abs(there).max(axis=1, initial=0.0)
            around = np.array([[1.0, 0.0, 0.0], [-0.5, 0.75, 0.0], [-0.5, -0.75, 0.0]])
            corners.append(there[:, None] + size[:, None, None] * around)
        else:
            corners.append(scene.triangles[image.triangle[rows, columns]])
        of_points &= points
        hogels.append(np.tile(np.array(image.camera.aperture.index, np.int64), (len(places), 1)))
        pixels.append(places[:, ::-1])
    return PixelClaims(
        scene=scene,
        hogel=np.concatenate(hogels),
        pixel=np.concatenate(pixels),
        corners=np.concatenate(corners),
        of_points=of_points,
    )


def outside_px(claims: PixelClaims, model: RendererModel, cap: float) -> Floats:
    """Return the distance of pixel centers outside their triangles, at most `cap` px, (N,)."""
    return np.asarray(np.minimum(inside_px(claims, model)[1].min(axis=0), cap))


def inside_px(claims: PixelClaims, model: RendererModel) -> tuple[Floats, Floats]:
    """Return distances of pixel centers from their triangles' edges, and from their triangles.

    Both are in px, for the projections of C and of C*. Distances from edges, (2, N, 3), are
    positive inside and negative outside. Distances from triangles, (2, N), are 0 inside, and
    infinite behind the camera.
    """
    scene, (width, height) = claims.scene, claims.scene.frustum.resolution
    (columns, rows), (sx, sy) = scene.plate.hogels, scene.plate.size
    column, row = model.order.cells(claims.hogel[:, 0], claims.hogel[:, 1], (columns, rows))
    apertures = (column + 0.5) * sx / columns - sx / 2, sy / 2 - (row + 0.5) * sy / rows
    column, row = model.orientation.cells(claims.pixel[:, 0], claims.pixel[:, 1], (width, height))
    u, v = (2 * column + 1) / width - 1, 1 - (2 * row + 1) / height
    # Axes are coordinate, corner, claim, so that all operations below are on whole arrays.
    (px, py, z), following = claims.corners.transpose(2, 1, 0), [1, 2, 0]
    two = [Aperture(column=0, row=0, x=place, y=place) for place in (0.0, 1.0)]
    distances, outsides = [], []
    distance = depth = np.empty(0)
    for side in (1, -1):
        if side < 0 and model.one_pencil:
            # C* has the same lines in the opposite direction: homogeneous coordinates change sign.
            distance, depth = -distance, -depth
        else:
            # Step 1: homogeneous film coordinates of the corners, (3, N). Center and shear of a ray
            # bundle are affine functions of the aperture's position along the same axis, so that
            # two bundles determine all bundles.
            entry, other = (model.bundle(scene, aperture, side) for aperture in two)
            w = side * (entry.center[2] - z)
            x, y = (
                (side * (p - c - (c1 - c) * a) - (k + (k1 - k) * a) * w) / t
                for p, a, c, c1, k, k1, t in zip(
                    *((px, py), apertures, entry.center[:2], other.center[:2]),
                    *(entry.shear, other.shear, entry.half_extent),
                    strict=True,
                )
            )
            # Step 2: the three edges as lines on the film, by cross products of corners. `values`
            # are the line equations at the pixel's center, `volume` is the determinant of the
            # corners.
            x_next, y_next, w_next = x[following], y[following], w[following]
            line_x = y * w_next - w * y_next
            line_y = w * x_next - x * w_next
            line_1 = x * y_next - y * x_next
            across, up = (u, v) if model.film == EVEN else model.film.bent(u, v, entry.half_extent)
            values = line_x * across + line_y * up + line_1
            volume = line_x[0] * x[2] + line_y[0] * y[2] + line_1[0] * w[2]
            # Step 3: divide by the gradient, for a distance in pixels. The depth of the triangle's
            # plane at the point follows from the same quantities. Multiply by the sign of the
            # determinant, so that distances are positive inside.
            with np.errstate(divide="ignore", invalid="ignore"):
                distance = values / np.hypot(line_x * 2 / width, line_y * 2 / height)
                depth = volume / values.sum(axis=0) * model.scene_scale
                distance *= np.sign(volume)
        outside = np.maximum(0.0, -distance.min(axis=0))
        seen = np.isfinite(outside) & (depth > MIN_DEPTH_PER_NEAR * model.camera(side).near)
        distances.append(distance.T)
        outsides.append(np.where(seen, outside, np.inf))
    return np.stack(distances), np.stack(outsides)
