"""The answer to `xfrustum verify`: limits, every hogel's figures, and all of them together."""

from __future__ import annotations

import math
from base64 import b64decode
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from xfrustum.compare.beyond import is_beyond
from xfrustum.compare.diagnosis.diagnosis import Diagnosis, doubtful
from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.compare.judging.image_displacement import MeasuredBy
from xfrustum.compare.judging.judged import Compared, Figures, HogelNumbers, Judging
from xfrustum.reports.common.json_ready import Summarized
from xfrustum.reports.inspection.channels import InspectedHogel
from xfrustum.reports.verification.figures import (
    COLORS,
    DISPLACEMENT,
    NOT_MEASURED,
    PlateNumbers,
    percent,
    totals,
)
from xfrustum.reports.verification.sources import as_given
from xfrustum.reports.verification.worst_hogels import WorstHogels
from xfrustum.scenes.arguments import real
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook.shown import Figure, Shown, Table
from xfrustum.scenes.plate.plate import Aperture
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

INVALID = "claims of what does not exist"
"""Name of a figure that is compared with `MAX_INVALID_SHARE`."""

MAX_INVALID_SHARE = 0.5
"""Share of the pixels in which an image shows something that may claim what does not exist, whatever the
limits."""


@dataclass(frozen=True, kw_only=True)
class Check:
    """One figure of a hogel and the limit that it is compared with; its fields are those of the JSON object.

    Attributes
    ----------
    figure
        What is limited, in words.
    value
        A share of pixels, or pixels of displacement; None where it cannot be known, or need not be.
    limit
        Largest value that is still right; None where nothing is limited.
    unit
        `share` or `px`.
    held
        Whether the limit is kept. What cannot be known keeps none, but the displacement of a truth without
        outlines need not be known.
    """

    figure: str
    value: float | None
    limit: float | None
    unit: str
    held: bool

    @property
    def words(self) -> str:
        """The figure and its limit, as text, page and JUnit print them."""
        limit = "no limit" if self.limit is None else f"limit {_sized(self.limit, self.unit)}"
        if self.value is not None:
            return f"{self.figure} {_sized(self.value, self.unit)} ({limit})"
        excused = self.held and self.limit is not None
        return f"{self.figure} {NOT_MEASURED if excused else 'unknown'} ({limit})"


def _sized(value: float, unit: str) -> str:
    return percent(value) if unit == "share" else f"{value:.3g} px"


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits within which a hogel is right.

    Attributes
    ----------
    wrong
        Largest share of wrong pixels, among those where image or answer shows a surface. Wrong are surfaces,
        where images tell them; else colors or outlines, whichever are compared.
    displacement_px
        Largest distance by which 99 of 100 surface points or outlines may be off; None for no limit.
    judging
        What pictures are compared by, and by how much colors may differ.
    """

    wrong: float = MAX_WRONG
    displacement_px: float | None = TOLERANCE_PX
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
        pixel is no share, unless none may be wrong.
        """
        shown = max(figures.shown, 1)

        def share(name: str, count: int) -> Check:
            single = count == 1 and self.wrong > 0
            held = single or not is_beyond(0.0, count / shown, math.inf, self.wrong)
            return Check(figure=name, value=count / shown, limit=self.wrong, unit="share", held=held)

        found = [share(figures.limited_words, figures.limited)]
        if figures.radiance is not None:
            found.append(share(COLORS, figures.radiance))
        if figures.invalid:
            found.append(
                Check(
                    figure=INVALID,
                    value=figures.invalid / figures.claimed,
                    limit=MAX_INVALID_SHARE,
                    unit="share",
                    held=not figures.mostly_invalid,
                )
            )
        return (*found, self._displacement(figures))

    def _displacement(self, figures: Figures) -> Check:
        """Compare a displacement; an image that shows nothing has none, and none is asked for.

        Nor is one asked for where the truth has no outline that a picture could show elsewhere: wrong pixels
        judge it alone.
        """
        spread, limit = figures.displacement_px, self.displacement_px
        value = spread.p99 if spread is not None else None if figures.claimed else 0.0
        excused = value is None and figures.measured_by is MeasuredBy.NO_OUTLINES
        held = limit is None or excused or not is_beyond(value, 0.0, limit)
        return Check(figure=DISPLACEMENT, value=value, limit=limit, unit="px", held=held)


def worst_checks(hogels: Sequence[tuple[Check, ...]]) -> tuple[Check, ...]:
    """Return the worst hogel's check of each figure: limits are for every hogel, not for their mean."""
    worst: dict[str, Check] = {}
    for check in (check for checks in hogels for check in checks):
        known = worst.get(check.figure)
        if known is None or _badness(check) > _badness(known):
            worst[check.figure] = check
    return tuple(worst.values())


def _badness(check: Check) -> tuple[bool, float]:
    unknown = -1.0 if check.held else math.inf
    return not check.held, unknown if check.value is None else check.value


