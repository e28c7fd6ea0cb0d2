"""The scene that a viewer sees where cameras step back by a near offset: a theorem and its closed form.

docs/method.md, "What the near offset looks like to a viewer", has the proof. All lines on which hogels replay
one drawn surface point P cross in one point P', which lies at the distance D from the plate:

    D = (|z| + n) zf / (zf + n),   without a fit D = |z| + n,   beyond the first slab D = |z|.

Behind the plate P' = P + m (kx, ky, -1), before it P' = P - m (kx, ky, -1), with D - |z| along z. Where P' is
the same for all apertures, what is replayed is the true picture of a moved scene.
"""

from __future__ import annotations

import numpy as np

from xfrustum.reference.lines.lines import film_window
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.plate.double_frustum import DoubleFrustum, Offset, Pivot
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Aperture


def replayed_distance(distance: Floats, frustum: Frustum, settings: DoubleFrustum) -> Floats:
    """Return D, the distance from the plate at which a viewer sees points at the distances |z|, scene units.

    A point at the first cut counts to the first slab.
    """
    distance = np.asarray(distance, dtype=np.float64)
    if settings.offset is Offset.NONE:
        return distance
    moved = distance + settings.near
    fitted = settings.fitted_height(frustum)
    if fitted is not None:
        moved = moved * (fitted / (fitted + settings.near))
    return np.where(distance <= _first_cut(settings), moved, distance)


def replayed_shifts(distance: Floats, frustum: Frustum, settings: DoubleFrustum) -> tuple[Floats, Floats]:
    """Return how far points are moved from the plate, and the factor of the shear by which they go aside."""
    moved = replayed_distance(distance, frustum, settings) - distance
    if settings.pivot is Pivot.CAMERA and settings.offset is Offset.PLATE:
        # The shear about the camera's own center draws points of the first slab a further k n aside.
        return moved, np.where(distance <= _first_cut(settings), moved - settings.near, moved)
    return moved, moved


def replayed_points(
    points: Floats, frustum: Frustum, aperture: Aperture, settings: DoubleFrustum, side: int
) -> Floats:
    """Return P', on the lines on which an aperture replays drawn points, at the distance at which they cross.

    The points (N, 3), scene units, are all on one side of the plate or in it: `side` is 1 behind the plate,
    where C draws, and -1 before it. Where P' does not depend on the aperture, a viewer sees the points there.
    """
    shear, _ = film_window(frustum, aperture)
    distance = -side * points[:, 2]
    _, aside = replayed_shifts(distance, frustum, settings)
    moved = points.copy()
    moved[:, :2] += side * aside[:, None] * shear
    moved[:, 2] = -side * replayed_distance(distance, frustum, settings)
    return moved


def _first_cut(settings: DoubleFrustum) -> float:
    return settings.slabs[0] if settings.slabs else np.inf


def moves_rigidly(frustum: Frustum, settings: DoubleFrustum) -> bool:
    """Return whether the point at which a surface point is replayed is the same for all apertures."""
    straight = settings.pivot is Pivot.CAMERA and settings.fitted_height(frustum) is None
    return not frustum.recentered or straight or settings.offset is Offset.NONE
