"""The planner: the fewest slabs, and then the largest margin, that keep what is required.

For a whole plate it asks a scout's worst apertures and random samples: docs/method.md, "The plate".
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from itertools import product
from typing import Any, Self, TypeVar

import numpy as np

from xfrustum.compare.planning.measure import HogelResult, hogel_results, measured, worst_errors
from xfrustum.compare.planning.reasons import disproved, exceptions, why, why_not
from xfrustum.compare.planning.search import (
    SMALLEST_PER_REACH,
    Attempt,
    DepthBuffer,
    Search,
    index_below,
    round_number,
)
from xfrustum.compare.planning.views import (
    Done,
    Quality,
    Requirement,
    View,
    Views,
    displacement_bound,
)
from xfrustum.compare.run import Evaluator
from xfrustum.compare.sampling import (
    CONFIDENCE,
    RandomSample,
    sample_hogels,
    share_at_most,
)
from xfrustum.compare.scout import AutoApertures, CoarseView, PlateScan
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Camera, DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture
from xfrustum.scenes.representation import ShortRepr
from xfrustum.tolerances import MAX_WRONG

MAX_SAMPLES = 3
"""Samples that are drawn at most, each after its predecessor disproved a plan."""

EACH = CONFIDENCE ** (1 / MAX_SAMPLES)
"""Confidence of each sample's bound, for all to hold together: they are independent (Sidak 1967)."""

WORST_VIEWS = 4
"""Worst apertures of the scout that a plan is made from at once; others join where they need more."""

SUSPECTED_EXCESS, MAX_SUSPECTED = 0.5, 8
"""Scouted displacement, in tolerances, from which on an aperture is traced in full before it is trusted, and
how many are at a time, the worst first: one line in a hundred of 576 is six, which tell a 99th
percentile to
a factor of two at best."""

MAX_HALVINGS = 5
"""Times that the number of apertures to be set aside is halved, each with a search for a plan: it is known to
a 32nd of all."""

MAX_LOWERED, MIN_LOWERED = 5, 1.02
"""Times that the largest near is lowered where drawings show more than was predicted, and by which factor at
least."""

#: times that a plan is made anew with apertures that joined; each time the worst of them join
MAX_ROUNDS = 8

MAX_LISTED_APERTURES = 100
"""Largest number of apertures that a result lists of each kind: some rows of a scout, and still readable."""

Found = TypeVar("Found")
Index = tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class PlateResult:
    """What is known of a plan all over the plate; counts are of hogels."""

    hogels: int
    scouted: int  #: looked through
    measured: int = 0  #: drawn and judged
    sampled: int = 0  #: in the last random sample
    beyond: int = 0  #: of the last sample, beyond the tolerance
    empty: int = 0  #: of the last sample, not beyond, and show nothing
    #: Nearest to what is allowed, or farthest beyond, of equals with most wrong surfaces; None
    #: without a plan
    worst: HogelResult | None = None
    worst_by: str | None = None  #: name of the error of `worst` that is so
    infeasible: int  #: looked through, and at which no near at all would keep to the tolerance
    set_aside: (
        int  #: others for which the plan was not made, since there is none for them and all others
    )
    share_beyond_at_most: float = 1.0
    confidence: float = 1.0  #: probability that the bound holds; 1 where every hogel was measured
    infeasible_apertures: tuple[Index, ...]  #: `MAX_LISTED_APERTURES` of each kind at most
    set_aside_apertures: tuple[Index, ...]

    @property
    def share_within_at_least(self) -> float:
        """Bound on the share of all hogels at which the plan holds."""
        return 1 - self.share_beyond_at_most

    @property
    def covers_the_plate(self) -> bool:
        """Whether the plan was made for every hogel that was looked through."""
        return not self.infeasible and not self.set_aside

    def summary(self) -> dict[str, Any]:
        """Return what `plan --json` prints under `plate`."""
        worst = self.worst and {**asdict(self.worst), "aperture": self.worst.aperture.index}
        if worst:
            del worst["others"]
        return {**asdict(self), "share_within_at_least": self.share_within_at_least, "worst": worst}


