"""Means of color over certified lines: over boxes of pixels, over apertures, to convergence.

The integral over a hogel's aperture (paper, section 6: band limiting) is taken at scrambled Sobol
points (Owen, 1997). Each scrambling gives an unbiased estimate. The scatter of several estimates
therefore measures the error of their mean, for any picture. The error of N points falls as N^-1.5
where a pixel changes smoothly with the point, and as N^-0.75 where an edge passes over it;
independent random points would give N^-0.5.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from xfrustum.reference.certify.certify import Certifier
from xfrustum.reference.certify.cone import Triangles
from xfrustum.reference.lines import crossed_frustum
from xfrustum.reference.memory import BAND_PIXELS, bands
from xfrustum.reference.shading import Shader, ShadowedShader
from xfrustum.scenes.appearance import MAX_SAMPLES, Sampling
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture, Plate

#: Points along each side of a pixel that integrate the box of multisampling. The error for a
#: straight edge along the rows or columns of points is at most half a row, 1/16 of the pixel; for
#: other edges it is less.
BOX_SIDE = 8

#: pixels whose sums are held at once, which bounds memory: 24 bytes a pixel
AVERAGED_PIXELS = 1 << 22


def averages(sampling: Sampling) -> bool:
    """Return whether the color of a pixel is a mean over several points."""
    return sampling != Sampling()


def points_per_side(sampling: Sampling) -> int:
    """Return the points along each side of a pixel that average color, also for multisampling."""
    return (
        sampling.supersample if sampling.multisample == 1 else max(sampling.supersample, BOX_SIDE)
    )


def mean_color(
    scene: Scene,
    triangles: Triangles,
    shader: Shader | ShadowedShader,
    apertures: Sequence[Aperture],
    side: int,
    rows: range,
) -> Floats:
    """Return mean linear RGB (rows, W, 3) over apertures and side x side points of each pixel."""
    width, height = scene.frustum.resolution
    total = np.zeros((len(rows), width, 3))
    for aperture in apertures:
        fine = replace(
            crossed_frustum(scene.frustum, aperture), resolution=(width * side, height * side)
        )
        certifier = Certifier(triangles, fine)
        for some in bands(width, rows, BAND_PIXELS // side**2):
            lines = range(some.start * side, some.stop * side)
            decided, directions = (
                certifier.decide(lines),
                fine.directions(slice(lines.start, lines.stop)),
            )
            position = np.asarray(fine.center) + decided.s[..., None] * directions
            color = shader.picture(decided.triangle, position, directions)
            # Sum row by row, so that the result does not depend on the division into bands.
            for row, line in zip(
                lines, color.reshape(len(lines), width, side, 3).sum(axis=2), strict=True
            ):
                total[row // side - rows.start] += line
    return total / (len(apertures) * side * side)


#: Number of independent estimates. Eight determine the standard error of a pixel to one part in
#: sqrt(2 (8 - 1)), and of a picture, the root mean square over its pixels, far better.
SCRAMBLINGS = 8

#: Initial number of points of each scrambling: with fewer, all estimates may miss an edge
FIRST_POINTS = 4

#: Default standard error, radiance: a quarter of an 8-bit step of full scale
TOLERANCE = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Converged:
    """Integral over an aperture, linear RGB (H, W, 3), its standard error and number of points."""

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
    """Double the number of points until the error is within the tolerance, in radiance.

    `mean` returns the picture (H, W, 3), averaged over some apertures; the aperture is as large as
    the plate's pitch. After `MAX_SAMPLES` points the picture is returned with the error reached.
    """
    engines = [
        scipy.stats.qmc.Sobol(2, rng=seed * SCRAMBLINGS + index) for index in range(SCRAMBLINGS)
    ]
    sums, count, more = [np.zeros(())] * SCRAMBLINGS, 0, FIRST_POINTS
    while True:
        # Doubling keeps all points so far: a Sobol sequence extends itself.
        for index, engine in enumerate(engines):
            points = _spread(plate, aperture, engine.random(more))
            sums[index] = sums[index] + more * mean(points)
        count += more
        # The scatter of independent scramblings estimates the error of their mean.
        estimates = np.stack(sums) / count
        estimate = Converged(
            color=estimates.mean(axis=0),
            standard_error=estimates.std(axis=0, ddof=1) / np.sqrt(SCRAMBLINGS),
            points=count * SCRAMBLINGS,
        )
        if estimate.error <= tolerance or 2 * estimate.points > MAX_SAMPLES:
            return estimate
        more = count


def _spread(plate: Plate, aperture: Aperture, points: Floats) -> list[Aperture]:
    """Return apertures at points of the unit square, stretched over one hogel pitch."""
    (width, height), (columns, rows) = plate.size, plate.hogels
    return [
        replace(aperture, x=aperture.x + x * width / columns, y=aperture.y + y * height / rows)
        for x, y in (points - 0.5).tolist()
    ]
