"""Plans for some apertures, and for a plate from its worst apertures and random samples.

docs/method.md, "The plate", has the derivation.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property

import numpy as np

from xfrustum.compare.planning.limits import COMPARED_BUFFERS, Limits, near_limits
from xfrustum.compare.planning.measure import HogelResult, hogel_results, measured
from xfrustum.compare.planning.requirement import Quality, Requirement, worst_errors
from xfrustum.compare.planning.search import (
    SMALLEST_PER_REACH,
    Outcome,
    Search,
)
from xfrustum.compare.planning.views import Done, View, Views, displacement_bound
from xfrustum.compare.run import Evaluator
from xfrustum.compare.sampling import CONFIDENCE, RandomSample, sample_hogels, share_at_most
from xfrustum.compare.scout import CoarseView, PlateScan
from xfrustum.reference import Reference
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Camera, DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture
from xfrustum.tolerances import MAX_WRONG

#: largest number of samples: each further one follows one that disproved a plan
MAX_SAMPLES = 3

#: Confidence of the bound of each sample, for all to hold together: they are independent (Sidak
#: 1967).
EACH = CONFIDENCE ** (1 / MAX_SAMPLES)

#: number of worst scanned apertures from which a plan is first made
WORST_VIEWS = 4

#: Scanned displacement, in tolerances, from which on an aperture is traced in full before it is
#: trusted, and how many at a time, the worst first: one line in a hundred of 576 is six, which give
#: a 99th percentile to a factor of two at best.
SUSPECTED_EXCESS, MAX_SUSPECTED = 0.5, 8

#: largest number of plans that are made anew with apertures that joined
MAX_ROUNDS = 8

#: largest number of apertures that a result lists
MAX_LISTED_APERTURES = 100

#: largest number of depth buffers to choose from that are all compared
MAX_COMPARED = 5

Index = tuple[int, int]


class Cause(StrEnum):
    """Reason for a plan, or for the lack of one."""

    #: one pair of frusta keeps all limits
    ONE_PAIR = "one-pair"
    #: fewer cuts fail
    CUTS = "cuts"
    #: no depth buffer orders sheets of the required separation
    SEPARATION = "separation"
    #: even the largest number of cuts fails
    TOO_MANY_CUTS = "too-many-cuts"
    #: eyes notice the smallest near
    EYES = "eyes"
    #: a surface in an aperture fills 1 % of its picture
    IN_APERTURE = "in-aperture"
    #: surfaces lie closer to the plate than the smallest cut
    AT_PLATE = "at-plate"
    #: a surface lies in every aperture that sees anything
    EVERY_APERTURE = "every-aperture"


@dataclass(frozen=True, kw_only=True)
class PlateResult:
    """Measures of a plan all over the plate; counts are of hogels."""

    hogels: int
    #: hogels that were scanned
    scouted: int
    #: hogels that were drawn and judged
    measured: int = 0
    #: hogels in the last random sample
    sampled: int = 0
    #: hogels of the last sample beyond the tolerance
    beyond: int = 0
    #: hogels of the last sample that show nothing and are not beyond
    empty: int = 0
    #: hogel with the largest excess; None without a plan
    worst: HogelResult | None = None
    #: name of the error of `worst` with the largest excess
    worst_by: str | None = None
    #: hogels at which no near keeps the tolerance
    infeasible: int
    share_beyond_at_most: float = 1.0
    #: probability that the bound holds; 1 where every hogel was measured
    confidence: float = 1.0
    #: at most `MAX_LISTED_APERTURES`
    infeasible_apertures: tuple[Index, ...]

    @property
    def share_within_at_least(self) -> float:
        """Bound on the share of all hogels at which the plan holds."""
        return 1 - self.share_beyond_at_most


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Settings that keep a requirement, and the measures of how well; lengths in scene units.

    Without a plan `near`, predictions and measures are None; so is the depth buffer where there
    was a choice.
    """

    requirement: Requirement
    cause: Cause
    near: float | None = None
    slabs: tuple[float, ...] = ()
    depth: DepthFormat | None = None
    mapping: DepthMapping | None = None
    #: errors at the worst aperture
    predicted: Quality | None = None
    measured: Quality | None = None
    #: whether all limits were measured to hold
    within: bool = False
    #: None for a plan of some apertures
    plate: PlateResult | None = None
    limits: Limits | None = None
    #: search that led to it; None where none was made
    outcome: Outcome | None = None
    in_aperture: tuple[Index, float] | None = (
        None  #: aperture of `IN_APERTURE`, share of its pixels
    )
    #: name of the model of the device that measured it
    device_model: str | None = None

    @property
    def settings(self) -> DoubleFrustum | None:
        """Settings of the plan; None without one."""
        if self.near is None or self.depth is None or self.mapping is None:
            return None
        return DoubleFrustum(
            near=self.near, slabs=self.slabs, depth=self.depth, mapping=self.mapping
        )