@dataclass(frozen=True, kw_only=True)
class Alternative:
    """Settings beside those of a plan, and how many of the plan's hogels are beyond with them, drawn."""

    near: float  #: scene units
    slabs: tuple[float, ...]
    depth: DepthFormat
    mapping: DepthMapping
    judged: int = 0
    beyond: int = 0

    @classmethod
    def from_settings(cls, settings: DoubleFrustum) -> Self:
        """Return settings that are not judged yet."""
        chosen = {name: getattr(settings, name) for name in ("near", "slabs", "depth", "mapping")}
        return cls(**chosen)

    @property
    def settings(self) -> DoubleFrustum:
        """The settings to draw with."""
        return DoubleFrustum(
            near=self.near, slabs=self.slabs, depth=self.depth, mapping=self.mapping
        )


@dataclass(frozen=True, kw_only=True, repr=False)
class Plan(ShortRepr):
    """What to draw with, and what that keeps, lengths in scene units.

    Without a plan `near` and what was predicted and measured are None; so is the depth buffer where
    there was more than one to choose from. `plate` is None where the plan was made for some
    apertures only, `auto` unless a scout chose them. `within` says whether everything that is
    required was measured to hold.
    """

    near: float | None = None
    slabs: tuple[float, ...] = ()
    depth: DepthFormat | None = None
    mapping: DepthMapping | None = None
    predicted: Quality | None = None  #: at the worst aperture
    measured: Quality | None = None
    within: bool = False
    reason: str
    plate: PlateResult | None = None
    auto: AutoApertures | None = None
    device_model: str | None = None  #: name of the model of the device that measured it
    #: Largest near predicted to hold; None where it is the plan's own, and where eyes judge near
    largest: Alternative | None = None
    #: Where sheets alone ask for cuts, the best settings without; else None
    without_cuts: Alternative | None = None

    @property
    def settings(self) -> DoubleFrustum | None:
        """The settings to draw with; None where there is no plan."""
        if self.near is None or self.depth is None or self.mapping is None:
            return None
        return DoubleFrustum(
            near=self.near, slabs=self.slabs, depth=self.depth, mapping=self.mapping
        )

    @property
    def alternatives(self) -> dict[str, Alternative]:
        """Settings that are judged beside the plan's, by the names of their fields."""
        found = {"largest": self.largest, "without_cuts": self.without_cuts}
        return {name: one for name, one in found.items() if one is not None}

    @property
    def depth_buffer(self) -> tuple[DepthFormat | None, DepthMapping | None]:
        """Its format and mapping."""
        return self.depth, self.mapping

    def summary(self) -> dict[str, Any]:
        """Return the plan as `plan --json` prints it."""
        told, unknown = (
            asdict(replace(self, plate=None, auto=None)),
            dict.fromkeys(one.name for one in fields(Quality)),
        )
        del told["auto"]
        return told | {
            "slabs": list(self.slabs),
            "predicted": told["predicted"] or unknown,
            "measured": told["measured"] or unknown,
            "plate": self.plate and self.plate.summary(),
            "apertures": self.auto and self.auto.record,
        }


def depth_buffers(
    depth: DepthFormat | None = None, mapping: DepthMapping | None = None
) -> tuple[DepthBuffer, ...]:
    """Return the depth buffers to choose from: all, or all of one format, of one mapping, or the one."""
    return tuple(product([depth] if depth else DepthFormat, [mapping] if mapping else DepthMapping))


# For some apertures
# ----------------------------------------------------------------------------------------


def plan(
    scene: Scene,
    apertures: Sequence[Aperture],
    requirement: Requirement | None = None,
    choices: Sequence[DepthBuffer] | None = None,
    done: Done = lambda hogels: None,
) -> Plan:
    """Plan how to draw some apertures of a scene, of which the worst counts, and measure the plan.

    Of the depth buffers to choose from, None for all, the fewest slabs count, then what is cheapest
    (depth that no fragment writes, then fewer bytes), then the largest margin. `done` is called
    twice for each aperture: when it is traced, and when it is measured. Raises InputError where
    there is no usable OpenGL.
    """
    requirement = requirement or Requirement()
    views = Views.traced(Reference(scene), apertures, done, requirement.device)
    made = predicted_plan(views, requirement, choices or depth_buffers())
    if (settings := made.settings) is None:
        return made
    made = _with_uncut(made, views, requirement, choices or depth_buffers())
    others = [one.settings for one in made.alternatives.values()]
    drawn, result, device = measured(views, settings, requirement, done, others=others)
    made = _with_judged(made, drawn, requirement.beyond_px)
    within = requirement.met_by(result)
    reason = made.reason if within else f"{made.reason} {disproved(result, requirement)}"
    return replace(made, measured=result, within=within, reason=reason, device_model=device)


