"""The answer to `xfrustum verify`: limits, every hogel's figures, and all of them together, also in words."""

from __future__ import annotations

import math
from base64 import b64decode
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from xfrustum.compare.beyond import is_beyond
from xfrustum.compare.diagnosis.diagnosis import Diagnosis, doubtful
from xfrustum.compare.judging.judged import (
    SURFACES,
    WRONG_WORDS,
    ColorFigures,
    Figures,
    HogelNumbers,
    Judging,
    MeasuredBy,
    SurfaceFigures,
)
from xfrustum.reports.common.json_ready import json_object, json_ready
from xfrustum.reports.inspection.channels import InspectedHogel
from xfrustum.reports.verification.sources import as_given
from xfrustum.reports.verification.worst_hogels import WorstHogels
from xfrustum.scenes.arguments import real
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook import Figure, Shown, Table
from xfrustum.scenes.plate.plate import Aperture
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

DISPLACEMENT, COLORS = "displacement", "wrong colors"
INVALID = "claims of what does not exist"
"""Names of what is compared with limits, beside the kinds of wrong pixels that `compare.judging.judged`
names."""

MAX_INVALID_SHARE = 0.5
"""Share of the pixels in which an image shows something that may claim what does not exist, whatever the
limits."""

NOT_MEASURED = "not measured, as there are no outlines"
"""Words for the displacement of an image whose truth has nothing that could be seen to move."""

JUDGED_WORDS = {
    "triangle": "surfaces, by the triangles that pixels name",
    "object": "surfaces, by the objects that pixels name",
    "coverage": "surfaces, by where something is shown",
    "outlines": "geometry: where pictures show something, and where outlines run, in whatever shading",
}
"""What is judged, in words, by `HogelNumbers.by`; plain pictures are judged by colors unless geometry was
asked for."""


