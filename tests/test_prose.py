"""Prose: no docstring and no description begins with a fragment whose subject the reader has to guess."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from inspect import cleandoc
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parent.parent
ROOMS = ("scenes", "reference", "raster", "compare", "reports", "research")
FOLDERS = ("src/xfrustum", *ROOMS, "scripts", "tests")

FRAGMENT = re.compile(r"(Of|Whose|Who|(By|In|To) which)\b")
"""Openings of a fragment: its subject stands somewhere else, or nowhere."""

DESCRIPTION = re.compile(r"(?:^|\n)(?:\S[^\n]*\n)+[ \t]+(\S[^\n]*)")
"""First line of a description of numpydoc: indented, below a name."""

EXAMPLE = '''
"""Who reads this module stumbles."""

LIMIT = 3
"""Of the hogels, so many."""


def example(scene):
    """Return the result.

    Parameters
    ----------
    scene
        Of the scene.
    """
'''


def fragments(source: str) -> Iterator[str]:
    """Yield the docstrings of a module, and of names in it, that begin so, and descriptions in them."""
    for node in ast.walk(ast.parse(source)) if FRAGMENT.search(source) else ():
        # A string that stands alone as a statement documents the name assigned above.
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            text = cleandoc(str(node.value.value))
            for opening in (text, *DESCRIPTION.findall(text)):
                if FRAGMENT.match(opening):
                    yield f"{node.lineno}: {opening.splitlines()[0]}"


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_docstring_and_description_begins_with_its_subject(folder: str) -> None:
    files = list((CHECKOUT / folder).rglob("*.py"))
    assert files
    assert [f"{path}:{one}" for path in files for one in fragments(path.read_text("utf-8"))] == []


def test_fragments_are_found_in_every_place_that_describes_something() -> None:
    found = ["2: Who reads this module stumbles.", "5: Of the hogels, so many.", "9: Of the scene."]
    assert sorted(fragments(EXAMPLE)) == found
