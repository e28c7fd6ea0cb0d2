"""Origins of float32 rays close to the scene, because a distant origin loses digits."""

from __future__ import annotations

import numpy as np

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene

CLEARANCE = 2.0**-6
"""Distance of the origins from the scene's box, as a share of its diagonal: far more than float32 rounds."""


def ray_origins(scene: Scene, center: Floats, directions: Floats, first: float) -> Floats:
    """Return a point on each line center + s d before every triangle that it meets at s >= first.

    The point has s = `first`, or lies a little before the line enters the scene's bounding box if that is
    later: the lines of a steep frustum come from far outside of the box.

    Parameters
    ----------
    scene
        Scene with the triangles.
    center
        (3,) the lines' common point.
    directions
        (N, 3) direction d of each line, with z = -1.
    first
        Smallest s that counts.
    """
    if not len(scene.vertices):
        return center + first * directions
    low, high = scene.bounds
    clearance = CLEARANCE * float(np.linalg.norm(high - low))
    low, high = low - clearance, high + clearance
    front = float(center[2] - high[2])
    s = np.full(len(directions), front)
    # Axis by axis: numpy is several times slower along rows of three.
    for axis in range(2):
        along = np.ascontiguousarray(directions[:, axis])
        side = np.where(along > 0, low[axis], high[axis]) - center[axis]
        with np.errstate(over="ignore"):
            # A line parallel to these two sides of the box lies between them everywhere or nowhere: they
            # do not bound s.
            s = np.maximum(s, np.divide(side, along, out=np.full(len(s), -np.inf), where=along != 0))
    # A line beside the box meets nothing, wherever it starts.
    s = np.maximum(np.where(np.isfinite(s), s, front), first)
    origins = np.empty_like(directions)
    for axis in range(3):
        origins[:, axis] = center[axis] + s * directions[:, axis]
    return origins