@dataclass(frozen=True, kw_only=True)
class Check:
    """One figure of a hogel and the limit that it is compared with; its fields are those of the JSON object.

    What cannot be known keeps no limit, but the displacement of a truth without outlines need not be known.
    """

    figure: str
    value: float | None  # None where it cannot be known, or need not be
    limit: float | None  # None where nothing is limited
    unit: str  # `share` of pixels, or `px` of displacement
    held: bool

    @property
    def words(self) -> str:
        """The figure and its limit, as text, page and JUnit print them."""
        limit = "no limit" if self.limit is None else f"limit {self._sized(self.limit)}"
        if self.value is not None:
            return f"{self.figure} {self._sized(self.value)} ({limit})"
        excused = self.held and self.limit is not None
        return f"{self.figure} {NOT_MEASURED if excused else 'unknown'} ({limit})"

    def _sized(self, value: float) -> str:
        return percent(value) if self.unit == "share" else f"{value:.3g} px"

    @property
    def badness(self) -> tuple[bool, float]:
        """Sort key of checks of one figure, the worst last."""
        unknown = -1.0 if self.held else math.inf
        return not self.held, unknown if self.value is None else self.value


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits within which a hogel is right, and how its image is judged."""

    wrong: float = MAX_WRONG
    """Largest share of wrong pixels, among those where image or answer shows a surface. Wrong are surfaces,
    where images tell them; else colors or outlines, whichever are compared."""
    displacement_px: float | None = TOLERANCE_PX
    """Largest distance by which 99 of 100 surface points or outlines may be off; None for no limit."""
    judging: Judging = field(default_factory=Judging)

    def __post_init__(self) -> None:
        if not 0 <= real(self.wrong) <= 1:
            raise InputError(f"max-wrong must be a share between 0 and 100 %, not {self.wrong}")
        if self.displacement_px is not None and not real(self.displacement_px) >= 0:
            raise InputError(f"max-displacement-px must be a number, not negative: {self.displacement_px}")
        if not real(self.judging.color_tolerance) >= 0:
            raise InputError(f"max-color must be a number, not negative: {self.judging.color_tolerance}")

    def checks(self, figures: Figures) -> tuple[Check, ...]:
        """Compare an image's figures with the limits (`compare.beyond`).

        Shares are of the pixels where something is shown, so that an empty film excuses nothing; but a single
        pixel is no share, unless none may be wrong. An image that shows nothing has no displacement, and none
        is asked for. Nor is one asked for where the truth has no outline that a picture could show elsewhere:
        wrong pixels judge it alone.
        """
        numbers = figures.numbers
        counts = {numbers.limited_words: numbers.limited}
        if numbers.radiance is not None:
            counts[COLORS] = numbers.radiance.wrong
        found = []
        for name, count in counts.items():
            share, single = count / max(numbers.shown, 1), count == 1 and self.wrong > 0
            held = single or not is_beyond(0.0, share, math.inf, self.wrong)
            found.append(Check(figure=name, value=share, limit=self.wrong, unit="share", held=held))
        if numbers.invalid:
            share, held = numbers.invalid / figures.claimed, 2 * numbers.invalid <= figures.claimed
            found.append(Check(figure=INVALID, value=share, limit=MAX_INVALID_SHARE, unit="share", held=held))
        spread, limit = numbers.displacement_px, self.displacement_px
        value = spread.p99 if spread is not None else None if figures.claimed else 0.0
        excused = value is None and numbers.displacement_by is MeasuredBy.NO_OUTLINES
        held = limit is None or excused or not is_beyond(value, 0.0, limit)
        return (*found, Check(figure=DISPLACEMENT, value=value, limit=limit, unit="px", held=held))


@dataclass(frozen=True, kw_only=True)
class Hogel:
    """What was found of one hogel: a problem, or figures as found and corrected, and the limits kept."""

    aperture: Aperture
    problem: str | None = None
    as_found: HogelNumbers | None = None
    corrected: HogelNumbers | None = None
    checks: tuple[Check, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether it is there and keeps to every limit."""
        return self.problem is None and all(check.held for check in self.checks)

    def told_from(self, folder: Path | None) -> Hogel:
        """Return the hogel with a problem that names files as the user did; see `as_given`."""
        return self if self.problem is None else replace(self, problem=as_given(self.problem, folder))

    @property
    def verdict(self) -> str:
        """One word: pass, fail, or missing."""
        return "missing" if self.problem else "pass" if self.passed else "fail"

    def summary(self) -> dict[str, Any]:
        """Return the JSON object."""
        fields = {**json_object(self), "aperture": list(self.aperture.index), "verdict": self.verdict}
        names = ("aperture", "verdict", "problem", "checks", "as_found", "corrected")
        return {name: fields[name] for name in names}


@dataclass(frozen=True, kw_only=True)
class PlateNumbers:
    """The numbers of all judged hogels together, as they are written; see `HogelNumbers`."""

    hogels: int
    by: str
    shown: int
    wrong: int
    fraction: float
    surface: SurfaceFigures | None
    invalid: int
    displacement_px: dict[str, float] | None  # `worst_p99`: p99 of the hogel in which it is largest
    displacement_by: str
    radiance: ColorFigures | None
    causes: dict[str, int] | None


def totals(figures: Sequence[HogelNumbers | None]) -> PlateNumbers | None:
    """Return the figures of all hogels together, None where there are none."""
    known = [one for one in figures if one is not None]
    if not known:
        return None
    shown, wrong = sum(one.shown for one in known), sum(one.wrong for one in known)
    surfaces = [one.surface for one in known if one.surface is not None]
    spreads = [one.displacement_px.p99 for one in known if one.displacement_px is not None]
    colored = [one.radiance.wrong for one in known if one.radiance is not None]
    causes = [one.causes for one in known if one.causes is not None]
    surface = None
    if surfaces:
        of_surface, outside = sum(one.wrong for one in surfaces), sum(one.outside for one in surfaces)
        surface = SurfaceFigures(wrong=of_surface, fraction=of_surface / max(shown, 1), outside=outside)
    return PlateNumbers(
        hogels=len(known),
        by=" or ".join(sorted({one.by for one in known})),
        shown=shown,
        wrong=wrong,
        fraction=wrong / shown if shown else 0.0,
        surface=surface,
        invalid=sum(one.invalid for one in known),
        displacement_px={"worst_p99": max(spreads)} if spreads else None,
        displacement_by=" or ".join(sorted({one.displacement_by for one in known})),
        radiance=ColorFigures(wrong=sum(colored)) if colored else None,
        causes={name: sum(one[name] for one in causes) for name in causes[0]} if causes else None,
    )


