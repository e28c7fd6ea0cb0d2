"""Rules beyond ruff and import-linter: sizes, calls that end the process, forbidden names."""

from __future__ import annotations

import ast
import re
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]
STAGES = ("scenes", "reference", "raster", "compare")
#: modules of compare, reference and raster that still compose prose; only remove entries
WORDED = {
    "compare/diagnosis/defects.py",
    "compare/judging/verdict.py",
    "compare/renderer_model/conventions.py",
    "raster/description.py",
    "raster/device/context.py",
    "reference/llvm.py",
}
FOLDERS = ("scenes", "reference", "raster", "compare", "reports", "research")
SOURCES = sorted(path for folder in (*FOLDERS, "src") for path in (CHECKOUT / folder).rglob("*.py"))
COMMAND_LINE = re.compile(r"src/xfrustum/(cli/.*|__main__)\.py|reports/exchange/blender\.py")
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
    patterns = ("*.md", "*.toml", "Makefile", "docs/**/*.md", "scripts/*", "tests/**/*.py", ".ci/*")
    written = [path for pattern in patterns for path in CHECKOUT.glob(pattern) if path.is_file()]
    assert len(written) > len(FOLDERS)
    assert [
        name(path) for path in (*SOURCES, *written) if OF_ONE_MACHINE.search(path.read_text())
    ] == []


def test_the_lock_file_names_no_registry_and_hashes_everything() -> None:
    entries = re.split(r"\n(?=\w)", (CHECKOUT / "requirements.lock").read_text())
    assert len(entries) > len(FOLDERS)
    assert not [entry for entry in entries if "://" in entry or "--hash=sha256:" not in entry]


def literals(path: Path) -> list[str]:
    """Return the strings of a module, except for docstrings and error messages."""
    excluded: set[int] = set()
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise | ast.Assert):
            excluded.update(map(id, ast.walk(node)))
        # A string as a statement documents the name above it.
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            excluded.add(id(node.value))
    constants = (node for node in ast.walk(tree) if isinstance(node, ast.Constant))
    return [
        node.value for node in constants if isinstance(node.value, str) and id(node) not in excluded
    ]


def test_stages_before_reports_make_no_html() -> None:
    sources = [path for path in SOURCES if name(path).split("/")[0] in STAGES]
    assert len(sources) > len(STAGES)
    markup = re.compile(r"</?(div|p|b|pre|img|table|svg|html|span)\b[^|]*>")
    suspects = [path for path in sources if markup.search(path.read_text())]
    assert [name(p) for p in suspects if any(map(markup.search, literals(p)))] == []
    imports = re.compile(r"^\s*(?:from|import) (?:html|jinja2|markupsafe|plotly)\b", re.MULTILINE)
    assert [name(path) for path in sources if imports.search(path.read_text())] == []


def test_stages_before_reports_build_no_sentences() -> None:
    """`reports` composes sentences from records; earlier stages compose only error messages."""
    sentence = re.compile(r"\w+ \w+ \w+ \w+ \w+")
    violations = [
        f"{name(path)}: {text!r}"
        for path in SOURCES
        if name(path).split("/")[0] in STAGES[1:] and name(path) not in WORDED
        for text in literals(path)
        if sentence.search(text)
    ]
    assert violations == []
