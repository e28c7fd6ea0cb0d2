"""The interval of each parameter of a guess: all values under which no claim fails.

Each claim gives an inequality: the distance of the pixel's center from each edge of its triangle, counted
inward, is at least zero. After linearizing, the guesses that satisfy all claims form a convex cell; linear
programming finds its extent along each axis.
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
    # Step 1: how fast each distance changes with each free parameter, by finite differences.
    steps = parameters.derivative_steps(scene, values)[list(free)]
    slopes = np.empty((len(here), len(free)))
    for column, (place, step) in enumerate(zip(free, steps, strict=True)):
        moved = values.copy()
        moved[place] += step
        slopes[:, column] = _distances(claims, scene, model.with_parameters(moved), rows) - here
    finite = np.isfinite(slopes).all(axis=1)
    # Step 2: here + slopes . x >= -allowed, with x in steps, and each parameter within its bounds.
    least, most = (limit[list(free)] - values[list(free)] for limit in parameters.bounds(scene))
    box = np.stack((least / steps, most / steps), axis=1)
    # Step 3: the smallest and the largest value of each parameter in the cell, by linear programming.
    middle = values.copy()
    for column, (place, step) in enumerate(zip(free, steps, strict=True)):
        ends = []
        for sign in (1.0, -1.0):
            cost = np.zeros(len(free))
            cost[column] = sign
            found = linprog(cost, A_ub=-slopes[finite], b_ub=here[finite] + allowed, bounds=box)
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
