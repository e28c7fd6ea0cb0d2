"""A bound of the space that images can show, with the largest near offset and all rounding.

What lies outside is certainly in no image; what lies inside may be hidden, or be shown by no aperture.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.plate.double_frustum import DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

#: Smallest near, as a share of the longest reach, for which images are known to end at `FAR_MARGIN`.
SMALLEST_NEAR_SHARE = 2.0**-16
#: Roundings of 2^-24 w in w - z, where clip depth z runs up to w at the far plane: two in z, one in w, one in
#: the difference, and four times as many for vertices and matrices that are rounded to float32 before.
FAR_ROUNDINGS = 16
#: Factor by which a drawn image may reach farther than asked for. With `standard` and `gl` depth w - z = n (f
#: - w) / (f - n) is a small difference of large numbers: a rounding of 2^-24 w moves the far plane by a share
#: 2^-24 f/n of w. At `SMALLEST_NEAR_SHARE` all are a sixteenth; twice that is allowed.
FAR_MARGIN = 1 / (1 - 2 * FAR_ROUNDINGS * 2.0**-24 / SMALLEST_NEAR_SHARE)
#: Margin of all lateral bounds, as a share of the largest term: a transform in float32 is off by at most
#: eight roundings of 2^-24 of the sum of its terms (raster/plate/clusters), and 2^-16 is 32 times as much.
ROUNDING_MARGIN = 2.0**-16
#: Triangles that are tried together. This bounds the memory, some 500 bytes for each.
TRIANGLES_AT_ONCE = 1 << 15


@dataclass(frozen=True, kw_only=True)
class Region:
    """The bound: all crossed frusta of a rectangle of apertures, widened by a near offset."""

    scene: Scene
    apertures: tuple[
        tuple[float, float], ...
    ]  # lowest and highest x, and y, of the points that lines run through
    step: float  #: largest distance by which cameras step back, scene units; 0 for the true frusta
    unbounded: bool = False  #: whether near is so small that float32 knows no far plane

    @classmethod
    def of(
        cls, scene: Scene, apertures: Iterable[Aperture] | None = None, settings: Sequence[DoubleFrustum] = ()
    ) -> Region:
        """Return the region of drawn images of some apertures with their cells; None for all of the plate.

        It is that of every near from `SMALLEST_NEAR_SHARE` of the reach up; only smaller ones need settings.
        """
        unbounded, step = any(loses_far_plane(scene, one) for one in settings), scene.frustum.longest_reach
        return cls(scene=scene, apertures=_cells(scene, apertures), step=step, unbounded=unbounded)

    @classmethod
    def true(cls, scene: Scene, apertures: Iterable[Aperture] | None = None) -> Region:
        """Return the region of the true frusta of some apertures with their cells; None for all."""
        return cls(scene=scene, apertures=_cells(scene, apertures), step=0.0)

    def holds(self, low: Floats, high: Floats) -> Mask:
        """Return which axis-parallel boxes may have a part in the region; False is certain.

        `low` and `high` are (N, 3) lowest and highest coordinates of each box, scene units. At a distance d
        from the plate the lines of an aperture at a span the interval a + (m - a) z/Z -+ t (d + n), where
        the screen has its middle m at the height Z. It is linear in d and in a each, so that over ranges of
        both its ends are extreme at the ranges' own ends.
        """
        held: Mask = np.zeros(len(low), dtype=np.bool_)
        for side, reach in zip((1.0, -1.0), self.scene.frustum.reach, strict=True):
            distances = side * low[:, 2], side * high[:, 2]
            nearest, farthest = np.minimum(*distances), np.maximum(*distances)
            end = math.inf if self.unbounded else FAR_MARGIN * reach
            inside = (farthest >= 0) & (nearest <= end)
            begin, stop = np.maximum(nearest, 0.0), np.minimum(np.maximum(farthest, 0.0), end)
            for axis in (0, 1):
                ends = [self._interval(axis, a, d, side) for a in self.apertures[axis] for d in (begin, stop)]
                lowest = np.minimum.reduce([middle - half for middle, half, _ in ends])
                highest = np.maximum.reduce([middle + half for middle, half, _ in ends])
                slack = ROUNDING_MARGIN * np.maximum.reduce([size for _, _, size in ends])
                inside &= (high[:, axis] >= lowest - slack) & (low[:, axis] <= highest + slack)
            held |= inside
        return held

    def _interval(self, axis: int, a: float, d: Floats, side: float) -> tuple[Floats, Floats, Floats]:
        """Return middle and half width of the lines of an aperture at distances d, and their largest term."""
        frustum = self.scene.frustum
        if frustum.screen is None:
            assert frustum.fov is not None
            half = math.tan(frustum.fov[axis] / 2) * (d + self.step)
            return np.full_like(d, a), half, abs(a) + half
        slope = (frustum.screen.center[axis] - a) / frustum.screen.height
        # The shear of pivot `camera` is fixed at the camera, which moves the frustum aside by up to a step.
        half = frustum.screen.size[axis] / 2 / abs(frustum.screen.height) * (d + self.step)
        half = half + abs(slope) * self.step
        return a + slope * side * d, half, abs(a) + abs(slope) * d + half

    def shows(self, part: SceneObject, faces: Indices | None = None) -> bool:
        """Return whether images may show one of an object's triangles, or of some; False is certain."""
        counted = part.faces if faces is None else faces
        if not self.holds(part.vertices.min(axis=0)[None], part.vertices.max(axis=0)[None])[0]:
            return False
        for start in range(0, len(counted), TRIANGLES_AT_ONCE):
            # Corner by corner, because numpy reduces over so short an axis several times slower.
            corners = part.vertices[counted[start : start + TRIANGLES_AT_ONCE]].transpose(1, 0, 2)
            if self.holds(reduce(np.minimum, corners), reduce(np.maximum, corners)).any():
                return True
        return False


def loses_far_plane(scene: Scene, settings: DoubleFrustum) -> bool:
    """Return whether a drawn image may show surfaces beyond `FAR_MARGIN` times the reach.

    That is so for tiny nears, unless clip depth is zero at the far plane (raster/cameras/depth_formats).
    """
    hyperbolic = settings.mapping in (DepthMapping.STANDARD, DepthMapping.GL)
    nearest = min((settings.near, *settings.slabs[:1]))
    return hyperbolic and nearest < SMALLEST_NEAR_SHARE * scene.frustum.longest_reach


def _cells(scene: Scene, apertures: Iterable[Aperture] | None) -> tuple[tuple[float, float], ...]:
    """Return the rectangle about the cells of some apertures; None for the plate itself."""
    plate = scene.plate
    if apertures is None:
        return tuple((-size / 2, size / 2) for size in plate.size)
    along = zip(*((aperture.x, aperture.y) for aperture in apertures), strict=True)
    halves = (size / count / 2 for size, count in zip(plate.size, plate.hogels, strict=True))
    return tuple((min(places) - half, max(places) + half) for places, half in zip(along, halves, strict=True))
