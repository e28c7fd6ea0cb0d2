"""Verification: the answer to `xfrustum verify`, and the files that it leaves."""

from __future__ import annotations

import math
from base64 import b64decode
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from xfrustum.compare.diagnosis.defects import Defect
from xfrustum.compare.diagnosis.diagnosis import Diagnosis
from xfrustum.compare.judging.verdict import Hogel, Outcome, Verdict
from xfrustum.compare.judging.where import Places, where_wrong, wrong_counts
from xfrustum.compare.sampling import SampleExtent
from xfrustum.reports import inspection
from xfrustum.reports.common.junit import JUnitCase, junit
from xfrustum.reports.common.outputs import Staging, json_object, json_ready, write_output
from xfrustum.reports.common.provenance import machine, versions
from xfrustum.reports.common.templates_environment import Filters, html_page, plain_text
from xfrustum.reports.inspection import InspectedHogel, PlateMap
from xfrustum.reports.notebook import Figure, NotebookRepr
from xfrustum.reports.parts import parquet_bytes
from xfrustum.reports.verification import words
from xfrustum.reports.verification.rows import rows_of
from xfrustum.reports.verification.worst import WorstHogels
from xfrustum.scenes import Aperture, Scene
from xfrustum.scenes.representation import plain

FILES = PAGE, DATA, INSPECTION = "index.html", "verification.json", inspection.PAGE
#: name of the file with a row for each hogel of a sample
ROWS = "hogels.parquet"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Verification(Verdict, NotebookRepr):
    """The answer to `xfrustum verify`: verdict and diagnosis of one renderer (`source`)."""

    scene: Scene
    source: str
    diagnosis: Diagnosis
    worst: WorstHogels = field(repr=False)
    #: of a sample of the plate; None for chosen hogels
    extent: SampleExtent | None = None

    @property
    def failed(self) -> int:
        """Number of hogels that are missing, exceed a limit or could not be judged."""
        return sum(not hogel.passed for hogel in self.hogels)

    @property
    def share_at_most(self) -> float | None:
        """Upper bound on the share of the plate's hogels that fail; None without a sample."""
        return None if self.extent is None else self.extent.at_most(self.failed)

    @property
    def kept(self) -> bool:
        """True if the verdict is good: every hogel passes, or the bound keeps the limit `until`."""
        limit = None if self.extent is None else self.extent.sample.until
        share = self.share_at_most
        return self.passed if limit is None else share is not None and share <= limit

    @property
    def inspected(self) -> list[InspectedHogel]:
        """The worst hogels with all their channels; none unless channels were kept."""
        return [
            pictured.inspected for pictured in self.worst.kept if pictured.inspected is not None
        ]

    @property
    def judged(self) -> str:
        """Properties of the images that were judged."""
        known = [hogel.as_found for hogel in self.hogels if hogel.as_found is not None]
        colored = any(numbers.radiance is not None for numbers in known)
        return words.judged_words({numbers.by for numbers in known}, colored, self.limits.judging)

    @property
    def explained(self) -> bool | None:
        """True if the diagnosis explains the wrong pixels; None where no judged image is wrong."""
        wrong = self.diagnosis.does_not_explain or any(check.held is False for check in self.checks)
        return True if self.diagnosis.faults else False if wrong else None

    @property
    def storage(self) -> dict[str, int]:
        """File formats that changed pixels, and the number of hogels of each."""
        return dict(
            sorted(Counter(hogel.storage for hogel in self.hogels if hogel.storage).items())
        )

    @property
    def where(self) -> dict[str, Any] | None:
        """Places of wrong pixels, where nothing is named; else None."""
        named = self.diagnosis.faults or self.explained is not False
        return None if named else where_wrong(self.scene, self._places)

    @property
    def _places(self) -> list[tuple[Aperture, Places]]:
        return [(hogel.aperture, hogel.places) for hogel in self.hogels if hogel.places is not None]

    def _said(self) -> str:
        return f"{self.source} as an answer to {self.scene.name!r}. {words.sentence(self)}"

    def table(self) -> str:
        """Return verdict, diagnosis and figures as lines."""
        return table(self)

    def _figures(self) -> Sequence[Figure]:
        shown = [entry for pictured in self.worst.kept[:1] for entry in pictured.pictures.items()]
        return [
            Figure(caption=f"worst hogel, {name}", content=b64decode(url.partition(",")[2]))
            for name, url in shown
        ]

    def defects(self) -> list[dict[str, Any]]:
        """Return the named defects, with their sentences, as `verify --json` prints them."""
        by = words.witnesses(self.diagnosis)
        return [
            _summary(defect, words.defect_words(defect, self.scene, by))
            for defect in self.diagnosis.faults
        ]

    def guesses(self) -> list[dict[str, Any]]:
        """Return the defects that explain too little, with their sentences."""
        verification = self.diagnosis
        return [
            _summary(defect, words.guess_words(defect, verification, self.scene))
            for defect in verification.does_not_explain
        ]

    def best_guesses(self) -> list[dict[str, Any]]:
        """Return the guesses that explain more than 0 %, which page and text print."""
        printed = self.diagnosis.guesses
        # Records keep every guess; page and text omit guesses without effect.
        pairs = zip(self.guesses(), self.diagnosis.does_not_explain, strict=True)
        return [guess for guess, defect in pairs if defect in printed]

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
            "diagnosis": json_ready(self.defects()),
            "does_not_explain": json_ready(self.guesses()),
            "explained": self.explained,
            "where": wrong_counts(self.scene, self._places),
            "found_by": words.basis_words(self.diagnosis),
            "as_found": json_ready(self.as_found),
            "corrected": json_ready(self.corrected),
            **self._sample_summary(),
            "hogels": [_hogel(hogel) for hogel in self.hogels],
        }

    def _sample_summary(self) -> dict[str, Any]:
        """Return the claim about the plate, in JSON's types; nothing without a sample."""
        if self.extent is None:
            return {}
        sample = self.extent.sample
        counts = {"hogels": sample.hogels, "judged": len(self.hogels), "beyond": self.failed}
        return {
            "share_beyond_at_most": self.share_at_most,
            "confidence": self.extent.confidence,
            "sample": {**counts, "limit": sample.until, "seed": sample.description["seed"]},
        }


