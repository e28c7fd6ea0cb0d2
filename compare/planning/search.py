"""The best plan with a given number of cuts: where to cut, how large near may be, and whether all is kept.

With k cuts, the first one, z1, is minimised: outside of z1 nothing is displaced, and within it
displacement shrinks with z1. How near to the plate z1 can be is decided from the far end inward.
The outermost slab ends at the reach, and its cut may be as low as the separation at the farthest
surface seen in it allows. A lower cut only helps the next slab, which then ends sooner and sees
nothing farther. So each slab in turn takes as much as it may, and no other k cuts have a smaller
z1.

Displacement falls in proportion to n, and errors of depth grow as n falls: between the two lies the
near that is farthest from either limit, and that one is planned, for apertures that nobody has
looked at.

Lengths have three digits, so that they can be read and typed; a plan is then also the same for
meshes that differ by rounding alone, such as a refined one.
"""

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from xfrustum.compare.planning.views import Quality, Requirement, Views
from xfrustum.compare.prediction.depth import EXPRESSION_ROUNDINGS, DepthRange
from xfrustum.scenes.plate.double_frustum import Camera, DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.plate import Frustum

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

INDICES_PER_OCTAVE = 271  #: mean number of lengths of three digits between a length and half of it
#: largest number of cuts of a plan: each slab is a pass over the whole scene, for each camera
MAX_CUTS = 16
BYTES = {DepthFormat.D16: 2, DepthFormat.D24: 3, DepthFormat.D32F: 4}  #: bytes of a depth value

ENOUGH_MARGIN = 10.0
"""Margin beyond which more is worth nothing: a tenth of what is allowed. What no scout has seen takes little
of it: of all 4,941 hogels of `beetle` the worst is displaced 1.2 times as much as the worst of the
605 that a
scout looked through, of `asymmetric` as much (`scout` with `LATTICE_APERTURES` of the whole plate)."""


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


def indices_of(frustum: Frustum) -> tuple[int, int]:
    """Return the indices of the smallest and of the largest length of near and of cuts."""
    reach = frustum.longest_reach
    return index_below(SMALLEST_PER_REACH * reach), index_below(reach, strictly=True)


def largest_index(low: int, high: int, holds: Callable[[float], bool]) -> int | None:
    """Return the largest index in low..high up to which a condition holds; None where it never does."""
    if low > high or not holds(round_number(low)):
        return None
    # The first is known to hold: so many of the others do.
    return low + bisect_left(
        range(low + 1, high + 1), True, key=lambda index: not holds(round_number(index))
    )


