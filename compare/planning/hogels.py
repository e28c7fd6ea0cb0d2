"""How well settings do at single hogels, measured, and what that says of the plate."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass
from itertools import islice
from typing import Any

from xfrustum.compare.beyond import displacement_p99
from xfrustum.compare.planning.views import Errors
from xfrustum.compare.prediction.chain import with_exact_depth
from xfrustum.compare.run import NO_TRUTHS, Judge, JudgedFrame, Wanted
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

MAX_LISTED_APERTURES = 100
"""Largest number of apertures that a result lists of each kind: some rows of a scout, and still readable."""

MAX_NAMED_APERTURES = 5
"""Largest number of apertures that a sentence names."""


@dataclass(frozen=True, kw_only=True)
class HogelResult(Errors):
    """How well a plan does at one hogel, measured."""

    aperture: Aperture


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
        Scouted hogels at which no near at all would keep to the tolerance.
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
    hopeless_apertures: tuple[tuple[int, int], ...] = ()
    set_aside_apertures: tuple[tuple[int, int], ...] = ()

    @property
    def share_within_at_least(self) -> float:
        """Bound on the share of all hogels at which the plan holds."""
        return 1 - self.share_beyond_at_most

    @property
    def covers_the_plate(self) -> bool:
        """Whether the plan was made for every scouted hogel."""
        return not self.hopeless and not self.set_aside

    @property
    def exceptions(self) -> str:
        """Beginning of a reason: the apertures that the plan was not made for; empty where there are none.

        They are counted and named, and the share of the plate that is left is said.
        """
        if self.covers_the_plate:
            return ""
        looked = f"of the {self.scouted:,} apertures that were looked through"
        parts = []
        if self.hopeless:
            named = _named(self.hopeless_apertures, self.hopeless)
            parts.append(
                f"at {self.hopeless:,} {looked} ({named}) a surface lies in the aperture itself, or so close "
                "to it that no near draws it"
            )
        if self.set_aside:
            counted = f"{self.set_aside:,} others" if self.hopeless else f"{self.set_aside:,} {looked}"
            verb = "is" if self.set_aside == 1 else "are"
            named = _named(self.set_aside_apertures, self.set_aside)
            parts.append(
                f"{counted} ({named}) {verb} set aside, since none hold for them together with the rest"
            )
        # Rounded down, for it is a lower bound.
        share = f"{math.floor(100 * self.share_within_at_least)} %"
        certain = "" if self.confidence == 1 else f" ({self.confidence:.0%})".replace("%", " %")
        return (
            f"No settings hold for the whole plate: {'; and '.join(parts)}. "
            f"For the others, at least {share} of the plate{certain}:"
        )

    def summary(self) -> dict[str, Any]:
        """Return what `plan --json` prints under `plate`."""
        numbers = asdict(self)
        numbers["share_within_at_least"] = self.share_within_at_least
        worst = numbers.pop("worst")
        if worst is not None:
            aperture = worst.pop("aperture")
            worst = {"aperture": [aperture["column"], aperture["row"]], **worst}
        return {**numbers, "worst": worst}


def _named(apertures: tuple[tuple[int, int], ...], count: int) -> str:
    """Return the first of so many apertures, as options name them, and an ellipsis where there are more."""
    named = apertures[:MAX_NAMED_APERTURES]
    words = [f"{column},{row}" for column, row in named]
    return "; ".join([*words, ".."] if count > len(named) else words)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Judged:
    """What a result is made of: one drawing, by any depth buffer or by an exact one."""

    aperture: Aperture
    settings: DoubleFrustum
    displacement_p99_px: float
    judged: int
    wrong: Mask

    @classmethod
    def of(cls, frame: JudgedFrame) -> _Judged:
        found = frame.comparison
        wrong = found.errors.surface
        assert wrong is not None, "the reference has the scene at hand"
        return cls(
            aperture=frame.aperture,
            settings=frame.settings,
            displacement_p99_px=displacement_p99(found),
            judged=found.judged,
            wrong=wrong,
        )


def hogel_results(
    judge: Judge,
    apertures: Iterable[Aperture],
    settings: DoubleFrustum,
    truths: Mapping[Aperture, HogelImage] = NO_TRUTHS,
) -> Iterator[HogelResult]:
    """Draw hogels, and yield how well the settings do at each, in order.

    Wrong surfaces that are right with exact depth are wrong by depth (`DepthControl`): each hogel is drawn
    with exact depth besides.

    Parameters
    ----------
    judge
        Judge of the scene.
    apertures, settings
        Hogels, and settings that they are drawn with.
    truths
        True images that are there already.
    """
    exact = with_exact_depth(settings)
    both = tuple(dict.fromkeys((settings, exact)))
    with closing(judge.frames(apertures, both, Wanted(), _Judged.of, truths)) as frames:
        while some := list(islice(frames, len(both))):
            found = {one.settings: one for one in some}
            drawn, control = found[settings], found[exact]
            count = max(drawn.judged, 1)
            yield HogelResult(
                aperture=drawn.aperture,
                displacement_p99_px=drawn.displacement_p99_px,
                surface_fraction=float(drawn.wrong.sum() / count),
                depth_wrong=float((drawn.wrong & ~control.wrong).sum() / count),
            )
