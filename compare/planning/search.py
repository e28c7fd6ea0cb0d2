"""Scan over numbers of cuts, with monotone searches for the cuts and for the near offset.

With k cuts, the first one, z1, is minimised: outside of z1 nothing is displaced, and within it
displacement shrinks with z1. Cuts are placed from the far end inward. The outermost slab ends at
the reach, and its cut is as low as the separation at the farthest surface in it allows. A lower cut
only helps the next slab, which then ends sooner and holds nothing farther. So each slab in turn
takes as much as it may, and no other k cuts have a smaller z1.

Displacement grows with n, and errors of depth grow as n falls: the near that is planned is the one
farthest from both limits, for apertures that no scan has traced.

Lengths have three digits, so that they can be read and typed; a plan is then also the same for
meshes that differ by rounding alone, such as a refined one.
"""

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

from xfrustum.compare.planning.requirement import DepthBuffer, Quality, Requirement
from xfrustum.compare.planning.views import Views
from xfrustum.compare.prediction.depth import EXPRESSION_ROUNDINGS, DepthRange
from xfrustum.scenes.plate.double_frustum import Camera, DepthFormat, DoubleFrustum
from xfrustum.scenes.plate.plate import Frustum

#: Smallest near and cut, share of the longest reach: float32 rounds a smaller n to nothing beside
#: it.
SMALLEST_PER_REACH = 1e-8

#: Factor within which predicted and measured smallest separations agree: predictions must order
#: sheets that are this many times closer than required.
SEPARATION_MARGIN = 2.0

#: Ratio of successive separations for which cuts are placed, where gaps in the scene are narrower
#: than the required separation, and their number: down to 1/4096 of it.
TARGET_RATIO, MAX_TARGETS = 2.0**-0.5, 24

#: mean number of lengths of three digits between a length and its half
INDICES_PER_OCTAVE = 271

#: largest number of cuts: each slab is a pass over the whole scene, for each camera
MAX_CUTS = 16
#: bytes of a depth value
BYTES = {DepthFormat.D16: 2, DepthFormat.D24: 3, DepthFormat.D32F: 4}

#: Margin beyond which more is worth nothing. Apertures that no scan has traced take little of it:
#: of all 4,941 hogels of `beetle` the worst is displaced 1.2 times as much as the worst of the 605
#: scanned.
ENOUGH_MARGIN = 10.0


def round_number(index: int) -> float:
    """Return a length of three digits; successive indices give successive ones, index 0 gives 1."""
    decade, place = divmod(index, 900)
    # Parsed, not multiplied: the float nearest to the digits.
    return float(f"{100 + place}e{decade - 2}")


def index_below(length: float, *, strictly: bool = False) -> int:
    """Return the index of the largest length of three digits up to a positive one, or below it."""
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
    """Return the largest index in low..high up to which a condition holds; None for none."""
    first_failure = bisect_left(
        range(low, high + 1), True, key=lambda index: not holds(round_number(index))
    )
    return low + first_failure - 1 if first_failure else None


