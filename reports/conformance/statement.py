"""Verdicts of a renderer as files: a statement to cite, a page, JUnit, and a badge."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import Any

from xfrustum.compare.judging.conformance import Pixels
from xfrustum.reports.common.junit import JUnitCase, junit
from xfrustum.reports.common.outputs import json_object, write_files
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.conformance.run import CaseOutcome, Verdict
from xfrustum.scenes.conformance.suite import LEVELS, SUITE, chosen, suite_digest

FILES = PAGE, JUNIT, STATEMENT, BADGE = "index.html", "junit.xml", "statement.json", "badge.json"
#: failed cases that the terminal lists
MAX_LISTED = 20
#: colors of a badge, by the names of badge services
COLORS = {
    CaseOutcome.PASS: "brightgreen",
    CaseOutcome.FAIL: "red",
    CaseOutcome.UNSUPPORTED: "lightgrey",
}
NOT_RUN = "not run"


@dataclass(kw_only=True, eq=False)
class Statement:
    """Verdicts of a renderer, with its name and device."""

    renderer: str
    device: str
    #: name of the model by which rounding is explained
    device_model: str
    verdicts: tuple[Verdict, ...]

    @cached_property
    def counts(self) -> dict[str, Counter[str]]:
        """Numbers of cases by judged level and outcome, and of the cases that were not run."""
        counts = {}
        # In the order of levels, whatever the order of verdicts.
        for level in LEVELS:
            run = Counter(str(case.verdict) for case in self.verdicts if case.level == level)
            if run:
                counts[level] = run
                # A partial run must not read as a full pass.
                run[NOT_RUN] = len(chosen((level,))) - run.total()
        return counts

    @property
    def levels(self) -> dict[str, CaseOutcome]:
        """CaseOutcome of each judged level: pass where no case fails and some case passes."""
        return {
            level: next(
                outcome
                # One failed case fails its level; unsupported cases only leave it partly claimed.
                for outcome in (CaseOutcome.FAIL, CaseOutcome.PASS, CaseOutcome.UNSUPPORTED)
                if counts[outcome]
            )
            for level, counts in self.counts.items()
        }

    @property
    def passed(self) -> bool:
        """No case fails; a renderer claims every case that it does not call unsupported."""
        return CaseOutcome.FAIL not in self.levels.values()

    @property
    def partly(self) -> set[str]:
        """Levels that are passed without some cases, which are not claimed or were not run."""
        return {level for level, n in self.counts.items() if 0 < n[CaseOutcome.PASS] < n.total()}

    @property
    def sentence(self) -> str:
        """The verdict in one sentence."""
        outcomes = self.levels
        failed = [level for level in outcomes if outcomes[level] is CaseOutcome.FAIL]
        passed = [level for level in outcomes if outcomes[level] is CaseOutcome.PASS]
        for place, level in enumerate(passed):
            if level in self.partly:
                counts = self.counts[level]
                share = f"{counts[CaseOutcome.PASS]} of {counts.total()} cases"
                passed[place] = f"{level} ({share})"
        parts = [f"passes {', '.join(passed)}"] if passed else []
        parts += [f"fails {', '.join(failed)}"] if failed else []
        claims = " and ".join(parts) or "claims none of these cases"
        return f"{self.renderer} {claims} of suite {SUITE}."

    def summary(self) -> dict[str, Any]:
        """Return statement.json."""
        cases = [json_object(verdict) for verdict in self.verdicts]
        return {
            "suite": SUITE,
            "suite_digest": suite_digest(),
            "xfrustum": metadata.version("xfrustum"),
            "renderer": self.renderer,
            "device": self.device,
            "device_model": self.device_model,
            "levels": self.levels,
            "counts": self.counts,
            # Pictures are megabytes of base64: they belong to the page.
            "cases": [{k: v for k, v in case.items() if k != "pictures"} for case in cases],
        }

    def badge(self) -> dict[str, Any]:
        """Return badge.json, in the form that badge services read."""
        outcomes = self.levels
        passed = [
            level + ("*" if level in self.partly else "")
            for level, outcome in outcomes.items()
            if outcome is CaseOutcome.PASS
        ]
        kind = (
            CaseOutcome.PASS
            if passed
            else CaseOutcome.UNSUPPORTED
            if self.passed
            else CaseOutcome.FAIL
        )
        nothing = "no level" if kind is CaseOutcome.FAIL else "nothing claimed"
        return {
            "schemaVersion": 1,
            "label": f"hogel conformance {SUITE}",
            "message": " ".join(passed) or nothing,
            # Passed levels beside failed ones: neither green nor red would be honest.
            "color": "yellow" if passed and not self.passed else COLORS[kind],
        }

    def table(self) -> str:
        """Return a line for the verdict, for each level, and for each failed case."""
        lines = [self.sentence]
        for level, outcome in self.levels.items():
            counts = ", ".join(f"{n} {name}" for name, n in sorted(self.counts[level].items()) if n)
            lines.append(f"{level}  {outcome:<11}  {counts:<32}  {LEVELS[level]}")
        failed = [case for case in self.verdicts if case.verdict is CaseOutcome.FAIL]
        lines += [f"  {case.name}: {case.cause}: {failure(case)}" for case in failed[:MAX_LISTED]]
        if more := len(failed[MAX_LISTED:]):
            lines.append(f"  and {more} more; --out has them all")
        return "\n".join(lines)


def counted_pixels(pixels: Pixels) -> str:
    """Return numbers of pixels in words."""
    counts = asdict(pixels)
    shown, wrong = counts.pop("shown"), counts.pop("wrong")
    causes = ", ".join(f"{count:,} {name}" for name, count in counts.items() if count)
    return f"{wrong:,} of {shown:,} pixels wrong" + (f" ({causes})" if causes else "")


def failure(verdict: Verdict) -> str:
    """Return the sentences about a failed case, or its numbers of pixels."""
    return "; ".join(verdict.words) or counted_pixels(verdict.pixels)


def junit_cases(verdicts: Sequence[Verdict]) -> list[JUnitCase]:
    """Return a test case of JUnit for each case."""
    cases = []
    for verdict in verdicts:
        cause = verdict.cause or "not claimed"
        cases.append(
            JUnitCase(
                classname=verdict.level,
                name=verdict.name,
                failure=f"{cause}: {failure(verdict)}"
                if verdict.verdict is CaseOutcome.FAIL
                else None,
                text=counted_pixels(verdict.pixels),
                # Continuous integration shows skipped tests without failing the build.
                skipped=cause if verdict.verdict is CaseOutcome.UNSUPPORTED else None,
            )
        )
    return cases


def write_statement(statement: Statement, out: Path) -> tuple[Path, ...]:
    """Write statement, page, JUnit and badge, all or nothing."""
    values = {"statement": statement, "suite": SUITE, "levels": LEVELS, "badge": statement.badge()}
    cases = junit_cases(statement.verdicts)
    files: dict[str, object] = {
        STATEMENT: statement.summary(),
        BADGE: statement.badge(),
        JUNIT: junit(f"xfrustum conformance {SUITE}", cases, statement.table()),
        PAGE: html_page("conformance.html.j2", values, {"pixels": counted_pixels}),
    }
    return write_files(out, files)
