"""Scan over numbers of cuts, with monotone searches for the cuts and for the near offset.

With k cuts, the first cut, z1, is minimised: surfaces beyond z1 are not displaced, and surfaces
before it are displaced less if z1 is smaller. Cuts are placed from the far end inward. The
outermost slab ends at the reach, and its cut is as low as the separation at the farthest surface in
the slab allows. A lower cut only helps the next slab: it ends earlier and contains no farther
surface. Each slab in turn is therefore made as deep as allowed, and no other k cuts have a smaller
z1.

Displacement grows with n, and depth errors grow as n decreases. The planned near has the largest
margin to both limits, as a reserve for apertures that were not scanned. The ranges of near allowed
by pixels and by depth buffers are searched in the same way.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from xfrustum.compare.planning.requirement import (
    DepthBuffer,
    NearLimit,
    Quality,
    Requirement,
    index_below,
    indices_of,
    largest_index,
    round_number,
    smallest_index,
)
from xfrustum.compare.planning.views import Views
from xfrustum.compare.prediction.depth import EXPRESSION_ROUNDINGS, DepthRange
from xfrustum.compare.scout import CoarseView, PlateScan
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.plate import Camera, DepthFormat, DepthMapping, DoubleFrustum, Frustum

#: Factor within which predicted and measured smallest separations agree. A plan is therefore
#: required to order, by prediction, sheets that are closer by this factor.
SEPARATION_MARGIN = 2.0

#: Ratio and number of the successive separations for which cuts are placed if gaps in the scene are
#: narrower than the required separation. The last is 1/4096 of the required separation.
TARGET_RATIO, MAX_TARGETS = 2.0**-0.5, 24

#: mean number of lengths of three digits between a length and its half
INDICES_PER_OCTAVE = 271

#: largest number of cuts: each slab is a pass over the whole scene, for each camera
MAX_CUTS = 16
#: bytes of a depth value
BYTES = {DepthFormat.D16: 2, DepthFormat.D24: 3, DepthFormat.D32F: 4}

#: Margin above which a larger margin has no benefit. Unscanned apertures need little margin: the
#: worst of all 4,941 hogels of `beetle` is displaced 1.2 times as much as the worst of the 605
#: scanned hogels.
ENOUGH_MARGIN = 10.0

#: Depth buffers: the cheapest, the most common, and the finest without depth from fragments.
COMPARED_BUFFERS: tuple[DepthBuffer, ...] = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D32F, DepthMapping.REVERSED),
)


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """Settings with their predicted errors, as ratios to the limits."""

    settings: DoubleFrustum
    predicted: Quality
    #: ratio of errors that grow with near
    near_excess: float
    #: larger of two ratios: of pixels wrong by depth, and of separation
    depth_excess: float

    @property
    def excess(self) -> float:
        """Largest ratio of an error to its limit; at most 1 if the attempt is valid."""
        return max(self.near_excess, self.depth_excess)

    @property
    def holds(self) -> bool:
        """True if all limits are kept."""
        return self.excess <= 1

    @property
    def missing(self) -> float:
        """Excess, but at least the excess at a sufficient margin."""
        return max(self.excess, 1 / ENOUGH_MARGIN)

    @property
    def price(self) -> tuple[bool, int]:
        """Cost of the depth buffer: depth written by fragments (no early test), then bytes."""
        return self.settings.mapping in EXPRESSION_ROUNDINGS, BYTES[self.settings.depth]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Result of a search."""

    #: whether some depth buffer resolves the required separation with some number of cuts
    able: bool
    #: number of depth buffers that are valid with the fewest cuts
    holding: int = 0
    #: cheapest attempt with the largest margin
    best: Attempt | None = None
    #: largest valid near with the cuts and buffer of `best`
    largest_near: float | None = None
    #: best failed attempt with one cut fewer, or with the most cuts if no attempt is valid
    failed: Attempt | None = None