def percent(fraction: float) -> str:
    """Return a share in percent, with three digits."""
    return f"{100 * fraction:.3g} %"


def figures_words(figures: PlateNumbers | HogelNumbers) -> str:
    """Return figures of one hogel, or of all, in words; each says which wrong it counts."""
    parts = [f"{figures.shown:,} pixels show something"]
    if figures.surface is not None:
        outside = f", {figures.surface.outside:,} from outside the film" if figures.surface.outside else ""
        share = percent(figures.surface.fraction)
        parts.append(f"{SURFACES} {figures.surface.wrong:,} ({share}{outside})")
    counted = " or ".join(WRONG_WORDS[name] for name in figures.by.split(" or "))
    parts.append(f"{counted} {figures.wrong:,} ({percent(figures.fraction)})")
    if figures.invalid:
        parts.append(f"{figures.invalid:,} claim what does not exist")
    if figures.radiance is not None:
        parts.append(f"{COLORS} on right surfaces {figures.radiance.wrong:,}")
    whole, spread, means = isinstance(figures, PlateNumbers), figures.displacement_px, figures.displacement_by
    name = f"{DISPLACEMENT} (p99{' of the worst hogel' if whole else ''})"
    if spread is None:
        parts.append(f"{name} {NOT_MEASURED if means == MeasuredBy.NO_OUTLINES else 'unknown'}")
    else:
        p99 = spread["worst_p99"] if isinstance(spread, dict) else spread.p99
        known = [m for m in means.split(" or ") if m not in (MeasuredBy.NOTHING, MeasuredBy.NO_OUTLINES)]
        some = " (in some hogels it cannot be known)" if MeasuredBy.NOTHING in means.split(" or ") else ""
        parts.append(f"{name} {p99:.3g} px by {' or '.join(known)}{some}")
    text = ", ".join(parts)
    if figures.causes is not None and figures.wrong:
        causes = ", ".join(f"{name} {count:,}" for name, count in figures.causes.items())
        text += f"; causes of {counted}: {causes}"
    return text


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Verification(Shown):
    """The answer to `xfrustum verify`: of which renderer, its limits, its faults, and every hogel.

    `source` is the name of who answered, `worst` has pictures of the worst hogels.
    """

    scene: Scene
    source: str
    limits: Limits
    diagnosis: Diagnosis
    hogels: tuple[Hogel, ...]
    worst: WorstHogels = field(repr=False)

    @property
    def passed(self) -> bool:
        """Whether every hogel is there and keeps to the limits."""
        return all(hogel.passed for hogel in self.hogels)

    @property
    def inspected(self) -> list[InspectedHogel]:
        """The worst hogels with all their channels; none unless channels were kept."""
        return [one.inspected for one in self.worst.kept if one.inspected is not None]

    @property
    def checks(self) -> tuple[Check, ...]:
        """The worst hogel's check of each figure: limits are for every hogel, not for their mean."""
        worst: dict[str, Check] = {}
        for check in (check for hogel in self.hogels for check in hogel.checks):
            worst[check.figure] = max(worst.get(check.figure, check), check, key=lambda one: one.badness)
        return tuple(worst.values())

    @property
    def as_found(self) -> PlateNumbers | None:
        """Figures of all hogels as they were delivered."""
        return totals([hogel.as_found for hogel in self.hogels])

    @property
    def corrected(self) -> PlateNumbers | None:
        """Figures of all hogels after correction for the diagnosis."""
        return totals([hogel.corrected for hogel in self.hogels])

    @property
    def judged(self) -> str:
        """What was judged, in words."""
        known = [hogel.as_found for hogel in self.hogels if hogel.as_found is not None]
        by = {one.by for one in known}
        words = [JUDGED_WORDS[name] for name in JUDGED_WORDS if name in by]
        if "color" in by or any(one.radiance is not None for one in known):
            tolerance = self.limits.judging.color_tolerance
            words.append(f"colors to within {tolerance:.3g} of linear radiance")
        return ", and ".join(words) or "nothing"

    @property
    def explained(self) -> bool | None:
        """Whether the diagnosis explains what is wrong; None where no image that was judged is."""
        if self.diagnosis.faults:
            return True
        wrong = not all(check.held for hogel in self.hogels for check in hogel.checks)
        return False if wrong or self.diagnosis.does_not_explain else None

    def _said(self) -> str:
        from xfrustum.reports.verification.files import sentence  # noqa: PLC0415 - it knows this module

        return f"{self.source} as an answer to {self.scene.name!r}. {sentence(self)}"

    def _tables(self) -> Sequence[Table]:
        rows = [(check.words, "kept" if check.held else "exceeded") for check in self.checks]
        words = [fault.words for fault in self.diagnosis.faults] or ["nothing found"]
        diagnosis = Table(rows=[(f"diagnosis, by {self.diagnosis.means}", text) for text in words])
        return (Table(head=("worst hogel", "limit"), rows=rows), diagnosis)

    def _figures(self) -> Sequence[Figure]:
        return [
            Figure(caption=f"worst hogel, {name}", content=b64decode(url.partition(",")[2]))
            for one in self.worst.kept[:1]
            for name, url in one.pictures.items()
        ]

    def summary(self) -> dict[str, Any]:
        """Return the answer as one JSON object, as the command prints it with `--json`."""
        limits, judging = self.limits, self.limits.judging
        return {
            "verdict": "pass" if self.passed else "fail",
            "scene": self.scene.name,
            "source": self.source,
            "limits": {
                "wrong": limits.wrong,
                "displacement_px": limits.displacement_px,
                "color": judging.color_tolerance,
            },
            "compared": str(judging.compared),
            "judged": self.judged,
            "checks": json_ready(self.checks),
            "diagnosis": json_ready(self.diagnosis.faults),
            "does_not_explain": json_ready(self.diagnosis.does_not_explain),
            "explained": self.explained,
            "found_by": self.diagnosis.means,
            "as_found": json_ready(self.as_found),
            "corrected": json_ready(self.corrected),
            "hogels": [hogel.summary() for hogel in self.hogels],
        }


