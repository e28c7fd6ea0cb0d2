"""Words and numbers of text formats: blanks are those of ASCII, numbers are finite and decimal."""

from __future__ import annotations

from tests.second_reader.model import Refused

LETTERS = "+-.0123456789eE"  #: of a number


def words(line: str) -> list[str]:
    """Split a line at blanks; other control characters stay in their words."""
    return [word.decode("latin-1") for word in line.encode("latin-1").split()]


def number(word: str) -> float:
    """Read a number: no inf, nan or 1_000."""
    try:
        if word.strip(LETTERS):
            raise ValueError
        return float(word)
    except ValueError:
        raise Refused(f"{word} is not a number") from None


def integer(word: str) -> int:
    """Read a whole number."""
    try:
        if word.strip("+-0123456789"):
            raise ValueError
        return int(word)
    except ValueError:
        raise Refused(f"{word} is not a whole number") from None
