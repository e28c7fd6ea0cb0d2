"""Ranges of near that depth buffers, pixels and a viewer's eyes each allow by themselves."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from xfrustum.compare.planning import search
from xfrustum.compare.planning.requirement import DepthBuffer, Requirement
from xfrustum.compare.planning.viewer import NearLimit
from xfrustum.compare.planning.views import Views
from xfrustum.compare.scout import CoarseView, PlateScan
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.plate import Frustum

#: The cheapest depth buffer, the usual one, and the finest whose depth no fragment writes.
COMPARED_BUFFERS: tuple[DepthBuffer, ...] = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D32F, DepthMapping.REVERSED),
)


@dataclass(frozen=True, kw_only=True)
class BufferLimit:
    """Smallest near with which a depth buffer orders all that is seen, in one pair of frusta."""

    depth: DepthFormat
    mapping: DepthMapping
    #: scene units, three digits; None where no near is enough
    smallest_near: float | None
    #: displacement by that near at the worst view, pixels
    displacement_p99_px: float | None
    #: whether it is the smallest near of all
    any_near: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Limits:
    """Ranges of near of all judges, closed forms for one pair of frusta."""

    #: largest near within the tolerance at all views; None where none is
    pixels: float | None
    buffers: tuple[BufferLimit, ...]
    eyes: tuple[NearLimit, ...]
    #: (A,) largest near of each scanned aperture; see `hogel_limits`
    hogels: Floats


def near_limits(
    views: Views,
    requirement: Requirement,
    buffers: Sequence[DepthBuffer],
    scan: PlateScan | None,
) -> Limits:
    """Return the range of near that each judge allows at some views."""
    tolerance = requirement.tolerance_px
    pixels = _largest_near(
        views.scene.frustum, lambda near: views.displaced(near, tolerance) <= tolerance
    )
    return Limits(
        pixels=pixels or None,
        buffers=buffer_limits(views, requirement, buffers),
        eyes=() if requirement.viewer is None else requirement.viewer.limits,
        hogels=np.zeros(0) if scan is None else hogel_limits(scan, tolerance),
    )


def buffer_limits(
    views: Views,
    requirement: Requirement,
    buffers: Sequence[DepthBuffer] = COMPARED_BUFFERS,
) -> tuple[BufferLimit, ...]:
    """Return the smallest near with which each depth buffer keeps the limits of depth.

    Sheets at the farthest visible surface are ordered, and few pixels are wrong by depth, at all of
    the views; both improve as near grows.
    """
    frustum = views.scene.frustum
    (low, high), limits = search.indices_of(frustum), []
    allowed = requirement.separation_in(frustum) / search.SEPARATION_MARGIN
    for depth, mapping in buffers:

        def enough(
            near: float, depth: DepthFormat = depth, mapping: DepthMapping = mapping
        ) -> bool:
            settings = DoubleFrustum(near=near, depth=depth, mapping=mapping)
            ordered = views.separation(settings) <= allowed
            return ordered and views.depth_wrong(settings) <= requirement.max_wrong

        near = search.round_number(search.smallest_index(low, high, enough))
        known = enough(near)
        limit = BufferLimit(
            depth=depth,
            mapping=mapping,
            smallest_near=near if known else None,
            displacement_p99_px=views.displaced(DoubleFrustum(near=near)) if known else None,
            any_near=known and near == search.round_number(low),
        )
        limits.append(limit)
    return tuple(limits)


def hogel_limits(scan: PlateScan, tolerance_px: float) -> Floats:
    """Return (A,) the largest near of each scanned aperture by closed form, scene units.

    It keeps 99 % of the visible surface within the tolerance: 0 where a surface lies too close
    to the aperture for any near, and NaN where nothing is visible.
    """
    scene = scan.scene

    def largest(look: CoarseView) -> float:
        if not math.isfinite(look.nearest):
            return math.nan
        return _largest_near(
            scene.frustum,
            lambda settings: look.displacement_p99_px(settings, scene) <= tolerance_px,
        )

    return np.array([largest(look) for look in scan.looks])


def _largest_near(frustum: Frustum, holds: Callable[[DoubleFrustum], bool]) -> float:
    """Return the largest near for which a condition holds; 0 where it never does."""
    low, high = search.indices_of(frustum)
    index = search.largest_index(low, high, lambda near: holds(DoubleFrustum(near=near)))
    return 0.0 if index is None else search.round_number(index)
