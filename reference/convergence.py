"""The integral over a hogel's aperture, converged to a stated tolerance (paper, section 6: band limiting).

By scrambled Sobol points (Owen, 1997). Each scrambling gives an unbiased estimate by itself, so that the
spread of several says how exact their mean is, without knowing anything about the picture. The error of
N points falls as N^-1.5 where a pixel changes smoothly with the point, and as N^-0.75 where an edge
passes over it; independent random points would give N^-0.5.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from xfrustum.scenes.appearance.sampling import MAX_SAMPLES
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.plate.plate import Aperture, Plate

SCRAMBLINGS = 8
"""Independent estimates. A pixel's standard error is itself known to one part in sqrt(2 (8 - 1)) or so,
that of a picture, the root mean square over its pixels, far better."""

FIRST_POINTS = 4
"""Of each scrambling: fewer may all miss an edge, and agree."""

TOLERANCE = 1e-3
"""A quarter of an 8-bit step of full scale."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Converged:
    """An integral over an aperture, and how well it is known.

    Attributes
    ----------
    color
        (H, W, 3) linear RGB.
    standard_error
        (H, W, 3) of each pixel and channel.
    points
        Points of the aperture that were averaged.
    """

    color: Floats
    standard_error: Floats
    points: int

    @property
    def error(self) -> float:
        """Root mean square of the standard error over all pixels and channels."""
        return float(np.sqrt(np.mean(self.standard_error**2)))


def converged(
    mean: Callable[[Sequence[Aperture]], Floats],
    plate: Plate,
    aperture: Aperture,
    tolerance: float,
    seed: int = 0,
) -> Converged:
    """Double the number of points until the error is at most the tolerance.

    Parameters
    ----------
    mean
        Returns the picture (H, W, 3), averaged over some apertures.
    plate
        Its pitch is the size of the aperture.
    aperture
        The middle.
    tolerance
        For `Converged.error`, in radiance. What is not reached with `MAX_SAMPLES` points is returned
        as it is: its error says so.
    """
    engines = [qmc.Sobol(2, rng=seed * SCRAMBLINGS + index) for index in range(SCRAMBLINGS)]
    sums, count, more = [np.zeros(())] * SCRAMBLINGS, 0, FIRST_POINTS
    while True:
        for index, engine in enumerate(engines):
            points = _spread(plate, aperture, engine.random(more))
            sums[index] = sums[index] + more * mean(points)
        count += more
        estimates = np.stack(sums) / count
        found = Converged(
            color=estimates.mean(axis=0),
            standard_error=estimates.std(axis=0, ddof=1) / np.sqrt(SCRAMBLINGS),
            points=count * SCRAMBLINGS,
        )
        if found.error <= tolerance or 2 * found.points > MAX_SAMPLES:
            return found
        more = count


def _spread(plate: Plate, aperture: Aperture, points: Floats) -> list[Aperture]:
    """Return apertures at points of the unit square, stretched over one hogel pitch."""
    (width, height), (columns, rows) = plate.size, plate.hogels
    return [
        replace(aperture, x=aperture.x + x * width / columns, y=aperture.y + y * height / rows)
        for x, y in (points - 0.5).tolist()
    ]
