"""The one place where templates are filled in: HTML pages, SVG and Markdown.

Every HTML page carries a Content-Security-Policy: the browser runs our own scripts, which it knows by their
hashes, and nothing else, whatever text of a scene has found its way into the page; and it loads nothing.
"""

import base64
import hashlib
import json
import pkgutil
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from xfrustum.reports.common.json_ready import json_ready

Filters = Mapping[str, Callable[..., Any]]

TEMPLATES = Path(__file__).parents[1] / "templates"

_POLICY_MARK = "@@content-security-policy@@"
"""Stands in a page for its policy until all scripts of the page are known. The first one is replaced: the
template has it before any text from outside."""


def html_page(template: str, filters: Filters, values: Mapping[str, Any], nonce: str | None = None) -> str:
    """Return a page that needs nothing else, online or offline; all text of the values is escaped.

    Beside the values, templates can use `policy()`, to be put first in the head; `plotly()`, the element with
    plotly.js; `script(NAME, ..)`, an element with scripts out of the folder of templates, one after the
    other; and `data(ID, VALUE)`, an element with JSON that scripts can read.

    `nonce` is a word in base64 by which the browser knows files of scripts beside the page, which our scripts
    load; nobody whose text is on the page can guess it. None where there are no such files.
    """
    sources: list[str] = []

    def element(source: str) -> Markup:
        sources.append(f"'sha256-{base64.b64encode(hashlib.sha256(source.encode()).digest()).decode()}'")
        return Markup(f"<script>{source}</script>")

    def script(*names: str) -> Markup:
        return element("\n".join((TEMPLATES / name).read_text(encoding="utf-8") for name in names))

    def data(identifier: str, value: Any) -> Markup:
        start = Markup('<script type="application/json" id="{}">').format(identifier)
        return start + script_json(value) + Markup("</script>")

    elements = {
        "policy": lambda: Markup(f'<meta http-equiv="Content-Security-Policy" content="{_POLICY_MARK}">'),
        "plotly": lambda: element(_plotly_js()),
        "script": script,
        "data": data,
    }
    text = _template(template, filters).render({**elements, **values})
    if nonce is not None:
        sources.append(f"'nonce-{nonce}'")
    # Plotly makes style elements and attributes, and offers a plot as a picture from a data or blob address.
    scripts = " ".join(sources) or "'none'"
    policy = (
        f"default-src 'none'; script-src {scripts}; style-src 'unsafe-inline'; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )
    return text.replace(_POLICY_MARK, policy, 1)


def svg_picture(template: str, filters: Filters, values: Mapping[str, Any]) -> str:
    """Return an SVG document; all text is escaped."""
    return _template(template, filters).render(values)


def plain_text(template: str, filters: Filters, values: Mapping[str, Any]) -> str:
    """Return a document in Markdown, in which nothing is escaped."""
    return _template(template, filters, autoescape=False).render(values)


def _plotly_js() -> str:
    """Return plotly.js; the package's own function for it imports all of plotly."""
    return (pkgutil.get_data("plotly", "package_data/plotly.min.js") or b"").decode()


def script_json(value: Any) -> Markup:
    """Return JSON for a script element: no string in it can close the element or end a line of a script."""
    text = json.dumps(json_ready(value), allow_nan=False, separators=(",", ":"))
    for letter in "<>&":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    # U+2028 and U+2029 are escaped already, as all that is not ASCII.
    return Markup(text)


def _template(name: str, filters: Filters, *, autoescape: bool = True) -> Template:
    return _environment(tuple(filters.items()), autoescape).get_template(name)


@cache  # an environment remembers the templates that it has compiled
def _environment(filters: tuple[tuple[str, Callable[..., Any]], ...], autoescape: bool) -> Environment:
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=autoescape,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=not autoescape,
    )
    environment.filters.update(filters)
    return environment
