"""The best plan with a given number of cuts: where to cut, how large near may be, and whether all is kept.

With k cuts, the first one, z1, is minimised. Outside of z1 nothing is displaced, and within it the less the
smaller z1 is, so that near may be larger; and a first slab that is shallow needs the smaller near for its
depths. How near to the plate z1 can be is decided from the far end inward. The outermost slab ends at the
reach, and its cut may be as low as the separation at the farthest surface that is seen in it allows: lower,
depths would be coarser. A lower cut only helps the next slab, which then ends sooner and sees nothing
farther. So each slab in
turn takes as much as it may, and no other k cuts have a smaller z1.
 A plan that just holds at the apertures it was made from fails at the next one that sees something nearer to
the plate. Displacement falls in proportion to n, and errors of depth grow as n falls: between the two lies
the near that is farthest from either limit, and that one is planned.

Lengths have three digits, so that they can be read and typed; a plan is then also the same for meshes that
differ by rounding alone, such as a refined one.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import assert_never

from xfrustum.compare.planning.views import Quality, Requirement, Views
from xfrustum.compare.prediction.share import Slab
from xfrustum.scenes.plate.double_frustum import Camera, DepthFormat, DepthMapping, DoubleFrustum

DepthBuffer = tuple[DepthFormat, DepthMapping]

SMALLEST_PER_REACH = 1e-8
"""Smallest near and cut, as a part of the larger reach: in float32, n this small beside the reach is
nothing."""

SEPARATION_MARGIN = 2.0
"""Sheets must be ordered by prediction when they are this many times closer than is asked for: the factor
within which predicted and measured smallest separations agree."""

TARGET_RATIO, MAX_TARGETS = 2.0**-0.5, 24
"""Ratio of successive targets for the cuts, where gaps in the scene are narrower than the separation, and the
largest number of targets that are tried: down to 1/4096 of the separation."""

INDICES_PER_OCTAVE = 271
"""Mean number of lengths of three digits between a length and half of it."""

MAX_CUTS = 16
"""Largest number of cuts of a plan: each slab is a pass over the whole scene, for each camera."""

BYTES = {DepthFormat.D16: 2, DepthFormat.D24: 3, DepthFormat.D32F: 4}
"""Bytes of a depth value."""

ENOUGH_MARGIN = 10.0
"""Margin beyond which more is worth nothing: a tenth of what is allowed. What no scout has seen takes little
of it: of all 4,941 hogels of `beetle` the worst is displaced 1.2 times as much as the worst of the 605 that a
scout looked through, of `asymmetric` as much (`scout` with `LATTICE_APERTURES` of the whole plate)."""


# Lengths of three digits -----------------------------------------------------------------------------------


def round_number(index: int) -> float:
    """Return a length of three digits; successive indices give successive ones, index 0 gives 1."""
    decade, place = divmod(index, 900)
    # Parsed, not multiplied: the float nearest to the digits.
    return float(f"{100 + place}e{decade - 2}")


def index_below(length: float, *, strictly: bool = False) -> int:
    """Return the index of the largest length of three digits up to a positive one, or strictly below it."""
    decade = math.floor(math.log10(length))
    # Logarithms and quotients round: begin above, and come down.
    index = decade * 900 + int(length / float(f"1e{decade}") * 100) - 98
    while round_number(index) > length or (strictly and round_number(index) == length):
        index -= 1
    return index


def largest_index(low: int, high: int, holds: Callable[[float], bool]) -> int | None:
    """Return the largest index in low..high whose length a condition holds for; None where it never does.

    The condition is true up to some length, and false beyond it.
    """
    if low > high or not holds(round_number(low)):
        return None
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if holds(round_number(middle)) else (low, middle - 1)
    return low


def smallest_index(low: int, high: int, holds: Callable[[float], bool]) -> int:
    """Return the smallest index in low..high whose length a condition holds for; `high` where it never does.

    The condition is false up to some length, and true beyond it.
    """
    return low + bisect_left(range(low, high), True, key=lambda index: holds(round_number(index)))


# Where to cut ----------------------------------------------------------------------------------------------


class Cutter:
    """Places the cuts of a scene's frusta; `lowest` and `highest` are indices of possible lengths."""

    def __init__(self, views: Views) -> None:
        frustum = views.scene.frustum
        self._views = views
        self._sides = ((Camera.C, frustum.reach[1]), (Camera.C_STAR, frustum.reach[0]))
        self.lowest = index_below(SMALLEST_PER_REACH * frustum.longest_reach)
        self.highest = index_below(frustum.longest_reach, strictly=True)

    def cuts(
        self, depth: DepthFormat, mapping: DepthMapping, count: int, separation: float
    ) -> tuple[float, ...]:
        """Return up to some number of heights, ascending, each as near to the plate as can be.

        Parameters
        ----------
        count
            Largest number of cuts; there are fewer where they come as near to the plate as any may.
        separation
            Separation that sheets at the farthest visible surface of every slab but the first must be ordered
            at.
        """
        cuts: list[float] = []
        highest = self.highest
        while len(cuts) < count and highest >= self.lowest:
            outer = cuts[-1] if cuts else None

            def fine_enough(height: float, outer: float | None = outer) -> bool:
                return self.separation(depth, mapping, height, outer) <= separation

            index = smallest_index(self.lowest, highest, fine_enough)
            cuts.append(round_number(index))
            highest = index - 1
        return tuple(reversed(cuts))

    def separation(self, depth: DepthFormat, mapping: DepthMapping, low: float, high: float | None) -> float:
        """Return the smallest separation at the farthest surface seen between cuts, or up to the reach."""
        settings, found = DoubleFrustum(near=low, depth=depth, mapping=mapping), [0.0]
        for camera, reach in self._sides:
            end = reach if high is None else min(high, reach)
            if low < end:
                slab = Slab(camera=camera, low=low, high=end, step=0.0, near=low, far=end)
                found.append(self._views.separation_in(slab, settings))
        return max(found)

    def finest(self, depth: DepthFormat, mapping: DepthMapping) -> float:
        """Return the smallest separation at each camera's farthest surface, in a slab made for it alone."""
        settings, found = DoubleFrustum(near=1.0, depth=depth, mapping=mapping), [0.0]
        for camera, reach in self._sides:
            far = max((view.farthest(camera) or 0.0 for view in self._views.views), default=0.0)
            if far > 0:
                index = index_below(far, strictly=True)
                low, high = round_number(index), min(round_number(index + 2), reach)
                slab = Slab(camera=camera, low=low, high=high, step=0.0, near=low, far=high)
                found.append(self._views.separation_in(slab, settings))
        return max(found)


