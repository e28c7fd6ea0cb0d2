"""Origins of float32 rays close to the scene, because a distant origin loses digits."""

from __future__ import annotations

from typing import Any

import numpy as np

from xfrustum.reference.devices.arithmetic import NUMPY, Arithmetic, Coordinates
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
    origins = np.empty_like(directions)
    # A line parallel to two sides of the box or steeper than doubles can hold is no cause for alarm.
    with np.errstate(over="ignore"):
        # Axis by axis: numpy is several times slower along rows of three.
        along = np.ascontiguousarray(directions.T)
        for axis, values in enumerate(entries(NUMPY, scene, center, along, first)):
            origins[:, axis] = values
    return origins


def entries(by: Arithmetic, scene: Scene, center: Coordinates, along: Coordinates, first: Any) -> list[Any]:
    """Return the origins of `ray_origins`, coordinate by coordinate; the scene has vertices.

    Parameters
    ----------
    by
        Arithmetic of the lines.
    scene, first
        As for `ray_origins`.
    center, along
        The common point, and the directions d.
    """
    low, high = scene.bounds
    clearance = CLEARANCE * float(np.linalg.norm(high - low))
    low, high = by.constants((low - clearance).tolist()), by.constants((high + clearance).tolist())
    front = center[2] - high[2]
    s = front
    for axis in range(2):
        side = by.select(along[axis] > 0.0, low[axis], high[axis]) - center[axis]
        # A line parallel to these two sides of the box lies between them everywhere or nowhere: they do not
        # bound s.
        bounded = along[axis] != 0.0
        s = by.maximum(s, by.select(bounded, side / by.select(bounded, along[axis], 1.0), -np.inf))
    # A line beside the box meets nothing, wherever it starts.
    s = by.maximum(by.select(by.isfinite(s), s, front), first)
    return [at + s * direction for at, direction in zip(center, along, strict=True)]
