"""The answer to `xfrustum verify`: limits and figures of hogels, words, and the files it leaves."""

from __future__ import annotations

import math
from base64 import b64decode
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from xfrustum.compare.beyond import is_beyond
from xfrustum.compare.diagnosis.diagnosis import Diagnosis
from xfrustum.compare.judging.judged import (
    MAX_MISSING_OUTLINES,
    SURFACES,
    WRONG_WORDS,
    ColorFigures,
    Figures,
    HogelNumbers,
    Judging,
    MeasuredBy,
    SurfaceFigures,
)
from xfrustum.compare.renderer_model.drawn_model import EVEN, RendererModel
from xfrustum.reports import inspection
from xfrustum.reports.common.junit import JUnitCase, junit
from xfrustum.reports.common.outputs import Staging, json_object, json_ready, write_output
from xfrustum.reports.common.provenance import machine, versions
from xfrustum.reports.common.templates_environment import (
    Filters,
    html_page,
    plain_text,
)
from xfrustum.reports.inspection import InspectedHogel, PlateMap
from xfrustum.reports.notebook import Figure, NotebookRepr
from xfrustum.reports.verification.sources import as_given
from xfrustum.reports.verification.where import Places, where_words, where_wrong, wrong_counts
from xfrustum.reports.verification.worst import WorstHogels
from xfrustum.scenes import Aperture, InputError, Scene
from xfrustum.scenes.arguments import real
from xfrustum.scenes.representation import plain
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

DISPLACEMENT, COLORS = "displacement", "wrong colors"
INVALID, MISSING = "claims of what does not exist", "missing outlines"
"""Names of what is compared with limits, beside the wrong pixels that `compare.judging.judged` names."""

MAX_INVALID_SHARE = (
    0.5  #: share of an image's claims that may be of what does not exist, whatever the limits
)

NOT_MEASURED = "not measured, as there are no outlines"
"""Words for the displacement of an image whose truth has nothing that could be seen to move."""

NOT_JUDGED = (
    "not judged"  #: verdict on images that are neither right nor wrong by anything that they show
)

JUDGED_WORDS = {
    "triangle": "surfaces, by the triangles that pixels name",
    "object": "surfaces, by the objects that pixels name",
    "coverage": "surfaces, by where something is shown",
    "outlines": "geometry: where pictures show something, and where outlines run, in whatever shading; not "
    "what lies between outlines",
}
"""What is judged, in words, by `HogelNumbers.by`; plain pictures are else judged by colors."""


