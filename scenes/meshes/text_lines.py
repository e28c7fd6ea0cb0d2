"""Lines of a mesh text, parsed into keywords and numbers by NumPy; errors name the line."""

from __future__ import annotations

import codecs
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Indices, Mask

_SPACE = ord(" ")  #: bytes up to this value are white space
_LINE_FEED = ord("\n")
#: Tab, vertical tab and form feed become blanks. Other control bytes become DEL, which is not part
#: of a number, so that the word is refused.
_BLANKS = {ord(blank): _SPACE for blank in "\t\v\f"} | {0: 0, _LINE_FEED: _LINE_FEED}
_CONTROL_TO_BLANK = bytes([*(_BLANKS.get(byte, 127) for byte in range(32)), *range(32, 256)])
#: Replacement of a backslash and the line feed after it, of the same length; `number` counts its
#: vertical tab as the end of a line.
_CONTINUED = b" \v"


def plain_text(data: bytes) -> bytes:
    """Return a text in ASCII or UTF-8 whose lines end with line feeds, from any encoding."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        data = data.decode("utf-16", "replace").encode()
    data = data.removeprefix(codecs.BOM_UTF8).replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return data.translate(_CONTROL_TO_BLANK)


def join_continued(data: bytes) -> bytes:
    """Join lines that end with a backslash to the next line, except in comments."""
    if b"\\\n" not in data:
        return data
    return re.sub(
        rb"#[^\n]*|\\\n",
        lambda match: _CONTINUED if match[0] == b"\\\n" else match[0],
        data,
    )


def starts_of(counts: Indices) -> Indices:
    """Return the start index of each group, for consecutive groups of these sizes."""
    return np.asarray(np.cumsum(counts) - counts)


def ranges(starts: Indices, counts: Indices) -> Indices:
    """Return the concatenated indices of ranges with these starts and sizes."""
    within = np.arange(int(counts.sum())) - np.repeat(starts_of(counts), counts)
    return np.asarray(np.repeat(starts, counts) + within)


class TextLines:
    """Lines of a plain text that are not blank, in order, without comments from `#` on."""

    def __init__(self, path: Path, data: bytes, start: int = 0) -> None:
        if b"\0" in data:
            raise InputError(
                f"{path}: has zero bytes, which text does not have; save it as UTF-8, or repair it"
            )
        self.path = path
        self._data = data if data.endswith(b"\n") else data + b"\n"
        self._bytes = np.frombuffer(self._data, np.uint8)
        ends = start + np.flatnonzero(self._bytes[start:] == _LINE_FEED)
        starts = np.concatenate([[start], ends + 1])[:-1]
        # Searching sorted positions is faster than splitting millions of lines.
        if b"#" in data:
            ends = _first_from(np.flatnonzero(self._bytes == ord("#")), starts, ends)
        if (self._bytes[starts] <= _SPACE)[starts < ends].any():  # indented
            starts = _first_from(np.flatnonzero(self._bytes > _SPACE), starts, ends)
        self._starts, self._ends = starts[starts < ends], ends[starts < ends]

    def __len__(self) -> int:
        return len(self._starts)

    def keywords(self, size: int) -> NDArray[np.bytes_]:
        """Return the first word of each line in lower case, cut to `size` bytes."""
        words = np.zeros((size, len(self)), np.uint8)
        inside = np.ones(len(self), np.bool_)
        for place in range(size):  # byte by byte: indices of all bytes take much memory
            letters = self._bytes[np.minimum(self._starts + place, len(self._bytes) - 1)]
            inside &= letters > _SPACE
            capital = (letters >= ord("A")) & (letters <= ord("Z"))
            words[place] = np.where(inside, letters + capital * np.uint8(32), 0)
        return np.ascontiguousarray(words.T).view(f"S{size}")[:, 0]

    def number(self, line: int) -> int:
        """Return the line number of a line in the file, from 1."""
        before = self._data[: self._starts[line]]
        return before.count(b"\n") + before.count(b"\v") + 1

    def text(self, line: int, *, comment: bool = False) -> str:
        """Return a line from its keyword on; `comment` keeps the part from `#` on, as in names."""
        start, end = int(self._starts[line]), int(self._ends[line])
        end = self._data.index(b"\n", start) if comment else end
        return self._data[start:end].decode("utf-8", "replace").strip(" ")

    def error(self, line: int, reason: str) -> InputError:
        """Return the error of a line, to be raised."""
        return InputError(f"{self.path}, line {self.number(line)}: {reason}")

    def check(
        self, lines: Mask | slice, right: Mask, reason: str, values: NDArray[Any] | None = None
    ) -> None:
        """Raise the error of the first wrong line.

        Braces in the reason are replaced by the line's entry in `values`.
        """
        for place in np.flatnonzero(~right)[:1].tolist():
            line = int(np.arange(len(self))[lines][place])
            raise self.error(line, reason if values is None else reason.format(values[place]))

    def numbers(
        self, lines: Mask | slice, kind: type[np.generic] = np.float64, *, skip: int = 0
    ) -> tuple[NDArray[Any], Indices]:
        """Return the numbers of some lines, line after line, and their count in each line.

        The first `skip` bytes of a line, its keyword, are skipped. Raises InputError for a word
        that is not a number.
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
        """Return the bytes of some lines, and the positions (L,) of their final line feeds."""
        starts, ends = self._starts[lines], self._ends[lines] + 1
        low, high = (starts[0], ends[-1]) if len(starts) else (0, 0)
        bounds = np.zeros(high - low + 1, np.int8)
        bounds[starts - low] = 1
        bounds[ends - low] -= 1  # where a line ends and the next begins, the two cancel
        text = self._bytes[low:high][np.cumsum(bounds[:-1], dtype=np.int8).view(np.bool_)]
        after = np.cumsum(ends - starts)
        text[after - 1] = _LINE_FEED  # also where a comment begins
        for place in range(skip):
            text[after - (ends - starts) + place] = _SPACE
        return text, after - 1


def parse(
    text: NDArray[np.uint8],
    kind: type[np.generic],
    count: int,
    refused: Callable[[int], InputError],
) -> NDArray[Any]:
    """Return the numbers in a text of `count` words; raise the error of the first wrong word."""
    data = text.tobytes()
    if count == 0:
        return np.zeros(0, kind)
    # NumPy stops at the first word that is not a number, and then the count is short.
    with suppress(ValueError):
        numbers = np.fromstring(data, kind, sep=" ")
        if len(numbers) == count:
            return numbers
    for word, token in enumerate(data.split()):
        try:
            whole = len(np.fromstring(token, kind, sep=" ")) == 1
        except ValueError:
            whole = False
        if not whole:
            raise refused(word)
    raise refused(0)


def word_starts(text: NDArray[np.uint8]) -> Indices:
    """Return the positions of the first bytes of words."""
    inked = np.concatenate([[False], text > _SPACE])
    return np.flatnonzero(inked[1:] > inked[:-1])


def _first_from(places: Indices, starts: Indices, ends: Indices) -> Indices:
    """Return the first of sorted positions at or after each start, but at most the end."""
    following = np.append(places, np.iinfo(np.int64).max)[np.searchsorted(places, starts)]
    return np.asarray(np.minimum(following, ends))
