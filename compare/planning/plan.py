"""The planner: the fewest slabs, and then the largest margin, that keep what is required.

For a whole plate: the closed form of displacement is evaluated for every aperture of a scout. The worst ones
are traced and planned for; whatever aperture the plan would then displace too much joins them, until there is
none. Then the plan is measured at all of them, and at a random sample that took no part in choosing, which
bounds the share of hogels beyond the tolerance (Clopper and Pearson 1934). An aperture of the sample at which
the plan fails joins the others, and a new sample is drawn. Where there is no plan for all, the hardest
apertures are set aside, and the plan says for which share of the plate it holds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any, TypeVar

from xfrustum.compare.planning import reason
from xfrustum.compare.planning.measure import HogelResult, hogel_results, measured
from xfrustum.compare.planning.search import (
    MAX_CUTS,
    SEPARATION_MARGIN,
    SMALLEST_PER_REACH,
    Attempt,
    DepthBuffer,
    Search,
)
from xfrustum.compare.planning.views import Done, Quality, Requirement, View, Views, displacement_bound
from xfrustum.compare.run import NO_TRUTHS, Judge
from xfrustum.compare.sampling import (
    CONFIDENCE,
    RandomSample,
    confidence_of_each,
    sample_hogels,
    share_at_most,
)
from xfrustum.compare.scout import AutoApertures, Look, Scout
from xfrustum.reference import Reference
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook.numbers import digits, percent
from xfrustum.scenes.notebook.shown import Shown, Table
from xfrustum.scenes.plate.double_frustum import Camera, DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

MAX_SAMPLES = 3
"""Samples that are drawn at most, each after its predecessor disproved a plan. They are independent, so that
the bounds of all of them hold together with `CONFIDENCE` if each holds with its cube root (Sidak 1967):
drawing again does not flatter the last one."""

WORST_VIEWS = 4
"""Worst apertures of the scout that a plan is made from at once; others join where they need more."""

SUSPECTED_EXCESS, MAX_SUSPECTED = 0.5, 8
"""Scouted displacement, in tolerances, from which on an aperture is traced in full before it is trusted, and
how many are at a time, the worst first: one line in a hundred of 576 is six, which tell a 99th percentile to
a factor of two at best."""

MAX_HALVINGS = 5
"""Times that the number of apertures to be set aside is halved: it is known to a 32nd of all. Each time a
plan is searched for, among all depth buffers."""

MAX_ROUNDS = 8
"""Times that a plan is made anew with apertures that joined; each time the worst of them join."""

MAX_LISTED_APERTURES = 100
"""Largest number of apertures that a result lists of each kind: some rows of a scout, and still readable."""

Found = TypeVar("Found")
Index = tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class PlateResult:
    """What is known of a plan all over the plate.

    Attributes
    ----------
    hogels, scouted, measured
        Hogels of the plate; of these, how many were looked through, and how many were drawn and judged.
    sampled, beyond
        Hogels of the last random sample, and of these the ones beyond the tolerance (`compare.beyond`).
    worst
        The measured hogel that comes nearest to what is allowed, or is farthest beyond it; None without a
        plan.
    hopeless
        Hogels that were looked through at which no near at all would keep to the tolerance.
    set_aside
        Further scouted hogels that the plan was not made for, since there is none for them and all others.
    hopeless_apertures, set_aside_apertures
        Column and row of these, `MAX_LISTED_APERTURES` of each kind at most.
    share_beyond_at_most
        Bound on the share of all hogels that are beyond the tolerance.
    confidence
        Probability that the bound holds; 1 where every hogel was measured.
    """

    hogels: int
    scouted: int
    measured: int
    sampled: int
    beyond: int
    worst: HogelResult | None
    hopeless: int
    set_aside: int
    share_beyond_at_most: float
    confidence: float
    hopeless_apertures: tuple[Index, ...] = ()
    set_aside_apertures: tuple[Index, ...] = ()

    @property
    def share_within_at_least(self) -> float:
        """Bound on the share of all hogels at which the plan holds."""
        return 1 - self.share_beyond_at_most

    @property
    def covers_the_plate(self) -> bool:
        """Whether the plan was made for every hogel that was looked through."""
        return not self.hopeless and not self.set_aside

    def summary(self) -> dict[str, Any]:
        """Return what `plan --json` prints under `plate`."""
        worst = None
        if self.worst is not None:
            numbers = asdict(self.worst)
            worst = {"aperture": self.worst.aperture.index} | {
                key: value for key, value in numbers.items() if key != "aperture"
            }
        return {**asdict(self), "share_within_at_least": self.share_within_at_least, "worst": worst}


@dataclass(frozen=True, kw_only=True, repr=False)
class Plan(Shown):
    """What to draw with, and what that keeps.

    Attributes
    ----------
    near, slabs
        Scene units; None and empty where there is no plan.
    depth, mapping
        Depth buffer; None where there is no plan and more than one was to be chosen from.
    predicted, measured
        Quality of these settings at the worst aperture; None where there is no plan.
    within
        Whether everything that is required was measured to hold.
    plate
        Results all over the plate; None where the plan was made for some apertures only.
    auto
        The apertures that the plan was made for, where a scout chose them; else None.
    """

    near: float | None = None
    slabs: tuple[float, ...] = ()
    depth: DepthFormat | None = None
    mapping: DepthMapping | None = None
    predicted: Quality | None = None
    measured: Quality | None = None
    within: bool = False
    reason: str
    plate: PlateResult | None = None
    auto: AutoApertures | None = None

    @property
    def settings(self) -> DoubleFrustum | None:
        """The settings to draw with; None where there is no plan."""
        if self.near is None or self.depth is None or self.mapping is None:
            return None
        return DoubleFrustum(near=self.near, slabs=self.slabs, depth=self.depth, mapping=self.mapping)

    def summary(self) -> dict[str, Any]:
        """Return the plan as `plan --json` prints it."""
        unknown = dict.fromkeys(Quality.__dataclass_fields__)
        chosen = (
            [{"aperture": one.aperture.index, "why": one.why} for one in self.auto.chosen]
            if self.auto
            else None
        )
        return {
            "near": self.near,
            "slabs": list(self.slabs),
            "depth": self.depth,
            "mapping": self.mapping,
            "predicted": asdict(self.predicted) if self.predicted else unknown,
            "measured": asdict(self.measured) if self.measured else unknown,
            "within": self.within,
            "reason": self.reason,
            "plate": self.plate.summary() if self.plate else None,
            "apertures": chosen,
        }

    def _said(self) -> str:
        settings = self.settings
        if settings is None or self.measured is None:
            return f"none; {self.reason}"
        cuts = f"cuts at {', '.join(map(digits, self.slabs))}" if self.slabs else "no cuts"
        keeps = "keeps what is required" if self.within else "does not keep what is required"
        return (
            f"near {digits(settings.near)} scene units, {cuts}, {settings.depth_label}; measured at the "
            f"worst aperture: 99 % within {digits(self.measured.displacement_p99_px)} px, "
            f"{percent(self.measured.surface_fraction)} wrong surface; {keeps}"
        )

    def _tables(self) -> Sequence[Table]:
        found = [Table(rows=[("reason", self.reason)])]
        if self.predicted is not None and self.measured is not None:
            rows = [
                (words, *(write(getattr(one, name)) for one in (self.predicted, self.measured)))
                for name, words, write in _QUALITIES
            ]
            found.insert(
                0, Table(head=("at the worst aperture", "predicted", "measured"), rows=rows, numbers=True)
            )
        if (one := self.plate) is not None:
            looked = (
                f"{one.hogels:,}, of which {one.scouted:,} were looked through and {one.measured:,} measured"
            )
            bound = f"{percent(one.share_beyond_at_most)}, with a confidence of {percent(one.confidence)}"
            found.append(Table(rows=[("hogels", looked), ("share of the plate beyond, at most", bound)]))
        return found


_QUALITIES = (
    ("displacement_p99_px", "displacement, 99 %, px", digits),
    ("surface_fraction", "wrong surface", percent),
    ("depth_wrong", "wrong by depth", percent),
    ("misordered", "sheets in the wrong order", percent),
    ("separation", "smallest separation, scene units", digits),
)
"""Fields of `Quality`, their names in a table, and the functions that write their values."""


def depth_buffers(
    depth: DepthFormat | None = None, mapping: DepthMapping | None = None
) -> tuple[DepthBuffer, ...]:
    """Return the depth buffers to choose from: all, or all of one format, of one mapping, or the one."""
    return tuple(product([depth] if depth else DepthFormat, [mapping] if mapping else DepthMapping))


# For some apertures ----------------------------------------------------------------------------------------


def plan(
    scene: Scene,
    apertures: Sequence[Aperture],
    requirement: Requirement | None = None,
    choices: Sequence[DepthBuffer] | None = None,
    done: Done = lambda steps: None,
) -> Plan:
    """Plan how to draw some apertures of a scene, of which the worst counts, and measure the plan.

    Parameters
    ----------
    choices
        Depth buffers to choose from, None for all. The fewest slabs count, then what is cheapest (depth
        that no fragment writes, then fewer bytes), then the largest margin.
    done
        Called with the number of steps that are done, out of `steps`.

    Raises
    ------
    InputError
        There is no usable OpenGL.
    """
    requirement = requirement or Requirement()
    views = Views.traced(Reference(scene), apertures, done)
    made = predicted_plan(views, requirement, choices or depth_buffers(), done)
    if made.settings is None:
        return made
    result = measured(views, made.settings, requirement, done)
    within = requirement.met_by(result)
    told = made.reason if within else f"{made.reason} {reason.disproved(result, requirement)}"
    return replace(made, measured=result, within=within, reason=told)


def steps(apertures: int) -> int:
    """Return the number of steps of a plan for some apertures: traced, searched, measured."""
    return 2 * apertures + MAX_CUTS + 1


def predicted_plan(
    views: Views,
    requirement: Requirement,
    choices: Sequence[DepthBuffer],
    done: Done = lambda steps: None,
) -> Plan:
    """Plan how to draw what some apertures show, by prediction alone; see `plan`."""
    searched = Search(views, requirement)
    found = search(searched, choices, done)
    if found.best is None:
        return no_plan(choices, reason.why_not(found, views, requirement))
    best = searched.most_robust(found.holding)
    return Plan(
        near=best.settings.near,
        slabs=best.settings.slabs,
        depth=best.settings.depth,
        mapping=best.settings.mapping,
        predicted=best.predicted,
        reason=reason.why(found, best, views, requirement),
    )


def search(
    searched: Search, choices: Sequence[DepthBuffer], done: Done = lambda steps: None
) -> reason.Outcome:
    """Look for the best of some depth buffers, with one cut more at a time.

    `done` is called with the number of steps that are done, out of `MAX_CUTS` + 1.
    """
    finest = {choice: searched.cutter.finest(*choice) for choice in choices}
    possible = [choice for choice in choices if finest[choice] * SEPARATION_MARGIN <= searched.separation]
    failed: list[Attempt] = []
    holding: list[Attempt] = []
    cuts = 0
    while possible and not searched.displaces_too_much and not holding and cuts <= MAX_CUTS:
        attempts = [searched.attempt(*choice, cuts) for choice in possible]
        holding = sorted((one for one in attempts if one.holds), key=lambda one: one.price)
        failed = failed if holding else attempts
        cuts += 1
        done(1)
    done(MAX_CUTS + 1 - cuts)
    return reason.Outcome(choices=choices, finest=min(finest.values()), failed=failed, holding=holding)


def no_plan(choices: Sequence[DepthBuffer], told: str) -> Plan:
    """Return the plan that says why there is none, with a depth buffer where there was no other choice."""
    depth, mapping = choices[0] if len(choices) == 1 else (None, None)
    return Plan(depth=depth, mapping=mapping, reason=told)


# For the plate ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class PlatePlanner:
    """Plans for a whole plate that a scout has looked at."""

    reference: Reference
    scouted: Scout
    requirement: Requirement
    choices: Sequence[DepthBuffer]
    done: Done = field(default=lambda steps: None)

    def plan(self, wanted: RandomSample) -> Plan:
        """Return the plan, measured at its worst apertures and at a random sample of hogels."""
        if self._seeing and self._hopeless.issuperset(look.aperture.index for look in self._seeing):
            return self._without_plan(
                "No plan: a surface lies in every aperture that sees anything, or so close to it that no "
                "near draws it. Move it before or behind the plate."
            )
        return self._planned(self._traced(self._first_apertures()), wanted, MAX_SAMPLES)

    def _planned(self, views: Views, wanted: RandomSample, samples: int) -> Plan:
        """Return the plan for some apertures and for those of up to so many samples that disprove it."""
        views, made = self._settled(views)
        if made.settings is None:
            return self._partial(made, wanted)
        sample = self._sampled(views, made.settings, wanted)
        missed = [one.aperture for one in sample if self.requirement.missed_by(one)]
        joining = [view for view in self._traced(missed).views if not self._is_hopeless(view)]
        if not joining or samples == 1:
            return self._measured(made, views, sample)
        return self._planned(replace(views, views=(*views.views, *joining)), wanted.next(), samples - 1)

    def _partial(self, whole: Plan, wanted: RandomSample) -> Plan:
        """Return a plan without the hardest apertures, measured at a sample of all.

        `whole` is the plan for the whole plate, which says why there is none.
        """

        def planned(looks: tuple[Look, ...]) -> tuple[Views, Plan] | None:
            planner = replace(self, scouted=replace(self.scouted, looks=looks))
            views, made = planner._settled(planner._traced(planner._first_apertures()))
            return None if made.settings is None else (views, made)

        looks = [look for look in self._seeing if look.aperture.index not in self._hopeless]
        found = largest_share(looks, planned)
        if found is None:
            return self._without_plan(
                f"{whole.reason} Nor was a plan found for any part of the plate: there is none even for the "
                "easiest aperture alone."
            )
        kept, (views, made) = found
        assert made.settings is not None
        left = {look.aperture.index for look in kept}
        aside = [look.aperture.index for look in looks if look.aperture.index not in left]
        told = f"{made.reason} For all apertures together: {whole.reason}" if aside else made.reason
        sample = self._sampled(views, made.settings, wanted)
        return self._measured(replace(made, reason=told), views, sample, aside)

    def _without_plan(self, told: str) -> Plan:
        """Return the plan that there is none, for no share of the plate."""
        aside = [one.aperture.index for one in self._seeing if one.aperture.index not in self._hopeless]
        none = PlateResult(
            hogels=math.prod(self.reference.scene.plate.hogels),
            scouted=len(self.scouted.looks),
            measured=0,
            sampled=0,
            beyond=0,
            worst=None,
            hopeless=len(self._hopeless),
            set_aside=len(aside),
            hopeless_apertures=_listed(self._hopeless),
            set_aside_apertures=_listed(aside),
            share_beyond_at_most=1.0,
            confidence=1.0,
        )
        return replace(no_plan(self.choices, told), plate=none)

    @cached_property
    def _seeing(self) -> tuple[Look, ...]:
        """Looks that see anything."""
        return tuple(look for look in self.scouted.looks if math.isfinite(look.nearest))

    @cached_property
    def _hopeless(self) -> frozenset[Index]:
        """Apertures that were looked through at which not even the smallest near keeps to the tolerance."""
        moved = self.scouted.displacements(self._smallest)
        pairs = zip(self.scouted.apertures, moved, strict=True)
        return frozenset(one.index for one, px in pairs if px > self.requirement.tolerance_px)

    def _is_hopeless(self, view: View) -> bool:
        frustum = self.reference.scene.frustum
        return displacement_bound(view.truth, frustum, self._smallest) > self.requirement.tolerance_px

    @property
    def _smallest(self) -> DoubleFrustum:
        return DoubleFrustum(near=SMALLEST_PER_REACH * self.reference.scene.frustum.longest_reach)

    def _first_apertures(self) -> list[Aperture]:
        """Return the middle, the worst apertures that some near can draw, and those that see farthest.

        Only of those that were looked through; none where no near can draw any.
        """
        scouted = self.scouted
        worst = [look.aperture for look in scouted.worst(len(scouted.looks))]
        worst = [one for one in worst if one.index not in self._hopeless][:WORST_VIEWS]
        farthest = [scouted.farthest(camera).aperture for camera in (Camera.C, Camera.C_STAR)]
        middle = [one for one in scouted.apertures if one == self.reference.scene.plate.middle]
        wanted = {one.index: one for one in (*middle, *worst, *farthest)}
        return [one for index, one in wanted.items() if index not in self._hopeless]

    def _traced(self, apertures: Sequence[Aperture]) -> Views:
        return Views.traced(self.reference, apertures, self.done)

    def _settled(self, views: Views) -> tuple[Views, Plan]:
        """Return a plan that closed forms predict to hold at every scouted aperture, and its apertures."""
        for _ in range(MAX_ROUNDS):
            made = predicted_plan(views, self.requirement, self.choices)
            joining = () if made.settings is None else self._displaced_too_much(views, made.settings)
            if not joining:
                break
            views = replace(views, views=(*views.views, *joining))
        return views, made

    def _displaced_too_much(self, views: Views, settings: DoubleFrustum) -> tuple[View, ...]:
        """Return what those scouted apertures see in full at which settings displace too much."""
        scene, tolerance = self.reference.scene, self.requirement.tolerance_px
        known = {view.aperture.index for view in views.views} | self._hopeless
        suspected = [
            look.aperture
            for look in self.scouted.worst(len(known) + MAX_SUSPECTED, settings)
            if look.aperture.index not in known
            and look.displacement_p99_px(settings, scene) > SUSPECTED_EXCESS * tolerance
        ]
        return tuple(
            view
            for view in self._traced(suspected[:MAX_SUSPECTED]).views
            if displacement_bound(view.truth, scene.frustum, settings) > tolerance
        )

    def _sampled(self, views: Views, settings: DoubleFrustum, wanted: RandomSample) -> list[HogelResult]:
        """Draw and judge hogels at random, out of those that nothing is known of."""
        plate = self.reference.scene.plate
        known = [view.aperture for view in views.views]
        known += [plate.aperture(*index) for index in self._hopeless]
        return self._drawn(sample_hogels(plate, wanted, known), settings)

    def _drawn(
        self,
        apertures: Sequence[Aperture],
        settings: DoubleFrustum,
        truths: Mapping[Aperture, HogelImage] = NO_TRUTHS,
    ) -> list[HogelResult]:
        """Draw apertures with some settings, and judge each by its truth, which may be there already."""
        results = []
        with Judge(self.reference.scene, reference=self.reference) as judge:
            for one in hogel_results(judge, apertures, settings, truths):
                results.append(one)
                self.done(1)
        return results

    def _measured(
        self, made: Plan, views: Views, sample: Sequence[HogelResult], set_aside: Sequence[Index] = ()
    ) -> Plan:
        """Return the plan with what was measured at its own apertures and at the sample."""
        assert made.settings is not None
        chosen = self._drawn([view.aperture for view in views.views], made.settings, views.truths)
        quality = measured(views, made.settings, self.requirement, self.done)
        plate = self._plate_result(chosen, sample, set_aside)
        assert plate.worst is not None
        holds = self.requirement.met_by(quality)
        told = f"{reason.exceptions(plate)} {made.reason}".lstrip()
        return replace(
            made,
            measured=quality,
            within=holds and plate.covers_the_plate and not self.requirement.missed_by(plate.worst),
            reason=told if holds else f"{told} {reason.disproved(quality, self.requirement)}",
            plate=plate,
        )

    def _plate_result(
        self, chosen: Sequence[HogelResult], sample: Sequence[HogelResult], set_aside: Sequence[Index]
    ) -> PlateResult:
        hogels = math.prod(self.reference.scene.plate.hogels)
        missed = [one.aperture for one in sample if self.requirement.missed_by(one)]
        drawn_hopeless = {one.aperture.index for one in self._traced(missed).views if self._is_hopeless(one)}
        beyond, chosen_beyond = (
            sum(one.beyond(self.requirement.tolerance_px) for one in some) for some in (sample, chosen)
        )
        known = len(chosen) + len(self._hopeless)
        everything = known + len(sample) == hogels
        # The sample speaks for the hogels that nothing was known of.
        each = confidence_of_each(MAX_SAMPLES)
        unchosen = beyond / max(len(sample), 1) if everything else share_at_most(beyond, len(sample), each)
        hopeless = self._hopeless | drawn_hopeless
        drawable = [one for one in (*chosen, *sample) if one.aperture.index not in drawn_hopeless]
        return PlateResult(
            hogels=hogels,
            scouted=len(self.scouted.looks) + len(drawn_hopeless),
            measured=len(chosen) + len(sample),
            sampled=len(sample),
            beyond=beyond,
            worst=max(drawable, key=self.requirement.excess),
            hopeless=len(hopeless),
            set_aside=len(set_aside),
            hopeless_apertures=_listed(hopeless),
            set_aside_apertures=_listed(set_aside),
            share_beyond_at_most=(chosen_beyond + len(self._hopeless) + unchosen * (hogels - known)) / hogels,
            confidence=1.0 if everything else CONFIDENCE,
        )


def _listed(indices: Iterable[Index]) -> tuple[Index, ...]:
    """Return columns and rows in order, as many as a result lists."""
    return tuple(sorted(indices)[:MAX_LISTED_APERTURES])


def largest_share(
    looks: Sequence[Look], planned: Callable[[tuple[Look, ...]], Found | None]
) -> tuple[tuple[Look, ...], Found] | None:
    """Set aside the hardest apertures, as few as need be, until a plan is found for the others.

    What is hard is told by closed forms. Apertures that see nearer to the plate than all others need the
    smallest near; those that see farthest lose digits; and where z^2 over near is largest, the steps of
    standard depth are. Each way is tried, and the one that leaves most apertures counts.

    Returns
    -------
    The looks that are kept, and what `planned` returned for them; None where not even the easiest aperture
    alone has a plan.
    """

    def distance(look: Look) -> float:
        return max(look.farthest(camera) for camera in (Camera.C, Camera.C_STAR))

    def depth_steps(look: Look) -> float:
        return look.pixels_per_near * distance(look) ** 2 if math.isfinite(look.pixels_per_near) else math.inf

    best: tuple[tuple[Look, ...], Found] | None = None
    aside = len(looks) - 1
    for hardness in (lambda look: look.pixels_per_near, distance, depth_steps):
        ordered = sorted(looks, key=hardness, reverse=True)
        found = planned(tuple(ordered[aside:])) if ordered else None
        if found is None:
            continue
        best, low = (tuple(ordered[aside:]), found), 0
        for _ in range(MAX_HALVINGS):
            if aside - low <= 1:
                break
            middle = (low + aside) // 2
            tried = planned(tuple(ordered[middle:]))
            if tried is None:
                low = middle
            else:
                best, aside = (tuple(ordered[middle:]), tried), middle
    return best
