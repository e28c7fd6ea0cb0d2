"""What a verification leaves behind: a page, JSON, JUnit XML, and lines for the terminal."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree

from xfrustum.reports.common.outputs import Staging, write_output
from xfrustum.reports.common.provenance import machine, versions
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.inspection import page as inspection
from xfrustum.reports.inspection.page import PlateMap
from xfrustum.reports.verification.verdict import Verification, figures_words, percent

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
