"""Rules that neither ruff nor import-linter checks: sizes, ways to end the process, forbidden names."""

from __future__ import annotations

import ast
import re
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]
FOLDERS = ("scenes", "reference", "raster", "compare", "reports", "research")
SOURCES = sorted(path for folder in (*FOLDERS, "src") for path in (CHECKOUT / folder).rglob("*.py"))
TESTS = sorted((CHECKOUT / "tests").rglob("*.py"))
COMMAND_LINE = re.compile(r"src/xfrustum/(cli/.*|__main__)\.py|reports/exchange/blender/render\.py")
OF_ONE_MACHINE = re.compile(r"(?<![\w.~/-])/(home|root|tmp|work|Users|mnt)/")


def name(path: Path) -> str:
    return path.relative_to(CHECKOUT).as_posix()


def test_only_the_command_line_ends_the_process() -> None:
    ends = {"exit", "_exit", "quit", "SystemExit"}

    def names(text: str) -> set[str]:
        nodes = list(ast.walk(ast.parse(text)))
        attributes = {node.attr for node in nodes if isinstance(node, ast.Attribute)}
        return attributes | {node.id for node in nodes if isinstance(node, ast.Name)}

    sources = [path for path in SOURCES if not COMMAND_LINE.match(name(path))]
    texts = {name(path): path.read_text() for path in sources}
    suspects = {path: text for path, text in texts.items() if any(word in text for word in ends)}
    assert suspects and [path for path, text in suspects.items() if names(text) & ends] == []


def test_nothing_names_a_place_on_one_machine() -> None:
    written = [
        path
        for pattern in (
            "*.md",
            "*.toml",
            "Makefile",
            "docs/**/*.md",
            "scripts/*",
            "tests/**/*.py",
            ".ci/*",
        )
        for path in CHECKOUT.glob(pattern)
        if path.is_file()
    ]
    assert len(written) > len(FOLDERS)
    assert [
        name(path) for path in (*SOURCES, *written) if OF_ONE_MACHINE.search(path.read_text())
    ] == []


def test_the_lock_file_names_no_registry_and_hashes_everything() -> None:
    entries = re.split(r"\n(?=\w)", (CHECKOUT / "requirements.lock").read_text())
    assert len(entries) > len(FOLDERS)
    assert not [entry for entry in entries if "://" in entry or "--hash=sha256:" not in entry]
