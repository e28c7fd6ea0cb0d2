"""How far the drawn picture is displaced, from the truth: a bound in closed form, and the model traced.

A plan must hold when it is measured, over the pixels of the drawn picture. These do not show quite what
the truth shows: at contours another surface, and everywhere points that belong farther out. So each of the
truth's pixels is given the largest displacement of itself and its neighbors, since a picture that is
displaced by less than a pixel shows nothing else there, and that as the pixel would have it where it is
drawn.

What no pixel of the truth shows that form cannot know. A camera that has stepped back by n sees farther to
the side than the true frustum where |z| is no larger than n: what the scene has there, beside the film,
comes into the picture. That is left to the reference, which traces the offset cameras themselves.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter

from xfrustum.compare.beyond import PERCENTILE, displacement_p99
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.compare.prediction.displacement import TruePoints, displacement_lengths, in_first_slab
from xfrustum.reference import Reference
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import DoubleFrustum, Offset
from xfrustum.scenes.plate.frustum import Frustum

NEIGHBORHOOD_PX = 3
"""Width of a neighborhood in pixels: one to each side."""


def displacement_bound(truth: HogelImage, frustum: Frustum, settings: DoubleFrustum) -> float:
    """Return the 99th percentile of displacement that a drawn picture does not exceed, in pixels.

    Parameters
    ----------
    truth
        The true image of an aperture.
    frustum, settings
        The scene's, and how the two cameras draw.

    Returns
    -------
    0 where the truth shows no surface. Infinite where more than one pixel in a hundred shows a surface in
    the aperture itself, which lies in the plate or passes through it: the true line ends there, and has no
    place for it on the film. Drawn is what lies closer than n, whose displacement no n makes small.

    Notes
    -----
    With zf the height that is drawn exactly, a surface at |z| is displaced by u n / (|z| + n) (1 - |z| / zf)
    where it belongs (`displacements`), and where it is drawn by (1 + n / |z|) / (1 + n / zf) times that.
    """
    if not truth.covered.any():
        return 0.0
    points = TruePoints.of(truth)
    moved = displacement_lengths(points, frustum, settings)
    if settings.offset is Offset.PLATE:
        fitted = settings.fitted_height(frustum)
        per_fit = 0.0 if fitted is None else 1 / fitted
        bent = in_first_slab(points.height, frustum, settings)
        ratio = (1 + settings.near / np.abs(points.height[bent])) / (1 + settings.near * per_fit)
        moved[bent] *= ratio
    moved = np.where(truth.covered & (truth.height == 0), np.inf, np.nan_to_num(moved, nan=0.0))
    largest = maximum_filter(moved, size=NEIGHBORHOOD_PX)[truth.covered]
    return float(np.percentile(largest, PERCENTILE, method="higher"))


def traced_errors(reference: Reference, truth: HogelImage, settings: DoubleFrustum) -> tuple[float, float]:
    """Return what two cameras that round nothing get wrong at an aperture.

    Returns
    -------
    The 99th percentile of displacement, px, infinite where it is undefined; and the share of judged pixels
    that show the wrong surface.
    """
    model = reference.trace_model(truth.camera.aperture, settings)
    found = compare_images(truth, model, reference, radiance=False)
    assert found.surface is not None, "the reference has the scene at hand"
    return displacement_p99(found), found.surface.fraction
