"""What a verification leaves behind: a page, JSON, JUnit XML, and lines for the terminal."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from xfrustum.reports.outputs import Staging
from xfrustum.reports.provenance import machine, versions
from xfrustum.reports.tables import json_ready
from xfrustum.reports.verdict import Verification, totals

_TEMPLATES = Path(__file__).parent / "templates"

FILES = PAGE, DATA = "index.html", "verification.json"

LISTED = 10
"""Missing hogels that the terminal names one by one."""


def write_verification(found: Verification, out: Path) -> tuple[Path, ...]:
    """Write the page and the JSON object, all or nothing.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    with Staging(out, FILES) as staging:
        (staging.folder / PAGE).write_text(render_page(found), encoding="utf-8")
        text = json.dumps(json_ready(found.summary()), allow_nan=False, indent=1)
        (staging.folder / DATA).write_text(text + "\n", encoding="utf-8")
        return staging.commit()


def render_page(found: Verification) -> str:
    """Return one HTML document that needs nothing else, online or offline."""
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["percent"] = percent
    return environment.get_template("verify.html.j2").render(
        found=found,
        summary=found.summary(),
        sentence=sentence(found),
        explained=explained(found),
        versions={**versions(), **machine()},
    )


def write_junit(found: Verification, path: Path) -> None:
    """Write one test case for each hogel as JUnit XML, aside and then renamed."""
    suite = ElementTree.Element(
        "testsuite",
        name=f"xfrustum verify {found.scene.name}",
        tests=str(len(found.hogels)),
        failures=str(sum(not hogel.passed and not hogel.problem for hogel in found.hogels)),
        errors=str(sum(bool(hogel.problem) for hogel in found.hogels)),
    )
    words = "; ".join(fault.words for fault in found.diagnosis.faults) or "no fault named"
    for hogel in found.hogels:
        name = f"hogel {hogel.aperture.column},{hogel.aperture.row}"
        case = ElementTree.SubElement(suite, "testcase", classname=found.scene.name or "scene", name=name)
        if hogel.problem:
            ElementTree.SubElement(case, "error", message=_xml_text(hogel.problem))
        elif not hogel.passed:
            assert hogel.as_found is not None
            failure = ElementTree.SubElement(case, "failure", message=_xml_text(_figures(hogel.as_found)))
            failure.text = _xml_text(f"diagnosis: {words}")
    ElementTree.SubElement(suite, "system-out").text = _xml_text(table(found))
    tree = ElementTree.ElementTree(suite)
    ElementTree.indent(tree)
    with tempfile.NamedTemporaryFile(dir=path.absolute().parent, delete=False) as file:
        tree.write(file, encoding="utf-8", xml_declaration=True)
    Path(file.name).chmod(0o666 & ~_umask())
    Path(file.name).replace(path)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _xml_text(text: str) -> str:
    """Return text without the control characters that XML has no way to write."""
    return "".join(letter for letter in text if letter in "\t\n" or ord(letter) >= 32)


def percent(fraction: float) -> str:
    """Return a share in percent, with three digits."""
    return f"{100 * fraction:.3g} %"


def sentence(found: Verification) -> str:
    """Return the verdict in one sentence."""
    missing = sum(bool(hogel.problem) for hogel in found.hogels)
    bad = sum(not hogel.passed and not hogel.problem for hogel in found.hogels)
    if found.passed:
        return f"Right: all {len(found.hogels)} hogels keep to the limits."
    parts = [f"{bad} of {len(found.hogels)} hogels exceed a limit"] if bad else []
    parts += [f"{missing} of {len(found.hogels)} could not be had"] if missing else []
    return f"Not right: {', and '.join(parts)}."


def table(found: Verification) -> str:
    """Return verdict, diagnosis and figures as lines."""
    lines = [sentence(found), f"diagnosis, by {found.diagnosis.means}:"]
    lines += [f"  {fault.words}{_interval(fault.low, fault.high)}" for fault in found.diagnosis.faults]
    if found.diagnosis.faults:
        lines += [f"  explained: {told}" for told in explained(found)]
    elif found.diagnosis.does_not_explain:
        lines.append("  no known fault explains what is wrong:")
        lines += [f"    {fault.words}" for fault in found.diagnosis.does_not_explain]
    else:
        lines.append("  nothing found")
    for name, figures in (
        ("as found", totals([hogel.as_found for hogel in found.hogels])),
        ("corrected", totals([hogel.corrected for hogel in found.hogels])),
    ):
        if figures is not None:
            lines.append(f"{name}: {_figures(figures)}")
    problems = [hogel for hogel in found.hogels if hogel.problem]
    lines += [f"hogel {h.aperture.column},{h.aperture.row}: {h.problem}" for h in problems[:LISTED]]
    if len(problems) > LISTED:
        lines.append(f"and {len(problems) - LISTED} more like these")
    return "\n".join(lines)


def explained(found: Verification) -> list[str]:
    """Return in words how much of what is wrong the diagnosis explains; none where nothing is wrong."""
    shares = [fault.explains for fault in found.diagnosis.faults if fault.explains is not None]
    return [f"{percent(min(shares))} of the wrong pixels of the hogels that were tested"] if shares else []


def _interval(low: float | None, high: float | None) -> str:
    return "" if low is None or high is None else f"  [{low:.6g}, {high:.6g}]"


def _figures(figures: dict[str, Any]) -> str:
    """Return figures of one hogel, or of all, in words."""
    share = percent(figures["fraction"])
    text = f"{figures['wrong']:,} of {figures['shown']:,} pixels that show something are wrong ({share})"
    if figures["surface"] is not None:
        text += f", wrong surfaces {percent(figures['surface']['fraction'])}"
    spread = figures["displacement_px"]
    if spread is not None:
        text += f", displacement p99 {spread.get('worst_p99', spread.get('p99')):.3g} px"
    if figures["radiance"] is not None:
        text += f", in another color {figures['radiance']['wrong']:,}"
    if figures["causes"] is not None and figures["wrong"]:
        text += "; causes: " + ", ".join(f"{name} {count:,}" for name, count in figures["causes"].items())
    return text