class Search:
    """Search for settings that are predicted to keep a requirement at some views."""

    def __init__(self, views: Views, requirement: Requirement) -> None:
        frustum = views.scene.frustum
        self._views, self.requirement = views, requirement
        self.separation = requirement.separation_in(frustum)
        self.lowest, self.highest = indices_of(frustum)
        self._reaches = {Camera.C: frustum.reach[1], Camera.C_STAR: frustum.reach[0]}
        self.judged = cache(self._judged)
        self._near_holds = cache(self._holds_in_closed_form)
        # Offset cameras are traced without rounding, so that a trace serves every depth buffer.
        self._traced = cache(
            lambda near, slabs: views.traced_errors(DoubleFrustum(near=near, slabs=slabs))
        )

    def best(self) -> Outcome:
        """Try increasing numbers of cuts, and return the best attempt with the fewest cuts."""
        able = [
            buffer
            for buffer in self.requirement.buffers
            if self._finest(buffer) * SEPARATION_MARGIN <= self.separation
        ]
        lowest, failed = round_number(self.lowest), None
        if not able or not self._near_holds(lowest, (lowest,)):
            return Outcome(able=bool(able))
        for cuts in range(MAX_CUTS + 1):
            attempts = [self.attempt(buffer, cuts) for buffer in able]
            holding = [attempt for attempt in attempts if attempt.holds]
            if not holding:
                failed = min(attempts, key=lambda attempt: attempt.excess)
                continue
            cheapest = min(attempt.price for attempt in holding)
            pairs = [
                (self._with_margin(attempt), attempt.settings.near)
                for attempt in holding
                if attempt.price == cheapest
            ]
            best, near = min(pairs, key=lambda pair: (pair[0].missing, -pair[0].settings.near))
            return Outcome(
                able=True, holding=len(holding), best=best, largest_near=near, failed=failed
            )
        return Outcome(able=True, failed=failed)

    def cuts(self, buffer: DepthBuffer, count: int, separation: float) -> tuple[float, ...]:
        """Return up to `count` heights, ascending, as close to the plate as a separation allows."""
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
        return max(
            self._separation_in(buffer, camera, low, min(high or reach, reach))
            for camera, reach in self._reaches.items()
        )

    def _finest(self, buffer: DepthBuffer) -> float:
        """Return the smallest separation at each camera's farthest surface, in a separate slab."""
        separations = [0.0]
        for camera, reach in self._reaches.items():
            if (far := self._views.farthest(camera)) > 0:
                index = index_below(far, strictly=True)
                low, high = round_number(index), min(round_number(index + 2), reach)
                separations.append(self._separation_in(buffer, camera, low, high))
        return max(separations)

    def _separation_in(self, buffer: DepthBuffer, camera: Camera, low: float, high: float) -> float:
        """Return the smallest separation in a slab beyond the first; 0 for an empty slab."""
        if low >= high:
            return 0.0
        # Cameras of all slabs except the first are in the aperture.
        slab = DepthRange(camera=camera, low=low, high=high, step=0.0, near=low, far=high)
        return self._views.separation_in(slab, _settings(buffer, 1.0))

    def attempt(self, buffer: DepthBuffer, cuts: int) -> Attempt:
        """Return the attempt with a number of cuts and the largest near, or the best failure."""
        failures, target = list[Attempt](), self.separation / SEPARATION_MARGIN
        for _ in range(MAX_TARGETS if cuts else 1):
            heights = self.cuts(buffer, cuts, target)
            trial = self.judged(_settings(buffer, heights[0], heights)) if heights else None
            # Depth precision grows with near: cuts that fail at the largest near need no search.
            if trial is None or trial.depth_excess <= 1:
                trial = self._with_largest_near(buffer, heights)
                if trial.holds:
                    return trial
            failures.append(trial)
            # Shallower outer slabs reduce only pixels that are wrong by depth, and enlarge the
            # first slab.
            if trial.predicted.depth_wrong <= self.requirement.max_wrong:
                break
            target *= TARGET_RATIO
        return min(failures, key=lambda candidate: candidate.depth_excess)

    def _with_largest_near(self, buffer: DepthBuffer, heights: tuple[float, ...]) -> Attempt:
        """Return the attempt with the largest near that pixels and eyes allow."""

        def judged(near: float) -> Attempt:
            return self.judged(_settings(buffer, near, heights))

        highest = index_below(heights[0]) if heights else self.highest
        index = largest_index(
            self.lowest, highest, lambda near: self._near_holds(near, heights[:1])
        )
        if index is None:
            return judged(round_number(self.lowest))
        # The closed form neglects surfaces that only offset cameras show, because their films cover
        # more. Rarely, a smaller near is therefore needed. The search proceeds by octaves, because
        # at much smaller nears depth is the only cause of wrong surfaces.
        above = index
        while index > self.lowest and judged(round_number(index)).near_excess > 1:
            above, index = index, max(index - INDICES_PER_OCTAVE, self.lowest)
        larger = largest_index(index, above - 1, lambda near: judged(near).near_excess <= 1)
        return judged(round_number(index if larger is None else larger))

    def _judged(self, settings: DoubleFrustum) -> Attempt:
        """Return an attempt; if closed forms accept it, its offset cameras are traced as well."""
        predicted = self._views.predicted(settings, self.separation)
        attempt = self._attempt(settings, predicted)
        if not attempt.holds or not self.requirement.pixels_count:
            return attempt
        moved, wrong = self._traced(settings.near, settings.slabs)
        moved = max(predicted.displacement_p99_px, moved)
        wrong += predicted.depth_wrong
        traced = replace(predicted, displacement_p99_px=moved, surface_fraction=wrong)
        return self._attempt(settings, traced)

    def _attempt(self, settings: DoubleFrustum, predicted: Quality) -> Attempt:
        wrong = predicted.depth_wrong / self.requirement.max_wrong
        return Attempt(
            settings=settings,
            predicted=predicted,
            near_excess=self.requirement.near_excess(predicted, settings),
            depth_excess=max(wrong, predicted.separation * SEPARATION_MARGIN / self.separation),
        )

    def _with_margin(self, largest: Attempt) -> Attempt:
        """Return the attempt with the largest near whose errors are a tenth of their limits.

        If errors of depth have a smaller margin there, return the attempt whose two margins are
        equal. If only eyes limit near, return `largest`, because the limits of eyes hold for all
        hogels, scanned or not.
        """
        if not self.requirement.pixels_count:
            return largest
        low, high, best = self.lowest, index_below(largest.settings.near), largest
        # Bisect: displacement grows with near, and errors of depth decrease.
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

    def _holds_in_closed_form(self, near: float, first_cut: tuple[float, ...]) -> bool:
        """Return whether displacement and eyes allow a near, regardless of depth and outer cuts."""
        settings = DoubleFrustum(near=near, slabs=first_cut)
        viewer, tolerance = self.requirement.viewer, self.requirement.limit_px
        unnoticed = viewer is None or viewer.excess(settings) <= 1
        return unnoticed and self._views.displaced(settings, tolerance) <= tolerance


