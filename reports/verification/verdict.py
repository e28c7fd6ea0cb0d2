"""Verification: the result of `xfrustum verify`, and its files."""

from __future__ import annotations

import math
from base64 import b64decode
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np

from xfrustum.compare.diagnosis.defects import Defect
from xfrustum.compare.diagnosis.diagnosis import Diagnosis
from xfrustum.compare.judging.judged import Figures, HogelNumbers
from xfrustum.compare.judging.verdict import (
    Hogel,
    Outcome,
    Places,
    Verdict,
    where_wrong,
    wrong_counts,
)
from xfrustum.compare.sampling import SampleExtent
from xfrustum.reference.truth import TruthBy
from xfrustum.reports import inspection
from xfrustum.reports.common.outputs import (
    Staging,
    json_object,
    json_ready,
    machine,
    versions,
    write_output,
)
from xfrustum.reports.common.records import named_columns, table_of
from xfrustum.reports.common.templates_environment import (
    Filters,
    JUnitCase,
    address,
    html_page,
    junit,
    plain_text,
    png,
)
from xfrustum.reports.inspection import InspectedHogel, PlateMap, inspected_figures
from xfrustum.reports.notebook import Figure, NotebookRepr
from xfrustum.reports.parts import parquet_bytes
from xfrustum.reports.verification import words
from xfrustum.scenes import NOTHING, Aperture, HogelImage, Scene
from xfrustum.scenes.arrays import Bytes
from xfrustum.scenes.representation import LEVELS, encoding_curve, plain

FILES = PAGE, DATA, INSPECTION = "index.html", "verification.json", inspection.PAGE
#: name of the file with a row for each hogel of a sample
ROWS = "hogels.parquet"

MAX_SHOWN_HOGELS, MAX_PICTURE_PX = 6, 512
"""Number of hogels with pictures, and longest side of a picture, px."""

WRONG_RGB, BACKGROUND_GRAY, TRUTH_STRENGTH = (224, 49, 49), 250, 0.35
"""Color of wrong pixels, gray level of empty pixels, opacity of the truth under errors."""


