"""Error bounds of the surface points that a rasterizer draws in float32."""

import numpy as np

from xfrustum.scenes.arrays import Floats, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.scenes.model.scene import Scene

POSITION_ROUNDINGS = 16
"""Roundings of 2^-24 of a triangle's largest coordinate L in a drawn surface point.

Our own rasterizer computes the point in double precision and rounds it once, in x and in z; seen
from an aperture a that is 1 + |x - a| / L roundings, 2 to 4 on the plates and objects of practice.
Renderers that interpolate the point as a varying need 16.

The vertex is stored with one. Perspective interpolation forms sum(b_i p_i / w_i) / sum(b_i / w_i)
from plane equations: one rounding for each product p_i / w_i, two for each of the two gradients,
two for each step along x and y, in numerator and denominator alike, and one for the quotient:
1 + 2 (1 + 2 + 4) + 1 = 16.
"""

FLOAT32_ROUNDING = 2.0**-24

POSITION_TOLERANCE = POSITION_ROUNDINGS * FLOAT32_ROUNDING
"""Error bound of a drawn point, relative to the largest coordinate of its triangle."""


def position_tolerance(scene: Scene, triangle: Numbers, position: Floats) -> Floats:
    """Return the error bounds (N,) of drawn surface points (N, 3), scene units.

    They are on triangles (N,); where that is `NOTHING`, the point's own coordinates stand for its
    triangle's.
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
