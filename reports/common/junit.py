"""Test cases as JUnit XML."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from xfrustum.reports.common.templates_environment import fragment

_NOT_IN_XML = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters outside of XML 1.0, which no reference can hold either (`Char`)."""


@dataclass(frozen=True)
class JUnitCase:
    """One test case of JUnit; it passed where it has no error, no failure, and was not skipped."""

    classname: str
    name: str
    error: str | None = None
    failure: str | None = None
    text: str = ""
    skipped: str | None = None


def junit(suite: str, cases: Sequence[JUnitCase], output: str) -> bytes:
    """Return test cases as JUnit XML, with the output of the suite."""
    text = fragment("junit.xml.j2", {"suite": suite, "cases": cases, "output": output})
    return _NOT_IN_XML.sub("\ufffd", text).encode()