def smallest_index(low: int, high: int, holds: Callable[[float], bool]) -> int:
    """Return the smallest index in low..high from which on a condition holds; `high` where it never does."""
    return low + bisect_left(range(low, high), True, key=lambda index: holds(round_number(index)))


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """Settings that were tried, and what is predicted of them: what counts, over what is allowed."""

    settings: DoubleFrustum
    predicted: Quality
    near_excess: float  #: of displacement and wrong surfaces, or of what eyes see
    depth_excess: float  #: of pixels wrong by depth and of separation

    @property
    def excess(self) -> float:
        """Ratio by which the worst of the requirements is exceeded; at most 1 where the attempt holds."""
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
        return self.settings.mapping in EXPRESSION_ROUNDINGS, BYTES[self.settings.depth]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Result of a search: attempts that hold, the cheapest first, and those that failed with one cut less."""

    choices: Sequence[DepthBuffer]
    #: smallest separation that any choice orders at the farthest surface, however it is cut
    finest: float
    holding: Sequence[Attempt]
    failed: Sequence[
        Attempt
    ]  #: with the most cuts there may be where none holds; empty where none was tried


class Search:
    """Looks for settings that are predicted to meet a requirement for some views."""

    def __init__(self, views: Views, requirement: Requirement) -> None:
        frustum = views.scene.frustum
        self._views, self.requirement = views, requirement
        self.separation = requirement.separation_in(frustum)
        self.lowest, self.highest = indices_of(frustum)
        self._sides = ((Camera.C, frustum.reach[1]), (Camera.C_STAR, frustum.reach[0]))
        self._tolerable = lru_cache(maxsize=None)(self._displaces_little)
        self.judged = lru_cache(maxsize=None)(self._judged)
        self._traced = lru_cache(maxsize=None)(
            lambda near, slabs: views.traced_errors(DoubleFrustum(near=near, slabs=slabs))
        )

    def among(self, choices: Sequence[DepthBuffer]) -> Outcome:
        """Look for the best of some depth buffers, with one cut more at a time."""
        finest = {choice: self.finest(choice) for choice in choices}
        possible = [
            choice for choice in choices if finest[choice] * SEPARATION_MARGIN <= self.separation
        ]
        failed: list[Attempt] = []
        holding: list[Attempt] = []
        # Where not even the smallest near behind the lowest cut keeps to the tolerance, nothing is
        # tried.
        lowest = round_number(self.lowest)
        for cuts in range(MAX_CUTS + 1 if possible and self._tolerable(lowest, (lowest,)) else 0):
            attempts = [self.attempt(choice, cuts) for choice in possible]
            holding = sorted((one for one in attempts if one.holds), key=lambda one: one.price)
            if holding:
                break
            failed = attempts
        return Outcome(choices=choices, finest=min(finest.values()), holding=holding, failed=failed)

    def cuts(self, buffer: DepthBuffer, count: int, separation: float) -> tuple[float, ...]:
        """Return at most so many heights, ascending, as near to the plate as the separation allows."""
        cuts: list[float] = []
        highest = self.highest
        while len(cuts) < count and highest >= self.lowest:
            outer = cuts[-1] if cuts else None

            def fine_enough(height: float, outer: float | None = outer) -> bool:
                return self.separation_between(buffer, height, outer) <= separation

            index = smallest_index(self.lowest, highest, fine_enough)
            cuts.append(round_number(index))
            highest = index - 1
        return tuple(reversed(cuts))

    def separation_between(self, buffer: DepthBuffer, low: float, high: float | None) -> float:
        """Return the smallest separation at the farthest surface seen between cuts, or up to the reach."""
        ends = [
            (camera, low, reach if high is None else min(high, reach))
            for camera, reach in self._sides
        ]
        return self._separation_in(buffer, ends)

    def finest(self, buffer: DepthBuffer) -> float:
        """Return the smallest separation at each camera's farthest surface, in a slab made for it alone."""
        ends = []
        for camera, reach in self._sides:
            if (far := self._views.farthest(camera)) > 0:
                index = index_below(far, strictly=True)
                ends.append((camera, round_number(index), min(round_number(index + 2), reach)))
        return self._separation_in(buffer, ends)

    def _separation_in(
        self, buffer: DepthBuffer, ends: Sequence[tuple[Camera, float, float]]
    ) -> float:
        """Return the largest of the smallest separations in slabs of cameras that stand in the aperture."""
        settings, found = DoubleFrustum(near=1.0, depth=buffer[0], mapping=buffer[1]), [0.0]
        for camera, low, high in ends:
            if low < high:
                slab = DepthRange(camera=camera, low=low, high=high, step=0.0, near=low, far=high)
                found.append(self._views.separation_in(slab, settings))
        return max(found)

    def attempt(self, buffer: DepthBuffer, cuts: int) -> Attempt:
        """Return the settings with so many cuts that hold with the largest near, or come nearest to it."""
        best: tuple[float, tuple[float, ...]] | None = None
        target = self.separation / SEPARATION_MARGIN
        for _ in range(MAX_TARGETS if cuts else 1):
            heights = self.cuts(buffer, cuts, target)
            wrong = separation = 0.0
            if heights:
                # With near as large as may be, depth is best off.
                settings = self._settings(buffer, heights[0], heights)
                wrong = self._views.depth_wrong(settings) / self.requirement.max_wrong
                separation = self._separation_excess(self._views.separation(settings))
            if max(wrong, separation) <= 1:
                one = self._with_largest_near(buffer, heights)
                if one.holds:
                    return one
                wrong, separation = (
                    one.predicted.depth_wrong / self.requirement.max_wrong,
                    one.excess,
                )
            if best is None or max(wrong, separation) < best[0]:
                best = max(wrong, separation), heights
            # Shallower outer slabs help only what is wrong by depth, at the cost of the first one.
            if wrong <= 1:
                break
            target *= TARGET_RATIO
        assert best is not None
        return self._with_largest_near(buffer, best[1])

    def _judged(self, settings: DoubleFrustum) -> Attempt:
        predicted = self._views.predicted(settings, self.separation)
        attempt = self._attempt(settings, predicted)
        if not attempt.holds or self.requirement.SEEN_BY_EYES:
            return attempt
        # Only now: the model is traced, which takes as long as everything else together.
        moved, wrong = self._traced(settings.near, settings.slabs)
        moved = max(predicted.displacement_p99_px, moved)
        wrong += predicted.depth_wrong
        return self._attempt(
            settings, replace(predicted, displacement_p99_px=moved, surface_fraction=wrong)
        )

    def most_robust(self, holding: Sequence[Attempt]) -> Attempt:
        """Return the cheapest attempt that holds with the largest margin, its near moved to that end."""
        cheapest = min(one.price for one in holding)
        cheap = [one for one in holding if one.price == cheapest]
        # What eyes see of near holds for all hogels, looked at or not, and depth gains by a larger
        # near.
        balanced = (
            cheap if self.requirement.SEEN_BY_EYES else [self._with_margin(one) for one in cheap]
        )
        return min(balanced, key=lambda one: (one.missing, -one.settings.near))

    def without_cuts(self, choices: Sequence[DepthBuffer]) -> Attempt | None:
        """Return the best attempt without cuts if no sheets need to be ordered; None where none holds."""
        lax = replace(self.requirement, separation=self._views.scene.frustum.longest_reach)
        search = Search(self._views, lax)
        holding = [one for one in (search.attempt(choice, 0) for choice in choices) if one.holds]
        return search.most_robust(holding) if holding else None

    def _with_margin(self, largest: Attempt) -> Attempt:
        """Return an attempt with the largest near that does no more than a tenth of what is allowed.

        Where depth would then be worse off, it is the near at which both have the same margin.
        """
        low, high, best = self.lowest, index_below(largest.settings.near), largest
        # Displacement grows with near, and what depth gets wrong falls with it: the interval is
        # halved.
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

    def _settings(
        self, buffer: DepthBuffer, near: float, heights: tuple[float, ...]
    ) -> DoubleFrustum:
        return DoubleFrustum(near=near, slabs=heights, depth=buffer[0], mapping=buffer[1])

    def _attempt(self, settings: DoubleFrustum, predicted: Quality) -> Attempt:
        by_pixels, by_eyes = (
            self.requirement.by_pixels(predicted),
            self.requirement.by_eyes(settings),
        )
        wrong = predicted.depth_wrong / self.requirement.max_wrong
        ordered = self._separation_excess(predicted.separation)
        return Attempt(
            settings=settings,
            predicted=predicted,
            near_excess=max(by_pixels, by_eyes),
            depth_excess=max(wrong, ordered),
        )

    def _separation_excess(self, separation: float) -> float:
        return separation * SEPARATION_MARGIN / self.separation

    def _with_largest_near(self, buffer: DepthBuffer, heights: tuple[float, ...]) -> Attempt:
        """Return settings with cuts at some heights, and the largest near that holds or else displaces.

        Where near may be as large as the first cut, both are as large as may be, up to the second
        cut.
        """
        first, others = (heights[0] if heights else None), heights[1:]

        def with_near(near: float) -> DoubleFrustum:
            return self._settings(buffer, near, heights)

        def tolerable(settings: DoubleFrustum) -> bool:
            return self._tolerable(settings.near, settings.slabs[:1])

        highest = index_below(first) if first else self.highest
        largest = self._largest(with_near, tolerable, self.lowest, highest)
        if not largest.holds or largest.settings.near != first:
            return largest

        def with_first_cut(height: float) -> DoubleFrustum:
            return self._settings(buffer, height, (height, *others))

        def may_hold(settings: DoubleFrustum) -> bool:
            ordered = self._views.separation(settings) * SEPARATION_MARGIN <= self.separation
            return ordered and tolerable(settings)

        highest = index_below(others[0], strictly=True) if others else self.highest
        raised = self._largest(with_first_cut, may_hold, index_below(first), highest)
        return raised if raised.holds else largest

    def _largest(
        self,
        settings_with: Callable[[float], DoubleFrustum],
        may_hold: Callable[[DoubleFrustum], bool],
        low: int,
        high: int,
    ) -> Attempt:
        """Return an attempt with the largest length that holds, or else one; `may_hold` is cheap."""

        def judged(length: float) -> Attempt:
            return self.judged(settings_with(length))

        def small_enough(length: float) -> bool:
            # It holds, or depth alone fails, which no smaller length would mend.
            one = judged(length)
            return one.holds or (one.depth_excess > 1 and one.settings.near <= farthest)

        farthest = max(self._views.farthest(camera) for camera, _ in self._sides)
        found = largest_index(low, high, lambda length: may_hold(settings_with(length)))
        index = above = low if found is None else found
        largest = judged(round_number(index))
        # A smaller near displaces less, and helps depth only where n is larger than any |z|, and
        # rounds w.
        while index > low and not small_enough(round_number(index)):
            above, index = index, max(index - INDICES_PER_OCTAVE, low)
        found = largest_index(index, above - 1, small_enough)
        attempt = largest if found is None else judged(round_number(found))
        return attempt if attempt.holds else largest

    def _displaces_little(self, near: float, first_cut: tuple[float, ...]) -> bool:
        """Return whether near displaces no more than is allowed, by closed form, and eyes notice nothing."""
        # The depth buffer and the other cuts do not matter.
        settings, tolerance = (
            DoubleFrustum(near=near, slabs=first_cut),
            self.requirement.tolerance_px,
        )
        unnoticed = self.requirement.by_eyes(settings) <= 1
        return unnoticed and self._views.displaced(settings, tolerance) <= tolerance