@dataclass(frozen=True, kw_only=True)
class Check:
    """One figure of a hogel and the limit that it is compared with; its fields are those of the JSON object.

    What cannot be known keeps no limit, but the displacement of a truth without outlines need not
    be known where colors are judged. Where nothing else could tell a wrong image, `held` is None.
    """

    figure: str
    value: float | None  #: None where it cannot be known, or need not be
    limit: float | None  #: None where nothing is limited
    unit: str  #: `share` of pixels, or `px` of displacement
    held: bool | None  #: None where nothing that the image shows could exceed the limit

    @property
    def words(self) -> str:
        """The figure and its limit, as text, page and JUnit print them."""

        def sized(value: float) -> str:
            return percent(value) if self.unit == "share" else f"{value:.3g} px"

        excused = self.held is not False and self.value is None
        value = NOT_MEASURED if excused else "unknown"
        value = value if self.value is None else sized(self.value)
        return f"{self.figure} {value} ({'no limit' if self.limit is None else f'limit {sized(self.limit)}'})"

    @property
    def badness(self) -> tuple[bool, bool, float]:
        """Sort key of checks of one figure, the worst last."""
        unknown = math.inf if self.held is False else -1.0
        return self.held is False, self.held is None, unknown if self.value is None else self.value


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits within which a hogel is right, and how its image is judged."""

    wrong: float = (
        MAX_WRONG  #: largest share of wrong surfaces, colors or outlines in what shows something
    )
    displacement_px: float | None = (
        TOLERANCE_PX  #: of 99 of 100 points or outlines; None for no limit
    )
    judging: Judging = field(default_factory=Judging)

    def __post_init__(self) -> None:
        if not 0 <= real(self.wrong) <= 1:
            raise InputError(f"max-wrong must be a share between 0 and 100 %, not {self.wrong}")
        if self.displacement_px is not None and not real(self.displacement_px) >= 0:
            raise InputError(
                f"max-displacement-px must be a number, not negative: {self.displacement_px}"
            )
        if not real(self.judging.color_tolerance) >= 0:
            raise InputError(
                f"max-color must be a number, not negative: {self.judging.color_tolerance}"
            )

    def checks(self, figures: Figures, excused: int = 0) -> tuple[Check, ...]:
        """Compare an image's figures with the limits (`compare.beyond`), some wrong pixels `excused`.

        Shares are of the pixels where something is shown, so that an empty film excuses nothing;
        but a single pixel is no share, unless none may be wrong. No displacement is asked of an
        image that shows nothing, nor of colors where the truth has no outline that a picture could
        show elsewhere. Any other image of such a truth is not judged.
        """
        numbers = figures.numbers
        counts = {numbers.limited_words: numbers.limited - excused}
        if numbers.radiance is not None:
            counts[COLORS] = numbers.radiance.wrong
        found = []
        for name, count in counts.items():
            share, single = count / max(numbers.shown, 1), count == 1 and self.wrong > 0
            held = single or not is_beyond(0.0, share, math.inf, self.wrong)
            found.append(Check(figure=name, value=share, limit=self.wrong, unit="share", held=held))
        if numbers.invalid:
            share, held = numbers.invalid / figures.claimed, 2 * numbers.invalid <= figures.claimed
            found.append(
                Check(figure=INVALID, value=share, limit=MAX_INVALID_SHARE, unit="share", held=held)
            )
        spread, limit = numbers.displacement_px, self.displacement_px
        value = spread.p99 if spread is not None else None if figures.claimed else 0.0
        told: bool | None = limit is None or not is_beyond(value, 0.0, limit)
        if value is None and numbers.displacement_by is MeasuredBy.NO_OUTLINES:
            told = None if numbers.blind else True
        elif (outlines := numbers.outlines) is not None and outlines.shown:
            share, most = outlines.missing / outlines.shown, MAX_MISSING_OUTLINES
            # A minority of outlines does not stand for the majority that the picture cannot show.
            doubtful = 2 * outlines.unknown > outlines.shown
            doubtful |= outlines.untold > self.wrong * numbers.shown
            kept = False if share > most else None if doubtful else True
            found.append(Check(figure=MISSING, value=share, limit=most, unit="share", held=kept))
        return (*found, Check(figure=DISPLACEMENT, value=value, limit=limit, unit="px", held=told))

    def mends(self, as_found: Figures, corrected: Figures, model: RendererModel) -> bool:
        """Return whether an image is right once it is corrected, wrong pixels by rounding excused.

        An image that fails must pass. One that could not be judged as found refutes nothing unless
        it fails.
        """
        # The true places of surface points on an uneven film are unknown.
        limits = self if model.film == EVEN else replace(self, displacement_px=None)
        before = [check.held for check in self.checks(as_found)]
        after = [check.held for check in limits.checks(corrected, corrected.rounded)]
        return all(after) or (False not in before + after and None in before)


@dataclass(frozen=True, kw_only=True)
class Hogel:
    """What was found of one hogel: a problem, or figures as found and corrected, and the limits kept."""

    aperture: Aperture
    problem: str | None = None
    as_found: HogelNumbers | None = None
    corrected: HogelNumbers | None = None
    checks: tuple[Check, ...] = ()
    places: Places | None = None  #: where its wrong pixels are, as found
    left: int = (
        0  #: number of wrong pixels that stay when it is corrected, without those by rounding
    )
    mended: bool = True  #: whether it is right when it is corrected
    storage: str | None = None  #: file format that changed its pixels, such as "JPEG, lossy"

    @property
    def verdict(self) -> str:
        """The verdict: missing, fail where a limit is exceeded, `NOT_JUDGED`, or pass."""
        if self.problem is not None:
            return "missing"
        held = [check.held for check in self.checks]
        return "fail" if False in held else NOT_JUDGED if None in held else "pass"

    @property
    def passed(self) -> bool:
        """Whether it is there and keeps to every limit."""
        return self.verdict == "pass"

    def told_from(self, folder: Path | None) -> Self:
        """Return the hogel with a problem that names files as the user did; see `as_given`."""
        return (
            self if self.problem is None else replace(self, problem=as_given(self.problem, folder))
        )

    def summary(self) -> dict[str, Any]:
        """Return the JSON object."""
        fields = json_object(self) | {
            "aperture": list(self.aperture.index),
            "verdict": self.verdict,
        }
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
    displacement_px: (
        dict[str, float] | None
    )  #: `worst_p99`: p99 of the hogel in which it is largest
    displacement_by: str
    radiance: ColorFigures | None
    causes: dict[str, int] | None


def totals(figures: Sequence[HogelNumbers | None]) -> PlateNumbers | None:
    """Return the figures of all hogels together, None where there are none."""
    known = [one for one in figures if one is not None]
    if not known:
        return None
    shown, wrong = sum(one.shown for one in known), sum(one.wrong for one in known)
    spreads = [one.displacement_px.p99 for one in known if one.displacement_px]
    colored = [one.radiance.wrong for one in known if one.radiance]
    causes = [one.causes for one in known if one.causes]
    surface = None
    if surfaces := [one.surface for one in known if one.surface]:
        bad, outside = sum(one.wrong for one in surfaces), sum(one.outside for one in surfaces)
        surface = SurfaceFigures(wrong=bad, fraction=bad / max(shown, 1), outside=outside)
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
        outside = (
            f", {figures.surface.outside:,} from outside the film"
            if figures.surface.outside
            else ""
        )
        share = percent(figures.surface.fraction)
        parts.append(f"{SURFACES} {figures.surface.wrong:,} ({share}{outside})")
    counted = " or ".join(WRONG_WORDS[name] for name in figures.by.split(" or "))
    parts.append(f"{counted} {figures.wrong:,} ({percent(figures.fraction)})")
    if figures.invalid:
        parts.append(f"{figures.invalid:,} claim what does not exist")
    if figures.radiance is not None:
        parts.append(f"{COLORS} on right surfaces {figures.radiance.wrong:,}")
    whole, spread, means = (
        isinstance(figures, PlateNumbers),
        figures.displacement_px,
        figures.displacement_by,
    )
    name = f"{DISPLACEMENT} (p99{' of the worst hogel' if whole else ''})"
    if spread is None:
        parts.append(f"{name} {NOT_MEASURED if means == MeasuredBy.NO_OUTLINES else 'unknown'}")
    else:
        p99 = spread["worst_p99"] if isinstance(spread, dict) else spread.p99
        known = [
            m for m in means.split(" or ") if m not in (MeasuredBy.NOTHING, MeasuredBy.NO_OUTLINES)
        ]
        some = (
            " (in some hogels it cannot be known)"
            if MeasuredBy.NOTHING in means.split(" or ")
            else ""
        )
        parts.append(f"{name} {p99:.3g} px by {' or '.join(known)}{some}")
    text = ", ".join(parts)
    if figures.causes is not None and figures.wrong:
        causes = ", ".join(f"{name} {count:,}" for name, count in figures.causes.items())
        text += f"; causes of {counted}: {causes}"
    return text


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Verification(NotebookRepr):
    """The answer to `xfrustum verify`: of which renderer (`source`), its limits, faults, and every hogel."""

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
    def verdict(self) -> str:
        """The verdict: pass, `NOT_JUDGED` where no hogel is wrong and not all could be judged, or fail."""
        verdicts = {hogel.verdict for hogel in self.hogels}
        return "pass" if self.passed else NOT_JUDGED if verdicts <= {"pass", NOT_JUDGED} else "fail"

    @property
    def inspected(self) -> list[InspectedHogel]:
        """The worst hogels with all their channels; none unless channels were kept."""
        return [one.inspected for one in self.worst.kept if one.inspected is not None]

    @property
    def checks(self) -> tuple[Check, ...]:
        """The worst hogel's check of each figure: limits are for every hogel, not for their mean."""
        worst: dict[str, Check] = {}
        for check in (check for hogel in self.hogels for check in hogel.checks):
            worst[check.figure] = max(
                worst.get(check.figure, check), check, key=lambda one: one.badness
            )
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
        wrong = self.diagnosis.does_not_explain or any(check.held is False for check in self.checks)
        return True if self.diagnosis.faults else False if wrong else None

    @property
    def storage(self) -> dict[str, int]:
        """File formats that changed pixels, and of how many hogels each."""
        return dict(sorted(Counter(one.storage for one in self.hogels if one.storage).items()))

    @property
    def where(self) -> dict[str, Any] | None:
        """Where images are wrong, where nothing is named; else None."""
        named = self.diagnosis.faults or self.explained is not False
        return None if named else where_wrong(self.scene, self._places)

    @property
    def _places(self) -> list[tuple[Aperture, Places]]:
        return [(one.aperture, one.places) for one in self.hogels if one.places is not None]

    def _said(self) -> str:
        return f"{self.source} as an answer to {self.scene.name!r}. {sentence(self)}"

    def table(self) -> str:
        """Return verdict, diagnosis and figures as lines."""
        return table(self)

    def _figures(self) -> Sequence[Figure]:
        shown = [entry for one in self.worst.kept[:1] for entry in one.pictures.items()]
        return [
            Figure(caption=f"worst hogel, {name}", content=b64decode(url.partition(",")[2]))
            for name, url in shown
        ]

    def summary(self) -> dict[str, Any]:
        """Return the answer as one JSON object, as the command prints it with `--json`."""
        limits, judging = self.limits, self.limits.judging
        return {
            "verdict": self.verdict,
            "scene": self.scene.name,
            "source": self.source,
            "limits": {
                "wrong": limits.wrong,
                "displacement_px": limits.displacement_px,
                "color": judging.color_tolerance,
            },
            "compared": str(judging.compared),
            "device_model": judging.device.name,
            "judged": self.judged,
            "storage": self.storage,
            "checks": json_ready(self.checks),
            "diagnosis": json_ready(self.diagnosis.faults),
            "does_not_explain": json_ready(self.diagnosis.does_not_explain),
            "explained": self.explained,
            "where": wrong_counts(self.scene, self._places),
            "found_by": self.diagnosis.means,
            "as_found": json_ready(self.as_found),
            "corrected": json_ready(self.corrected),
            "hogels": [hogel.summary() for hogel in self.hogels],
        }


