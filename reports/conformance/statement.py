"""Verdicts of a renderer as files: a statement to cite, a page, JUnit, and a badge."""

from __future__ import annotations

from collections import Counter
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
from xfrustum.scenes.conformance_suite import LEVELS, SUITE, chosen, suite_digest

FILES = PAGE, JUNIT, STATEMENT, BADGE = "index.html", "junit.xml", "statement.json", "badge.json"
#: largest number of failed cases in the terminal
MAX_LISTED = 20
NOT_RUN = "not run"


@dataclass(kw_only=True, eq=False)
class Statement:
    """Verdicts of a renderer, with its name and device."""

    renderer: str
    device: str
    #: name of the device model that explains rounding
    device_model: str
    verdicts: tuple[Verdict, ...]

    @cached_property
    def counts(self) -> dict[str, Counter[str]]:
        """Numbers of cases by judged level and outcome, including cases that were not run."""
        counts = dict[str, Counter[str]]()
        for case in sorted(self.verdicts, key=lambda case: list(LEVELS).index(case.level)):
            counts.setdefault(case.level, Counter())[str(case.verdict)] += 1
        for level, run in counts.items():
            # A partial run must not look like a complete pass.
            run[NOT_RUN] = len(chosen((level,))) - run.total()
        return counts

    @property
    def levels(self) -> dict[str, CaseOutcome]:
        """Outcome of each judged level: pass if no case fails and at least one passes."""
        # One failed case fails the level; a level with unsupported cases is partly claimed.
        order = (CaseOutcome.FAIL, CaseOutcome.PASS, CaseOutcome.UNSUPPORTED)
        return {
            level: next(outcome for outcome in order if counts[outcome])
            for level, counts in self.counts.items()
        }

    def of_outcome(self, outcome: CaseOutcome) -> list[str]:
        """Return the judged levels with an outcome."""
        return [level for level, result in self.levels.items() if result is outcome]

    @property
    def passed(self) -> bool:
        """True if no case fails; a renderer claims all cases but unsupported cases."""
        return CaseOutcome.FAIL not in self.levels.values()

    @property
    def partly(self) -> set[str]:
        """Passed levels with cases that are not claimed or were not run."""
        return {level for level, n in self.counts.items() if 0 < n[CaseOutcome.PASS] < n.total()}

    @property
    def sentence(self) -> str:
        """Verdict, one sentence."""
        failed, passed = self.of_outcome(CaseOutcome.FAIL), []
        for level in self.of_outcome(CaseOutcome.PASS):
            counts = self.counts[level]
            share = f" ({counts[CaseOutcome.PASS]} of {counts.total()} cases)"
            passed.append(level + (share if level in self.partly else ""))
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
            # Leave pictures, megabytes of base64, to the page.
            "cases": [{k: v for k, v in case.items() if k != "pictures"} for case in cases],
        }

    def badge(self) -> dict[str, Any]:
        """Return badge.json, in the form that badge services read."""
        levels = self.of_outcome(CaseOutcome.PASS)
        message = " ".join(level + ("*" if level in self.partly else "") for level in levels)
        # Yellow: some levels pass and some fail.
        color = "brightgreen" if self.passed else "yellow"
        if not message:
            nothing = ("nothing claimed", "lightgrey") if self.passed else ("no level", "red")
            message, color = nothing
        return {
            "schemaVersion": 1,
            "label": f"hogel conformance {SUITE}",
            "message": message,
            "color": color,
        }

    def table(self) -> str:
        """Return lines for the verdict, each level, and each failed case."""
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


def junit_case(verdict: Verdict) -> JUnitCase:
    """Return the test case of JUnit for a case."""
    cause, outcome = verdict.cause or "not claimed", verdict.verdict
    failed = f"{cause}: {failure(verdict)}" if outcome is CaseOutcome.FAIL else None
    return JUnitCase(
        classname=verdict.level,
        name=verdict.name,
        failure=failed,
        text=counted_pixels(verdict.pixels),
        # Continuous integration shows skipped tests without failing the build.
        skipped=cause if outcome is CaseOutcome.UNSUPPORTED else None,
    )


def write_statement(statement: Statement, out: Path) -> tuple[Path, ...]:
    """Write statement, page, JUnit and badge, all or nothing."""
    values = {"statement": statement, "suite": SUITE, "levels": LEVELS, "badge": statement.badge()}
    cases = list(map(junit_case, statement.verdicts))
    files: dict[str, object] = {
        STATEMENT: statement.summary(),
        BADGE: statement.badge(),
        JUNIT: junit(f"xfrustum conformance {SUITE}", cases, statement.table()),
        PAGE: html_page("conformance.html.j2", values, {"pixels": counted_pixels}),
    }
    return write_files(out, files)
