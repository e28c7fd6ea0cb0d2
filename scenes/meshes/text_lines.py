"""Lines of a mesh text, split into keywords and numbers by whole arrays; errors name the line."""

from __future__ import annotations

import codecs
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.arrays import Indices, Mask
from xfrustum.scenes.errors import InputError

_SPACE = ord(" ")  #: bytes up to this one are white space
#: Tab, vertical tab and form feed are blanks; other control bytes become DEL, which no number has.
_BLANKS = {ord(blank): _SPACE for blank in "\t\v\f"} | {0: 0, ord("\n"): ord("\n")}
_CONTROL_TO_BLANK = bytes([*(_BLANKS.get(byte, 127) for byte in range(32)), *range(32, 256)])
_CONTINUED = (
    b" \v"  #: written over a backslash and the line end that it continues, so that lines count
)


def plain_text(data: bytes) -> bytes:
    """Return a text in ASCII or UTF-8 with line feeds alone, whatever its encoding and line ends are."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        data = data.decode("utf-16", "replace").encode()
    data = data.removeprefix(codecs.BOM_UTF8).replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return data.translate(_CONTROL_TO_BLANK)


def join_continued(data: bytes) -> bytes:
    """Join lines of a plain text that end with a backslash to the next line, comments excepted."""
    if b"\\\n" not in data:
        return data
    return re.sub(rb"#[^\n]*|\\\n", _joined, data)


def _joined(found: re.Match[bytes]) -> bytes:
    return _CONTINUED if found[0] == b"\\\n" else found[0]


class TextLines:
    """Lines of a plain text that are not blank, in order, without comments from `#` on."""

    def __init__(self, path: Path, data: bytes, start: int = 0) -> None:
        if b"\0" in data:
            raise InputError(
                f"{path}: has zero bytes, as no text has; save it as UTF-8, or repair it"
            )
        self.path = path
        self._data = data if data.endswith(b"\n") else data + b"\n"
        self._bytes = np.frombuffer(self._data, np.uint8)
        ends = start + np.flatnonzero(self._bytes[start:] == ord("\n"))
        starts = np.concatenate([[start], ends + 1])[:-1]
        if b"#" in data:
            ends = _first_from(np.flatnonzero(self._bytes == ord("#")), starts, ends)
        if (self._bytes[starts] <= _SPACE)[starts < ends].any():  # indented
            starts = _first_from(np.flatnonzero(self._bytes > _SPACE), starts, ends)
        self._starts, self._ends = starts[starts < ends], ends[starts < ends]

    def __len__(self) -> int:
        return len(self._starts)

    def keywords(self, size: int) -> NDArray[np.bytes_]:
        """Return the first word of each line in lower case, cut after some bytes."""
        places = np.minimum(self._starts[:, None] + np.arange(size), len(self._bytes) - 1)
        words = self._bytes[places]
        for place in range(size):
            ended = words[:, place] <= _SPACE
            words[ended, place:] = 0
        words[(words >= ord("A")) & (words <= ord("Z"))] += ord("a") - ord("A")
        return np.ascontiguousarray(words).view(f"S{size}")[:, 0]

    def number(self, line: int) -> int:
        """Return the line number of a line in the file, from 1."""
        before = self._data[: self._starts[line]]
        return before.count(b"\n") + before.count(b"\v") + 1

    def text(self, line: int, *, comment: bool = False) -> str:
        """Return a line from its keyword on; with what seems to be a comment, where names may hold `#`."""
        start, end = int(self._starts[line]), int(self._ends[line])
        end = self._data.index(b"\n", start) if comment else end
        return self._data[start:end].decode("utf-8", "replace").strip(" ")

    def error(self, line: int, reason: str) -> InputError:
        """Return the error of a line, to be raised."""
        return InputError(f"{self.path}, line {self.number(line)}: {reason}")

    def numbers(
        self, lines: Mask | slice, kind: type[np.generic] = np.float64, *, skip: int = 0
    ) -> tuple[NDArray[Any], Indices]:
        """Return the numbers of some lines in a row, and how many each has.

        The first `skip` bytes of a line, its keyword, are left out. Raises InputError at what is no
        number.
        """
        text, line_ends = self.bytes_of(lines, skip=skip)
        starts = word_starts(text)

        def refused(word: int) -> InputError:
            line = int(np.arange(len(self))[lines][np.searchsorted(line_ends, starts[word])])
            return self.error(
                line, f"'{self.text(line)[:60]}' has a word that is no number; mend the line"
            )

        counts = np.diff(np.searchsorted(starts, line_ends), prepend=0)
        return parse(text, kind, len(starts), refused), counts

    def bytes_of(self, lines: Mask | slice, *, skip: int = 0) -> tuple[NDArray[np.uint8], Indices]:
        """Return the bytes of some lines, and the places (L,) of the line feeds that end them."""
        starts, ends = self._starts[lines], self._ends[lines] + 1
        breaks = np.flatnonzero(starts[1:] != ends[:-1])
        blocks = (
            zip(starts[[0, *(breaks + 1)]].tolist(), ends[[*breaks, -1]].tolist(), strict=True)
            if len(starts)
            else ()
        )
        text = np.concatenate([self._bytes[:0], *(self._bytes[start:end] for start, end in blocks)])
        after = np.cumsum(ends - starts)
        text[after - 1] = ord("\n")  # also where a comment begins
        for place in range(skip):
            text[after - (ends - starts) + place] = _SPACE
        return text, after - 1


def parse(
    text: NDArray[np.uint8],
    kind: type[np.generic],
    count: int,
    refused: Callable[[int], InputError],
) -> NDArray[Any]:
    """Return the numbers of a text of some words; raise the error of the first word that is no number."""
    data = text.tobytes()
    if count == 0:
        return np.zeros(0, kind)
    with suppress(ValueError):
        found = np.fromstring(data, kind, sep=" ")
        if len(found) == count:
            return found
    for word, token in enumerate(data.split()):
        try:
            whole = len(np.fromstring(token, kind, sep=" ")) == 1
        except ValueError:
            whole = False
        if not whole:
            raise refused(word)
    raise refused(0)


def word_starts(text: NDArray[np.uint8]) -> Indices:
    """Return the places where words of a text begin."""
    inked = text > _SPACE
    first = [0] if len(text) and inked[0] else []
    return np.concatenate([first, np.flatnonzero(inked[1:] > inked[:-1]) + 1]).astype(np.int64)


def _first_from(places: Indices, starts: Indices, ends: Indices) -> Indices:
    """Return the first of ordered places from each start on, or the end where none comes before it."""
    found = np.concatenate([places, [np.iinfo(np.int64).max]])[np.searchsorted(places, starts)]
    return np.asarray(np.minimum(found, ends))
