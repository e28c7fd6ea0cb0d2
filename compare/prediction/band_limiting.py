"""Closed form of band limiting: blur over a hogel's area, and the number of points it needs.

A band-limited hogel shows the mean of the pictures from all points of its area, a box of one pitch
p (paper, section 6). From one side of the box to the other, the picture of a surface at height z
moves by p |1/z - 1/Z| W/(2 t) pixels, with the screen at Z. This distance is the blur. Along
straight contours, color across the blur is a sum of steps. The exact mean of a step is the share of
the box on one side of a line; its mean over N points is the share of the points on this side. The
largest difference of these two shares, over all lines, is the discrepancy D(N) of the points for
half planes. Therefore the error of the mean over N points is at most V D(N), where V is the total
change of color across the blur: the contrast of an edge.

For m x m points in rows and columns, D = 1/(2 m). The points of `sampling.sub_apertures`, only few
of which lie on one line, have a smaller D from about 1,000 points on. In the mean over a pixel's
area an edge is a ramp, at least one pixel wide. A blur of b pixels, summed over both axes, changes
this mean by at most V b/8. If b < 1, the error of the points affects only a share b of the pixel.
"""

import math
from collections.abc import Iterable
from types import MappingProxyType

import numpy as np

from xfrustum.reference.lines import film_window
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.model.visibility import DepthBin, Region, depth_bins
from xfrustum.scenes.plate import Aperture

LEVEL = 1 / 255  #: one level of 8 bits, in radiance

#: Half-plane discrepancy of N sub-apertures, N a power of two: the largest difference between the
#: share of the points on one side of a straight line and the share of the box on that side. It was
#: computed for 2,000 to 6,000 directions of the line and all offsets, refined near the maximum, and
#: rounded up; a test computes it again. N = 2 is missing, because two points have a larger
#: discrepancy than one.
DISCREPANCY = MappingProxyType(
    {
        1: 0.5,
        4: 0.393,
        8: 0.218,
        16: 0.184,
        32: 0.142,
        64: 0.0774,
        128: 0.0608,
        256: 0.0329,
        512: 0.0231,
    }
    | {
        1024: 0.0157,
        2048: 0.00985,
        4096: 0.00715,
        8192: 0.00515,
        16384: 0.0034,
        32768: 0.0023,
        65536: 0.0017,
    }
)


def blur_px(scene: Scene, z: float) -> tuple[float, float]:
    """Return the blur of a point at signed height z, in columns and rows; infinite for z = 0."""
    frustum, plate, screen = scene.frustum, scene.plate, scene.frustum.screen
    moved = abs((math.inf if z == 0 else 1 / z) - (0.0 if screen is None else 1 / screen.height))
    _, half = film_window(frustum, plate.middle)
    columns, rows = (
        plate.size[axis] / plate.hogels[axis] * moved * frustum.resolution[axis] / (2 * half[axis])
        for axis in (0, 1)
    )
    return columns, rows


def error_bound(count: int, blur: tuple[float, float], contrast: float) -> float:
    """Return the largest error, radiance, of a mean over `count` points (key of `DISCREPANCY`)."""
    error = contrast * min(1.0, sum(blur)) * DISCREPANCY[count]
    return min(error, contrast * sum(blur) / 8) if count == 1 else error


def sub_apertures_for(
    blur: tuple[float, float], contrast: float, error: float = LEVEL
) -> int | None:
    """Return the smallest number of points with `error_bound` at most `error`, or None."""
    return next(
        (count for count in DISCREPANCY if error_bound(count, blur, contrast) <= error), None
    )


def blurs(scene: Scene, content: DepthBin) -> tuple[tuple[float, float], float]:
    """Return a depth bin's largest blur on each axis, and its smallest blur on the larger axis."""
    sign, screen = -1.0 if content.behind else 1.0, scene.frustum.screen
    nearest, farthest = (blur_px(scene, sign * end) for end in (content.nearest, content.farthest))
    least = min(max(nearest), max(farthest))
    if screen is not None and content.nearest <= sign * screen.height <= content.farthest:
        least = 0.0
    return (max(nearest[0], farthest[0]), max(nearest[1], farthest[1])), least


def contrast_of(scene: Scene, apertures: Iterable[Aperture] | None = None) -> float:
    """Return a bound of the radiance step at an edge, 0 to 1, seen from apertures (None: all).

    It is the largest radiance that the materials of visible objects can have, next to black. It is
    at most one, because 8-bit pictures are clipped there.
    """
    region, environment = Region.from_cells(scene, apertures), scene.appearance.environment
    lights = sum((np.array(light.color) for light in scene.appearance.lights), np.zeros(3))
    sky = np.zeros(3)
    if environment is not None and environment.strength > 0:
        sky = environment.strength * environment.radiance.max(axis=(0, 1)).astype(np.float64)
    brightest = 0.0
    for part, material in zip(scene.objects, scene.materials, strict=True):
        if region.shows(part):
            # Textures are at most one.
            colors = part.vertex_colors
            albedo = np.ones(3) if colors is None else colors.max(axis=0)[:3].astype(np.float64)
            body = (np.array(material.ambient) + lights * material.diffuse) * albedo
            brightest = max(
                brightest, *(body + lights * material.specular + sky * material.reflectivity)
            )
    return min(1.0, float(brightest))


def needed_sub_apertures(scene: Scene, error: float = LEVEL) -> int:
    """Return the number of sub-apertures for a radiance error, at most the largest tabulated."""
    contrast = contrast_of(scene)
    counts = [
        sub_apertures_for(blurs(scene, content)[0], contrast, error)
        for content in depth_bins(scene)
    ]
    return max((max(DISCREPANCY) if count is None else count for count in counts), default=1)