@dataclass(frozen=True, kw_only=True)
class Pictured:
    """Pictures of one hogel as data URLs, with the size and a description of its error."""

    aperture: Aperture
    words: str
    #: shares of wrong pixels as delivered and as corrected
    badness: tuple[float, float]
    pictures: dict[str, str]
    #: all channels, if requested
    inspected: InspectedHogel | None = None

    @classmethod
    def from_figures(
        cls, scene: Scene | None, aperture: Aperture, as_found: Figures, corrected: Figures
    ) -> Self:
        """Draw truth, image and errors, as delivered and corrected; with a scene, all channels."""
        truth, pictures = _shown(as_found.answer, as_found.image), {}
        # The corrected image is judged by another model, with another truth.
        rest = _shown(corrected.answer, corrected.image)
        drawn = {"truth": truth, "image": _shown(as_found.image)}
        drawn |= {"error": _errors(truth, as_found), "rest": _errors(rest, corrected)}
        for name, pixels in drawn.items():
            step = -(-max(pixels.shape[:2]) // MAX_PICTURE_PX)
            pictures[name] = address(png(pixels[::step, ::step], optimize=False))
        pair = as_found, corrected
        return cls(
            aperture=aperture,
            words=as_found.numbers.limited_figure,
            badness=badness(*pair),
            pictures=pictures,
            inspected=None if scene is None else inspected_figures(scene, aperture, *pair),
        )


def badness(as_found: Figures, corrected: Figures) -> tuple[float, float]:
    """Return the sort key of hogels: the worst hogel has the largest key."""
    return as_found.numbers.judged_fraction, corrected.numbers.judged_fraction


@dataclass(kw_only=True)
class WorstHogels:
    """The worst hogels so far, worst first; with a scene, all their channels are kept."""

    scene: Scene | None = None
    kept: list[Pictured] = field(default_factory=list)

    def add(self, aperture: Aperture, as_found: Figures, corrected: Figures) -> None:
        """Add a hogel if it is among the worst; of equal hogels the earlier remains."""
        full = len(self.kept) == MAX_SHOWN_HOGELS
        if not full or badness(as_found, corrected) > self.kept[-1].badness:
            self.kept.append(Pictured.from_figures(self.scene, aperture, as_found, corrected))
            self.kept.sort(key=lambda pictured: pictured.badness, reverse=True)
            del self.kept[MAX_SHOWN_HOGELS:]


def _shown(image: HogelImage, like: HogelImage | None = None) -> Bytes:
    """Return a picture of an image: its colors, or else a color for each surface.

    Surfaces are triangles or objects, whichever `like` (default: `image`) identifies. A truth
    identifies both, and must be drawn like the image next to it.
    """
    if image.color is not None:
        linear = np.clip(np.nan_to_num(image.color), 0, 1)
        return np.asarray(np.rint(LEVELS * encoding_curve(linear)), dtype=np.uint8)
    named = image.triangle if ((like or image).triangle != NOTHING).any() else image.object
    if not (named != NOTHING).any():
        named = np.where(image.covered, 0, NOTHING)
    # Neighboring numbers get colors far apart: multiples of odd constants.
    spread = named[..., None].astype(np.int64) * np.array([37, 101, 173]) + np.array([90, 60, 140])
    shades = np.where((named == NOTHING)[..., None], BACKGROUND_GRAY, spread % 200 + 30)
    return shades.astype(np.uint8)


def _errors(truth: Bytes, figures: Figures) -> Bytes:
    """Return a picture of wrong pixels over the faded truth."""
    beneath = BACKGROUND_GRAY - TRUTH_STRENGTH * (BACKGROUND_GRAY - truth.astype(np.float64))
    beneath[~figures.answer.covered] = BACKGROUND_GRAY
    beneath[figures.error] = WRONG_RGB
    return np.asarray(beneath, dtype=np.uint8)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Verification(Verdict, NotebookRepr):
    """Result of `xfrustum verify`: verdict and diagnosis of a renderer (`source`)."""

    scene: Scene
    source: str
    diagnosis: Diagnosis
    #: pictured hogels, the worst first
    worst: tuple[Pictured, ...] = field(default=(), repr=False)
    #: count of judged hogels of a sample, and its bounds; None for chosen hogels
    extent: SampleExtent | None = None
    #: order in which truths are computed
    truth_by: TruthBy = TruthBy.HOGELS

    @property
    def failed(self) -> int:
        """Number of hogels that are missing, exceed a limit or could not be judged."""
        return sum(not hogel.passed for hogel in self.hogels)

    @property
    def share_at_most(self) -> float | None:
        """Upper bound on the share of the plate's hogels that fail; None if no sample was drawn."""
        return None if self.extent is None else self.extent.at_most(self.failed)

    @property
    def kept(self) -> bool:
        """True if every hogel passes or, with `until`, if the bound is at most `until`."""
        limit = None if self.extent is None else self.extent.sample.until
        share = self.share_at_most
        return self.passed if limit is None else share is not None and share <= limit

    @property
    def judged(self) -> str:
        """Judged properties of the images."""
        known = [hogel.as_found for hogel in self.hogels if hogel.as_found is not None]
        colored = any(numbers.radiance is not None for numbers in known)
        return words.judged_words({numbers.by for numbers in known}, colored, self.limits.judging)

    @property
    def explained(self) -> bool | None:
        """True if the diagnosis explains the wrong pixels; None if no judged image is wrong."""
        wrong = self.diagnosis.does_not_explain or any(check.held is False for check in self.checks)
        return True if self.diagnosis.faults else False if wrong else None

    @property
    def storage(self) -> dict[str, int]:
        """File formats that changed pixels, and the number of hogels of each."""
        return dict(sorted(Counter(h.storage for h in self.hogels if h.storage).items()))

    @property
    def places(self) -> list[tuple[Aperture, Places]]:
        """Places of wrong pixels of each judged hogel."""
        return [(hogel.aperture, hogel.places) for hogel in self.hogels if hogel.places is not None]

    @property
    def where(self) -> dict[str, Any]:
        """Places of wrong pixels if no defect is named; else empty."""
        unnamed = self.explained is False and not self.diagnosis.faults
        return (where_wrong(self.scene, self.places) if unnamed else None) or {}

    def _said(self) -> str:
        return f"{self.source} as an answer to {self.scene.name!r}. {words.sentence(self)}"

    def table(self) -> str:
        """Return verdict, diagnosis and measures as lines."""
        return table(self)

    def _figures(self) -> Sequence[Figure]:
        shown = [entry for pictured in self.worst[:1] for entry in pictured.pictures.items()]
        return [
            Figure(caption=f"worst hogel, {name}", content=b64decode(url.partition(",")[2]))
            for name, url in shown
        ]

    def defects(self) -> list[dict[str, Any]]:
        """Return the named defects, with their sentences, as `verify --json` prints them."""
        by = words.witnesses(self.diagnosis)
        faults = self.diagnosis.faults
        return [_defect(fault, words.defect_words(fault, self.scene, by)) for fault in faults]

    def guesses(self, *, printed: bool = False) -> list[dict[str, Any]]:
        """Return defects that explain too little; if `printed`, only those above 0 %."""
        diagnosis = self.diagnosis
        guesses = diagnosis.guesses if printed else diagnosis.does_not_explain
        return [
            _defect(guess, words.guess_words(guess, diagnosis, self.scene)) for guess in guesses
        ]

    def summary(self) -> dict[str, Any]:
        """Return the JSON object that `verify --json` prints."""
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
            "truth_by": str(self.truth_by),
            "storage": self.storage,
            "checks": json_ready(self.checks),
            "diagnosis": json_ready(self.defects()),
            "does_not_explain": json_ready(self.guesses()),
            "explained": self.explained,
            "where": wrong_counts(self.scene, self.places),
            "found_by": words.basis_words(self.diagnosis),
            "as_found": json_ready(self.as_found),
            "corrected": json_ready(self.corrected),
            **self._sample_summary(),
            "hogels": [_hogel(hogel) for hogel in self.hogels],
        }

    def _sample_summary(self) -> dict[str, Any]:
        """Return the bound for the plate, in JSON types; empty without a sample."""
        if self.extent is None:
            return {}
        sample = self.extent.sample
        counts = {"hogels": sample.hogels, "judged": len(self.hogels), "beyond": self.failed}
        return {
            "share_beyond_at_most": self.share_at_most,
            "confidence": self.extent.confidence,
            "sample": {**counts, "limit": sample.until, "seed": sample.description["seed"]},
        }


