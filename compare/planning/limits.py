"""The near that each judge allows by itself: a depth buffer from below, pixels of each hogel from above."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from xfrustum.compare.planning import search
from xfrustum.compare.planning.plan import SUSPECTED_EXCESS
from xfrustum.compare.planning.views import Requirement, Views, displacement_bound
from xfrustum.compare.scout import CoarseView, PlateScan
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.plate import Frustum
from xfrustum.scenes.representation import digits

COMPARED_BUFFERS: tuple[search.DepthBuffer, ...] = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D32F, DepthMapping.REVERSED),
)
"""The cheapest depth buffer, the usual one, and the finest of those that no fragment has to write."""


MAX_TRACED = 16  #: apertures whose limits are taken from films in full


@dataclass(frozen=True, kw_only=True)
class BufferLimit:
    """What a depth buffer asks of near where one pair of frusta draws everything, by closed forms."""

    depth: DepthFormat
    mapping: DepthMapping
    smallest_near: (
        float | None
    )  #: scene units, three digits; None where no near up to the reach is enough
    #: what that near does at the worst aperture that was looked through, but those in which a
    #: surface lies
    displacement_p99_px: float | None
    any_near: bool = False  #: whether it is the smallest near of all

    def words(self, units: str) -> str:
        """Say what the depth buffer asks for, in scene units."""
        label = f"the depth buffer {str(self.depth).upper()} {self.mapping}"
        if self.smallest_near is None:
            return f"{label} orders what is seen at no near"
        if self.any_near:
            return f"{label} orders what is seen at any near"
        return f"{label} asks for near from {digits(self.smallest_near)} {units} on"


def buffer_limits(
    views: Views,
    scouted: PlateScan,
    requirement: Requirement,
    buffers: Sequence[search.DepthBuffer] = COMPARED_BUFFERS,
) -> tuple[BufferLimit, ...]:
    """Return the smallest near with which each depth buffer keeps what a requirement asks of depth.

    Sheets at the farthest visible surface are in order, and few pixels are wrong by depth, at all
    of the views; both improve as near grows.
    """
    frustum = scouted.scene.frustum
    (low, high), found = search.indices_of(frustum), []
    for depth, mapping in buffers:

        def enough(
            near: float, depth: DepthFormat = depth, mapping: DepthMapping = mapping
        ) -> bool:
            settings = DoubleFrustum(near=near, depth=depth, mapping=mapping)
            apart, allowed = views.separation(settings), requirement.separation_in(frustum)
            ordered = apart * search.SEPARATION_MARGIN <= allowed
            return ordered and views.depth_wrong(settings) <= requirement.max_wrong

        near, moved = search.round_number(search.smallest_index(low, high, enough)), None
        if enough(near):
            everywhere = scouted.displacements(DoubleFrustum(near=near))
            moved = float(everywhere[np.isfinite(everywhere)].max(initial=0.0))
        limit = BufferLimit(
            depth=depth,
            mapping=mapping,
            smallest_near=None if moved is None else near,
            displacement_p99_px=moved,
            any_near=moved is not None and near == search.round_number(low),
        )
        found.append(limit)
    return tuple(found)


def hogel_limits(scouted: PlateScan, tolerance_px: float) -> Floats:
    """Return (A,) the largest near that each aperture of a scout allows by closed form, scene units.

    It keeps 99 % of what the aperture sees within the tolerance: 0 where a surface lies in the
    aperture or so close to it that no near does, and NaN where nothing is seen.
    """
    scene = scouted.scene

    def largest(look: CoarseView) -> float:
        if not math.isfinite(look.nearest):
            return math.nan
        return _largest_near(
            scene.frustum, tolerance_px, lambda settings: look.displacement_p99_px(settings, scene)
        )

    return np.array([largest(look) for look in scouted.looks])


def _largest_near(
    frustum: Frustum, tolerance_px: float, displaced: Callable[[DoubleFrustum], float]
) -> float:
    """Return the largest near that displaces no more than a tolerance; 0 where none does."""
    low, high = search.indices_of(frustum)
    index = search.largest_index(
        low, high, lambda near: displaced(DoubleFrustum(near=near)) <= tolerance_px
    )
    return 0.0 if index is None else search.round_number(index)


def traced_limits(
    reference: Reference, scouted: PlateScan, limits: Floats, tolerance_px: float
) -> Floats:
    """Return the limits of `hogel_limits` with the smallest ones taken from films in full.

    Six lines of a coarse film are one in a hundred, and tell a percentile to a factor of two:
    apertures up to that factor above the smallest limit are traced, `MAX_TRACED` at most.
    """
    found, frustum, smallest = limits.copy(), scouted.scene.frustum, math.inf
    possible = [number for number in np.argsort(limits, kind="stable") if limits[number] > 0]
    for number in possible[:MAX_TRACED]:
        if limits[number] * SUSPECTED_EXCESS > smallest:
            break
        truth = reference.trace(scouted.apertures[number])
        moved = partial(displacement_bound, truth, frustum)
        found[number] = _largest_near(frustum, tolerance_px, moved)
        smallest = min(smallest, found[number] or math.inf)
    return found