def _summary(defect: Defect, text: str) -> dict[str, Any]:
    """Return a defect as `verify --json` prints it."""
    fields = asdict(defect) | {"words": text, "alternatives": list(defect.alternatives)}
    names = ("fault", "value", "low", "high", "unit", "words", "alternatives", "explains")
    return {name: fields[name] for name in names}


def _hogel(hogel: Hogel) -> dict[str, Any]:
    """Return a hogel as `verify --json` prints it."""
    index = {"aperture": list(hogel.aperture.index), "verdict": hogel.verdict}
    names = ("aperture", "verdict", "problem", "checks", "as_found", "corrected")
    return {name: (json_object(hogel) | index)[name] for name in names}


def write_verification(verification: Verification, out: Path) -> tuple[Path, ...]:
    """Write the page and the JSON object, and the inspection page if channels were kept."""
    with Staging(out, FILES) as staging:
        staging.write(PAGE, render_page(verification))
        staging.write(DATA, verification.summary())
        if verification.extent is not None:
            staging.write(ROWS, parquet_bytes(rows_of(verification.hogels)))
        if verification.inspected:
            known = [
                (hogel.aperture.index, hogel.as_found)
                for hogel in verification.hogels
                if hogel.as_found
            ]
            shares = [(*index, (numbers.surface or numbers).fraction) for index, numbers in known]
            inspected = inspection.Inspection(
                command="verify",
                scene=verification.scene,
                intro=f"The worst hogels of {verification.source}, as they were found.",
                hogels=verification.inspected,
                plate_map=PlateMap.from_values(
                    verification.scene.plate, "Share of wrong pixels", shares
                ),
            )
            inspection.write_inspection(staging.folder, inspected)
        # The inspection page of an earlier run would show other images than the page beside it.
        # Both pages are replaced together, or neither.
        with inspection.replacing_inspection(out, kept=bool(verification.inspected)):
            return staging.commit()