# What holds ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """Settings that were tried, and what is predicted of them.

    Attributes
    ----------
    near_excess, depth_excess
        Ratios of the predicted quality to what is allowed: for near, the worse one of displacement and of
        wrong surfaces; for depth, the worse one of pixels wrong by depth and of separation.
    """

    settings: DoubleFrustum
    predicted: Quality
    near_excess: float
    depth_excess: float

    @property
    def excess(self) -> float:
        """Ratio by which the worst of the requirements is exceeded; at most 1 if none is."""
        return max(self.near_excess, self.depth_excess)

    @property
    def holds(self) -> bool:
        """Whether all requirements are met."""
        return self.excess <= 1

    @property
    def missing(self) -> float:
        """The excess, but no less than what is enough."""
        return max(self.excess, 1 / ENOUGH_MARGIN)

    @property
    def price(self) -> tuple[bool, int]:
        """What its depth buffer costs: whether fragments write it, which costs the early test, then bytes."""
        return _written_by_fragments(self.settings.mapping), BYTES[self.settings.depth]


def _written_by_fragments(mapping: DepthMapping) -> bool:
    """Return whether fragments write a mapping's depth."""
    match mapping:
        case DepthMapping.LOGARITHMIC | DepthMapping.LINEAR:
            return True
        case DepthMapping.STANDARD | DepthMapping.GL | DepthMapping.REVERSED:
            return False
        case _:
            assert_never(mapping)


