"""The answer to `xfrustum verify`: limits, figures of hogels, words, and what is left behind as files."""

from __future__ import annotations

import json
import math
import re
from base64 import b64decode
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

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
from xfrustum.reports.common.outputs import Staging, write_output
from xfrustum.reports.common.provenance import machine, versions
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.inspection import page as inspection
from xfrustum.reports.inspection.channels import InspectedHogel
from xfrustum.reports.inspection.page import PlateMap
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
    value: float | None  #: None where it cannot be known, or need not be
    limit: float | None  #: None where nothing is limited
    unit: str  #: `share` of pixels, or `px` of displacement
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
    displacement_px: dict[str, float] | None  #: `worst_p99`: p99 of the hogel in which it is largest
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


FILES = PAGE, DATA, INSPECTION = "index.html", "verification.json", inspection.PAGE

MAX_LISTED = 10
"""Missing hogels that the terminal names one by one."""


def write_verification(found: Verification, out: Path) -> tuple[Path, ...]:
    """Write the page and the JSON object, and the inspection page if channels were kept, all or nothing.

    Raises InputError where the folder cannot be written.
    """
    with Staging(out, FILES) as staging:
        (staging.folder / PAGE).write_text(render_page(found), encoding="utf-8")
        text = json.dumps(found.summary(), allow_nan=False, indent=1)
        (staging.folder / DATA).write_text(text + "\n", encoding="utf-8")
        if found.inspected:
            known = [(one.aperture.index, one.as_found) for one in found.hogels if one.as_found is not None]
            shares = [(*index, (numbers.surface or numbers).fraction) for index, numbers in known]
            inspected = inspection.Inspection(
                command="verify",
                scene=found.scene,
                told=(f"The worst hogels of {found.source}, as they were found.",),
                hogels=found.inspected,
                plate_map=PlateMap.of(found.scene.plate, "Share of wrong pixels", shares),
            )
            inspection.write_inspection(staging.folder, inspected)
        with inspection.replacing_inspection(out):
            written = staging.commit()
    if not found.inspected:
        # That of an earlier run would show other images than the page beside it.
        inspection.remove_inspection(out)
    return written


def render_page(found: Verification) -> str:
    """Return one HTML document that needs nothing else, online or offline."""
    as_found, corrected = found.as_found, found.corrected
    values = {
        "found": found,
        "summary": found.summary(),
        "sentence": sentence(found),
        "explained": explained(found),
        "unexplained": unexplained(found),
        "guesses": found.diagnosis.guesses,
        "as_found": as_found and figures_words(as_found),
        "corrected": corrected and figures_words(corrected),
        "versions": {**versions(), **machine()},
    }
    return html_page("verify.html.j2", {"percent": percent, "figures": figures_words}, values)


def write_junit(found: Verification, path: Path) -> None:
    """Write one test case for each hogel as JUnit XML, whole or not at all."""
    suite = ElementTree.Element(
        "testsuite",
        name=_xml_text(f"xfrustum verify {found.scene.name}"),
        tests=str(len(found.hogels)),
        failures=str(sum(not hogel.passed and not hogel.problem for hogel in found.hogels)),
        errors=str(sum(bool(hogel.problem) for hogel in found.hogels)),
    )
    classname = _xml_text(found.scene.name) or "scene"
    words = "; ".join(fault.words for fault in found.diagnosis.faults) or "no fault named"
    for hogel in found.hogels:
        name = f"hogel {hogel.aperture.column},{hogel.aperture.row}"
        case = ElementTree.SubElement(suite, "testcase", classname=classname, name=name)
        if hogel.problem:
            ElementTree.SubElement(case, "error", message=_xml_text(hogel.problem))
        elif not hogel.passed:
            assert hogel.as_found is not None
            exceeded = "; ".join(check.words for check in hogel.checks if not check.held)
            failure = ElementTree.SubElement(case, "failure", message=_xml_text(exceeded))
            failure.text = _xml_text(f"{figures_words(hogel.as_found)}\ndiagnosis: {words}")
    ElementTree.SubElement(suite, "system-out").text = _xml_text(table(found))
    ElementTree.indent(suite)
    write_output(path, ElementTree.tostring(suite, encoding="utf-8", xml_declaration=True), "--junit")


_NOT_IN_XML = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What a document of XML 1.0 cannot hold, not even as a reference (the specification's `Char`)."""


def _xml_text(text: str) -> str:
    """Return text in which replacement characters stand for all that XML has no way to write."""
    return _NOT_IN_XML.sub("\ufffd", text)


def sentence(found: Verification) -> str:
    """Return the verdict in one sentence, with the figures of the worst hogel that decided it."""
    count = len(found.hogels)
    missing = sum(bool(hogel.problem) for hogel in found.hogels)
    bad = sum(not hogel.passed and not hogel.problem for hogel in found.hogels)
    if found.passed:
        kept = ", ".join(check.words for check in found.checks)
        who = "the hogel keeps" if count == 1 else f"all {count} hogels keep"
        return f"Right: {who} to the limits: at worst {kept}."
    exceeded = ", ".join(check.words for check in found.checks if not check.held)
    who = "the hogel exceeds" if count == 1 else f"{bad} of {count} hogels exceed{'s' if bad == 1 else ''}"
    parts = [f"{who} a limit: at worst {exceeded}"] if bad else []
    if missing:
        parts.append(f"{missing} of {count} could not be had (--apertures names which to judge)")
    return f"Not right: {'; and '.join(parts)}."


def table(found: Verification) -> str:
    """Return verdict, diagnosis and figures as lines."""
    lines = [sentence(found), f"judged: {found.judged}", f"diagnosis, by {found.diagnosis.means}:"]
    for fault in found.diagnosis.faults:
        known = fault.low is not None and fault.high is not None
        lines.append(f"  {fault.words}" + (f"  [{fault.low:.6g}, {fault.high:.6g}]" if known else ""))
    if found.diagnosis.faults:
        lines += [f"  explained: {told}" for told in explained(found)]
    elif found.explained is False:
        lines.append(f"  {unexplained(found)}")
        lines += [f"    {fault.words}" for fault in found.diagnosis.guesses]
    else:
        judged = any(hogel.as_found for hogel in found.hogels)
        lines.append("  nothing found" if judged else "  no hogel could be judged")
    for name, figures in (("as found", found.as_found), ("corrected", found.corrected)):
        if figures is not None:
            lines.append(f"{name}: {figures_words(figures)}")
    problems = [hogel for hogel in found.hogels if hogel.problem]
    if len(problems) > 1 and len({hogel.problem for hogel in problems}) == 1:
        return "\n".join([*lines, f"{len(problems)} hogels: {problems[0].problem}"])
    lines += [f"hogel {h.aperture.column},{h.aperture.row}: {h.problem}" for h in problems[:MAX_LISTED]]
    if len(problems) > MAX_LISTED:
        lines.append(f"and {len(problems) - MAX_LISTED} more like these")
    return "\n".join(lines)


def unexplained(found: Verification) -> str:
    """Return in words that no fault is named for what is wrong."""
    if found.diagnosis.refuted:
        return "no single fault that was tried explains all hogels; one of the alternatives may"
    return "no known fault explains what is wrong"


def explained(found: Verification) -> list[str]:
    """Return in words how much of what is wrong the diagnosis explains; none where nothing is wrong."""
    shares = [fault.explains for fault in found.diagnosis.faults if fault.explains is not None]
    return [f"{percent(min(shares))} of the wrong pixels of the hogels that were tested"] if shares else []
