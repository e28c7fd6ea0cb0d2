"""Bezier patches: points, normals and second derivatives of tensor-product surfaces of any degrees.

A control net is (n + 1, m + 1, 3): the surface of degree n along u, its first index, and m along v,
both from 0 to 1 (Farin, "Curves and surfaces for CAGD", 5th ed., chapters 4 and 14).
"""

from __future__ import annotations

import math

import numpy as np

from xfrustum.scenes.arrays import Floats

EPSILON = float(np.finfo(np.float64).eps)
"""Distance from 1 to the next larger double, 2^-52: twice the largest relative error of one rounding."""

MAX_STEPS = 1e18
"""Largest number of steps that is counted along a patch: the quotient that gives it may be infinite."""


def evenly(count: int) -> Floats:
    """Return the count + 1 parameters that divide 0..1 into equal steps."""
    return np.asarray(np.arange(count + 1) / count)


def casteljau(controls: Floats, at: Floats) -> Floats:
    """Return the points (T, ..., 3) of a Bezier curve, or curves, at parameters (T,).

    De Casteljau's repeated interpolation, element by element, gives the same doubles on every machine, and
    exactly the first and the last control point at 0 and 1.
    """
    at = at.reshape(-1, *(1 for _ in controls.shape))
    points = np.broadcast_to(controls, (len(at), *controls.shape))
    while points.shape[1] > 1:
        points = points[:, :-1] * (1 - at) + points[:, 1:] * at
    return points[:, 0]


def surface(net: Floats, u: Floats, v: Floats) -> Floats:
    """Return the points (U, V, 3) of a patch on a grid of parameters (U,) and (V,)."""
    return np.ascontiguousarray(casteljau(casteljau(net, u).swapaxes(0, 1), v).swapaxes(0, 1))


def derivative(net: Floats, axis: int) -> Floats:
    """Return the control net of the derivative along u (axis 0) or v (axis 1), one degree lower."""
    degree = net.shape[axis] - 1
    if degree == 0:
        return np.zeros_like(net)
    return np.asarray(degree * np.diff(net, axis=axis))


def second_derivative_bounds(net: Floats) -> tuple[float, float, float]:
    """Return upper bounds of |f_uu|, |f_uv| and |f_vv| over a patch.

    A Bezier surface, hence also a derivative of one, lies in the convex hull of its control points.
    """
    along_u, along_v = derivative(net, 0), derivative(net, 1)
    second = (derivative(along_u, 0), derivative(along_u, 1), derivative(along_v, 1))
    f_uu, f_uv, f_vv = (float(np.linalg.norm(part, axis=-1).max()) for part in second)
    return f_uu, f_uv, f_vv


def normals(net: Floats, u: Floats, v: Floats) -> Floats:
    """Return the unit normals (U, V, 3) along f_u x f_v; NaN where there is none.

    Where f_u x f_v is zero on a border, as all along a border that is collapsed to a point, the normal is
    the limit from inside along the other parameter, in which f_u x f_v grows by its derivative.
    """
    # Step 1: f_u x f_v everywhere, and where it is zero within rounding.
    net_u, net_v = derivative(net, 0), derivative(net, 1)
    f_u, f_v = surface(net_u, u, v), surface(net_v, u, v)
    cross = np.cross(f_u, f_v)
    zero = np.linalg.norm(cross, axis=-1) <= _cross_rounding(net, f_u, f_v)
    if zero.any():
        # Step 2: the derivatives of f_u x f_v along v and along u, by the product rule.
        f_uu, f_uv, f_vv = (
            surface(part, u, v) for part in (derivative(net_u, 0), derivative(net_u, 1), derivative(net_v, 1))
        )
        # Toward the inside, a parameter grows from 0 and falls from 1.
        from_v = np.sign(0.5 - v)[:, None] * (np.cross(f_uv, f_v) + np.cross(f_u, f_vv))
        from_u = np.sign(0.5 - u)[:, None, None] * (np.cross(f_uu, f_v) + np.cross(f_u, f_uv))
        # Step 3: on a border the derivative toward the inside is the direction of the limit; along v first.
        at_v, at_u = np.isin(v, (0, 1))[None, :, None], np.isin(u, (0, 1))[:, None, None]
        limit = np.where(at_v & from_v.any(axis=-1, keepdims=True), from_v, np.where(at_u, from_u, 0.0))
        cross = np.where(zero[..., None], limit, cross)
    # Step 4: unit length, and NaN where even the limit is zero.
    length = np.linalg.norm(cross, axis=-1, keepdims=True)
    return np.asarray(np.divide(cross, length, out=np.full(cross.shape, np.nan), where=length > 0))


def _cross_rounding(net: Floats, f_u: Floats, f_v: Floats) -> Floats:
    """Return the largest length that f_u x f_v can have by rounding where it is zero.

    De Casteljau's interpolation of degree n rounds by at most 2 n epsilon of the largest control point,
    a difference of control points by epsilon of itself, and a cross product by 4 epsilon of the product
    of the lengths.
    """
    length_u, length_v = np.linalg.norm(f_u, axis=-1), np.linalg.norm(f_v, axis=-1)
    steps = 2 * sum(net.shape) * EPSILON
    off_u, off_v = (steps * np.linalg.norm(derivative(net, axis), axis=-1).max() for axis in (0, 1))
    return np.asarray(length_u * off_v + length_v * off_u + 4 * EPSILON * length_u * length_v)


def steps_for(net: Floats, chord_tolerance: float) -> tuple[int, int]:
    """Return the numbers of steps along u and v into which a patch must be cut to keep a chord tolerance.

    Flat right triangles with legs 1/a and 1/b in the parameters lie within
    (M_uu/a^2 + 2 M_uv/(a b) + M_vv/b^2) / 8 of the surface, point by point, M being the largest second
    derivatives (Filip, Magedson and Markot, "Surface algorithms using bounds on derivatives", CAGD 3,
    1986). With 2/(a b) <= 1/a^2 + 1/b^2 this is at most ((M_uu + M_uv)/a^2 + (M_uv + M_vv)/b^2) / 8;
    the fewest triangles give each half of the tolerance.
    """
    # M_uu + M_uv and M_uv + M_vv.
    f_uu, f_uv, f_vv = second_derivative_bounds(net)
    along_u, along_v = f_uu + f_uv, f_uv + f_vv
    # Each direction gets half of the tolerance, or all of it where the other one needs none.
    halves = 2 if along_u > 0 and along_v > 0 else 1
    # bound / (8 a^2) = tolerance / halves, solved for a.
    needed = (math.sqrt(halves * (bound / chord_tolerance) / 8) for bound in (along_u, along_v))
    steps_u, steps_v = (max(1, math.ceil(min(steps, MAX_STEPS))) for steps in needed)
    return steps_u, steps_v