def wrong_in(numbers: HogelNumbers) -> int:
    """Return the number of pixels of a hogel that the limits count as wrong, a wrong color included."""
    return numbers.limited + (0 if numbers.radiance is None else numbers.radiance.wrong)


def with_correction_tested(found: Verification) -> Verification:
    """Return a verification whose faults are named only if all hogels are right when corrected for them.

    A diagnosis is made of some hogels by pixels that differ; the verdict judges all of them by
    their limits, before and after correction. Faults that leave any hogel wrong become guesses,
    which state the share of the wrong pixels of all judged hogels that they explain.
    """
    judged = [one for one in found.hogels if one.as_found and one.corrected]
    wrong = [one for one in judged if not one.mended]
    if not found.diagnosis.faults or not wrong:
        return found
    pairs = [
        (one.as_found, one.corrected, one.left) for one in judged if one.as_found and one.corrected
    ]
    before, after = (
        sum(wrong_in(mine) for mine, *_ in pairs),
        sum(wrong_in(its) for _, its, _ in pairs),
    )
    # A correction after which nothing could be wrong explains nothing.
    left = sum(wrong_in(mine) if its.blind else rest for mine, its, rest in pairs)
    share = max(0.0, 1.0 - left / before) if before else 0.0
    named = ", ".join(f"{one.aperture.column},{one.aperture.row}" for one in wrong[:MAX_NAMED])
    told = f"would explain only {100 * share:.0f} % of what is wrong"
    told += (
        f"; corrected for it, {after:,} pixels of all judged hogels are wrong instead of {before:,}"
    )
    told += f", and {len(wrong)} of {len(judged)} hogels do not pass: {named}"
    told += ", .." if len(wrong) > MAX_NAMED else ""
    refuted = (
        replace(fault, explains=share, words=f"{fault.words}: {told}")
        for fault in found.diagnosis.faults
    )
    guesses = (*refuted, *found.diagnosis.does_not_explain)
    diagnosis = replace(found.diagnosis, faults=(), does_not_explain=guesses, refuted=True)
    return replace(found, diagnosis=diagnosis)


