"""Check the words of source files: `python -m tests.documents.words [PATH ..]`.

Without a path, the rooms of `CLEAN` are checked, as in `make test`. Prints one line for each
violation and exits with status 1 if there is any.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]
COLUMNS = 100

#: Rooms and modules whose words are checked in `make test`. To extend it to all: `CLEAN = ALL`.
ALL = ("scenes", "reference", "raster", "compare", "reports", "research", "src", "scripts", "tests")
CLEAN: tuple[str, ...] = (
    "scripts/freeze_conformance_suite.py",
    "reference",
    "raster",
    "research",
    "compare",
    "reports",
    "scenes",
    "src",
    "tests",
)

#: Words that begin no sentence
BEGINNING = re.compile(r"(?:What|That|Those|Who|Whoever|Whether|Of)\b")
#: Phrases forbidden in docstrings and comments, each with advice
PHRASES = [
    (re.compile(pattern, re.IGNORECASE), advice)
    for pattern, advice in (
        (r"\b(?:asks?|asked|asking)\b", "programs query, request or call"),
        (r"\b(?:tells?|told|telling)\b", "programs return, print or report"),
        (r"\b(?:says?|said|saying)\b", "programs state, print or name"),
        (r"\b(?:knows?|knew|knowing)\b", "programs store or have"),
        (r"\b(?:wants?|wanted|wanting)\b", "programs need or request"),
        (r"\b(?:nobody|somebody|whoever|anybody)\b", "name the role: user, renderer, caller"),
        (r"\b(?:that|those|the one|the ones) of\b", "repeat the noun"),
        (r"\b(?:the ones?|that) (?:that|which|who)\b", "repeat the noun"),
        (r"\bof what\b|\bwhat (?:is|are|was|has|have|it|they|a|an|the|no|one)\b", "name the thing"),
        (r"\bso many\b|\bas it is\b|\bas they are\b", "name the number or state"),
    )
]  # fmt: skip
#: Forbidden names of variables, parameters, functions and attributes
NAMES = frozenset(
    ("found", "asked", "told", "said", "wanted", "beside", "given", "one", "hopeless", "companions")
)

Violation = tuple[int, str]


def violations(source: str) -> Iterator[Violation]:
    """Yield the line and the description of each violation in a module."""
    for number, line in enumerate(source.splitlines(), 1):
        if len(line) > COLUMNS:
            yield number, f"{len(line)} columns, at most {COLUMNS}"
    texts, names = docstrings_and_names(ast.parse(source))
    for number, text in (*texts, *comments(source)):
        yield from ((number, problem) for problem in problems(text))
    yield from ((n, f"the name {name!r}: use the noun") for n, name in names if name in NAMES)


def problems(text: str) -> Iterator[str]:
    """Yield the descriptions of the forbidden words of one docstring or comment."""
    words = re.sub(r"`[^`]*`|\"[^\"]*\"", "``", text)  # quoted code and messages are exempt
    for sentence in re.split(r"(?<=[.:;?!])\s+|\n\s*\n|\n\s*-+\n", words):
        if BEGINNING.match(sentence.strip()):
            yield f"a sentence begins with {sentence.split()[0]!r}: {sentence.strip()[:60]!r}"
    flat = " ".join(words.split())
    for pattern, advice in PHRASES:
        if match := pattern.search(flat):
            yield f"{match[0]!r} ({advice}): {flat[max(0, match.start() - 25) :][:60]!r}"


def docstrings_and_names(tree: ast.Module) -> tuple[list[tuple[int, str]], list[tuple[int, str]]]:
    """Return docstrings, strings below attributes, and assigned names, with their lines."""
    texts, names = [], []
    for node in ast.walk(tree):
        match node:
            case ast.Expr(value=ast.Constant(value=str(text))):
                texts.append((node.lineno, text))
            case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name):
                names.append((node.lineno, name))
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                names.append((node.lineno, name))
    return texts, names


def comments(source: str) -> Iterator[tuple[int, str]]:
    """Yield line and text of each comment; comments on consecutive lines are joined."""
    start, last, text = 0, -1, ""
    for row, line in enumerate(source.splitlines(), 1):
        # Two blanks separate a comment from code, and hardly ever precede # in a string.
        place = 0 if line.lstrip().startswith("#") else line.rfind("  # ") + line.rfind("  #:") + 1
        words = line[place:].lstrip("#: ")
        if place < 0 or not words or re.match(r"(?:noqa|fmt:|type:|!)", words):
            continue
        if row == last + 1 and place == 0:
            last, text = row, f"{text} {words}"
            continue
        if text:
            yield start, text
        start, last, text = row, row, words
    if text:
        yield start, text


def modules(paths: tuple[str, ...]) -> Iterator[Path]:
    """Yield the Python files at or below some paths, relative to the checkout."""
    for path in paths:
        place = CHECKOUT / path
        yield from [place] if place.suffix == ".py" else sorted(place.rglob("*.py"))


def report(paths: tuple[str, ...]) -> list[str]:
    """Return one line for each violation in the modules at or below some paths."""
    return [
        f"{module.relative_to(CHECKOUT)}:{line}: {problem}"
        for module in modules(paths)
        for line, problem in sorted(violations(module.read_text(encoding="utf-8")))
    ]


if __name__ == "__main__":
    lines = report(tuple(sys.argv[1:]) or CLEAN)
    sys.stdout.write("".join(f"{line}\n" for line in lines))
    sys.exit(bool(lines))