def predicted_plan(views: Views, requirement: Requirement) -> Plan:
    """Return the plan that closed forms predict for some views.

    Depth buffers are ordered by the fewest slabs, then by cost (depth that no fragment writes,
    then fewer bytes), then by the largest margin.
    """
    outcome = Search(views, requirement).best()
    if outcome.best is None:
        depth, mapping = requirement.buffers[0] if len(requirement.buffers) == 1 else (None, None)
        return Plan(
            requirement=requirement,
            cause=_cause_of_failure(outcome, views, requirement),
            depth=depth,
            mapping=mapping,
            outcome=outcome,
        )
    settings = outcome.best.settings
    return Plan(
        requirement=requirement,
        cause=Cause.CUTS if settings.slabs else Cause.ONE_PAIR,
        near=settings.near,
        slabs=settings.slabs,
        depth=settings.depth,
        mapping=settings.mapping,
        predicted=outcome.best.predicted,
        outcome=outcome,
    )


def _cause_of_failure(outcome: Outcome, views: Views, requirement: Requirement) -> Cause:
    if not outcome.able:
        return Cause.SEPARATION
    if outcome.failed is not None:
        return Cause.TOO_MANY_CUTS
    if not requirement.pixels_count:
        return Cause.EYES
    smallest = SMALLEST_PER_REACH * views.scene.frustum.longest_reach
    in_aperture = math.isinf(views.displaced(DoubleFrustum(near=smallest)))
    return Cause.IN_APERTURE if in_aperture else Cause.AT_PLATE


def with_limits(made: Plan, views: Views, scan: PlateScan | None = None) -> Plan:
    """Return a plan with the range of near that each judge allows at its views."""
    buffers = made.requirement.buffers
    compared = [*(COMPARED_BUFFERS if len(buffers) > MAX_COMPARED else buffers)]
    if (settings := made.settings) is not None:
        own = settings.depth, settings.mapping
        compared += [] if own in compared else [own]
    return replace(made, limits=near_limits(views, made.requirement, compared, scan))


