"""The interface of ray tracers, and the scale in which they are given a scene."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from xfrustum.scenes.arrays import Floats, Numbers

TRACERS = ("embree", "mitsuba")
"""Names of the tracers that can be asked for, the default first."""


class Tracer(Protocol):
    """A scene's triangles in a ray tracer.

    The answers are proposals, in the tracer's own precision: `certify` knows no tracer.
    """

    name: str

    def first_hits(self, origins: Floats, directions: Floats) -> Numbers:
        """Return the first triangle of each ray, (N,), `NOTHING` where there is none.

        Parameters
        ----------
        origins, directions
            (N, 3) scene units; directions need no unit length.
        """


def unit_scale(vertices: Floats) -> float:
    """Return the power of two that brings a scene to about unit size.

    Embree has absolute constants near the limits of float32. A power of two changes no bit of a
    mantissa, so that the picture does not depend on the unit of length.
    """
    size = float(np.abs(vertices).max(initial=0.0))
    return float(2.0 ** -np.floor(np.log2(size))) if size > 0 else 1.0
