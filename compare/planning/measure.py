"""Is a requirement met? Measured, by drawing the scene, and sheets at its farthest visible surfaces."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from xfrustum.compare.planning.hogels import hogel_results
from xfrustum.compare.planning.sheets import misordered
from xfrustum.compare.planning.views import Quality, Requirement, View, Views
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.compare.run import Judge
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

SEARCH_RATIO = 8.0
"""The smallest separation is looked for between this many times less and more than is predicted."""

SEARCH_HALVINGS = 7
"""Times that the range of the search is halved, on a logarithmic scale: it leaves 2 log2(8) / 2^7 octaves,
3 %."""


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
        Function that is called after each aperture, with 1.
    smallest
        Whether to look for the smallest separation, which no requirement limits; else it is NaN.
    """
    separation = requirement.separation_in(views.scene.frustum)
    found = []
    with Judge(views.scene, reference=views.reference) as judge:
        apertures = [view.aperture for view in views.views]
        drawn = list(hogel_results(judge, apertures, settings, views.truths))
    for view, result in zip(views.views, drawn, strict=True):
        found.append(
            Quality(
                displacement_p99_px=result.displacement_p99_px,
                surface_fraction=result.surface_fraction,
                depth_wrong=result.depth_wrong,
                misordered=misordered(views.scene, view, settings, separation),
                separation=_smallest_separation(views, view, settings) if smallest else math.nan,
            )
        )
        done(1)
    return Quality.worst(found)


def meets(quality: Quality, requirement: Requirement) -> bool:
    """Return whether what was measured is what is required."""
    return not requirement.missed_by(quality) and quality.misordered <= MAX_MISORDERED_FRACTION


def _smallest_separation(views: Views, view: View, settings: DoubleFrustum) -> float:
    """Return the smallest separation of sheets that are ordered; infinite where none so far is."""
    predicted = replace(views, views=(view,)).separation(settings)
    if not predicted:
        return 0.0

    def ordered(separation: float) -> bool:
        return misordered(views.scene, view, settings, separation) <= MAX_MISORDERED_FRACTION

    low, high = predicted / SEARCH_RATIO, predicted * SEARCH_RATIO
    if not ordered(high):
        return math.inf
    for _ in range(SEARCH_HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if ordered(middle) else (middle, high)
    return high