@dataclass(frozen=True, kw_only=True)
class HogelRecord:
    """JSON object of a `Hogel`."""

    aperture: tuple[int, int]
    verdict: str
    problem: str | None
    checks: tuple[Check, ...]
    as_found: HogelNumbers | None
    corrected: HogelNumbers | None


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
        """Return the hogel with a problem that names files as the user did; see `sources.as_given`."""
        return self if self.problem is None else replace(self, problem=as_given(self.problem, folder))

    @property
    def verdict(self) -> str:
        """One word: pass, fail, or missing."""
        return "missing" if self.problem else "pass" if self.passed else "fail"

    @property
    def record(self) -> HogelRecord:
        """The hogel, as it is written."""
        return HogelRecord(
            aperture=self.aperture.index,
            verdict=self.verdict,
            problem=self.problem,
            checks=self.checks,
            as_found=self.as_found,
            corrected=self.corrected,
        )


JUDGED_WORDS = {
    "triangle": "surfaces, by the triangles that pixels name",
    "object": "surfaces, by the objects that pixels name",
    "coverage": "surfaces, by where something is shown",
    "outlines": "geometry: where pictures show something, and where outlines run, in whatever shading",
}
"""What is judged, in words, by `Figures.by`; plain pictures are judged by colors unless geometry was asked
for."""


@dataclass(frozen=True, kw_only=True)
class LimitsRecord:
    """JSON object of `Limits`."""

    wrong: float
    displacement_px: float | None
    color: float


@dataclass(frozen=True, kw_only=True)
class VerificationRecord:
    """JSON object of a `Verification`."""

    verdict: str
    scene: str
    source: str
    limits: LimitsRecord
    compared: Compared
    judged: str
    checks: tuple[Check, ...]
    diagnosis: tuple[Fault, ...]
    does_not_explain: tuple[Fault, ...]
    explained: bool | None
    found_by: str
    as_found: PlateNumbers | None
    corrected: PlateNumbers | None
    hogels: tuple[HogelRecord, ...]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Verification(Shown, Summarized[VerificationRecord]):
    """The answer to `xfrustum verify`.

    Attributes
    ----------
    scene, source
        What was asked, and the name of who answered.
    limits, diagnosis, hogels
        Limits that hogels must keep to, what was found wrong, and every hogel.
    worst
        Pictures of the worst hogels.
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
        """The worst hogel's check of each figure that is compared with a limit."""
        return worst_checks([hogel.checks for hogel in self.hogels])

    @property
    def judged(self) -> str:
        """What was judged, in words."""
        judging = self.limits.judging
        known = [hogel.as_found for hogel in self.hogels if hogel.as_found is not None]
        by = {one.by for one in known}
        words = [JUDGED_WORDS[name] for name in JUDGED_WORDS if name in by]
        if "color" in by or any(one.radiance is not None for one in known):
            words.append(f"colors to within {judging.color_tolerance:.3g} of linear radiance")
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

    @property
    def record(self) -> VerificationRecord:
        """The answer, as it is written."""
        return VerificationRecord(
            verdict="pass" if self.passed else "fail",
            scene=self.scene.name,
            source=self.source,
            limits=LimitsRecord(
                wrong=self.limits.wrong,
                displacement_px=self.limits.displacement_px,
                color=self.limits.judging.color_tolerance,
            ),
            compared=self.limits.judging.compared,
            judged=self.judged,
            checks=self.checks,
            diagnosis=tuple(self.diagnosis.faults),
            does_not_explain=tuple(self.diagnosis.does_not_explain),
            explained=self.explained,
            found_by=self.diagnosis.means,
            as_found=totals([hogel.as_found for hogel in self.hogels]),
            corrected=totals([hogel.corrected for hogel in self.hogels]),
            hogels=tuple(hogel.record for hogel in self.hogels),
        )


def with_correction_tested(found: Verification) -> Verification:
    """Return a verification without the faults whose correction does not make all judged hogels better.

    A diagnosis is made of some hogels, of which few may be wrong: another fault may show these the same and
    all others otherwise. Faults that the corrected figures of all judged hogels refute become guesses, which
    state the share of the wrong pixels of all judged hogels that they explain.
    """
    pairs = [(one.as_found, one.corrected) for one in found.hogels if one.as_found and one.corrected]
    if not found.diagnosis.faults or any(before.by != after.by for before, after in pairs):
        return found
    before, after = (sum(map(_wrong, numbers)) for numbers in (list(zip(*pairs, strict=True)) or ((), ())))
    left = sum(one.causes["unexplained"] if one.causes else _wrong(one) for _, one in pairs)
    share = max(0.0, 1.0 - left / before) if before else 0.0
    if after < before or not before:
        return found
    told = f"corrected for it, {after:,} pixels of all judged hogels are wrong instead of {before:,}"
    refuted = tuple(
        replace(doubtful(doubted), words=f"{doubtful(doubted).words}; {told}")
        for doubted in (replace(fault, explains=share) for fault in found.diagnosis.faults)
    )
    guesses = (*refuted, *found.diagnosis.does_not_explain)
    diagnosis = replace(found.diagnosis, faults=(), does_not_explain=guesses, refuted=True)
    return replace(found, diagnosis=diagnosis)


def _wrong(numbers: HogelNumbers) -> int:
    """Return the number of wrong pixels of a hogel, those of a wrong color included."""
    return numbers.wrong + (0 if numbers.radiance is None else numbers.radiance.wrong)