FILES = PAGE, DATA, INSPECTION = "index.html", "verification.json", inspection.PAGE

MAX_LISTED = 10  #: missing hogels that the terminal names one by one
MAX_NAMED = 4  #: hogels that a sentence names


def write_verification(found: Verification, out: Path) -> tuple[Path, ...]:
    """Write the page and the JSON object, and the inspection page if channels were kept, all or nothing."""
    with Staging(out, FILES) as staging:
        staging.write(PAGE, render_page(found))
        staging.write(DATA, found.summary())
        if found.inspected:
            known = [
                (one.aperture.index, one.as_found)
                for one in found.hogels
                if one.as_found is not None
            ]
            shares = [(*index, (numbers.surface or numbers).fraction) for index, numbers in known]
            inspected = inspection.Inspection(
                command="verify",
                scene=found.scene,
                told=f"The worst hogels of {found.source}, as they were found.",
                hogels=found.inspected,
                plate_map=PlateMap.from_values(found.scene.plate, "Share of wrong pixels", shares),
            )
            inspection.write_inspection(staging.folder, inspected)
        # The inspection page of an earlier run would show other images than the page beside it.
        with inspection.replacing_inspection(out, kept=bool(found.inspected)):
            return staging.commit()


MAP_CLASSES = (
    (-math.inf, "#56b4e9", "keeps to the limits"),
    (math.ulp(0.0), "#f3cf8e", "exceeds a limit"),
    (0.1, "#e69f00", "a tenth or more is wrong"),
    (0.5, "#d55e00", "half or more is wrong"),
    (math.inf, "#8c8c8c", "missing or not judged"),
)
"""Classes of hogels on the map of a plate: the least share that is wrong, color and words."""