def predicted_plan(
    views: Views,
    requirement: Requirement,
    choices: Sequence[DepthBuffer],
    largest_near: float | None = None,
) -> Plan:
    """Plan how to draw what some apertures show, by prediction alone; see `plan`.

    `largest_near` is that of drawings, where a larger one is predicted and was not confirmed.
    """
    search = Search(views, requirement)
    found = search.among(choices)
    if not found.holding:
        return _no_plan(choices, why_not(found, views, requirement))
    best = search.most_robust(found.holding)
    settings = best.settings
    largest = next(one for one in found.holding if _buffer(one) == _buffer(best)).settings
    if largest_near is not None:
        largest = replace(largest, near=largest_near)
    beside = not requirement.SEEN_BY_EYES and largest.near != settings.near
    return Plan(
        near=settings.near,
        slabs=settings.slabs,
        depth=settings.depth,
        mapping=settings.mapping,
        predicted=best.predicted,
        reason=why(found, best, largest, views, requirement),
        largest=Alternative.from_settings(largest) if beside else None,
    )


def _with_uncut(
    made: Plan, views: Views, requirement: Requirement, choices: Sequence[DepthBuffer]
) -> Plan:
    """Return a plan with the best settings without cuts, where sheets alone ask for its cuts."""
    uncut = Search(views, requirement).without_cuts(choices) if made.slabs else None
    return (
        made
        if uncut is None
        else replace(made, without_cuts=Alternative.from_settings(uncut.settings))
    )


def _with_judged(made: Plan, results: Sequence[HogelResult], tolerance_px: float) -> Plan:
    """Return a plan with the hogels that are beyond with each of its alternatives, counted."""
    judged = {
        name: replace(
            one,
            judged=len(results),
            beyond=sum(result.others[number].beyond(tolerance_px) for result in results),
        )
        for number, (name, one) in enumerate(made.alternatives.items())
    }
    return replace(made, largest=judged.get("largest"), without_cuts=judged.get("without_cuts"))


def _buffer(attempt: Attempt) -> DepthBuffer:
    return attempt.settings.depth, attempt.settings.mapping


def _no_plan(choices: Sequence[DepthBuffer], reason: str, plate: PlateResult | None = None) -> Plan:
    depth, mapping = choices[0] if len(choices) == 1 else (None, None)
    return Plan(depth=depth, mapping=mapping, reason=reason, plate=plate)


