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

from xfrustum.compare.metrics.displacement import displacement, lengths
from xfrustum.compare.prediction.displacement import TruePoints, displacement_lengths, in_first_slab, pierced
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import DoubleFrustum, Offset
from xfrustum.scenes.plate.frustum import Frustum

PERCENTILE = 99.0
"""Percentile of displacement that a requirement limits."""

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
    0 where the truth shows no surface. Infinite where more than one pixel in a hundred shows a surface
    that passes through the aperture itself: the true line meets it there, and has no place for it on the
    film; drawn is what lies closer than n, displaced by pixels at any n.

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
    moved = np.where(pierced(truth), np.inf, np.nan_to_num(moved, nan=0.0))
    largest = maximum_filter(moved, size=NEIGHBORHOOD_PX)[truth.covered]
    return float(np.percentile(largest, PERCENTILE, method="higher"))


def traced_displacement(reference: Reference, truth: HogelImage, settings: DoubleFrustum) -> float:
    """Return the 99th percentile of displacement of what the two cameras would draw without rounding."""
    model = reference.trace_model(truth.camera.aperture, settings)
    return displacement_percentile(displacement(model, truth.camera))


def displacement_percentile(vectors: Floats) -> float:
    """Return the 99th percentile of the lengths of vectors (.., 2) where they are known; 0 where none is."""
    moved = lengths(vectors)
    moved = moved[np.isfinite(moved)]
    return float(np.percentile(moved, PERCENTILE)) if moved.size else 0.0
