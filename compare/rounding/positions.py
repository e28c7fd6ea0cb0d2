"""Error bounds of the surface points that a rasterizer draws in float32."""

import numpy as np

from xfrustum.scenes.arrays import Floats, Numbers
from xfrustum.scenes.model.images import NOTHING
from xfrustum.scenes.model.scene import Scene

POSITION_ROUNDINGS = 16
"""Roundings of 2^-24 of a triangle's largest coordinate L in a drawn surface point.

Our own rasterizer computes the point in double precision and rounds x and z once each. Seen from an
aperture a, these are 1 + |x - a| / L roundings: 2 to 4 for usual plates and objects. Renderers that
interpolate the point as a varying need 16.

The stored vertex has one rounding. Perspective interpolation computes sum(b_i
p_i / w_i) / sum(b_i / w_i) from plane equations. Numerator and denominator each have one rounding
for a product p_i / w_i, two for the two gradients, and four for the steps along x and y. The
quotient has one: 1 + 2 (1 + 2 + 4) + 1 = 16.
"""

FLOAT32_ROUNDING = 2.0**-24

POSITION_TOLERANCE = POSITION_ROUNDINGS * FLOAT32_ROUNDING
"""Error bound of a drawn point, relative to the largest coordinate of its triangle."""


def position_tolerance(scene: Scene, triangle: Numbers, position: Floats) -> Floats:
    """Return the error bounds (N,) of drawn surface points (N, 3), scene units.

    `triangle` (N,) are the triangles of the points. Where it is `NOTHING`, the bound uses the
    coordinates of the point itself in place of its triangle's.
    """
    known = triangle != NOTHING
    if known.all():
        return POSITION_TOLERANCE * scene.largest_coordinates[triangle]
    largest: Floats = np.abs(position).max(axis=1, initial=0.0)
    largest[known] = scene.largest_coordinates[triangle[known]]
    return POSITION_TOLERANCE * largest


def largest_tolerance(scene: Scene) -> float:
    """Return the largest `position_tolerance` of a point on a scene's triangles, scene units."""
    return float(POSITION_TOLERANCE * scene.largest_coordinates.max(initial=0.0))