def smallest_index(low: int, high: int, holds: Callable[[float], bool]) -> int:
    """Return the smallest index in low..high from which on a condition holds; else `high`."""
    return low + bisect_left(range(low, high), True, key=lambda index: holds(round_number(index)))


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """Settings with their predicted errors, as ratios to the limits."""

    settings: DoubleFrustum
    predicted: Quality
    #: ratio of errors that grow with near
    near_excess: float
    #: ratio of pixels wrong by depth, and of separation
    depth_excess: float

    @property
    def excess(self) -> float:
        """Largest ratio of an error to its limit; at most 1 where the attempt holds."""
        return max(self.near_excess, self.depth_excess)

    @property
    def holds(self) -> bool:
        """Compliance with all limits."""
        return self.excess <= 1

    @property
    def missing(self) -> float:
        """Excess, clipped below at the excess of a sufficient margin."""
        return max(self.excess, 1 / ENOUGH_MARGIN)

    @property
    def price(self) -> tuple[bool, int]:
        """Cost of the depth buffer: fragment-written depth disables the early test; then bytes."""
        return self.settings.mapping in EXPRESSION_ROUNDINGS, BYTES[self.settings.depth]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Result of a search."""

    #: whether any depth buffer orders the required separation, however it is cut
    able: bool
    #: depth buffers that hold with the fewest cuts
    holding: int
    #: cheapest attempt with the largest margin
    best: Attempt | None = None
    #: largest near that holds with the cuts and buffer of `best`
    largest_near: float | None = None
    #: failed attempt nearest to holding, with one cut less, or with the most cuts where none holds
    failed: Attempt | None = None


class Search:
    """Search for settings that are predicted to keep a requirement at some views."""

    def __init__(self, views: Views, requirement: Requirement) -> None:
        frustum = views.scene.frustum
        self._views, self.requirement = views, requirement
        self.separation = requirement.separation_in(frustum)
        self.lowest, self.highest = indices_of(frustum)
        self._sides = ((Camera.C, frustum.reach[1]), (Camera.C_STAR, frustum.reach[0]))
        self.judged = cache(self._judged)
        self._near_holds = cache(self._holds_in_closed_form)
        self._traced = cache(
            lambda near, slabs: views.traced_errors(DoubleFrustum(near=near, slabs=slabs))
        )

    def best(self) -> Outcome:
        """Scan numbers of cuts upward, and return the best attempt with the fewest."""
        able = [
            buffer
            for buffer in self.requirement.buffers
            if self._finest(buffer) * SEPARATION_MARGIN <= self.separation
        ]
        outcome = Outcome(holding=0, able=bool(able))
        lowest = round_number(self.lowest)
        if not able or not self._near_holds(lowest, (lowest,)):
            return outcome
        for cuts in range(MAX_CUTS + 1):
            attempts = [self.attempt(buffer, cuts) for buffer in able]
            holding = [attempt for attempt in attempts if attempt.holds]
            if holding:
                cheapest = min(attempt.price for attempt in holding)
                pairs = [
                    (self._with_margin(attempt), attempt)
                    for attempt in holding
                    if attempt.price == cheapest
                ]
                best, largest = min(
                    pairs, key=lambda pair: (pair[0].missing, -pair[0].settings.near)
                )
                return replace(
                    outcome, holding=len(holding), best=best, largest_near=largest.settings.near
                )
            outcome = replace(outcome, failed=min(attempts, key=lambda attempt: attempt.excess))
        return outcome

    def cuts(self, buffer: DepthBuffer, count: int, separation: float) -> tuple[float, ...]:
        """Return up to `count` heights, ascending, as near to the plate as a separation allows."""
        cuts: list[float] = []
        highest = self.highest
        while len(cuts) < count and highest >= self.lowest:
            outer = cuts[-1] if cuts else None

            def ordered(height: float, outer: float | None = outer) -> bool:
                return self.separation_between(buffer, height, outer) <= separation

            index = smallest_index(self.lowest, highest, ordered)
            cuts.append(round_number(index))
            highest = index - 1
        return tuple(reversed(cuts))

    def separation_between(self, buffer: DepthBuffer, low: float, high: float | None) -> float:
        """Return the smallest separation at the farthest visible surface between two heights."""
        ends = [(camera, low, min(high or reach, reach)) for camera, reach in self._sides]
        return self._separation_in(buffer, ends)

    def _finest(self, buffer: DepthBuffer) -> float:
        """Return the smallest separation at each camera's farthest surface, in a separate slab."""
        ends = []
        for camera, reach in self._sides:
            if (far := self._views.farthest(camera)) > 0:
                index = index_below(far, strictly=True)
                ends.append((camera, round_number(index), min(round_number(index + 2), reach)))
        return self._separation_in(buffer, ends)

    def _separation_in(
        self, buffer: DepthBuffer, ends: Sequence[tuple[Camera, float, float]]
    ) -> float:
        settings, separations = DoubleFrustum(near=1.0, depth=buffer[0], mapping=buffer[1]), [0.0]
        for camera, low, high in ends:
            # Outside of the first slab cameras stand in the aperture.
            if low < high:
                slab = DepthRange(camera=camera, low=low, high=high, step=0.0, near=low, far=high)
                separations.append(self._views.separation_in(slab, settings))
        return max(separations)

    def attempt(self, buffer: DepthBuffer, cuts: int) -> Attempt:
        """Return the attempt with a number of cuts and the largest near, or the best failure."""
        failures, target = list[Attempt](), self.separation / SEPARATION_MARGIN
        for _ in range(MAX_TARGETS if cuts else 1):
            heights = self.cuts(buffer, cuts, target)
            # Depth precision grows with near: cuts that fail at the largest near need no search.
            trial = self._depth_alone(buffer, heights)
            candidate = self._with_largest_near(buffer, heights) if trial <= 1 else None
            if candidate is not None and candidate.holds:
                return candidate
            failures.append(candidate or self.judged(self._settings(buffer, heights[0], heights)))
            # Shallower outer slabs help pixels wrong by depth alone, at the cost of the first slab.
            if failures[-1].predicted.depth_wrong <= self.requirement.max_wrong:
                break
            target *= TARGET_RATIO
        return min(failures, key=lambda candidate: candidate.depth_excess)

    def _depth_alone(self, buffer: DepthBuffer, heights: tuple[float, ...]) -> float:
        """Return the excess of depth with near at the first cut; 0 without cuts."""
        if not heights:
            return 0.0
        settings = self._settings(buffer, heights[0], heights)
        wrong = self._views.depth_wrong(settings) / self.requirement.max_wrong
        return max(wrong, self._separation_excess(self._views.separation(settings)))

    def _with_largest_near(self, buffer: DepthBuffer, heights: tuple[float, ...]) -> Attempt:
        """Return the attempt whose near is the largest that pixels and eyes allow."""

        def judged(near: float) -> Attempt:
            return self.judged(self._settings(buffer, near, heights))

        highest = index_below(heights[0]) if heights else self.highest
        index = largest_index(
            self.lowest, highest, lambda near: self._near_holds(near, heights[:1])
        )
        if index is None:
            return judged(round_number(self.lowest))
        # Offset cameras cover more beside the film than the truth: rarely, a smaller near is
        # needed. The search proceeds by octaves, since depth alone makes wrong surfaces at much
        # smaller nears.
        above = index
        while index > self.lowest and judged(round_number(index)).near_excess > 1:
            above, index = index, max(index - INDICES_PER_OCTAVE, self.lowest)
        larger = largest_index(index, above - 1, lambda near: judged(near).near_excess <= 1)
        return judged(round_number(index if larger is None else larger))

    def _judged(self, settings: DoubleFrustum) -> Attempt:
        """Return an attempt, with its offset cameras traced where closed forms hold."""
        predicted = self._views.predicted(settings, self.separation)
        attempt = self._attempt(settings, predicted)
        if not attempt.holds or not self.requirement.pixels_count:
            return attempt
        moved, wrong = self._traced(settings.near, settings.slabs)
        moved = max(predicted.displacement_p99_px, moved)
        wrong += predicted.depth_wrong
        return self._attempt(
            settings, replace(predicted, displacement_p99_px=moved, surface_fraction=wrong)
        )

    def _with_margin(self, largest: Attempt) -> Attempt:
        """Return the attempt with the largest near whose errors are a tenth of their limits.

        Where depth would then be worse off, it is the near at which both have the same
        margin. With limits of eyes alone, near stays: they hold for all hogels, scanned or
        not.
        """
        if not self.requirement.pixels_count:
            return largest
        low, high, best = self.lowest, index_below(largest.settings.near), largest
        # Displacement grows with near, and errors of depth fall with it: the interval is halved.
        while low < high:
            middle = (low + high) // 2
            candidate = self.judged(replace(largest.settings, near=round_number(middle)))
            if candidate.holds and candidate.missing <= best.missing:
                best = candidate
            if candidate.near_excess > max(candidate.depth_excess, 1 / ENOUGH_MARGIN):
                high = middle
            else:
                low = middle + 1
        return best

    def _settings(
        self, buffer: DepthBuffer, near: float, heights: tuple[float, ...]
    ) -> DoubleFrustum:
        return DoubleFrustum(near=near, slabs=heights, depth=buffer[0], mapping=buffer[1])

    def _attempt(self, settings: DoubleFrustum, predicted: Quality) -> Attempt:
        wrong = predicted.depth_wrong / self.requirement.max_wrong
        return Attempt(
            settings=settings,
            predicted=predicted,
            near_excess=self.requirement.near_excess(predicted, settings),
            depth_excess=max(wrong, self._separation_excess(predicted.separation)),
        )

    def _separation_excess(self, separation: float) -> float:
        return separation * SEPARATION_MARGIN / self.separation

    def _holds_in_closed_form(self, near: float, first_cut: tuple[float, ...]) -> bool:
        """Return whether displacement and eyes allow a near, regardless of depth and outer cuts."""
        settings = DoubleFrustum(near=near, slabs=first_cut)
        viewer, tolerance = self.requirement.viewer, self.requirement.limit_px
        unnoticed = viewer is None or viewer.excess(settings) <= 1
        return unnoticed and self._views.displaced(settings, tolerance) <= tolerance