def with_correction_tested(found: Verification) -> Verification:
    """Return a verification without the faults whose correction does not make all judged hogels better.

    A diagnosis is made of some hogels, of which few may be wrong: another fault may show these the same and
    all others otherwise. Faults that the corrected figures of all judged hogels refute become guesses, which
    state the share of the wrong pixels of all judged hogels that they explain.
    """
    pairs = [(one.as_found, one.corrected) for one in found.hogels if one.as_found and one.corrected]
    if not found.diagnosis.faults or any(before.by != after.by for before, after in pairs):
        return found
    before, after = sum(_wrong(one) for one, _ in pairs), sum(_wrong(one) for _, one in pairs)
    if after < before or not before:
        return found
    left = sum(one.causes["unexplained"] if one.causes else _wrong(one) for _, one in pairs)
    share = max(0.0, 1.0 - left / before)
    told = f"corrected for it, {after:,} pixels of all judged hogels are wrong instead of {before:,}"
    doubted = [doubtful(replace(fault, explains=share)) for fault in found.diagnosis.faults]
    refuted = [replace(fault, words=f"{fault.words}; {told}") for fault in doubted]
    guesses = (*refuted, *found.diagnosis.does_not_explain)
    diagnosis = replace(found.diagnosis, faults=(), does_not_explain=guesses, refuted=True)
    return replace(found, diagnosis=diagnosis)


def _wrong(numbers: HogelNumbers) -> int:
    """Return the number of wrong pixels of a hogel, those of a wrong color included."""
    return numbers.wrong + (0 if numbers.radiance is None else numbers.radiance.wrong)
