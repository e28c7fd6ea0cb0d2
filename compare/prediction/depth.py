"""Closed form of the smallest separation of two surfaces that a depth buffer still orders.

Two errors limit it. They are independent, so that their squares add.

 * The step: distinct depths are stored as equal ones up to one step of the format, and a strict test
   then keeps the wrong surface where it was drawn first (docs/method.md).
 * Float32: whatever the format, depth is computed in float32 before it is stored. Each rounding is
   uniform within half a unit in the last place of the rounded number: a variance of a twelfth of a
   unit squared. The difference of two surfaces has twice that variance, and is close to normal.
"""

from __future__ import annotations

from statistics import NormalDist
from typing import assert_never

import numpy as np

from xfrustum.compare.rounding.depth import LOG_ULPS, STEP
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping

MAX_MISORDERED_FRACTION = 0.01
"""Largest share of pixels that may show the wrong surface at a separation that counts as ordered; equal to
`tolerances.MAX_WRONG`."""

CLIP_DEPTH_ROUNDINGS = 3
"""Roundings of a vertex's depth, relative to w: clip depth is a product and a sum, and clip w is rounded."""

PLANE_ROUNDINGS = 2
"""Roundings of a triangle's plane equation: one step along x and one along y."""

W_ROUNDINGS = 6
"""Roundings of a fragment's w: the surface's position, clip w, its reciprocal, the two steps of the plane
equation of 1 / w, and the reciprocal of 1 / w."""

EXPRESSION_ROUNDINGS = {DepthMapping.LINEAR: 3, DepthMapping.LOGARITHMIC: LOG_ULPS}
"""Roundings of the depth that a fragment computes from w. Linear depth has a difference, a division, and
storing; the logarithm counts its half units in the last place. The approximation error of the logarithm
beyond rounding is the same for two depths so near to each other, and cancels."""


def smallest_separation(
    w: Floats, near_plane: float, far_plane: float, depth: DepthFormat, mapping: DepthMapping
) -> Floats:
    """Return the smallest separation of two surfaces that a depth buffer still orders.

    Depth resolution does not depend on which surface wins: at the same distance w from the camera the
    separation is the same for C (nearest wins) and C* (farthest wins). C* keeps the surfaces of largest w,
    where hyperbolic depth is coarsest.

    Parameters
    ----------
    w
        Distances of the surfaces from the camera along its axis, scene units, between the planes.
    near_plane, far_plane
        Distances of the near and far plane from the camera: without slabs n, and n + the reach on the
        camera's side.

    Returns
    -------
    The difference of two surfaces' w, scene units, at which `MAX_MISORDERED_FRACTION` of the pixels still
    show the wrong one, where equal depths count as wrong; the shape of `w`.

    Notes
    -----
    Steps alone, by depth b bits deep (docs/method.md): w^2 (f - n) / (f n 2^b) for the hyperbolic
    mappings, w ln(f / n) / 2^b logarithmic, (f - n) / 2^b linear; for D32F the spacing of float32 at
    the stored value, which near one is that of 24 bits, and 2^-24 to 2^-23 of w reversed.
    """
    w = np.asarray(w, dtype=np.float64)
    stored, slope = stored_depth(w, near_plane, far_plane, mapping)
    step = STEP[depth] or float32_spacing(stored)
    chance = NormalDist().inv_cdf(1 - MAX_MISORDERED_FRACTION)
    rounding = chance * np.sqrt(2 * depth_variance(w, (stored, slope), near_plane, far_plane, mapping))
    return np.asarray(np.hypot(step, rounding) / slope)


def stored_depth(w: Floats, n: float, f: float, mapping: DepthMapping) -> tuple[Floats, Floats]:
    """Return the stored value before rounding, and the absolute value of its derivative by w."""
    match mapping:
        case DepthMapping.LOGARITHMIC:
            octaves = np.log(f / n)
            return np.log(w / n) / octaves, 1 / (w * octaves)
        case DepthMapping.LINEAR:
            return (w - n) / (f - n), np.full_like(w, 1 / (f - n))
        case DepthMapping.STANDARD | DepthMapping.GL:
            return f * (w - n) / (w * (f - n)), f * n / ((f - n) * w**2)
        case DepthMapping.REVERSED:
            return n * (f - w) / (w * (f - n)), f * n / ((f - n) * w**2)
        case _:
            assert_never(mapping)


def depth_variance(
    w: Floats, depth: tuple[Floats, Floats], n: float, f: float, mapping: DepthMapping
) -> Floats:
    """Return the variance of one surface's depth from the roundings of float32, given its `stored_depth`."""
    stored, slope = depth
    spacing = float32_spacing(w)
    position = (slope * spacing) ** 2
    # Clip depth is a sum of two terms, and rounds relative to the larger: one, or reversed n / w.
    largest: Floats | float
    match mapping:
        case DepthMapping.LINEAR | DepthMapping.LOGARITHMIC:
            after = EXPRESSION_ROUNDINGS[mapping] * float32_spacing(stored) ** 2
            return np.asarray((W_ROUNDINGS * position + after) / 12)
        case DepthMapping.STANDARD | DepthMapping.GL:
            largest = f / (f - n)
        case DepthMapping.REVERSED:
            largest = f * n / ((f - n) * w)
        case _:
            assert_never(mapping)
    clip = CLIP_DEPTH_ROUNDINGS * (largest * spacing / w) ** 2
    if mapping is DepthMapping.GL:
        # Depth from -1 to 1 is rounded, halved, and rounded once more when it is moved by a half.
        divided = float32_spacing(2 * stored - 1) ** 2
        moved = (1 + PLANE_ROUNDINGS) * float32_spacing(stored) ** 2
        return np.asarray((position + (clip + divided) / 4 + moved) / 12)
    return np.asarray((position + clip + (1 + PLANE_ROUNDINGS) * float32_spacing(stored) ** 2) / 12)


def float32_spacing(values: Floats) -> Floats:
    """Return the distance of neighboring float32 numbers at some values."""
    return np.spacing(np.abs(values).astype(np.float32)).astype(np.float64)
