"""Triangles cut by heights: the corners of what is left of each, and its area."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.scene import TRIANGLES_AT_ONCE, SceneObject
from xfrustum.scenes.plate.frustum import Frustum


@dataclass(frozen=True, kw_only=True, eq=False)
class Layer:
    """The parts of some triangles between two heights that lie on one side of the plate.

    Attributes
    ----------
    corners
        (F, 9, 3) corners of each part in no order, scene units. The part is their convex hull.
    valid
        (F, 9) whether each of these corners exists; all false where a triangle has no part in the layer.
    behind
        Whether the layer lies behind the plate, z <= 0, and not before it.
    """

    corners: Floats
    valid: Mask
    behind: bool


def triangles_in_chunks(part: SceneObject, at_once: int = TRIANGLES_AT_ONCE // 4) -> Iterator[Floats]:
    """Yield (F, 3, 3) corners of an object's triangles, some at a time.

    Cutting takes four times the memory per triangle that `TRIANGLES_AT_ONCE` allows for.
    """
    for start in range(0, len(part.faces), at_once):
        yield part.vertices[part.faces[start : start + at_once]]


def layers(triangles: Floats, frustum: Frustum) -> Iterator[Layer]:
    """Cut triangles (F, 3, 3) by the reach, the plate, and the height of the projection screen.

    Within one layer the film coordinate of a point, and the range of apertures that see it, are functions of
    the point's height without a pole.
    """
    toward, back = frustum.reach
    heights = [-back, 0.0, toward]
    if frustum.screen is not None and -back < frustum.screen.height < toward:
        heights.append(frustum.screen.height)
    heights.sort()
    for low, high in pairwise(heights):
        yield _layer(triangles, low, high)


def _layer(triangles: Floats, low: float, high: float) -> Layer:
    z = triangles[..., 2]
    ends = np.roll(triangles, -1, axis=1)
    corners, valid = [triangles], [(z >= low) & (z <= high)]
    for height in (low, high):
        above, below = ends[..., 2] - height, z - height
        crossing = (above > 0) != (below > 0)
        share = np.divide(below, below - above, out=np.zeros_like(z), where=crossing)
        points = triangles + share[..., None] * (ends - triangles)
        points[..., 2] = height
        corners.append(points)
        valid.append(crossing)
    return Layer(
        corners=np.concatenate(corners, axis=1), valid=np.concatenate(valid, axis=1), behind=high <= 0
    )


def areas(triangles: Floats) -> Floats:
    """Return the (F,) areas of triangles (F, 3, 3), square scene units."""
    edges = triangles[:, 1:] - triangles[:, :1]
    return np.asarray(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2)


def share_between(triangles: Floats, low: float, high: float) -> Floats:
    """Return the (F,) share of each triangle's area that lies between two heights, both ends included."""
    z = np.sort(triangles[..., 2], axis=1)
    flat = z[:, 0] == z[:, 2]
    share = _share_below(z, high) - _share_below(z, low)
    return np.where(flat, (z[:, 0] >= low) & (z[:, 0] <= high), np.clip(share, 0.0, 1.0))


def _share_below(z: Floats, height: float) -> Floats:
    """Return the (F,) share of each triangle's area below a height.

    The length of a triangle's section grows linearly from its lowest corner to its middle one, and
    shrinks linearly from there: the area below is quadratic in the height on either side.

    Parameters
    ----------
    z
        (F, 3) heights of the corners in ascending order, scene units.
    height
        Height below which the area counts, scene units.
    """
    lowest, middle, highest = z.T
    ones = np.ones(len(z))

    def quotient(part: Floats, whole: Floats) -> Floats:
        # Quotients outside 0 to 1 are not used, and might overflow.
        usable = (whole > 0) & (part >= 0) & (part <= whole)
        return np.divide(part, whole, out=ones.copy(), where=usable)

    rise, fall = height - lowest, highest - height
    rising = quotient(rise, highest - lowest) * quotient(rise, middle - lowest)
    falling = quotient(fall, highest - lowest) * quotient(fall, highest - middle)
    within = np.where(height < middle, rising, 1.0 - falling)
    return np.where(height <= lowest, 0.0, np.where(height >= highest, 1.0, within))