# For the plate
# ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class PlatePlanner:
    """Plans for a whole plate that a scout has looked at; `done` is called for each hogel that it makes."""

    reference: Reference
    scouted: PlateScan
    requirement: Requirement
    choices: Sequence[DepthBuffer]
    done: Done = field(default=lambda hogels: None)

    def plan(self, wanted: RandomSample) -> Plan:
        """Return the plan, measured at its worst apertures and at a random sample of hogels."""
        if self._seeing and not self._possible:
            return self._without_plan(
                "No plan: a surface lies in every aperture that sees anything, or so close to it that no "
                "near draws it. Move it before or behind the plate."
            )
        views = self.first_views()
        for last in (False,) * (MAX_SAMPLES - 1) + (True,):
            views, made = self._settled(views)
            if made.settings is None:
                return self._partial(made, wanted)
            sample = self._sampled(views, made, wanted)
            joining = [
                view for view in self._disproving(made, sample) if not self._is_infeasible(view)
            ]
            if not joining or last:
                break
            views, wanted = replace(views, views=(*views.views, *joining)), wanted.next()
        return self._measured(made, views, sample)

    def _partial(self, whole: Plan, wanted: RandomSample) -> Plan:
        """Return a plan without the hardest apertures; `whole` says why there is none for the whole plate."""

        def planned(looks: tuple[CoarseView, ...]) -> tuple[Views, Plan] | None:
            planner = replace(self, scouted=replace(self.scouted, looks=looks))
            views, made = planner._settled(planner.first_views())
            return None if made.settings is None else (views, made)

        found = largest_share(self._possible, planned)
        if found is None:
            return self._without_plan(
                f"{whole.reason} Nor was a plan found for any part of the plate: there is none even for the "
                "easiest aperture alone."
            )
        kept, (views, made) = found
        assert made.settings is not None
        sample = self._sampled(views, made, wanted)
        aside = _indices(self._possible) - _indices(kept)
        result = self._measured(made, views, sample, aside)
        if not aside:
            return result
        return replace(result, reason=f"{result.reason} For all apertures together: {whole.reason}")

    def _without_plan(self, reason: str) -> Plan:
        return _no_plan(
            self.choices, reason, self._plate_result(self._infeasible, _indices(self._possible))
        )

    def _plate_result(
        self, infeasible: frozenset[Index], aside: frozenset[Index], **found: Any
    ) -> PlateResult:
        return PlateResult(
            hogels=math.prod(self.reference.scene.plate.hogels),
            scouted=len(_indices(self.scouted.looks) | infeasible),
            infeasible=len(infeasible),
            set_aside=len(aside),
            infeasible_apertures=tuple(sorted(infeasible)[:MAX_LISTED_APERTURES]),
            set_aside_apertures=tuple(sorted(aside)[:MAX_LISTED_APERTURES]),
            **found,
        )

    def _measured(
        self,
        made: Plan,
        views: Views,
        sample: Sequence[HogelResult],
        aside: frozenset[Index] = frozenset(),
    ) -> Plan:
        assert made.settings is not None
        others = [one.settings for one in made.alternatives.values()]
        chosen, sheets, device = measured(
            views, made.settings, self.requirement, self.done, others=others
        )
        drawn_infeasible = _indices(
            view for view in self._missed(sample) if self._is_infeasible(view)
        )
        limit = self.requirement.beyond_px
        beyond, chosen_beyond = (
            sum(one.beyond(limit) for one in some) for some in (sample, chosen)
        )
        hogels, known = (
            math.prod(self.reference.scene.plate.hogels),
            len(chosen) + len(self._infeasible),
        )
        everything = known + len(sample) == hogels
        # The sample speaks for the hogels that nothing was known of.
        unchosen = (
            beyond / max(len(sample), 1) if everything else share_at_most(beyond, len(sample), EACH)
        )
        drawable = [one for one in (*chosen, *sample) if one.aperture.index not in drawn_infeasible]
        worst = max(drawable, key=lambda one: (self.requirement.excess(one), one.surface_fraction))
        quality = replace(sheets, **worst_errors(drawable))
        plate = self._plate_result(
            self._infeasible | drawn_infeasible,
            aside,
            measured=len(chosen) + len(sample),
            sampled=len(sample),
            beyond=beyond,
            empty=sum(not (one.covered or one.beyond(limit)) for one in sample),
            worst=worst,
            worst_by=self.requirement.worst_measure(worst),
            share_beyond_at_most=(
                chosen_beyond + len(self._infeasible) + unchosen * (hogels - known)
            )
            / hogels,
            confidence=1.0 if everything else CONFIDENCE,
        )
        made = self._confirmed(_with_judged(made, drawable, limit), views, drawable)
        holds, reason = (
            self.requirement.met_by(quality),
            f"{exceptions(plate)} {made.reason}".lstrip(),
        )
        if not holds:
            reason = f"{reason} {disproved(quality, self.requirement)}"
        within = holds and plate.covers_the_plate
        return replace(
            made, measured=quality, within=within, reason=reason, plate=plate, device_model=device
        )

    def _confirmed(self, made: Plan, views: Views, results: Sequence[HogelResult]) -> Plan:
        """Return a plan whose largest near is lowered until none of its hogels is beyond, drawn."""
        limit, largest, asked = self.requirement.beyond_px, made.largest, made
        for _ in range(MAX_LOWERED):
            if largest is None or not largest.beyond:
                break
            number = [*made.alternatives].index("largest") if made is asked else None
            drawn = [one if number is None else one.others[number] for one in results]
            excess = max(MIN_LOWERED, *(self.requirement.by_pixels(one) for one in drawn))
            near = round_number(index_below(largest.near / excess))
            if near <= (made.near or 0.0):
                break
            made = predicted_plan(views, self.requirement, self.choices, near)
            largest = made.largest
            assert largest is not None
            with Evaluator(self.reference.scene, reference=self.reference) as judge:
                apertures = [one.aperture for one in results]
                results = list(hogel_results(judge, apertures, largest.settings))
            beyond = sum(one.beyond(limit) for one in results)
            largest = replace(largest, judged=len(results), beyond=beyond)
        return asked if made is asked else replace(asked, reason=made.reason, largest=largest)

    @cached_property
    def _seeing(self) -> tuple[CoarseView, ...]:
        return tuple(look for look in self.scouted.looks if math.isfinite(look.nearest))

    @cached_property
    def _possible(self) -> tuple[CoarseView, ...]:
        """Looks that see something that some near can draw."""
        return tuple(look for look in self._seeing if look.aperture.index not in self._infeasible)

    @cached_property
    def _infeasible(self) -> frozenset[Index]:
        """Apertures that were looked through at which not even the smallest near keeps to the tolerance."""
        moved = self.scouted.displacements(self._smallest)
        pairs = zip(self.scouted.apertures, moved, strict=True)
        return frozenset(one.index for one, px in pairs if px > self.requirement.tolerance_px)

    def _is_infeasible(self, view: View) -> bool:
        frustum = self.reference.scene.frustum
        return (
            displacement_bound(view.truth, frustum, self._smallest) > self.requirement.tolerance_px
        )

    @property
    def _smallest(self) -> DoubleFrustum:
        return DoubleFrustum(near=SMALLEST_PER_REACH * self.reference.scene.frustum.longest_reach)

    def first_views(self) -> Views:
        """Trace the middle, the worst apertures that some near can draw, and those that see farthest."""
        scouted, middle = self.scouted, self.reference.scene.plate.middle
        worst = [look.aperture for look in scouted.worst(len(scouted.looks))]
        worst = [one for one in worst if one.index not in self._infeasible][:WORST_VIEWS]
        farthest = [scouted.farthest(camera).aperture for camera in (Camera.C, Camera.C_STAR)]
        wanted = [*(one for one in scouted.apertures if one == middle), *worst, *farthest]
        drawable = [one for one in dict.fromkeys(wanted) if one.index not in self._infeasible]
        return Views.traced(self.reference, drawable, self.done, self.requirement.device)

    def _settled(self, views: Views) -> tuple[Views, Plan]:
        """Return a plan that closed forms predict to hold at every scouted aperture, and its apertures.

        So they do of its largest near.
        """
        traced: dict[Index, View] = {}
        for _ in range(MAX_ROUNDS):
            made = predicted_plan(views, self.requirement, self.choices)
            if made.settings is None:
                return views, made
            joining = self._unkept(made, traced, _indices(views.views) | self._infeasible)
            if not joining:
                break
            views = replace(views, views=(*views.views, *joining))
        return views, _with_uncut(made, views, self.requirement, self.choices)

    def _unkept(self, made: Plan, traced: dict[Index, View], known: frozenset[Index]) -> list[View]:
        """Trace the worst apertures by a plan's near and by its largest; return those that fail."""
        unkept: dict[Index, View] = {}
        for settings in (one.settings for one in (made, made.largest) if one is not None):
            assert settings is not None
            excess = self._scouted_excess(settings)
            suspected = {
                self.scouted.apertures[number].index: self.scouted.apertures[number]
                for number in np.argsort(-excess, kind="stable")
                if excess[number] > SUSPECTED_EXCESS
            }
            new = [
                one
                for index, one in suspected.items()
                if index not in known and index not in traced
            ]
            views = Views.traced(self.reference, new[:MAX_SUSPECTED], self.done).views
            traced |= {view.aperture.index: view for view in views}
            drawn = [traced[index] for index in suspected if index in traced and index not in known]
            unkept |= {view.aperture.index: view for view in self._failing(drawn, settings)}
        return list(unkept.values())

    def _scouted_excess(self, settings: DoubleFrustum) -> Floats:
        """Return (A,) errors over what is allowed, as the scout estimates them; 0 where eyes judge near."""
        if self.requirement.SEEN_BY_EYES:
            return np.zeros(len(self.scouted.looks))
        moved = self.scouted.displacements(settings) / self.requirement.tolerance_px
        return np.maximum(moved, self.scouted.wrong_shares(settings) / MAX_WRONG)

    def _failing(self, views: Sequence[View], settings: DoubleFrustum) -> list[View]:
        """Return apertures that are beyond, drawn, or that closed forms do not keep from it."""
        scene, tolerance = self.reference.scene, self.requirement.tolerance_px
        if not views:
            return []
        truths = {view.aperture: view.truth for view in views}
        with Evaluator(scene, reference=self.reference) as judge:
            results = list(hogel_results(judge, truths, settings, truths))
        return [
            view
            for view, result in zip(views, results, strict=True)
            if result.beyond(tolerance)
            or displacement_bound(view.truth, scene.frustum, settings) > tolerance
        ]

    def _sampled(self, views: Views, made: Plan, wanted: RandomSample) -> list[HogelResult]:
        """Draw and judge hogels at random, out of those that nothing is known of."""
        assert made.settings is not None
        scene, results = self.reference.scene, []
        others = [one.settings for one in made.alternatives.values()]
        known = [scene.plate.aperture(*index) for index in _indices(views.views) | self._infeasible]
        chosen = sample_hogels(scene.plate, wanted, known)
        with Evaluator(scene, reference=self.reference) as judge:
            for one in hogel_results(judge, chosen, made.settings, others=others):
                results.append(one)
                self.done(1)
        return results

    def _disproving(self, made: Plan, sample: Sequence[HogelResult]) -> tuple[View, ...]:
        """Trace hogels of a sample with too many errors: by a plan all, by its largest near the worst."""
        missed = {
            one.aperture.index: one.aperture for one in sample if self.requirement.missed_by(one)
        }
        if made.largest is not None:
            number = [*made.alternatives].index("largest")
            drawn = [(one.others[number], one.aperture) for one in sample]
            beyond = [one for one in drawn if one[0].beyond(self.requirement.beyond_px)]
            beyond.sort(key=lambda one: self.requirement.by_pixels(one[0]), reverse=True)
            missed |= {aperture.index: aperture for _, aperture in beyond[:WORST_VIEWS]}
        return Views.traced(self.reference, list(missed.values()), self.done).views

    def _missed(self, sample: Sequence[HogelResult]) -> tuple[View, ...]:
        """Trace those hogels of a sample that have more errors than are allowed."""
        missed = [one.aperture for one in sample if self.requirement.missed_by(one)]
        return Views.traced(self.reference, missed, self.done).views


