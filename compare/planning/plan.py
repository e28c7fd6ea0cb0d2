"""Plans for some apertures, and for a plate from its worst apertures and random samples.

docs/method.md, "The plate", has the derivation.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from xfrustum.compare.planning.requirement import (
    SMALLEST_PER_REACH,
    Quality,
    Requirement,
    worst_errors,
)
from xfrustum.compare.planning.search import (
    COMPARED_BUFFERS,
    Limits,
    Outcome,
    Search,
    near_limits,
)
from xfrustum.compare.planning.views import (
    Done,
    HogelResult,
    View,
    Views,
    displacement_bound,
    hogel_results,
    measured,
)
from xfrustum.compare.run import Evaluator
from xfrustum.compare.sampling import CONFIDENCE, RandomSample, sample_hogels, share_at_most
from xfrustum.compare.scout import CoarseView, PlateScan
from xfrustum.reference import Reference
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import (
    Aperture,
    Camera,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Frustum,
)
from xfrustum.tolerances import MAX_WRONG

#: largest number of samples: another sample is drawn only if the last sample disproved the plan
MAX_SAMPLES = 3

#: Confidence of the bound of each sample, chosen so that all bounds together have `CONFIDENCE`:
#: samples are independent (Sidak 1967).
EACH = CONFIDENCE ** (1 / MAX_SAMPLES)

#: number of worst scanned apertures for the first plan
WORST_VIEWS = 4

#: Scanned displacement, in tolerances, above which an aperture is traced in full, and the number of
#: apertures traced at once, the worst first. A scan has 576 lines: the six largest values give the
#: 99th percentile only to a factor of two.
SUSPECTED_EXCESS, MAX_SUSPECTED = 0.5, 8

#: largest number of repeated plans with added apertures
MAX_ROUNDS = 8

#: largest number of apertures that a result lists
MAX_LISTED_APERTURES = 100

#: Largest number of choices of a depth buffer at which all are compared
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
    """Measurements of a plan over the whole plate; integers count hogels."""

    hogels: int
    #: hogels that were scanned
    scouted: int
    #: hogels that were drawn and judged
    measured: int = 0
    #: hogels in the last random sample
    sampled: int = 0
    #: hogels of the last sample beyond the tolerance
    beyond: int = 0
    #: hogels of the last sample that show nothing and are not beyond the tolerance
    empty: int = 0
    #: hogel with the largest excess; None if there is no plan
    worst: HogelResult | None = None
    #: name of the error of `worst` with the largest excess
    worst_by: str | None = None
    #: hogels that exceed the tolerance at every near
    infeasible: int
    share_beyond_at_most: float = 1.0
    #: probability that the bound holds; 1 where every hogel was measured
    confidence: float = 1.0
    #: the infeasible hogels, at most `MAX_LISTED_APERTURES`
    infeasible_apertures: tuple[Index, ...]

    @property
    def share_within_at_least(self) -> float:
        """Bound on the share of all hogels at which the plan holds."""
        return 1 - self.share_beyond_at_most


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Settings that keep a requirement, and their predicted and measured errors, scene units.

    Without a plan, `near`, predictions and measures are None. The depth buffer is then None as
    well, unless the requirement allows only one.
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
    #: result of the search for the plan; None without a search
    outcome: Outcome | None = None
    #: name of the model of the device on which the plan was measured
    device_model: str | None = None

    @property
    def settings(self) -> DoubleFrustum | None:
        """Settings of the plan; None if there is no plan."""
        if self.near is None or self.depth is None or self.mapping is None:
            return None
        return DoubleFrustum(
            near=self.near, slabs=self.slabs, depth=self.depth, mapping=self.mapping
        )


def predicted_plan(views: Views, requirement: Requirement) -> Plan:
    """Return the plan predicted by closed forms for some views.

    Depth buffers are ordered by the fewest slabs, then by cost (no depth written by fragments, then
    fewer bytes), then by the largest margin.
    """
    outcome = Search(views, requirement).best()
    if outcome.best is None:
        depth, mapping = requirement.buffers[0] if len(requirement.buffers) == 1 else (None, None)
        cause = _cause_of_failure(outcome, views, requirement)
        return Plan(
            requirement=requirement, cause=cause, depth=depth, mapping=mapping, outcome=outcome
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
    undefined = math.isinf(views.displaced(_smallest_near(views.scene.frustum)))
    return Cause.IN_APERTURE if undefined else Cause.AT_PLATE


def _smallest_near(frustum: Frustum) -> DoubleFrustum:
    return DoubleFrustum(near=SMALLEST_PER_REACH * frustum.longest_reach)


def with_limits(made: Plan, views: Views, scan: PlateScan | None = None) -> Plan:
    """Add the limits of near by pixels, depth buffers and eyes, at some views, to a plan."""
    buffers = made.requirement.buffers
    compared = [*(COMPARED_BUFFERS if len(buffers) > MAX_COMPARED else buffers)]
    if (settings := made.settings) is not None:
        compared.append((settings.depth, settings.mapping))
    limits = near_limits(views, made.requirement, list(dict.fromkeys(compared)), scan)
    return replace(made, limits=limits)


def plan_apertures(
    scene: Scene,
    apertures: Sequence[Aperture],
    requirement: Requirement,
    done: Done = lambda hogels: None,
) -> Plan:
    """Plan for the worst of some apertures of a scene, and measure the plan.

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
class PlateViews:
    """Traced apertures of a plate with a possible near, and infeasible apertures without one.

    An infeasible aperture is either excluded before a sample is drawn, or it belongs to a sample
    and counts in the sample's share. A sample represents all hogels that are neither
    traced nor excluded.
    """

    views: Views
    #: apertures excluded by the scan, or by the trace of an aperture that the scan suspected
    excluded: frozenset[Index]
    #: infeasible hogels of samples
    sampled: frozenset[Index] = frozenset()

    @property
    def infeasible(self) -> frozenset[Index]:
        """Apertures that exceed the tolerance at every near."""
        return self.excluded | self.sampled

    @property
    def known(self) -> frozenset[Index]:
        """Apertures that a sample need not represent."""
        return _indices(self.views.views) | self.excluded

    @property
    def any_surface(self) -> bool:
        """True if a surface is visible through a feasible aperture."""
        return any(view.truth.covered.any() for view in self.views.views)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlatePlanner:
    """Planner for a scanned plate; `done` is called for each traced or drawn hogel."""

    reference: Reference
    scan: PlateScan
    requirement: Requirement
    done: Done = field(default=lambda hogels: None)

    def plan(self, sample: RandomSample) -> Plan:
        """Return the plan, measured at its worst apertures and at a random sample of hogels."""
        chosen = self.first_views()
        if chosen.excluded and not chosen.any_surface:
            plate = self._plate_result(chosen)
            return Plan(requirement=self.requirement, cause=Cause.EVERY_APERTURE, plate=plate)
        for last in (False,) * (MAX_SAMPLES - 1) + (True,):
            chosen, made = self._settled(chosen)
            if made.settings is None:
                made = replace(made, plate=self._plate_result(chosen))
                break
            results = self._sampled(chosen, made.settings, sample)
            missed = [result.aperture for result in results if self.requirement.missed_by(result)]
            joining, infeasible = self._traced(missed)
            # Keep infeasible hogels: a later sample need not contain them.
            chosen = replace(chosen, sampled=chosen.sampled | infeasible)
            if not joining or last:
                made = self._measured(made, chosen, results)
                break
            chosen = replace(chosen, views=chosen.views.joined(joining))
            sample = sample.next()
        return with_limits(made, chosen.views, self.scan)

    def first_views(self) -> PlateViews:
        """Trace the middle, the worst apertures, and apertures with the farthest surfaces.

        If none of these apertures shows a surface, the next worst apertures are traced in turn.
        """
        scan, limit = self.scan, self.requirement.limit_px
        moved = scan.displacements(_smallest_near(self.reference.scene.frustum))
        excluded = _indices(scan.looks[k] for k in np.flatnonzero(moved > limit))
        worst = [
            look for look in scan.worst(len(scan.looks)) if look.aperture.index not in excluded
        ]
        seeing = [look.aperture for look in worst if math.isfinite(look.nearest)]
        none = Views(reference=self.reference, views=(), device=self.requirement.device)
        chosen = PlateViews(views=none, excluded=excluded)
        joining = []
        if seeing or not excluded:
            middle = [a for a in scan.apertures if a == self.reference.scene.plate.middle]
            farthest = [scan.farthest(camera).aperture for camera in (Camera.C, Camera.C_STAR)]
            joining = [*middle, *(look.aperture for look in worst[:WORST_VIEWS]), *farthest]
        while joining and not chosen.any_surface:
            unknown = [a for a in dict.fromkeys(joining) if a.index not in chosen.known]
            chosen = self._joined(chosen, unknown)
            joining = [a for a in seeing if a.index not in chosen.known][:WORST_VIEWS]
        return chosen

    def _joined(self, chosen: PlateViews, apertures: Sequence[Aperture]) -> PlateViews:
        """Trace apertures that the scan suspects, and add them to the views or exclude them."""
        joining, infeasible = self._traced(apertures)
        views, excluded = chosen.views.joined(joining), chosen.excluded | infeasible
        return replace(chosen, views=views, excluded=excluded)

    def _traced(self, apertures: Sequence[Aperture]) -> tuple[tuple[View, ...], frozenset[Index]]:
        """Trace apertures; return the feasible views, and the indices of infeasible apertures.

        Every trace is tested: the coarse film of a scan may miss a surface in the aperture.
        """
        frustum = self.reference.scene.frustum
        traced = Views.traced(self.reference, apertures, self.done).views
        settings, limit = _smallest_near(frustum), self.requirement.limit_px
        bounds = [displacement_bound(view.truth, frustum, settings) for view in traced]
        views = tuple(view for view, px in zip(traced, bounds, strict=True) if px <= limit)
        return views, _indices(traced) - _indices(views)

    def _settled(self, chosen: PlateViews) -> tuple[PlateViews, Plan]:
        """Return a plan with its views, repeated until the scan suspects no further aperture."""
        for _ in range(MAX_ROUNDS):
            made = predicted_plan(chosen.views, self.requirement)
            known = chosen.known | chosen.sampled
            suspected = [a for a in self._suspected(made) if a.index not in known]
            if not suspected:
                break
            chosen = self._joined(chosen, suspected[:MAX_SUSPECTED])
        return chosen, made

    def _suspected(self, made: Plan) -> list[Aperture]:
        """Return scanned apertures whose errors may exceed a limit, the worst first."""
        if made.settings is None or not self.requirement.pixels_count:
            return []
        moved = self.scan.displacements(made.settings) / self.requirement.limit_px
        excess = np.maximum(moved, self.scan.wrong_shares(made.settings) / MAX_WRONG)
        worst_first = np.argsort(-excess, kind="stable")
        return [self.scan.apertures[k] for k in worst_first if excess[k] > SUSPECTED_EXCESS]

    def _sampled(
        self, chosen: PlateViews, settings: DoubleFrustum, sample: RandomSample
    ) -> list[HogelResult]:
        """Draw and judge a random sample of the hogels not examined before."""
        scene, results = self.reference.scene, []
        known = [scene.plate.aperture(*index) for index in chosen.known]
        apertures = sample_hogels(scene.plate, sample, known)
        with Evaluator(scene, reference=self.reference) as judge:
            for result in hogel_results(judge, apertures, settings):
                results.append(result)
                self.done(1)
        return results

    def _measured(self, made: Plan, chosen: PlateViews, sample: Sequence[HogelResult]) -> Plan:
        """Return a plan with its errors measured at its views and at a sample of other hogels."""
        assert made.settings is not None
        views, sheets, device = measured(chosen.views, made.settings, self.requirement, self.done)
        limit, hogels = self.requirement.tolerance_px, math.prod(self.reference.scene.plate.hogels)
        beyond = sum(result.beyond(limit) for result in sample)
        unfit = len(chosen.excluded) + sum(result.beyond(limit) for result in views)
        # The sample represents the hogels that were not examined before.
        others = hogels - len(chosen.known)
        everything = len(sample) == others
        share = share_at_most(beyond, len(sample), EACH)
        if everything:
            share = beyond / max(len(sample), 1)
        drawable = [
            result for result in (*views, *sample) if result.aperture.index not in chosen.infeasible
        ]
        worst = max(
            drawable, key=lambda result: (self.requirement.excess(result), result.surface_fraction)
        )
        quality = replace(sheets, **worst_errors(drawable))
        plate = replace(
            self._plate_result(chosen),
            measured=len(views) + len(sample),
            sampled=len(sample),
            beyond=beyond,
            empty=sum(not (result.covered or result.beyond(limit)) for result in sample),
            worst=worst,
            worst_by=self.requirement.worst_measure(worst),
            share_beyond_at_most=(unfit + share * others) / hogels,
            confidence=1.0 if everything else CONFIDENCE,
        )
        within = self.requirement.met_by(quality) and not chosen.infeasible
        return replace(made, measured=quality, within=within, plate=plate, device_model=device)

    def _plate_result(self, chosen: PlateViews) -> PlateResult:
        return PlateResult(
            hogels=math.prod(self.reference.scene.plate.hogels),
            scouted=len(_indices(self.scan.looks) | chosen.infeasible),
            infeasible=len(chosen.infeasible),
            infeasible_apertures=tuple(sorted(chosen.infeasible)[:MAX_LISTED_APERTURES]),
        )


def _indices(some: Iterable[CoarseView | View]) -> frozenset[Index]:
    return frozenset(view.aperture.index for view in some)
