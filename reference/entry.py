"""Where to start a float32 ray: not far away, for every digit of its origin is spent on distance."""

from __future__ import annotations

import numpy as np

from xfrustum.reference.cone import Floats
from xfrustum.scenes.scene import Scene

CLEARANCE = 2.0**-6
"""Distance kept from the scene's box, as a share of its diagonal: far more than float32 rounds."""


def ray_origins(scene: Scene, center: Floats, directions: Floats, first: float) -> Floats:
    """Return a point on each line center + s d before everything that it meets with s >= first.

    That is s = `first`, or a little before the line enters the scene's bounding box if that is
    later: the lines of a steep frustum come from far outside of it.

    Parameters
    ----------
    scene
        What may be met.
    center
        (3,) the lines' common point.
    directions
        (N, 3) d of each line.
    first
        The smallest s that counts.
    """
    if not len(scene.vertices):
        return center + first * directions
    low, high = scene.bounds
    clearance = CLEARANCE * float(np.linalg.norm(high - low))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        to_low, to_high = (low - clearance - center) / directions, (high + clearance - center) / directions
    enters = np.fmin(to_low, to_high)
    s = np.fmax(np.fmax(enters[:, 0], enters[:, 1]), enters[:, 2])
    # A line beside the box meets nothing, wherever it starts.
    return center + np.where(np.isfinite(s), np.maximum(s, first), first)[:, None] * directions