def _settings(buffer: DepthBuffer, near: float, heights: tuple[float, ...] = ()) -> DoubleFrustum:
    return DoubleFrustum(near=near, slabs=heights, depth=buffer[0], mapping=buffer[1])


# Ranges of near, for one pair of frusta
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class BufferLimit:
    """Smallest near at which a depth buffer orders all visible surfaces, for one pair of frusta."""

    depth: DepthFormat
    mapping: DepthMapping
    #: scene units, three digits; None if the buffer fails at every near
    smallest_near: float | None = None
    #: displacement at that near in the worst view, pixels
    displacement_p99_px: float | None = None
    #: whether `smallest_near` is the lower end of the searched range
    any_near: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Limits:
    """Ranges of near allowed by pixels, depth buffers and eyes, for one pair of frusta."""

    #: largest near within the tolerance at all views; None if every near exceeds it
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
    """Return the limits of near by pixels, depth buffers and eyes at some views."""
    tolerance, viewer = requirement.tolerance_px, requirement.viewer
    pixels = _largest_near(
        views.scene.frustum, lambda near: views.displaced(near, tolerance) <= tolerance
    )
    return Limits(
        pixels=pixels or None,
        buffers=tuple(buffer_limit(views, requirement, buffer) for buffer in buffers),
        eyes=() if viewer is None else viewer.limits(),
        hogels=np.zeros(0) if scan is None else hogel_limits(scan, tolerance),
    )


def buffer_limit(views: Views, requirement: Requirement, buffer: DepthBuffer) -> BufferLimit:
    """Return the smallest near with which a depth buffer meets the limits of depth.

    At all of the views, sheets at the farthest visible surface must be ordered, and few pixels may
    be wrong by depth. Both improve as near grows.
    """
    low, high = indices_of(views.scene.frustum)
    allowed = requirement.separation_in(views.scene.frustum) / SEPARATION_MARGIN

    def enough(near: float) -> bool:
        settings = _settings(buffer, near)
        ordered = views.separation(settings) <= allowed
        return ordered and views.depth_wrong(settings) <= requirement.max_wrong

    index = smallest_index(low, high, enough)
    near, limit = round_number(index), BufferLimit(depth=buffer[0], mapping=buffer[1])
    if not enough(near):
        return limit
    moved = views.displaced(DoubleFrustum(near=near))
    return replace(limit, smallest_near=near, displacement_p99_px=moved, any_near=index == low)


def hogel_limits(scan: PlateScan, tolerance_px: float) -> Floats:
    """Return the largest near of each scanned aperture by closed form, (A,), scene units.

    At this near, 99 % of the visible surface is displaced within the tolerance. It is 0 if a
    surface lies too close to the aperture for any near, and NaN if no surface is visible.
    """

    def largest(look: CoarseView) -> float:
        if not math.isfinite(look.nearest):
            return math.nan
        return _largest_near(
            scan.scene.frustum,
            lambda settings: look.displacement_p99_px(settings, scan.scene) <= tolerance_px,
        )

    return np.array([largest(look) for look in scan.looks])


def _largest_near(frustum: Frustum, holds: Callable[[DoubleFrustum], bool]) -> float:
    """Return the largest near for which a condition holds; 0 if it never holds."""
    low, high = indices_of(frustum)
    index = largest_index(low, high, lambda near: holds(DoubleFrustum(near=near)))
    return 0.0 if index is None else round_number(index)
