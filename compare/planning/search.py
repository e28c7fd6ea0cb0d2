"""The best plan with a given number of cuts: how large near may be, and whether all is kept."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

from xfrustum.compare.planning.cuts import Cutter
from xfrustum.compare.planning.numbers import index_below, largest_index, round_number
from xfrustum.compare.planning.views import Quality, Requirement, Views
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum

DepthBuffer = tuple[DepthFormat, DepthMapping]

SEPARATION_MARGIN = 2.0
"""Sheets must be ordered by prediction when they are this many times closer than is asked for: the factor
within which predicted and measured smallest separations agree."""

TARGET_RATIO = 2.0**-0.5
"""Ratio of successive targets for the cuts, where gaps in the scene are narrower than the separation."""

INDICES_PER_OCTAVE = 271
"""Mean number of lengths of three digits between a length and half of it."""

MAX_CUTS = 16
"""Largest number of cuts of a plan: each slab is a pass over the whole scene, for each camera."""

MAX_TARGETS = 24
"""Largest number of targets that are tried: down to 1/4096 of the separation."""


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """Settings that were tried.

    Attributes
    ----------
    settings
        Settings of the two cameras.
    predicted
        Quality that is predicted of them.
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


class Search:
    """Looks for settings that are predicted to meet a requirement.

    Parameters
    ----------
    views
        Views of the scene that must be shown.
    requirement
        Quality that they must keep.
    """

    def __init__(self, views: Views, requirement: Requirement) -> None:
        self._views = views
        self.requirement = requirement
        self._frustum = views.scene.frustum
        self.separation = requirement.separation_in(self._frustum)
        self.cutter = Cutter(views)
        self._lowest, self._highest = self.cutter.lowest, self.cutter.highest
        # Displacement depends on near and the first cut alone.
        self._tolerable = lru_cache(maxsize=None)(self._is_tolerable)
        self._traced = lru_cache(maxsize=None)(self._traced_errors)

    @property
    def displaces_too_much(self) -> bool:
        """Whether not even the smallest near behind the lowest cut is within the tolerance."""
        lowest = round_number(self._lowest)
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

    def _depth_excess(
        self, depth: DepthFormat, mapping: DepthMapping, heights: tuple[float, ...]
    ) -> tuple[float, float]:
        """Return how far wrong pixels and separation exceed what is allowed, with near as large as may be."""
        settings = DoubleFrustum(near=heights[0], depth=depth, mapping=mapping, slabs=heights)
        return (
            self._views.depth_wrong(settings) / self.requirement.max_wrong,
            self._views.separation(settings) * SEPARATION_MARGIN / self.separation,
        )

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

    def _attempt(self, settings: DoubleFrustum, predicted: Quality) -> Attempt:
        return Attempt(
            settings=settings,
            predicted=predicted,
            near_excess=self.requirement.near_excess(predicted, settings),
            depth_excess=max(
                predicted.depth_wrong / self.requirement.max_wrong,
                predicted.separation * SEPARATION_MARGIN / self.separation,
            ),
        )

    def _with_largest_near(
        self, depth: DepthFormat, mapping: DepthMapping, heights: tuple[float, ...]
    ) -> Attempt:
        """Return settings with cuts at some heights, and the largest near that holds or else displaces."""
        near = self._largest_near(heights)
        settings = DoubleFrustum(near=near, depth=depth, mapping=mapping, slabs=heights)
        if heights and near == heights[0]:
            raised = self._raised(settings)
            if raised is not None:
                return raised
        largest = self.judged(settings)
        return self._lowered(largest) or largest

    def _lowered(self, attempt: Attempt) -> Attempt | None:
        """Return an attempt with the largest near, up to its own, that holds; None where none does."""
        if attempt.holds:
            return attempt
        index = index_below(attempt.settings.near)

        def lowered(near: float) -> Attempt:
            return self.judged(replace(attempt.settings, near=near))

        # A smaller near displaces less, and helps depth only where n is larger than any |z|, and rounds w.
        while index > self._lowest and (attempt.depth_excess <= 1 or attempt.settings.near > self._farthest):
            index = max(index - INDICES_PER_OCTAVE, self._lowest)
            attempt = lowered(round_number(index))
            if attempt.holds:
                highest = index + INDICES_PER_OCTAVE - 1
                found = largest_index(index, highest, lambda near: lowered(near).holds)
                return attempt if found is None else lowered(round_number(found))
        return None

    @property
    def _farthest(self) -> float:
        return max(
            (float(seen[-1]) for view in self._views.views for seen in view.seen.values() if len(seen)),
            default=0.0,
        )

    def _largest_near(self, heights: tuple[float, ...]) -> float:
        """Return the largest near whose displacement is tolerable, up to the first cut."""
        highest = index_below(heights[0]) if heights else self._highest
        first = heights[0] if heights else None
        found = largest_index(self._lowest, highest, lambda near: self._tolerable(near, first))
        return round_number(self._lowest if found is None else found)

    def _raised(self, settings: DoubleFrustum) -> Attempt | None:
        """Return an attempt with the largest first cut, up to the second, that near may be as large as."""
        first, *others = settings.slabs

        def raised(height: float) -> DoubleFrustum:
            return replace(settings, near=height, slabs=(height, *others))

        def may_hold(height: float) -> bool:
            separation = self._views.separation(raised(height))
            return self._tolerable(height, height) and separation * SEPARATION_MARGIN <= self.separation

        lowest = index_below(first)
        highest = index_below(others[0], strictly=True) if others else self._highest
        found = largest_index(lowest, highest, may_hold)
        if found is None:
            return None
        attempt = self.judged(raised(round_number(found)))
        if not attempt.holds:
            # What the closed form does not know is looked at again, with ten times the effort.
            found = largest_index(lowest, found, lambda height: self.judged(raised(height)).holds)
            return None if found is None else self.judged(raised(round_number(found)))
        return attempt

    def _is_tolerable(self, near: float, first_cut: float | None) -> bool:
        settings = DoubleFrustum(near=near, slabs=() if first_cut is None else (first_cut,))
        if not self.requirement.allows(settings):
            return False
        return all(moved <= self.requirement.tolerance_px for moved in self._views.displaced(settings))

    def _traced_errors(self, near: float, slabs: tuple[float, ...]) -> tuple[float, float]:
        return self._views.traced_errors(DoubleFrustum(near=near, slabs=slabs))
