"""The interface of ray tracers, and the scale of the scenes that they get."""

from typing import Protocol

import numpy as np

from xfrustum.scenes.arrays import Floats, Numbers

TRACERS = ("embree", "mitsuba")  #: names of the tracers; the first is the default


class Tracer(Protocol):
    """Triangles of a scene in a ray tracer. Its hits are proposals: `certify` uses no tracer."""

    name: str

    def first_hits(self, origins: Floats, directions: Floats) -> Numbers:
        """Return the first triangle (N,) of rays (N, 3) of any length, `NOTHING` for none."""


def unit_scale(vertices: Floats) -> float:
    """Return the power of two that scales a scene to about unit size, exactly.

    Embree has absolute constants near the limits of float32.
    """
    size = float(np.abs(vertices).max(initial=0.0))
    return float(2.0 ** -np.floor(np.log2(size))) if size > 0 else 1.0