def plan_apertures(
    scene: Scene,
    apertures: Sequence[Aperture],
    requirement: Requirement,
    done: Done = lambda hogels: None,
) -> Plan:
    """Plan for some apertures of a scene, of which the worst counts, and measure the plan.

    `done` is called twice for each aperture. InputError without usable OpenGL.
    """
    views = Views.traced(Reference(scene), apertures, done, requirement.device)
    made = with_limits(predicted_plan(views, requirement), views)
    if made.settings is None:
        return made
    _, result, device = measured(views, made.settings, requirement, done)
    within = requirement.met_by(result)
    return replace(made, measured=result, within=within, device_model=device)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlatePlanner:
    """Planner for a scanned plate; `done` is called for each hogel that it makes."""

    reference: Reference
    scan: PlateScan
    requirement: Requirement
    done: Done = field(default=lambda hogels: None)

    def plan(self, sample: RandomSample) -> Plan:
        """Return the plan, measured at its worst apertures and at a random sample of hogels."""
        if not self._feasible and any(math.isfinite(look.nearest) for look in self.scan.looks):
            plate = self._plate_result(self._infeasible)
            return Plan(requirement=self.requirement, cause=Cause.EVERY_APERTURE, plate=plate)
        views, infeasible = self.first_views(), self._infeasible
        for last in (False,) * (MAX_SAMPLES - 1) + (True,):
            views, made = self._settled(views)
            if made.settings is None:
                made = replace(made, plate=self._plate_result(infeasible))
                break
            results = self._sampled(views, made.settings, sample)
            missed = self._missed(results)
            # Kept from sample to sample: a later one need not have these hogels.
            infeasible |= _indices(view for view in missed if self._is_infeasible(view))
            joining = [view for view in missed if view.aperture.index not in infeasible]
            if not joining or last:
                made = self._measured(made, views, results, infeasible)
                break
            views, sample = replace(views, views=(*views.views, *joining)), sample.next()
        return with_limits(made, views, self.scan)

    @cached_property
    def _infeasible(self) -> frozenset[Index]:
        """Scanned apertures at which not even the smallest near keeps the tolerance."""
        moved = self.scan.displacements(self._smallest)
        pairs = zip(self.scan.apertures, moved, strict=True)
        return frozenset(aperture.index for aperture, px in pairs if px > self.requirement.limit_px)

    @cached_property
    def _feasible(self) -> bool:
        """Visibility of any drawable surface through a scanned aperture."""
        seeing = (look for look in self.scan.looks if math.isfinite(look.nearest))
        return any(look.aperture.index not in self._infeasible for look in seeing)

    def _is_infeasible(self, view: View) -> bool:
        frustum, tolerance = self.reference.scene.frustum, self.requirement.limit_px
        return displacement_bound(view.truth, frustum, self._smallest) > tolerance

    @property
    def _smallest(self) -> DoubleFrustum:
        return DoubleFrustum(near=SMALLEST_PER_REACH * self.reference.scene.frustum.longest_reach)

    def first_views(self) -> Views:
        """Trace the middle, the worst feasible apertures, and those that see farthest."""
        scan, middle = self.scan, self.reference.scene.plate.middle
        worst = [look.aperture for look in scan.worst(len(scan.looks))]
        worst = [aperture for aperture in worst if aperture.index not in self._infeasible][
            :WORST_VIEWS
        ]
        farthest = [scan.farthest(camera).aperture for camera in (Camera.C, Camera.C_STAR)]
        chosen = [
            *(aperture for aperture in scan.apertures if aperture == middle),
            *worst,
            *farthest,
        ]
        feasible = [
            aperture for aperture in dict.fromkeys(chosen) if aperture.index not in self._infeasible
        ]
        return self._traced(feasible)

    def _traced(self, apertures: Sequence[Aperture]) -> Views:
        return Views.traced(self.reference, apertures, self.done, self.requirement.device)

    def _settled(self, views: Views) -> tuple[Views, Plan]:
        """Return a plan, and its views, that the scan suspects at no further aperture."""
        for _ in range(MAX_ROUNDS):
            made = predicted_plan(views, self.requirement)
            known = _indices(views.views) | self._infeasible
            suspected = [
                aperture for aperture in self._suspected(made) if aperture.index not in known
            ]
            if not suspected:
                break
            joining = self._traced(suspected[:MAX_SUSPECTED]).views
            views = replace(views, views=(*views.views, *joining))
        return views, made

    def _suspected(self, made: Plan) -> list[Aperture]:
        """Return scanned apertures whose errors may exceed a limit, the worst first."""
        if made.settings is None or not self.requirement.pixels_count:
            return []
        moved = self.scan.displacements(made.settings) / self.requirement.limit_px
        excess = np.maximum(moved, self.scan.wrong_shares(made.settings) / MAX_WRONG)
        worst_first = np.argsort(-excess, kind="stable")
        return [self.scan.apertures[k] for k in worst_first if excess[k] > SUSPECTED_EXCESS]

    def _sampled(
        self, views: Views, settings: DoubleFrustum, sample: RandomSample
    ) -> list[HogelResult]:
        """Draw and judge random hogels, out of those that are neither views nor infeasible."""
        scene, results = self.reference.scene, []
        known = [scene.plate.aperture(*index) for index in _indices(views.views) | self._infeasible]
        chosen = sample_hogels(scene.plate, sample, known)
        with Evaluator(scene, reference=self.reference) as judge:
            for result in hogel_results(judge, chosen, settings):
                results.append(result)
                self.done(1)
        return results

    def _missed(self, results: Sequence[HogelResult]) -> tuple[View, ...]:
        """Trace the hogels of a sample that exceed a limit."""
        return self._traced(
            [result.aperture for result in results if self.requirement.missed_by(result)]
        ).views

    def _measured(
        self,
        made: Plan,
        views: Views,
        sample: Sequence[HogelResult],
        found_infeasible: frozenset[Index],
    ) -> Plan:
        """Return a plan with its measures at its views and at a sample of all other hogels."""
        assert made.settings is not None
        chosen, sheets, device = measured(views, made.settings, self.requirement, self.done)
        limit, hogels = self.requirement.tolerance_px, math.prod(self.reference.scene.plate.hogels)
        beyond, chosen_beyond = (
            sum(result.beyond(limit) for result in some) for some in (sample, chosen)
        )
        known = len(chosen) + len(self._infeasible)
        everything = known + len(sample) == hogels
        # The sample speaks for the hogels of which nothing was known.
        share = share_at_most(beyond, len(sample), EACH)
        if everything:
            share = beyond / max(len(sample), 1)
        drawable = [
            result for result in (*chosen, *sample) if result.aperture.index not in found_infeasible
        ]
        worst = max(
            drawable, key=lambda result: (self.requirement.excess(result), result.surface_fraction)
        )
        quality = replace(sheets, **worst_errors(drawable))
        infeasible = self._infeasible | found_infeasible
        unfit = chosen_beyond + len(self._infeasible)
        plate = replace(
            self._plate_result(infeasible),
            measured=len(chosen) + len(sample),
            sampled=len(sample),
            beyond=beyond,
            empty=sum(not (result.covered or result.beyond(limit)) for result in sample),
            worst=worst,
            worst_by=self.requirement.worst_measure(worst),
            share_beyond_at_most=(unfit + share * (hogels - known)) / hogels,
            confidence=1.0 if everything else CONFIDENCE,
        )
        within = self.requirement.met_by(quality) and not infeasible
        return replace(made, measured=quality, within=within, plate=plate, device_model=device)

    def _plate_result(self, infeasible: frozenset[Index]) -> PlateResult:
        return PlateResult(
            hogels=math.prod(self.reference.scene.plate.hogels),
            scouted=len(_indices(self.scan.looks) | infeasible),
            infeasible=len(infeasible),
            infeasible_apertures=tuple(sorted(infeasible)[:MAX_LISTED_APERTURES]),
        )


def _indices(some: Iterable[CoarseView | View]) -> frozenset[Index]:
    return frozenset(view.aperture.index for view in some)
