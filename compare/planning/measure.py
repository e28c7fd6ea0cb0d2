"""Is a requirement met? Measured, by drawing the scene, and sheets at its farthest visible surfaces."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from xfrustum.compare.metrics.displacement import displacement
from xfrustum.compare.metrics.error_maps import judged_pixels
from xfrustum.compare.metrics.surface import wrong_surface
from xfrustum.compare.planning.displacement import displacement_percentile
from xfrustum.compare.planning.sheets import misordered
from xfrustum.compare.planning.views import Quality, Requirement, View, Views
from xfrustum.compare.prediction.depth import MISORDERED
from xfrustum.raster import Rasterizer
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

SEARCHED = 8.0
"""The smallest separation is looked for between this many times less and more than is predicted."""

HALVINGS = 7
"""Of the range in which it is looked for, on a logarithmic scale: leaves 2 log2(8) / 2^7 octaves, 3 %."""


def measure(
    scene: Scene, apertures: Sequence[Aperture], settings: DoubleFrustum, requirement: Requirement
) -> Quality:
    """Return how well any settings do, at the worst of some apertures.

    Raises
    ------
    InputError
        The settings make no sense for the scene's frustum, or there is no usable OpenGL.
    """
    settings.check_against(scene.frustum)
    return measured(Views.of(scene, apertures), settings, requirement)


def measured(
    views: Views,
    settings: DoubleFrustum,
    requirement: Requirement,
    done: Callable[[int], object] = lambda steps: None,
    *,
    smallest: bool = True,
) -> Quality:
    """Draw what some apertures show, and sheets at its farthest surfaces; return the worst.

    Parameters
    ----------
    done
        Called after each aperture, with 1.
    smallest
        Whether to look for the smallest separation, which nothing is required of; else it is NaN.
    """
    separation = requirement.separation_in(views.scene.frustum)
    found = []
    with Rasterizer(views.scene) as rasterizer:
        for view in views.views:
            moved, wrong = _drawn(views, view, rasterizer, settings)
            found.append(
                Quality(
                    displacement_p99_px=moved,
                    depth_wrong=wrong,
                    misordered=misordered(views.scene, view, settings, separation),
                    separation=_smallest_separation(views, view, settings) if smallest else math.nan,
                )
            )
            done(1)
    return Quality.worst(found)


def meets(quality: Quality, requirement: Requirement) -> bool:
    """Return whether what was measured is what is required."""
    return (
        quality.displacement_p99_px <= requirement.tolerance_px
        and quality.depth_wrong <= requirement.max_wrong
        and quality.misordered <= MISORDERED
    )


def _drawn(views: Views, view: View, rasterizer: Rasterizer, settings: DoubleFrustum) -> tuple[float, float]:
    """Return the 99th percentile of displacement, and the share of wrong surfaces charged to depth.

    That is what is wrong with the depth buffer and right with a linear one in 32 bits, all else equal: the
    last link of the chain (docs/method.md, "The error budget").
    """
    exact_depth = replace(settings, depth=DepthFormat.D32F, mapping=DepthMapping.LINEAR)
    image, without = (
        rasterizer.render(view.aperture, one, normals=False, color=False) for one in (settings, exact_depth)
    )
    judged = judged_pixels(view.truth)
    wrong = judged & wrong_surface(view.truth, image, views.reference)
    if wrong.any():
        wrong &= ~wrong_surface(view.truth, without, views.reference)
    return (
        displacement_percentile(displacement(image, view.truth.camera)),
        float(wrong.sum() / max(judged.sum(), 1)),
    )


def _smallest_separation(views: Views, view: View, settings: DoubleFrustum) -> float:
    """Return the smallest separation of sheets that are ordered; infinite where none so far is."""
    predicted = replace(views, views=(view,)).separation(settings)
    if not predicted:
        return 0.0

    def ordered(separation: float) -> bool:
        return misordered(views.scene, view, settings, separation) <= MISORDERED

    low, high = predicted / SEARCHED, predicted * SEARCHED
    if not ordered(high):
        return math.inf
    for _ in range(HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if ordered(middle) else (middle, high)
    return high