def _indices(some: Iterable[CoarseView | View]) -> frozenset[Index]:
    return frozenset(one.aperture.index for one in some)


def largest_share(
    looks: Sequence[CoarseView], planned: Callable[[tuple[CoarseView, ...]], Found | None]
) -> tuple[tuple[CoarseView, ...], Found] | None:
    """Set aside the hardest apertures, as few as need be, until a plan is found for the others.

    Apertures that see nearer to the plate than all others need the smallest near; those that see
    farthest lose digits; and where z^2 over near is largest, the steps of standard depth are. Each
    way is tried, and the one that leaves most apertures counts. Returns the looks that are kept,
    and what `planned` returned for them; None where not even the easiest aperture alone has a plan.
    """

    def distance(look: CoarseView) -> float:
        return max(look.farthest(camera) for camera in (Camera.C, Camera.C_STAR))

    def depth_steps(look: CoarseView) -> float:
        return (
            look.pixels_per_near * distance(look) ** 2
            if math.isfinite(look.pixels_per_near)
            else math.inf
        )

    best: tuple[tuple[CoarseView, ...], Found] | None = None
    aside = len(looks) - 1
    for hardness in (lambda look: look.pixels_per_near, distance, depth_steps):
        ordered = tuple(sorted(looks, key=hardness, reverse=True))
        found = planned(ordered[aside:]) if ordered else None
        if found is None:
            continue
        best, low = (ordered[aside:], found), 0
        for _ in range(MAX_HALVINGS):
            if aside - low <= 1:
                break
            middle = (low + aside) // 2
            tried = planned(ordered[middle:])
            if tried is None:
                low = middle
            else:
                best, aside = (ordered[middle:], tried), middle
    return best
