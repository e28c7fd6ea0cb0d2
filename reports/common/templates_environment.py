"""The only place that fills in templates: HTML pages, SVG, XML with JUnit, and Markdown.

Every HTML page carries a Content-Security-Policy: the browser runs only our own scripts, identified
by their hashes, even if text of a scene gets into the page, and the page loads no other file.
"""

import base64
import hashlib
import io
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from pkgutil import get_data
from types import MappingProxyType
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from numpy.typing import NDArray
from PIL import Image

from xfrustum.reports.common.outputs import json_ready
from xfrustum.scenes.representation import counted, digits, percent

Filters = Mapping[str, Callable[..., Any]]
#: no filters in addition to the filters of all templates
NO_FILTERS: Filters = MappingProxyType({})

TEMPLATES = Path(__file__).parents[1] / "templates"

_POLICY_MARK = "@@content-security-policy@@"
"""Placeholder of the policy until all scripts of the page are known.

The first occurrence is replaced: it comes before any text from outside."""


def html_page(
    template: str,
    values: Mapping[str, Any],
    filters: Filters = NO_FILTERS,
) -> str:
    """Return a self-contained page, which works offline; all text of the values is escaped.

    In addition to the values, templates can use `policy()`, to be put first in the head;
    `plotly()`, the element with plotly.js; `script(NAME, ..)`, an element with the joined scripts
    of these names from the folder of templates; and `data(ID, VALUE)`, an element with JSON that
    scripts can read.
    """
    sources: list[str] = []

    def element(source: str) -> Markup:
        sources.append(
            f"'sha256-{base64.b64encode(hashlib.sha256(source.encode()).digest()).decode()}'"
        )
        return Markup(f"<script>{source}</script>")

    def script(*names: str) -> Markup:
        return element("\n".join((TEMPLATES / name).read_text(encoding="utf-8") for name in names))

    def data(identifier: str, value: Any) -> Markup:
        start = Markup('<script type="application/json" id="{}">').format(identifier)
        return start + script_json(value) + Markup("</script>")

    elements = {
        "policy": lambda: Markup(
            f'<meta http-equiv="Content-Security-Policy" content="{_POLICY_MARK}">'
        ),
        # Plotly's own function for this would import the whole package.
        "plotly": lambda: element(
            (get_data("plotly", "package_data/plotly.min.js") or b"").decode()
        ),
        "script": script,
        "data": data,
    }
    text = (
        _environment(tuple(filters.items())).get_template(template).render({**elements, **values})
    )
    # Plotly makes style elements and attributes, and offers a plot as a picture from a data or blob
    # address.
    scripts = " ".join(sources) or "'none'"
    policy = (
        f"default-src 'none'; script-src {scripts}; style-src 'unsafe-inline'; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )
    return text.replace(_POLICY_MARK, policy, 1)


def fragment(template: str, values: Mapping[str, Any], filters: Filters = NO_FILTERS) -> str:
    """Return an SVG or XML document, or a part of an HTML page; all text is escaped."""
    return _environment(tuple(filters.items())).get_template(template).render(values)


def plain_text(template: str, values: Mapping[str, Any], filters: Filters = NO_FILTERS) -> str:
    """Return a document in Markdown, in which nothing is escaped."""
    return (
        _environment(tuple(filters.items()), autoescape=False).get_template(template).render(values)
    )


def sentence(template: str, macro: str, **values: Any) -> str:
    """Return the text of a template macro, with white space collapsed to single blanks."""
    return " ".join(str(getattr(_macros(template), macro)(**values)).split())


@cache
def _macros(template: str) -> Any:
    return _environment((), autoescape=False).get_template(template).module


def png(pixels: NDArray[np.number], *, optimize: bool = True) -> bytes:
    """Encode levels (H, W), (H, W, 3) or (H, W, 4) from 0 to 255 as PNG."""
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels, dtype=np.uint8)).save(
        buffer, "PNG", optimize=optimize
    )
    return buffer.getvalue()


def address(encoded: bytes) -> str:
    """Return an encoded picture, WebP, PNG or SVG, as a data URL."""
    kind = "svg+xml"
    if encoded.startswith((b"RIFF", b"\x89PNG")):
        kind = "webp" if encoded.startswith(b"RIFF") else "png"
    return f"data:image/{kind};base64,{base64.b64encode(encoded).decode()}"


def script_json(value: Any) -> Markup:
    """Return JSON for a script element: no string in it can close the element or end a line."""
    text = json.dumps(json_ready(value), allow_nan=False, separators=(",", ":"))
    for letter in "<>&":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    # U+2028 and U+2029 are already escaped, like all other non-ASCII characters.
    return Markup(text)


# An environment caches its compiled templates.
@cache
def _environment(
    filters: tuple[tuple[str, Callable[..., Any]], ...], *, autoescape: bool = True
) -> Environment:
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=autoescape,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=not autoescape,
    )
    environment.filters.update(
        {
            "digits": digits,
            "percent": percent,
            "counted": counted,
            "address": address,
            **dict(filters),
        }
    )
    return environment


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
