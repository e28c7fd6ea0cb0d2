"""Rules that neither ruff nor import-linter checks: sizes, ways to end the process, forbidden names."""

from __future__ import annotations

import ast
import re
import runpy
from collections.abc import Iterator
from inspect import cleandoc
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[1]
FOLDERS = ("scenes", "reference", "raster", "compare", "reports")
SOURCES = sorted(path for folder in (*FOLDERS, "src") for path in (CHECKOUT / folder).rglob("*.py"))
TESTS = sorted((CHECKOUT / "tests").rglob("*.py"))
COMMAND_LINE = re.compile(r"src/xfrustum/(cli/.*|__main__)\.py|reports/exchange/blender/render\.py")
LONGEST_MODULE = 700
"""Largest number of lines: an idea is a module of 150 to 600 lines, so that it is read in one sitting."""

OF_ONE_MACHINE = re.compile(r"(?<![\w.~/-])/(home|root|tmp|work|Users|mnt)/")


def name(path: Path) -> str:
    return path.relative_to(CHECKOUT).as_posix()


def test_modules_are_read_in_one_sitting() -> None:
    assert [
        name(path) for path in (*SOURCES, *TESTS) if len(path.read_text().splitlines()) > LONGEST_MODULE
    ] == []


def test_only_the_command_line_ends_the_process() -> None:
    def names(path: Path) -> set[str]:
        nodes = list(ast.walk(ast.parse(path.read_text())))
        attributes = {node.attr for node in nodes if isinstance(node, ast.Attribute)}
        return attributes | {node.id for node in nodes if isinstance(node, ast.Name)}

    sources = [path for path in SOURCES if not COMMAND_LINE.match(name(path))]
    assert [name(path) for path in sources if names(path) & {"exit", "_exit", "quit", "SystemExit"}] == []


def test_nothing_names_a_place_on_one_machine() -> None:
    written = [
        path
        for pattern in ("*.md", "*.toml", "Makefile", "docs/**/*.md", "scripts/*", "tests/**/*.py", ".ci/*")
        for path in CHECKOUT.glob(pattern)
        if path.is_file()
    ]
    assert len(written) > len(FOLDERS)
    assert [name(path) for path in (*SOURCES, *written) if OF_ONE_MACHINE.search(path.read_text())] == []


def test_the_lock_file_names_no_registry_and_hashes_everything() -> None:
    entries = re.split(r"\n(?=\w)", (CHECKOUT / "requirements.lock").read_text())
    assert len(entries) > len(FOLDERS)
    assert not [entry for entry in entries if "://" in entry or "--hash=sha256:" not in entry]


# Prose: no docstring and no description begins with a fragment whose subject the reader has to guess.

DESCRIBED = ("src/xfrustum", "scenes", "reference", "raster", "compare", "reports", "scripts", "tests")

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
    for node in ast.walk(ast.parse(source)):
        # A string that stands alone as a statement documents the name assigned above.
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            text = cleandoc(str(node.value.value))
            for opening in (text, *DESCRIPTION.findall(text)):
                if FRAGMENT.match(opening):
                    yield f"{node.lineno}: {opening.splitlines()[0]}"


@pytest.mark.parametrize("folder", DESCRIBED)
def test_every_docstring_and_description_begins_with_its_subject(folder: str) -> None:
    files = list((CHECKOUT / folder).rglob("*.py"))
    assert files
    assert [f"{path}:{one}" for path in files for one in fragments(path.read_text("utf-8"))] == []


def test_fragments_are_found_in_every_place_that_describes_something() -> None:
    found = ["2: Who reads this module stumbles.", "5: Of the hogels, so many.", "9: Of the scene."]
    assert sorted(fragments(EXAMPLE)) == found


# The figures of docs/method.md are those that their program draws.

PROGRAM = runpy.run_path(str(CHECKOUT / "scripts" / "draw_method_figures.py"))


@pytest.mark.parametrize("name", sorted(PROGRAM["FIGURES"]))
def test_a_figure_is_what_its_program_draws_and_the_page_shows_it(name: str) -> None:
    drawn = PROGRAM["FIGURES"][name]().document()
    assert (CHECKOUT / "docs" / "images" / name).read_text() == drawn
    assert f"images/{name}" in (CHECKOUT / "docs" / "method.md").read_text()