class Search:
    """Looks for settings that are predicted to meet a requirement for some views."""

    def __init__(self, views: Views, requirement: Requirement) -> None:
        self._views = views
        self.requirement = requirement
        self.separation = requirement.separation_in(views.scene.frustum)
        self.cutter = Cutter(views)
        # Displacement depends on near and the first cut alone.
        self._tolerable = lru_cache(maxsize=None)(self._is_tolerable)
        self._traced = lru_cache(maxsize=None)(
            lambda near, slabs: views.traced_errors(DoubleFrustum(near=near, slabs=slabs))
        )

    @property
    def displaces_too_much(self) -> bool:
        """Whether not even the smallest near behind the lowest cut is within the tolerance."""
        lowest = round_number(self.cutter.lowest)
        return not self._tolerable(lowest, lowest)

    def attempt(self, depth: DepthFormat, mapping: DepthMapping, cuts: int) -> Attempt:
        """Return the settings with a number of cuts that hold with the largest near.

        Where none holds, those that come nearest to it.
        """
        best: tuple[float, tuple[float, ...]] | None = None
        target = self.separation / SEPARATION_MARGIN
        for _ in range(MAX_TARGETS if cuts else 1):
            heights = self.cutter.cuts(depth, mapping, cuts, target)
            by_depth = self._depth_excess(depth, mapping, heights) if heights else (0.0, 0.0)
            if max(by_depth) <= 1:
                one = self._with_largest_near(depth, mapping, heights)
                if one.holds:
                    return one
                by_depth = (one.predicted.depth_wrong / self.requirement.max_wrong, one.excess)
            if best is None or max(by_depth) < best[0]:
                best = max(by_depth), heights
            # Shallower outer slabs help only what is wrong by depth, at the cost of the first one.
            if by_depth[0] <= 1:
                break
            target *= TARGET_RATIO
        assert best is not None
        return self._with_largest_near(depth, mapping, best[1])

    def judged(self, settings: DoubleFrustum) -> Attempt:
        """Return what is to be expected of any settings."""
        attempt = self._attempt(settings, self._views.predicted(settings, self.separation))
        if not attempt.holds or self.requirement.SEEN_BY_EYES:
            return attempt
        # Only now: the model is traced, which takes as long as everything else together.
        moved, wrong = self._traced(settings.near, settings.slabs)
        predicted = replace(
            attempt.predicted,
            displacement_p99_px=max(attempt.predicted.displacement_p99_px, moved),
            surface_fraction=wrong + attempt.predicted.depth_wrong,
        )
        return self._attempt(settings, predicted)

    def most_robust(self, holding: Sequence[Attempt]) -> Attempt:
        """Return the cheapest attempt that holds with the largest margin, its near moved to that end."""
        cheapest = min(one.price for one in holding)
        cheap = [one for one in holding if one.price == cheapest]
        # What eyes see of near holds for all hogels, looked at or not, and depth gains by a larger near.
        balanced = cheap if self.requirement.SEEN_BY_EYES else [self._with_margin(one) for one in cheap]
        return min(balanced, key=lambda one: (one.missing, -one.settings.near))

    def _with_margin(self, largest: Attempt) -> Attempt:
        """Return an attempt with the near that is farthest from the limits, up to `ENOUGH_MARGIN`.

        That is the largest near that does no more than a tenth of what is allowed, or, where depth would then
        be worse off, the near at which both have the same margin.
        """
        low, high = self.cutter.lowest, index_below(largest.settings.near)
        best = largest
        # Displacement grows with near, and what depth gets wrong falls with it: the interval is halved.
        while low < high:
            middle = (low + high) // 2
            one = self.judged(replace(largest.settings, near=round_number(middle)))
            if one.holds and one.missing <= best.missing:
                best = one
            if one.near_excess > max(one.depth_excess, 1 / ENOUGH_MARGIN):
                high = middle
            else:
                low = middle + 1
        return best

    def _depth_excess(
        self, depth: DepthFormat, mapping: DepthMapping, heights: tuple[float, ...]
    ) -> tuple[float, float]:
        """Return how far wrong pixels and separation exceed what is allowed, with near as large as may be."""
        settings = DoubleFrustum(near=heights[0], depth=depth, mapping=mapping, slabs=heights)
        wrong, separation = self._views.depth_wrong(settings), self._views.separation(settings)
        return wrong / self.requirement.max_wrong, separation * SEPARATION_MARGIN / self.separation

    def _attempt(self, settings: DoubleFrustum, predicted: Quality) -> Attempt:
        by_separation = predicted.separation * SEPARATION_MARGIN / self.separation
        return Attempt(
            settings=settings,
            predicted=predicted,
            near_excess=self.requirement.near_excess(predicted, settings),
            depth_excess=max(predicted.depth_wrong / self.requirement.max_wrong, by_separation),
        )

    def _with_largest_near(
        self, depth: DepthFormat, mapping: DepthMapping, heights: tuple[float, ...]
    ) -> Attempt:
        """Return settings with cuts at some heights, and the largest near that holds or else displaces."""
        highest, first = self.cutter.highest, None
        if heights:
            highest, first = index_below(heights[0]), heights[0]
        found = largest_index(self.cutter.lowest, highest, lambda near: self._tolerable(near, first))
        near = round_number(self.cutter.lowest if found is None else found)
        settings = DoubleFrustum(near=near, depth=depth, mapping=mapping, slabs=heights)
        raised = self._raised(settings) if near == first else None
        largest = raised or self.judged(settings)
        return self._lowered(largest) or largest

    def _lowered(self, attempt: Attempt) -> Attempt | None:
        """Return an attempt with the largest near, up to its own, that holds; None where none does."""
        if attempt.holds:
            return attempt
        index = index_below(attempt.settings.near)
        ends = (view.farthest(camera) or 0.0 for view in self._views.views for camera in view.seen)
        farthest = max(ends, default=0.0)

        def lowered(near: float) -> Attempt:
            return self.judged(replace(attempt.settings, near=near))

        # A smaller near displaces less, and helps depth only where n is larger than any |z|, and rounds w.
        while index > self.cutter.lowest and (attempt.depth_excess <= 1 or attempt.settings.near > farthest):
            index = max(index - INDICES_PER_OCTAVE, self.cutter.lowest)
            attempt = lowered(round_number(index))
            if attempt.holds:
                highest = index + INDICES_PER_OCTAVE - 1
                found = largest_index(index, highest, lambda near: lowered(near).holds)
                return attempt if found is None else lowered(round_number(found))
        return None

    def _raised(self, settings: DoubleFrustum) -> Attempt | None:
        """Return an attempt with the largest first cut, up to the second, that near may be as large as."""
        first, *others = settings.slabs

        def raised(height: float) -> DoubleFrustum:
            return replace(settings, near=height, slabs=(height, *others))

        def may_hold(height: float) -> bool:
            separation = self._views.separation(raised(height))
            return self._tolerable(height, height) and separation * SEPARATION_MARGIN <= self.separation

        lowest = index_below(first)
        highest = index_below(others[0], strictly=True) if others else self.cutter.highest
        found = largest_index(lowest, highest, may_hold)
        if found is not None and not self.judged(raised(round_number(found))).holds:
            # What the closed form does not know is looked at again, with ten times the effort.
            found = largest_index(lowest, found, lambda height: self.judged(raised(height)).holds)
        return None if found is None else self.judged(raised(round_number(found)))

    def _is_tolerable(self, near: float, first_cut: float | None) -> bool:
        settings = DoubleFrustum(near=near, slabs=() if first_cut is None else (first_cut,))
        tolerance = self.requirement.tolerance_px
        return self.requirement.allows(settings) and all(
            moved <= tolerance for moved in self._views.displaced(settings)
        )
