"""The interval of each parameter of a guess: all values under which no claim fails.

Each claim gives an inequality: the distance of the pixel's center from each edge of its triangle, counted
inward, is at least zero. After linearizing, the guesses that satisfy all claims form a convex cell; linear
programming finds its extent along each axis. A renderer without a near offset may have one that is too small
to be seen, because no camera has its near plane in its center: all values are allowed that some such offset
allows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import linprog

from xfrustum.compare.diagnosis.claims import Claims
from xfrustum.compare.diagnosis.containment import inside_px
from xfrustum.compare.renderer_model import parameters
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.model.scene import Scene

SNAP_PX = math.sqrt(2) / 2 * 2.0**-8
"""Largest distance by which rasterizers move edges, in pixels: half the diagonal of a step of the 8 subpixel
bits that graphics hardware has."""

NEIGHBORHOOD_PX = 0.5
"""Largest distance of an edge from a pixel's center at which it can bound the fit, in pixels. The fit is
right to a fraction of a pixel, so that edges farther away bound nothing."""


UNSEEN_NEAR_PER_REACH = parameters.SMALLEST_FACTOR * parameters.TOLD_APART_PER_REACH
"""Largest near offset, as a part of the reach, that a renderer may have unseen: at the depth at which offsets
are told apart it widens the film by the smallest factor that has a name."""


def feasible_interval(
    claims: Claims, scene: Scene, model: DrawnModel, free: Sequence[int], noise_px: float
) -> tuple[Floats, Floats, Floats]:
    """Return middle, lowest and highest values (P,) under which no claim fails by more than noise.

    Parameters
    ----------
    claims
        Claims, nearly all of which hold under the guess; the others bound nothing.
    scene
        Scene that was drawn.
    model
        Guess that fits the claims.
    free
        Places of the parameters that may move; the others keep their values.
    noise_px
        Distance by which claims fail under the guess; `SNAP_PX` is allowed in addition.
    """
    values = model.parameters
    low, high = values.copy(), values.copy()
    if not free or not len(claims):
        return values, low, high
    allowed = SNAP_PX + noise_px
    here, rows = _bounding(claims, scene, model, allowed)
    # Step 1: how fast each distance changes with each parameter that may move, by finite differences. An
    # unseen near offset moves too; it has no interval of its own.
    (near,) = parameters.places("near")
    unseen = [near] if near not in free and not model.near else []
    moving = [*free, *unseen]
    steps = parameters.derivative_steps(scene, values)[moving]
    slopes = np.empty((len(here), len(moving)))
    for column, (place, step) in enumerate(zip(moving, steps, strict=True)):
        moved = values.copy()
        moved[place] += step
        slopes[:, column] = _distances(claims, scene, model.with_parameters(moved), rows) - here
    kept = np.isfinite(slopes).all(axis=1)
    # Step 2: here + slopes . x >= -allowed, with x in steps, and each parameter within its bounds.
    least, most = (limit[moving] - values[moving] for limit in parameters.bounds(scene))
    box = np.stack((least / steps, most / steps), axis=1)
    if unseen:
        box[-1, 1] = UNSEEN_NEAR_PER_REACH * scene.frustum.longest_reach / steps[-1]
        # Surfaces in the plate itself move by any distance, and not in proportion.
        kept &= np.abs(slopes[:, -1]) * box[-1, 1] < NEIGHBORHOOD_PX
    # Step 3: the smallest and the largest value of each parameter in the cell, by linear programming.
    middle = values.copy()
    for column, (place, step) in enumerate(zip(free, steps[: len(free)], strict=True)):
        ends = []
        for sign in (1.0, -1.0):
            cost = np.zeros(len(moving))
            cost[column] = sign
            found = linprog(cost, A_ub=-slopes[kept], b_ub=here[kept] + allowed, bounds=box)
            ends.append(found.x[column] * step if found.status == 0 else -sign * np.inf)
        low[place], high[place] = values[place] + ends[0], values[place] + ends[1]
        if np.isfinite(ends).all():
            middle[place] = (low[place] + high[place]) / 2
    return middle, low, high


def _bounding(
    claims: Claims, scene: Scene, model: DrawnModel, allowed: float
) -> tuple[Floats, tuple[Indices, Indices, Indices]]:
    """Return the distances that can bound the fit, and their places: camera, claim, edge."""
    distance, outside = inside_px(claims, scene, model)
    camera = np.argmin(outside, axis=0)
    number = np.arange(len(claims))
    held = outside[camera, number] <= allowed
    own = distance[camera, number]
    claim, edge = np.nonzero(held[:, None] & (np.abs(own) < NEIGHBORHOOD_PX))
    return own[claim, edge], (camera[claim], claim, edge)


def _distances(
    claims: Claims,
    scene: Scene,
    model: DrawnModel,
    rows: tuple[Indices, Indices, Indices],
) -> Floats:
    distance, _ = inside_px(claims, scene, model)
    return np.asarray(distance[rows])