def plate_map(found: Verification) -> dict[str, Any] | None:
    """Return which hogels are wrong, as paths of an SVG in units of cells; None where no map is needed.

    A cell of a large plate stands for several hogels, and shows the worst of them.
    """
    if found.passed or len(found.hogels) == 1:
        return None

    def badness(hogel: Hogel) -> float:
        shares = (check.value or 0.0 for check in hogel.checks if check.unit == "share")
        wrong = max(
            0.0 if hogel.passed else math.ulp(0.0), max(shares, default=0.0) * (not hogel.passed)
        )
        return math.inf if hogel.verdict in ("missing", NOT_JUDGED) else wrong

    every = ((*hogel.aperture.index, badness(hogel)) for hogel in found.hogels)
    cells = PlateMap.from_values(found.scene.plate, "", every).cells
    number = np.searchsorted([least for least, _, _ in MAP_CLASSES], cells, side="right") - 1
    number[np.isnan(cells)] = -1
    classes = [
        {"color": color, "words": words, "cells": np.argwhere(number == place).tolist()}
        for place, (_, color, words) in enumerate(MAP_CLASSES)
    ]
    return {"size": cells.shape[::-1], "classes": [one for one in classes if one["cells"]]}


def number(value: float | None, unit: str | None) -> str:
    """Write a number with six digits, whole ones in full, and shares as percent."""
    if value is None:
        return ""
    if unit == "share":
        return percent(value)
    return (
        f"{value:,.0f}"
        if float(value).is_integer() and abs(value) < 2**53
        else plain(f"{value:.6g}")
    )


FILTERS: Filters = {"percent": percent, "figures": figures_words, "number": number}


def _told(found: Verification) -> dict[str, Any]:
    """Return what page and text tell of a verification."""
    return {
        "found": found,
        "sentence": sentence(found),
        "explained": explained(found),
        "unexplained": unexplained(found),
        "nothing": nothing_found(found),
        "where": where_words(found.where or {}),
        "figures": {"as found": found.as_found, "corrected": found.corrected},
    }


def render_page(found: Verification) -> str:
    """Return one HTML document that needs nothing else, online or offline."""
    made_by = {**versions(), **machine()}
    values = {
        **_told(found),
        "summary": found.summary(),
        "map": plate_map(found),
        "versions": made_by,
    }
    return html_page("verify.html.j2", values, FILTERS)


def write_junit(found: Verification, path: Path) -> None:
    """Write one test case for each hogel as JUnit XML, whole or not at all."""
    words = "; ".join(fault.words for fault in found.diagnosis.faults) or "no fault named"
    cases = []
    for hogel in found.hogels:
        exceeded = "; ".join(check.words for check in hogel.checks if check.held is False)
        if hogel.verdict == NOT_JUDGED:
            exceeded = NOTHING_TO_JUDGE
        text = (
            "" if hogel.as_found is None else f"{figures_words(hogel.as_found)}\ndiagnosis: {words}"
        )
        name = f"hogel {hogel.aperture.column},{hogel.aperture.row}"
        case = JUnitCase(found.scene.name or "scene", name, hogel.problem, exceeded, text)
        cases.append(case)
    write_output(path, junit(f"xfrustum verify {found.scene.name}", cases, table(found)), "--junit")


