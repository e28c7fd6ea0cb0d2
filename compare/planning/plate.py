"""A plan that holds for the plate: made from its worst apertures, measured at these and at a random sample.

The closed form of displacement is evaluated for every aperture of a scout. The worst ones are traced and
planned for; whatever aperture the plan would then displace too much joins them, until there is none. Then
the plan is measured at all of them, and at a random sample that took no part in choosing, which bounds the
share of hogels beyond what is required (Clopper and Pearson 1934). An aperture of the sample at which the
plan fails joins the others, and a new sample is drawn. Where there is no plan for all, the hardest apertures
are set aside, and the plan says for which share of the plate it holds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

from xfrustum.compare.planning.cuts import SMALLEST_PER_REACH
from xfrustum.compare.planning.displacement import displacement_bound
from xfrustum.compare.planning.hogels import (
    MAX_LISTED_APERTURES,
    HogelResult,
    PlateResult,
    hogel_results,
)
from xfrustum.compare.planning.measure import measured, meets
from xfrustum.compare.planning.plan import Plan, no_plan, predicted_plan
from xfrustum.compare.planning.reason import disproved
from xfrustum.compare.planning.search import DepthBuffer
from xfrustum.compare.planning.views import Requirement, View, Views
from xfrustum.compare.run import NO_TRUTHS, Judge
from xfrustum.compare.sampling import (
    CONFIDENCE,
    RandomSample,
    confidence_of_each,
    sample_hogels,
    share_at_most,
)
from xfrustum.compare.scout import Look, Scout
from xfrustum.reference import Reference
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

MAX_SAMPLES = 3
"""Samples that are drawn at most, each after its predecessor disproved a plan. They are independent, so that
the bounds of all of them hold together with `CONFIDENCE` if each holds with its cube root (Sidak 1967):
drawing again does not flatter the last one."""

WORST_VIEWS = 4
"""Worst apertures of the scout that a plan is made from at once; others join where they need more."""

SUSPECTED_EXCESS = 0.5
"""Scouted displacement, in tolerances, from which on an aperture is traced in full before it is trusted:
one line in a hundred of 576 is six, which tell a 99th percentile to a factor of two at best."""

MAX_SUSPECTED = 8
"""Suspected apertures that are traced in full at a time, the worst first."""

MAX_HALVINGS = 5
"""Times that the number of apertures to be set aside is halved: it is known to a 32nd of all. Each time a
plan is searched for, among all depth buffers."""

MAX_ROUNDS = 8
"""Times that a plan is made anew with apertures that joined; each time the worst of them join."""


Found = TypeVar("Found")


@dataclass(frozen=True, kw_only=True, eq=False)
class PlatePlanner:
    """Plans for a whole plate that a scout has looked at.

    Attributes
    ----------
    reference
        Truth of the scene.
    scouted
        Looks through apertures all over its plate.
    requirement, choices
        What every hogel must keep, and the depth buffers to choose from.
    done
        Called with 1 after each aperture that is traced or drawn.

    """

    reference: Reference
    scouted: Scout
    requirement: Requirement
    choices: Sequence[DepthBuffer]
    done: Callable[[int], object] = field(default=lambda steps: None)

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

        Parameters
        ----------
        whole
            The plan for the whole plate, which says why there is none.
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
        reason = f"{made.reason} For all apertures together: {whole.reason}" if aside else made.reason
        sample = self._sampled(views, made.settings, wanted)
        return self._measured(replace(made, reason=reason), views, sample, aside)

    def _without_plan(self, reason: str) -> Plan:
        """Return the plan that there is none, for no share of the plate."""
        columns, rows = self.reference.scene.plate.hogels
        return replace(
            no_plan(self.choices, reason),
            plate=PlateResult(
                hogels=columns * rows,
                scouted=len(self.scouted.looks),
                measured=0,
                sampled=0,
                beyond=0,
                worst=None,
                hopeless=len(self._hopeless),
                set_aside=sum(look.aperture.index not in self._hopeless for look in self._seeing),
                hopeless_apertures=_listed(self._hopeless),
                set_aside_apertures=_listed(
                    look.aperture.index for look in self._seeing if look.aperture.index not in self._hopeless
                ),
                share_beyond_at_most=1.0,
                confidence=1.0,
            ),
        )

    @cached_property
    def _seeing(self) -> tuple[Look, ...]:
        """Looks that see anything."""
        return tuple(look for look in self.scouted.looks if math.isfinite(look.nearest))

    @cached_property
    def _hopeless(self) -> frozenset[tuple[int, int]]:
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
            if made.settings is None:
                break
            joining = self._displaced_too_much(views, made.settings)
            if not joining:
                break
            views = replace(views, views=(*views.views, *joining))
        return views, made

    def _displaced_too_much(self, views: Views, settings: DoubleFrustum) -> tuple[View, ...]:
        """Return what those scouted apertures see in full at which settings displace too much."""
        known = {view.aperture.index for view in views.views} | self._hopeless
        suspected = [
            look.aperture
            for look in self.scouted.worst(len(known) + MAX_SUSPECTED, settings)
            if look.aperture.index not in known
            and look.displacement_p99_px(settings, self.reference.scene)
            > SUSPECTED_EXCESS * self.requirement.tolerance_px
        ][:MAX_SUSPECTED]
        frustum = self.reference.scene.frustum
        return tuple(
            view
            for view in self._traced(suspected).views
            if displacement_bound(view.truth, frustum, settings) > self.requirement.tolerance_px
        )

    def _sampled(self, views: Views, settings: DoubleFrustum, wanted: RandomSample) -> list[HogelResult]:
        """Draw and judge hogels at random, out of those that nothing is known of."""
        plate = self.reference.scene.plate
        hopeless = [plate.aperture(*index) for index in self._hopeless]
        known = [*(view.aperture for view in views.views), *hopeless]
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
        self,
        made: Plan,
        views: Views,
        sample: Sequence[HogelResult],
        set_aside: Sequence[tuple[int, int]] = (),
    ) -> Plan:
        """Return the plan with what was measured at its own apertures and at the sample."""
        assert made.settings is not None
        chosen = self._drawn([view.aperture for view in views.views], made.settings, views.truths)
        quality = measured(views, made.settings, self.requirement, self.done)
        plate = self._plate_result(chosen, sample, set_aside)
        assert plate.worst is not None
        holds = meets(quality, self.requirement)
        reason = f"{plate.exceptions} {made.reason}".lstrip()
        reason = reason if holds else f"{reason} {disproved(quality, self.requirement)}"
        return replace(
            made,
            measured=quality,
            within=holds and plate.covers_the_plate and not self.requirement.missed_by(plate.worst),
            reason=reason,
            plate=plate,
        )

    def _plate_result(
        self,
        chosen: Sequence[HogelResult],
        sample: Sequence[HogelResult],
        set_aside: Sequence[tuple[int, int]],
    ) -> PlateResult:
        columns, rows = self.reference.scene.plate.hogels
        missed = [one.aperture for one in sample if self.requirement.missed_by(one)]
        drawn_hopeless = {one.aperture.index for one in self._traced(missed).views if self._is_hopeless(one)}
        drawn = [*chosen, *sample]
        beyond, chosen_beyond = (
            sum(one.beyond(self.requirement.tolerance_px) for one in some) for some in (sample, chosen)
        )
        known = len(chosen) + len(self._hopeless)
        everything = known + len(sample) == columns * rows
        # The sample speaks for the hogels that nothing was known of.
        each = confidence_of_each(MAX_SAMPLES)
        unchosen = beyond / max(len(sample), 1) if everything else share_at_most(beyond, len(sample), each)
        beyond_share = chosen_beyond + len(self._hopeless) + unchosen * (columns * rows - known)
        hopeless = self._hopeless | drawn_hopeless
        return PlateResult(
            hogels=columns * rows,
            scouted=len(self.scouted.looks) + len(drawn_hopeless),
            measured=len(drawn),
            sampled=len(sample),
            beyond=beyond,
            worst=max(
                (one for one in drawn if one.aperture.index not in drawn_hopeless),
                key=self.requirement.excess,
            ),
            hopeless=len(hopeless),
            set_aside=len(set_aside),
            hopeless_apertures=_listed(hopeless),
            set_aside_apertures=_listed(set_aside),
            share_beyond_at_most=beyond_share / (columns * rows),
            confidence=1.0 if everything else CONFIDENCE,
        )


def _listed(indices: Iterable[tuple[int, int]]) -> tuple[tuple[int, int], ...]:
    """Return columns and rows in order, as many as a result lists."""
    return tuple(sorted(indices)[:MAX_LISTED_APERTURES])


def largest_share(
    looks: Sequence[Look], planned: Callable[[tuple[Look, ...]], Found | None]
) -> tuple[tuple[Look, ...], Found] | None:
    """Set aside the hardest apertures, as few as need be, until a plan is found for the others.

    What is hard is told by closed forms. Apertures that see nearer to the plate than all others need the
    smallest near; those that see farthest lose digits; and where z^2 over near is largest, the steps of
    standard depth are. Each way is tried, and the one that leaves most apertures counts.

    Parameters
    ----------
    looks
        Looks at apertures that see something, for all of which together there is no plan.
    planned
        Function that returns a plan for some looks, None where there is none.

    Returns
    -------
    The looks that are kept, and their plan; None where not even the easiest aperture alone has one.
    """
    best: tuple[tuple[Look, ...], Found] | None = None
    aside = len(looks) - 1
    for hardness in (_nearness, _distance, _depth_steps):
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


def _nearness(look: Look) -> float:
    return look.pixels_per_near


def _distance(look: Look) -> float:
    return max(look.farthest(camera) for camera in (Camera.C, Camera.C_STAR))


def _depth_steps(look: Look) -> float:
    """Return the step of standard depth at the farthest surface with the largest near, but for a factor."""
    if math.isinf(look.pixels_per_near):
        return math.inf
    return look.pixels_per_near * _distance(look) ** 2
