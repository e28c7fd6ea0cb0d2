"""The planner: the fewest slabs, and then the largest margin, that keep what is required."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import Any

from xfrustum.compare.planning.hogels import PlateResult
from xfrustum.compare.planning.measure import measured, meets
from xfrustum.compare.planning.reason import Outcome, disproved, why, why_not
from xfrustum.compare.planning.robust import most_robust, price
from xfrustum.compare.planning.search import MAX_CUTS, SEPARATION_MARGIN, Attempt, DepthBuffer, Search
from xfrustum.compare.planning.views import Quality, Requirement, Views
from xfrustum.compare.scout import AutoApertures
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook.numbers import digits, percent
from xfrustum.scenes.notebook.shown import Shown, Table
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture


@dataclass(frozen=True, kw_only=True, repr=False)
class Plan(Shown):
    """What to draw with, and what that keeps.

    Attributes
    ----------
    near
        Scene units; None where there is no plan.
    slabs
        Heights |z| of the cuts, ascending.
    depth, mapping
        Format of the depth buffer, and what it stores; None where there is no plan and more than one
        was to be chosen from.
    predicted, measured
        Quality of these settings at the worst aperture; None where there is no plan.
    plate
        Results all over the plate; None where the plan was made for some apertures only.
    auto
        The apertures that the plan was made for, where a scout chose them; else None.
    within
        Whether everything that is required was measured to hold.
    reason
        Reason for this plan and nothing simpler, in words.
    """

    near: float | None
    slabs: tuple[float, ...]
    depth: DepthFormat | None
    mapping: DepthMapping | None
    predicted: Quality | None
    measured: Quality | None
    within: bool
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
            "apertures": _choices(self.auto) if self.auto else None,
        }

    def _said(self) -> str:
        settings = self.settings
        if settings is None or self.measured is None:
            return f"none; {self.reason}"
        cuts = f"cuts at {', '.join(map(digits, self.slabs))}" if self.slabs else "no cuts"
        keeps = "keeps what is required" if self.within else "does not keep what is required"
        return (
            f"near {digits(settings.near)} scene units, {cuts}, {settings.depth_label}; "
            f"measured at the worst aperture: 99 of 100 surface points "
            f"within {digits(self.measured.displacement_p99_px)} px, "
            f"{percent(self.measured.depth_wrong)} wrong by depth; {keeps}"
        )

    def _tables(self) -> Sequence[Table]:
        found = [Table(rows=[("reason", self.reason)])]
        if self.predicted is not None and self.measured is not None:
            head = ("at the worst aperture", "predicted", "measured")
            rows = [
                (words, *(write(getattr(one, name)) for one in (self.predicted, self.measured)))
                for name, words, write in _QUALITIES
            ]
            found.insert(0, Table(head=head, rows=rows, numbers=True))
        if self.plate is not None:
            one = self.plate
            bound = f"{percent(one.share_beyond_at_most)}, with a confidence of {percent(one.confidence)}"
            judged = (
                f"{one.hogels:,}, of which {one.scouted:,} were looked through and {one.measured:,} measured"
            )
            found.append(Table(rows=[("hogels", judged), ("share of the plate beyond, at most", bound)]))
        return found


_QUALITIES = (
    ("displacement_p99_px", "displacement, 99 %, px", digits),
    ("depth_wrong", "wrong by depth", percent),
    ("misordered", "sheets in the wrong order", percent),
    ("separation", "smallest separation, scene units", digits),
)
"""Fields of `Quality`, their names in a table, and the functions that write their values."""


def _choices(auto: AutoApertures) -> list[dict[str, object]]:
    return [{"aperture": list(one.aperture.index), "why": one.why} for one in auto.chosen]


def depth_buffers(
    depth: DepthFormat | None = None, mapping: DepthMapping | None = None
) -> tuple[DepthBuffer, ...]:
    """Return the depth buffers to choose from: all, or all of one format, of one mapping, or the one."""
    return tuple(product([depth] if depth else DepthFormat, [mapping] if mapping else DepthMapping))


def plan(
    scene: Scene,
    apertures: Sequence[Aperture],
    requirement: Requirement | None = None,
    choices: Sequence[DepthBuffer] | None = None,
    done: Callable[[int], object] = lambda steps: None,
) -> Plan:
    """Plan how to draw some apertures of a scene, and measure the plan.

    Parameters
    ----------
    apertures
        At least one; the worst counts.
    requirement
        None for the usual.
    choices
        Depth buffers to choose from, None for all. The fewest slabs count, then what is cheapest (depth
        that no fragment writes, then fewer bytes), then the largest margin (`planning.robust`).
    done
        Called with the number of steps that are done, out of `steps`.

    Raises
    ------
    InputError
        There is no usable OpenGL.
    """
    requirement = requirement or Requirement()
    views = Views.of(scene, apertures, done)
    made = predicted_plan(views, requirement, choices or depth_buffers(), done)
    if made.settings is None:
        return made
    result = measured(views, made.settings, requirement, done)
    within = meets(result, requirement)
    return replace(
        made,
        measured=result,
        within=within,
        reason=made.reason if within else f"{made.reason} {disproved(result, requirement)}",
    )


def predicted_plan(
    views: Views,
    requirement: Requirement,
    choices: Sequence[DepthBuffer],
    done: Callable[[int], object] = lambda steps: None,
) -> Plan:
    """Plan how to draw what some apertures show, by prediction alone; see `plan`."""
    searched = Search(views, requirement)
    found = search(searched, choices, done)
    if found.best is None:
        return no_plan(choices, why_not(found, views, requirement))
    best = most_robust(searched, found.holding)
    return Plan(
        near=best.settings.near,
        slabs=best.settings.slabs,
        depth=best.settings.depth,
        mapping=best.settings.mapping,
        predicted=best.predicted,
        measured=None,
        within=False,
        reason=why(found, best, views, requirement),
    )


def steps(apertures: int) -> int:
    """Return the number of steps of a plan for some apertures: traced, searched, measured."""
    return 2 * apertures + MAX_CUTS + 1


def search(
    searched: Search, choices: Sequence[DepthBuffer], done: Callable[[int], object] = lambda steps: None
) -> Outcome:
    """Look for the best of some depth buffers, with one cut more at a time.

    Parameters
    ----------
    searched
        What makes attempts.
    choices
        At least one.
    done
        Called with the number of steps that are done, out of `MAX_CUTS` + 1.
    """
    finest = {choice: searched.cutter.finest(*choice) for choice in choices}
    possible = [choice for choice in choices if finest[choice] * SEPARATION_MARGIN <= searched.separation]
    failed: list[Attempt] = []
    holding: list[Attempt] = []
    cuts = 0
    while possible and not searched.displaces_too_much and not holding and cuts <= MAX_CUTS:
        attempts = [searched.attempt(*choice, cuts) for choice in possible]
        holding = sorted((one for one in attempts if one.holds), key=lambda one: price(one.settings))
        failed = failed if holding else attempts
        cuts += 1
        done(1)
    done(MAX_CUTS + 1 - cuts)
    return Outcome(choices=choices, finest=min(finest.values()), failed=failed, holding=holding)


def no_plan(choices: Sequence[DepthBuffer], reason: str) -> Plan:
    """Return the plan that says why there is none, with a depth buffer where there was no other choice."""
    depth, mapping = choices[0] if len(choices) == 1 else (None, None)
    return Plan(
        near=None,
        slabs=(),
        depth=depth,
        mapping=mapping,
        predicted=None,
        measured=None,
        within=False,
        reason=reason,
    )