NOTHING_TO_JUDGE = "the truth has no outlines that could be seen to be wrong (write numbers of triangles, or judge colors)"
"""Words for images that are neither right nor wrong by anything that they show."""


def sentence(found: Verification) -> str:
    """Return the verdict in one sentence, with the figures of the worst hogel that decided it."""
    verdicts = [hogel.verdict for hogel in found.hogels]
    count, missing, bad = len(verdicts), verdicts.count("missing"), verdicts.count("fail")
    if found.passed:
        kept = ", ".join(check.words for check in found.checks)
        who = "the hogel keeps" if count == 1 else f"all {count} hogels keep"
        return f"Right: {who} to the limits: at worst {kept}."
    if found.verdict == NOT_JUDGED:
        blind = verdicts.count(NOT_JUDGED)
        who = "the hogel" if count == 1 else f"{blind} of {count} hogels"
        rest = "" if blind == count else "; the others keep to the limits"
        return f"Not judged, neither right nor wrong: in {who} {NOTHING_TO_JUDGE}{rest}."
    exceeded = ", ".join(check.words for check in found.checks if check.held is False)
    who = (
        "the hogel exceeds"
        if count == 1
        else f"{bad} of {count} hogels exceed{'s' if bad == 1 else ''}"
    )
    parts = [f"{who} a limit: at worst {exceeded}"] if bad else []
    if blind := verdicts.count(NOT_JUDGED):
        parts.append(f"in {blind} of {count} {NOTHING_TO_JUDGE}")
    if missing:
        parts.append(f"{missing} of {count} could not be had (--apertures names which to judge)")
    return f"Not right: {'; and '.join(parts)}."


def table(found: Verification) -> str:
    """Return verdict, diagnosis and figures as lines."""
    problems = [hogel for hogel in found.hogels if hogel.problem]
    values = {**_told(found), "problems": problems, "listed": MAX_LISTED}
    return plain_text("verify.txt.j2", values, FILTERS).removesuffix("\n")


def unexplained(found: Verification) -> str:
    """Return in words that no fault is named for what is wrong."""
    several = "no single fault that was tried explains all hogels; one of the alternatives may"
    ambiguous = found.diagnosis.refuted and any(
        one.alternatives for one in found.diagnosis.does_not_explain
    )
    words = several if ambiguous else "no known fault explains what is wrong"
    # Mistakes of single hogels are seen only where these are among the hogels that are diagnosed.
    wrong = [one.aperture for one in found.hogels if one.verdict == "fail"]
    if wrong and found.diagnosis.nothing_wrong:
        named = ";".join(f"{one.column},{one.row}" for one in wrong[:MAX_LISTED])
        words += f": the hogels that were diagnosed are right; diagnose some of both, --apertures '{named};..'"
    black = (found.where or {}).get("shown", {}).get("nothing", {}).get("wrong", 0)
    if black and found.as_found is not None and found.as_found.by == "outlines":
        # A surface that no light reaches and one that is not drawn make the same picture.
        words += f"; {black:,} of the wrong pixels are black where the truth shows a surface: black is taken "
        words += "for nothing; if they are unlit, draw with some ambient light, or write numbers of triangles"
    return words


def explained(found: Verification) -> list[str]:
    """Return in words how much of what is wrong the diagnosis explains; none where it names nothing."""
    if not found.diagnosis.faults:
        return []
    shares = [fault.explains for fault in found.diagnosis.faults if fault.explains is not None]
    return (
        [f"{percent(min(shares))} of the wrong pixels of the hogels that were tested"]
        if shares
        else []
    )


def nothing_found(found: Verification) -> str:
    """Return in words that no fault was found, and what is wrong within the limits all the same."""
    if found.as_found is None:
        return "no hogel could be judged"
    count = (found.as_found.causes or {}).get("unexplained", 0)
    if not count:
        return "nothing found"
    by_hogel = {one.aperture: (one.as_found and one.as_found.causes) or {} for one in found.hogels}
    worst = max(by_hogel, key=lambda one: by_hogel[one].get("unexplained", 0))
    return f"nothing found; {count:,} pixels are wrong by no rounding, most in hogel {worst.column},{worst.row}"