MAP_CLASSES = (
    (-math.inf, "#56b4e9", "keeps to the limits"),
    (math.ulp(0.0), "#f3cf8e", "exceeds a limit"),
    (0.1, "#e69f00", "a tenth or more is wrong"),
    (0.5, "#d55e00", "half or more is wrong"),
    (math.inf, "#8c8c8c", "missing or not judged"),
)
"""Classes of hogels on the map of a plate: the least share that is wrong, color and words."""


def plate_map(verification: Verification) -> dict[str, Any] | None:
    """Return the classes of hogels as cells of an SVG; None where no map is needed.

    A cell of a large plate stands for several hogels, and shows the worst of them.
    """
    # A map of equal cells has no information.
    if verification.passed or len(verification.hogels) == 1:
        return None

    def badness(hogel: Hogel) -> float:
        if hogel.passed:
            return 0.0
        shares = (check.value or 0.0 for check in hogel.checks if check.unit == "share")
        # A hogel without a verdict is the worst class, so that a coarse cell never hides it.
        unknown = hogel.verdict in (Outcome.MISSING, Outcome.NOT_JUDGED)
        return math.inf if unknown else max(math.ulp(0.0), *shares, 0.0)

    every = ((*hogel.aperture.index, badness(hogel)) for hogel in verification.hogels)
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
    """Return a number with six digits, whole ones in full, and shares as percent."""
    if value is None:
        return ""
    if unit == "share":
        return words.percent(value)
    # Beyond 2^53 doubles skip integers: digits in full would pretend precision.
    whole = float(value).is_integer() and abs(value) < 2**53
    return f"{value:,.0f}" if whole else plain(f"{value:.6g}")


FILTERS: Filters = {
    "percent": words.percent,
    "figures": words.figures_words,
    "check": words.check_words,
    "number": number,
}


def _told(verification: Verification) -> dict[str, Any]:
    """Return the values of both templates, page and text."""
    return {
        "found": verification,
        "defects": verification.defects(),
        "guesses": verification.best_guesses(),
        "found_by": words.basis_words(verification.diagnosis),
        "sentence": words.sentence(verification),
        "claim": words.claim(verification),
        "explained": words.explained_words(verification),
        "unexplained": words.unexplained_words(verification),
        "nothing": words.nothing_words(verification),
        "where": words.where_words(verification.where or {}),
        "figures": {"as found": verification.as_found, "corrected": verification.corrected},
    }


def render_page(verification: Verification) -> str:
    """Return one HTML document that needs nothing else, online or offline."""
    made_by = {**versions(), **machine()}
    values = {
        "summary": verification.summary(),
        "map": plate_map(verification),
        "versions": made_by,
    }
    return html_page("verify.html.j2", _told(verification) | values, FILTERS)


def table(verification: Verification) -> str:
    """Return verdict, diagnosis and figures as lines."""
    problems = [hogel for hogel in verification.hogels if hogel.problem]
    values = _told(verification) | {"problems": problems, "listed": words.MAX_LISTED}
    return plain_text("verify.txt.j2", values, FILTERS).removesuffix("\n")


def write_junit(verification: Verification, path: Path) -> None:
    """Write one test case for each hogel as JUnit XML, whole or not at all."""
    named = "; ".join(defect["words"] for defect in verification.defects()) or "no fault named"
    cases = []
    for hogel in verification.hogels:
        exceeded = "; ".join(
            words.check_words(check) for check in hogel.checks if check.held is False
        )
        # JUnit has no such outcome: a test that could not be judged must not pass.
        if hogel.verdict is Outcome.NOT_JUDGED:
            exceeded = words.NOTHING_TO_JUDGE
        figures = "" if hogel.as_found is None else words.figures_words(hogel.as_found)
        text = figures and f"{figures}\ndiagnosis: {named}"
        name = f"hogel {hogel.aperture.column},{hogel.aperture.row}"
        cases.append(
            JUnitCase(verification.scene.name or "scene", name, hogel.problem, exceeded, text)
        )
    write_output(
        path,
        junit(f"xfrustum verify {verification.scene.name}", cases, table(verification)),
        "--junit",
    )