def _defect(defect: Defect, text: str) -> dict[str, Any]:
    """Return a defect as `verify --json` prints it."""
    fields = vars(defect) | {"words": text, "alternatives": list(defect.alternatives)}
    names = ("fault", "value", "low", "high", "unit", "words", "alternatives", "explains")
    return {name: fields[name] for name in names}


def _hogel(hogel: Hogel) -> dict[str, Any]:
    """Return a hogel as `verify --json` prints it."""
    fields = json_object(hogel) | {"aperture": list(hogel.aperture.index)}
    fields["verdict"] = hogel.verdict
    names = ("aperture", "verdict", "problem", "checks", "as_found", "corrected")
    return {name: fields[name] for name in names}


@dataclass(frozen=True, kw_only=True)
class HogelRow:
    """Row of a hogel of another renderer, as delivered and as corrected for the diagnosis."""

    column: int
    row: int
    #: whether the hogel is missing (`problem`) or does not pass
    beyond: bool
    verdict: str
    problem: str | None
    as_found: HogelNumbers | None = field(metadata=named_columns("{}"))
    corrected: HogelNumbers | None

    @classmethod
    def from_hogel(cls, hogel: Hogel) -> Self:
        """Return the row of a judged hogel."""
        column, row = hogel.aperture.index
        return cls(
            column=column,
            row=row,
            beyond=not hogel.passed,
            verdict=hogel.verdict,
            problem=hogel.problem,
            as_found=hogel.as_found,
            corrected=hogel.corrected,
        )


def write_verification(verification: Verification, out: Path) -> tuple[Path, ...]:
    """Write the page and the JSON object, and the inspection page if channels were kept."""
    inspected = [hogel.inspected for hogel in verification.worst if hogel.inspected is not None]
    with Staging(out, FILES) as staging:
        staging.write(PAGE, render_page(verification))
        staging.write(DATA, verification.summary())
        if verification.extent is not None:
            rows = [HogelRow.from_hogel(hogel) for hogel in verification.hogels]
            staging.write(ROWS, parquet_bytes(table_of(HogelRow, rows)))
        if inspected:
            shares = [
                (*hogel.aperture.index, (hogel.as_found.surface or hogel.as_found).fraction)
                for hogel in verification.hogels
                if hogel.as_found
            ]
            plate, caption = verification.scene.plate, "Share of wrong pixels"
            page = inspection.Inspection(
                command="verify",
                scene=verification.scene,
                intro=f"The worst hogels of {verification.source}, as they were found.",
                hogels=inspected,
                plate_map=PlateMap.from_values(plate, caption, shares),
            )
            inspection.write_inspection(staging.folder, page)
        # An inspection page of an earlier run would not match the new page: replace both or none.
        with inspection.replacing_inspection(out, kept=bool(inspected)):
            return staging.commit()


