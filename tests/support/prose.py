"""Everything that Python files say in English, and which of it begins like a riddle.

`python -m tests.support.prose compare/prediction tests` lists candidates for a reader to judge, with more
openings than a test can be strict about, and the names of constants that hold one word.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from inspect import cleandoc
from pathlib import Path

RIDDLE_OPENING = re.compile(r"(Of|Whose|Who|(By|In|To) which)\b")
"""Openings of a fragment: its subject stands somewhere else, or nowhere."""

SUSPECT_OPENING = re.compile(
    r"(Of|Whose|Who|Which|Those|That|Such|So|There|As|But|And|Also|Else|What|How"
    r"|(By|In|To|From|With|For|On|At) (which|what|that|whose))\b"
)
"""Openings that a reader of the listing has to judge: most of them point at something outside the text."""

SENTENCE_WORDS = 3
"""Texts of fewer words are listed: a noun may suffice for a parameter, but seldom says what it holds."""

DESCRIBING_SECTIONS = ("Attributes", "Parameters", "Other Parameters", "Returns", "Yields", "Raises")
"""Sections of numpydoc that give every name a description of its own."""

CONSTANT_NAME = re.compile(r"_?[A-Z][A-Z0-9_]*")


class Kind(StrEnum):
    """The places in a Python file that hold English."""

    DOCSTRING = "docstring"
    DESCRIPTION = "description"
    COMMENT = "comment"
    CONSTANT = "constant"


@dataclass(frozen=True, kw_only=True)
class Text:
    """One piece of English, or the name of a constant.

    Attributes
    ----------
    path
        File that holds the text.
    line
        Line where the text begins, or, for a description, where its docstring begins; from 1.
    kind
        Place of the text in the file.
    words
        The text itself without quotes, indentation and comment signs.
    """

    path: Path
    line: int
    kind: Kind
    words: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.kind}: {' '.join(self.words.split())}"


def python_files(folders: Iterable[Path]) -> Iterator[Path]:
    """Yield all Python files below some folders, sorted."""
    for folder in folders:
        yield from sorted(folder.rglob("*.py"))


def texts(path: Path) -> Iterator[Text]:
    """Yield the docstrings, descriptions, comments and names of constants in a file."""
    source = path.read_text(encoding="utf-8")
    module = ast.parse(source)
    yield from _described(path, module)
    yield from _constants(path, module)
    yield from _comments(path, source)


def riddles(path: Path) -> list[Text]:
    """Return the docstrings and descriptions in a file that begin like a riddle, as "Of the scene." does."""
    module = ast.parse(path.read_text(encoding="utf-8"))
    return [text for text in _described(path, module) if RIDDLE_OPENING.match(text.words)]


def candidates(path: Path) -> list[Text]:
    """Return the texts in a file that a reader should judge: suspect openings, and texts of a word or two."""
    return [text for text in texts(path) if _is_candidate(text)]


def _is_candidate(text: Text) -> bool:
    if text.kind is Kind.CONSTANT:
        return "_" not in text.words.strip("_")
    short = len(text.words.split()) < SENTENCE_WORDS and not text.words.startswith(("noqa", "type:"))
    return short or SUSPECT_OPENING.match(text.words) is not None


def _described(path: Path, module: ast.Module) -> Iterator[Text]:
    """Yield the docstrings and descriptions in a module.

    A string that stands alone as a statement counts as a docstring: it documents the name assigned above.
    """
    for node in ast.walk(module):
        match node:
            case ast.Expr(value=ast.Constant(value=str(docstring))):
                yield from _docstring_texts(path, node.lineno, cleandoc(docstring))


def _docstring_texts(path: Path, line: int, docstring: str) -> Iterator[Text]:
    """Yield a docstring's prose up to its first section, and each description of its sections.

    Descriptions are indented below a name; a result without a name is described by paragraphs of its own.
    """
    parts = re.split(r"^(\w[\w ]*)\n-{3,}$", docstring, flags=re.MULTILINE)
    yield Text(path=path, line=line, kind=Kind.DOCSTRING, words=parts[0].strip())
    for title, body in zip(parts[1::2], parts[2::2], strict=True):
        if title not in DESCRIBING_SECTIONS:
            continue
        indented = re.findall(r"(?:^[ \t]+\S.*\n?(?:^[ \t]*\n(?=[ \t]))*)+", body, flags=re.MULTILINE)
        for description in indented or re.split(r"\n\s*\n", body.strip()):
            yield Text(path=path, line=line, kind=Kind.DESCRIPTION, words=cleandoc(description))


def _constants(path: Path, module: ast.Module) -> Iterator[Text]:
    for node in module.body:
        if isinstance(node, ast.Assign):
            targets = node.targets
        elif isinstance(node, ast.AnnAssign):
            targets = [node.target]
        else:
            continue
        for name in (part for target in targets for part in ast.walk(target)):
            if isinstance(name, ast.Name) and CONSTANT_NAME.fullmatch(name.id):
                yield Text(path=path, line=name.lineno, kind=Kind.CONSTANT, words=name.id)


def _comments(path: Path, source: str) -> Iterator[Text]:
    """Yield comments; lines that follow each other without code between them are one comment."""
    block: list[str] = []
    first = last = 0
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type != tokenize.COMMENT:
            continue
        alone = not token.line[: token.start[1]].strip()
        words = token.string.lstrip("#! ").rstrip()
        if block and alone and token.start[0] == last + 1:
            block.append(words)
        else:
            if block:
                yield Text(path=path, line=first, kind=Kind.COMMENT, words="\n".join(block))
            block, first = [words], token.start[0]
        last = token.start[0]
    if block:
        yield Text(path=path, line=first, kind=Kind.COMMENT, words="\n".join(block))


def main(folders: list[str]) -> None:
    """Print the candidates below some folders, one on each line."""
    for path in python_files(map(Path, folders)):
        for text in candidates(path):
            sys.stdout.write(f"{text}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
