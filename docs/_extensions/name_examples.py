"""Append the examples of docs/api/examples.md to the docstrings of public names.

The page is one program, which a test runs; the page of each name shows its part.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

PAGE = Path(__file__).resolve().parents[1] / "api" / "examples.md"

_SECTION = re.compile(
    r"^## (?P<name>\S+)\n(?P<words>.*?)```pycon\n(?P<code>.*?)```", re.MULTILINE | re.DOTALL
)


def examples() -> dict[str, tuple[str, str]]:
    """Return words and code of each name, as `xfrustum.NAME`."""
    text = PAGE.read_text(encoding="utf-8")
    return {
        f"xfrustum.{found['name']}": (found["words"].strip(), found["code"].rstrip())
        for found in _SECTION.finditer(text)
    }


def _add(
    app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]
) -> None:
    """Append the example of a name to its docstring."""
    del app, what, thing, options
    # Escape |z|, an absolute value, which reStructuredText would read as a substitution.
    lines[:] = [re.sub(r"\|(\w+)\|", r"\\|\1\\|", line) for line in lines]
    found = examples().get(name)
    if found is not None and "Examples" not in lines:
        words, code = found
        note = "The example goes on from those before it on :doc:`/docs/api/examples`."
        lines += [
            "",
            "Examples",
            "--------",
            *([words, ""] if words else []),
            *code.splitlines(),
            "",
            note,
            "",
        ]


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the hook, before numpydoc's hook."""
    app.connect("autodoc-process-docstring", _add, priority=100)
    return {"parallel_read_safe": True}