MAP_CLASSES = (
    (-math.inf, "#56b4e9", "keeps to the limits"),
    (math.ulp(0.0), "#f3cf8e", "exceeds a limit"),
    (0.1, "#e69f00", "a tenth or more is wrong"),
    (0.5, "#d55e00", "half or more is wrong"),
    (math.inf, "#8c8c8c", "missing or not judged"),
)
"""Classes of hogels on the map of a plate: least share of wrong pixels, color, caption."""


def plate_map(verification: Verification) -> dict[str, Any] | None:
    """Return the classes of hogels as cells of an SVG; None if no map is needed.

    A cell of a large plate covers several hogels and shows the worst.
    """
    # A map of equal cells has no information.
    if verification.passed or len(verification.hogels) == 1:
        return None

    def rank(hogel: Hogel) -> float:
        if hogel.passed:
            return 0.0
        # A hogel without a verdict is the worst class, so that a coarse cell never hides it.
        if hogel.verdict in (Outcome.MISSING, Outcome.NOT_JUDGED):
            return math.inf
        shares = (check.value or 0.0 for check in hogel.checks if check.unit == "share")
        return max(math.ulp(0.0), *shares, 0.0)

    every = ((*hogel.aperture.index, rank(hogel)) for hogel in verification.hogels)
    cells = PlateMap.from_values(verification.scene.plate, "", every).cells
    number = np.searchsorted([least for least, _, _ in MAP_CLASSES], cells, side="right") - 1
    # NaN sorts above infinity in searchsorted; cells without a judged hogel stay empty.
    number[np.isnan(cells)] = -1
    classes = [
        {"color": color, "words": entry, "cells": np.argwhere(number == place).tolist()}
        for place, (_, color, entry) in enumerate(MAP_CLASSES)
    ]
    return {"size": cells.shape[::-1], "classes": [entry for entry in classes if entry["cells"]]}


def number(value: float | None, unit: str | None) -> str:
    """Return a number with six digits, integers in full, and shares in percent."""
    if value is None:
        return ""
    if unit == "share":
        return words.percent(value)
    # Above 2^53, doubles skip integers: printing all digits would suggest false precision.
    whole = float(value).is_integer() and abs(value) < 2**53
    return f"{value:,.0f}" if whole else plain(f"{value:.6g}")


FILTERS: Filters = {
    "percent": words.percent,
    "figures": words.figures_words,
    "check": words.check_words,
    "number": number,
}


def _values(verification: Verification) -> dict[str, Any]:
    """Return the values for both templates, page and text."""
    return {
        "found": verification,
        "defects": verification.defects(),
        "guesses": verification.guesses(printed=True),
        "found_by": words.basis_words(verification.diagnosis),
        "sentence": words.sentence(verification),
        "claim": words.claim(verification),
        "explained": words.explained_words(verification),
        "unexplained": words.unexplained_words(verification),
        "nothing": words.nothing_words(verification),
        "where": words.where_words(verification.where),
        "figures": {"as found": verification.as_found, "corrected": verification.corrected},
    }


def render_page(verification: Verification) -> str:
    """Return one self-contained HTML document."""
    more = {"summary": verification.summary(), "map": plate_map(verification)}
    values = _values(verification) | more | {"versions": {**versions(), **machine()}}
    return html_page("verify.html.j2", values, FILTERS)


def table(verification: Verification) -> str:
    """Return verdict, diagnosis and measures as lines."""
    problems = [hogel for hogel in verification.hogels if hogel.problem]
    values = _values(verification) | {"problems": problems, "listed": words.MAX_LISTED}
    return plain_text("verify.txt.j2", values, FILTERS).removesuffix("\n")


def write_junit(verification: Verification, path: Path) -> None:
    """Write one test case for each hogel as JUnit XML, completely or not at all."""
    named = "; ".join(defect["words"] for defect in verification.defects()) or "no fault named"
    scene, cases = verification.scene.name, []
    for hogel in verification.hogels:
        exceeded = "; ".join(map(words.check_words, (c for c in hogel.checks if c.held is False)))
        # JUnit has no outcome for a hogel that cannot be judged; it must not pass.
        if hogel.verdict is Outcome.NOT_JUDGED:
            exceeded = words.NOTHING_TO_JUDGE
        figures = "" if hogel.as_found is None else words.figures_words(hogel.as_found)
        text = figures and f"{figures}\ndiagnosis: {named}"
        name = f"hogel {hogel.aperture.column},{hogel.aperture.row}"
        cases.append(JUnitCase(scene or "scene", name, hogel.problem, exceeded, text))
    content = junit(f"xfrustum verify {scene}", cases, table(verification))
    write_output(path, content, "--junit")
