"""Rules that neither ruff nor import-linter checks: sizes, ways to end the process, forbidden names."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[1]
FOLDERS = ("scenes", "reference", "raster", "compare", "reports")
SOURCES = sorted(path for folder in (*FOLDERS, "src") for path in (CHECKOUT / folder).rglob("*.py"))
TESTS = sorted((CHECKOUT / "tests").rglob("*.py"))
COMMAND_LINE = re.compile(r"src/xfrustum/(cli/.*|__main__)\.py|reports/exchange/blender/render\.py")
LONGEST_MODULE = 500
LARGEST_ROOM = 14
"""Largest number of modules in a folder, so that a listing shows them at a glance."""
LONGEST_FUNCTION = 60
"""Largest numbers of lines: a module is read in one sitting, a function on one screen."""

OF_ONE_MACHINE = re.compile(r"(?<![\w.~/-])/(home|root|tmp|work|Users|mnt)/")


def name(path: Path) -> str:
    return path.relative_to(CHECKOUT).as_posix()


def functions(tree: ast.Module) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    return (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))


def own_lines(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Count the lines of a function without those of classes that it defines: their methods count apart."""
    inner = sum((c.end_lineno or 0) - c.lineno for c in function.body if isinstance(c, ast.ClassDef))
    return (function.end_lineno or 0) - function.lineno - inner


@pytest.mark.parametrize("path", [*SOURCES, *TESTS], ids=name)
def test_modules_stay_small(path: Path) -> None:
    assert len(path.read_text().splitlines()) <= LONGEST_MODULE


@pytest.mark.parametrize("path", SOURCES, ids=name)
def test_functions_stay_small(path: Path) -> None:
    text = path.read_text()
    long = {f.name for f in functions(ast.parse(text)) if own_lines(f) >= LONGEST_FUNCTION}
    assert not long


ROOMS = sorted({path.parent for path in (*SOURCES, *TESTS)})


@pytest.mark.parametrize("room", ROOMS, ids=name)
def test_rooms_stay_small(room: Path) -> None:
    assert len(list(room.glob("*.py"))) <= LARGEST_ROOM


@pytest.mark.parametrize("room", [room for room in ROOMS if "tests" not in room.parts], ids=name)
def test_the_docstring_of_a_package_is_its_table_of_contents(room: Path) -> None:
    told = ast.get_docstring(ast.parse((room / "__init__.py").read_text())) or ""
    _, table, *_ = told.split("\n\n")
    listed = [line.split()[0] for line in table.splitlines() if not line.startswith(" ")]
    there = [path.stem for path in room.glob("*.py") if path.stem not in {"__init__", "__main__"}]
    there += [f"{folder.name}/" for folder in room.iterdir() if (folder / "__init__.py").exists()]
    if room != CHECKOUT / "src" / "xfrustum":
        assert sorted(listed) == sorted(there)


@pytest.mark.parametrize("path", [p for p in SOURCES if not COMMAND_LINE.match(name(p))], ids=name)
def test_only_the_command_line_ends_the_process(path: Path) -> None:
    mentioned = {
        node.attr if isinstance(node, ast.Attribute) else node.id
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute | ast.Name)
    }
    assert not mentioned & {"exit", "_exit", "quit", "SystemExit"}


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
