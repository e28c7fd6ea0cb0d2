"""The verdicts of a renderer as files: a statement that can be cited, a page, JUnit, and a badge."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import Any

from xfrustum.reports.common.junit import JUnitCase, junit
from xfrustum.reports.common.outputs import Staging, json_ready
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.conformance.run import Verdict
from xfrustum.scenes.conformance.suite import LEVELS, SUITE, chosen, suite_digest

FILES = PAGE, JUNIT, STATEMENT, BADGE = "index.html", "junit.xml", "statement.json", "badge.json"

MAX_LISTED = 20  #: failed cases that the terminal names one by one

COLORS = {"pass": "brightgreen", "fail": "red", "unsupported": "lightgrey"}
"""Colors of a badge, by the names that badge services know."""


@dataclass(frozen=True, kw_only=True)
class Statement:
    """What a renderer is found to do: its name, the device that it ran on, and a verdict for each case."""

    renderer: str
    device: str
    device_model: str  #: name of the model by which rounding is explained
    verdicts: tuple[Verdict, ...]

    @cached_property
    def levels(self) -> dict[str, str]:
        """The verdict of each level that was asked: pass where no case fails and some case passes."""
        found = {}
        for level in LEVELS:
            told = {one.verdict for one in self.verdicts if one.level == level}
            if told:
                found[level] = (
                    "fail" if "fail" in told else "pass" if "pass" in told else "unsupported"
                )
        return found

    @property
    def passed(self) -> bool:
        """Whether no case fails; a renderer claims what it does not call unsupported."""
        return "fail" not in self.levels.values()

    @property
    def counts(self) -> dict[str, Counter[str]]:
        """Numbers of cases by level and verdict, and of those that were not run."""
        found = {}
        for level in self.levels:
            found[level] = Counter(one.verdict for one in self.verdicts if one.level == level)
            found[level]["not run"] = len(chosen((level,))) - found[level].total()
        return found

    @property
    def sentence(self) -> str:
        """The verdict in one sentence."""
        failed = [level for level, told in self.levels.items() if told == "fail"]
        passed = [
            f"{level} ({self.counts[level]['pass']} of {self.counts[level].total()} cases)"
            if level in self.partly
            else level
            for level, told in self.levels.items()
            if told == "pass"
        ]
        parts = [f"passes {', '.join(passed)}"] if passed else []
        parts += [f"fails {', '.join(failed)}"] if failed else []
        return f"{self.renderer} {' and '.join(parts) or 'claims none of these cases'} of suite {SUITE}."

    @property
    def partly(self) -> set[str]:
        """Levels that are passed without some of their cases, which are not claimed or were not run."""
        return {level for level, told in self.counts.items() if 0 < told["pass"] < told.total()}

    def summary(self) -> dict[str, Any]:
        """Return statement.json."""
        cases = []
        for one in self.verdicts:
            entry = json_ready(one)
            del entry["pictures"]
            cases.append(entry)
        return {
            "suite": SUITE,
            "suite_digest": suite_digest(),
            "xfrustum": metadata.version("xfrustum"),
            "renderer": self.renderer,
            "device": self.device,
            "device_model": self.device_model,
            "levels": self.levels,
            "counts": self.counts,
            "cases": cases,
        }

    def badge(self) -> dict[str, Any]:
        """Return badge.json, in the form that badge services read."""
        passed = [
            level + ("*" if level in self.partly else "")
            for level, v in self.levels.items()
            if v == "pass"
        ]
        kind = "pass" if passed else "fail" if "fail" in self.levels.values() else "unsupported"
        color = "yellow" if passed and not self.passed else COLORS[kind]
        message = " ".join(passed) or ("no level" if kind == "fail" else "nothing claimed")
        return {
            "schemaVersion": 1,
            "label": f"hogel conformance {SUITE}",
            "message": message,
            "color": color,
        }

    def table(self) -> str:
        """Return the verdict as lines: a line for each level, and one for each case that fails."""
        lines = [self.sentence]
        for level, told in self.levels.items():
            counts = ", ".join(f"{n} {name}" for name, n in sorted(self.counts[level].items()) if n)
            lines.append(f"{level}  {told:<11}  {counts:<32}  {LEVELS[level]}")
        failed = [one for one in self.verdicts if one.verdict == "fail"]
        lines += [f"  {one.name}: {one.cause}: {one.told}" for one in failed[:MAX_LISTED]]
        more = len(failed) - MAX_LISTED
        return "\n".join(
            [*lines, *([f"  and {more} more; --out has them all"] if more > 0 else [])]
        )


def write_statement(found: Statement, out: Path) -> tuple[Path, ...]:
    """Write statement, page, JUnit and badge, all or nothing."""
    with Staging(out, FILES) as staging:
        staging.write(STATEMENT, found.summary())
        staging.write(BADGE, found.badge())
        staging.write(
            JUNIT,
            junit(f"xfrustum conformance {SUITE}", junit_cases(found.verdicts), found.table()),
        )
        values = {"found": found, "suite": SUITE, "levels": LEVELS, "badge": found.badge()}
        staging.write(PAGE, html_page("conformance.html.j2", values))
        return staging.commit()


def junit_cases(verdicts: Sequence[Verdict]) -> list[JUnitCase]:
    """Return a test case of JUnit for each case."""
    cases = []
    for one in verdicts:
        told = one.cause or "not claimed"
        failure = f"{told}: {one.told}" if one.verdict == "fail" else None
        skipped = told if one.verdict == "unsupported" else None
        case = JUnitCase(one.level, one.name, None, failure, one.pixels.words, skipped)
        cases.append(case)
    return cases
